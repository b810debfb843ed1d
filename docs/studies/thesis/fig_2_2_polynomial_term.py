"""Fig 2.2: the polynomial term on and off.

The interpolation of thesis (2.1) is used alone here: if every prescribed node moves, the server itself separates a
rigid motion first, so that it reproduces a rigid motion with and without the polynomial.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.assembly import sparse_matrix
from mesh_motion_numerics.interpolation.centres import CentreLayout
from mesh_motion_numerics.interpolation.interpolant import factorize
from mesh_motion_numerics.interpolation.kernels import BASES
from mesh_motion_numerics.mesh.roles import BoundaryRoles
from mesh_motion_numerics.quality.metrics import cell_quality, reference_sizes
from numpy.typing import NDArray

from docs.studies.moved_bodies import StoredMesh, Turn, stored
from docs.studies.study import Outcome, Picture, Study, Table
from docs.studies.thesis._linear_polynomial import WithPolynomial

Floats = NDArray[np.float64]

MESH = "tests/references/thesis_block"
POLYNOMIALS = ("none", "linear")
#: A severe motion of the block, as in the figure, and one of everything.
BLOCK = Turn((-0.1, 0.1), 45.0)
WHOLE = Turn((0.3, -0.2), 60.0, centre=(0.5, 0.5))


def moved(mesh: StoredMesh, prescribed: Floats, controls: NDArray[np.int64], radius: float, polynomial: str) -> Floats:
    """Nodes (n, d) after the bare interpolation of ``displacement`` (n, d) at the control nodes."""
    factorization = factorize(mesh.points[controls], support_radius=radius)
    system = WithPolynomial(factorization) if polynomial == "linear" else factorization
    interpolant = system.solve((prescribed - mesh.points)[controls])
    return mesh.points + evaluation.displacement(interpolant, mesh.points)


def turned_block(mesh: StoredMesh) -> Floats:
    """Nodes with the block turned and everything else at rest."""
    block = mesh.patches["block"].nodes
    prescribed = mesh.points.copy()
    prescribed[block] = BLOCK(mesh.points[block])
    return prescribed


def run(quick: bool) -> Outcome:
    """Three uses of the same boundary, each with and without the polynomial."""
    del quick
    mesh = stored(MESH)
    roles = BoundaryRoles.from_patches(mesh.patches)
    rows: list[list[Any]] = []
    for radius in (0.5, 2.5):
        turned = [_rigid_error(mesh, roles.all, radius, p) for p in POLYNOMIALS]
        rows.append(["rigid motion of block and outer wall: largest error of a node", radius, *turned])
        fixed = [_fixed_wall(mesh, roles, radius, p) for p in POLYNOMIALS]
        rows.append(["block, outer wall held: minimum size-skew", radius, *(f[0] for f in fixed)])
        rows.append(["the same: mean displacement in the outer tenth", radius, *(f[1] for f in fixed)])
        free = [_free_wall(mesh, roles, radius, p) for p in POLYNOMIALS]
        rows.append(["block alone interpolated: largest displacement of the outer wall", radius, *free])
    table = Table(("", "R", "without polynomial", "with polynomial"), rows, digits=3)
    text = (
        f"The block's mesh; block: {BLOCK.degrees:.0f}° and {list(BLOCK.shift)}; rigid motion of everything: "
        f"{WHOLE.degrees:.0f}° and {list(WHOLE.shift)}. {_sparseness(mesh, roles)}"
    )
    caption = "The figure's motion, R = 0.5. Above: outer wall held; below: only the block is interpolated."
    return Outcome([table], [Picture(draw, caption, size=(7.5, 7.7))], text)


def _rigid_error(mesh: StoredMesh, controls: NDArray[np.int64], radius: float, polynomial: str) -> float:
    """Largest distance of a node from its position in a rigid motion of the whole boundary."""
    goal = WHOLE(mesh.points)
    return float(np.linalg.norm(moved(mesh, goal, controls, radius, polynomial) - goal, axis=1).max())


def _fixed_wall(mesh: StoredMesh, roles: BoundaryRoles, radius: float, polynomial: str) -> tuple[float, float]:
    """Minimum size-skew, and mean displacement of the nodes near the outer wall."""
    points = moved(mesh, turned_block(mesh), roles.all, radius, polynomial)
    quality = cell_quality(points, mesh.cells, reference_sizes(mesh.points, mesh.cells)).metric("size-skew")
    near = np.abs(mesh.points - 0.5).max(axis=1) > 0.4
    return float(quality.min()), float(np.linalg.norm(points - mesh.points, axis=1)[near].mean())


def _free_wall(mesh: StoredMesh, roles: BoundaryRoles, radius: float, polynomial: str) -> float:
    """Largest displacement of the outer wall when it is not held."""
    points = moved(mesh, turned_block(mesh), roles.moving, radius, polynomial)
    return float(np.linalg.norm(points - mesh.points, axis=1)[roles.fixed].max())


def _sparseness(mesh: StoredMesh, roles: BoundaryRoles) -> str:
    """Number of nonzero entries of the matrix of (2.4), with and without the polynomial's rows."""
    points, basis, radius = mesh.points[roles.all], BASES["wendland-c2"], 0.25
    full = int(sparse_matrix(CentreLayout.build(points, basis, radius), basis, radius).nnz)
    more = 2 * (points.shape[1] + 1) * len(points)
    return (
        f"With R = {radius} the interpolation matrix has {full} nonzero entries; the polynomial's rows and columns add "
        f"{more}. Their Schur complement is formed instead, so that the sparse factors stay as they are."
    )


def draw(figure: Any) -> None:
    """The deformed meshes."""
    mesh = stored(MESH)
    roles = BoundaryRoles.from_patches(mesh.patches)
    triangles = mesh.cells.blocks[0].nodes
    axes = figure.subplots(2, 2).ravel()
    cases = [(roles.all, p, "wall held") for p in POLYNOMIALS] + [(roles.moving, p, "block alone") for p in POLYNOMIALS]
    for axis, (controls, polynomial, what) in zip(axes, cases, strict=True):
        points = moved(mesh, turned_block(mesh), controls, 0.5, polynomial)
        axis.triplot(points[:, 0], points[:, 1], triangles, color="0.35", linewidth=0.3, antialiased=False)
        axis.set_aspect("equal")
        axis.set_title(f"{what}, {'no' if polynomial == 'none' else 'with'} polynomial", fontsize=10)
        axis.tick_params(labelsize=7)


def claims(outcome: Outcome) -> None:
    """Check exactness with the polynomial only, the motion of a free far field, and the small gain in quality."""
    for begin in (0, 4):
        rigid, quality, _, free = outcome.tables[0].rows[begin : begin + 4]
        assert rigid[3] < 1e-12
        assert rigid[2] > 1e-4
        assert abs(quality[3] - quality[2]) < 0.1
        assert free[3] > 0.3
    near = outcome.tables[0].rows[3]
    assert near[2] < 0.5 * near[3]


STUDY = Study(
    title="What does the polynomial of (2.1) give, and what does it cost?",
    source="Fig 2.2 (equations 2.1–2.6)",
    run=run,
    claims=claims,
    functions=(
        "mesh_motion_numerics.interpolation.polynomial.LinearBasis",
        "docs.studies.thesis._linear_polynomial.WithPolynomial",
    ),
)
