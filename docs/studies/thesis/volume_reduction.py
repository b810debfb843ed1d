"""§2.2.1: three ways to evaluate the interpolation at fewer places: saved time and lost quality."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.interpolant import factorize
from mesh_motion_numerics.interpolation.support_radius import suggest_support_radius
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import BoundaryRoles, Patch
from mesh_motion_numerics.quality.metrics import cell_quality, reference_sizes
from numpy.typing import NDArray

from docs.studies.moved_bodies import StoredMesh, Turn, stored
from docs.studies.refinement import refined
from docs.studies.study import Outcome, Picture, Study, Table
from docs.studies.thesis._volume_reduction import VOLUME_REDUCTIONS, Field, VolumeProblem
from docs.studies.thesis._volume_reduction.background_grid import INTERPOLATIONS, CartesianGrid

Floats = NDArray[np.float64]

#: Motions of the two bodies.
MOTIONS: dict[str, dict[str, Turn]] = {
    "2D slab": {
        "up by 1/20": Turn((0.0, 0.05)),
        "up by 1/2": Turn((0.0, 0.5)),
        "+60°": Turn((0.0, 0.0), 60.0),
    },
    "3D box": {
        "up by 1/20": Turn((0.0, 0.05, 0.0)),
        "up by 1/2": Turn((0.0, 0.5, 0.0)),
        "+30°": Turn((0.0, 0.0, 0.0), 30.0),
    },
}


def body_mesh(name: str, *, quick: bool) -> StoredMesh:
    """A mesh of a body far from its walls."""
    if name == "2D slab":
        return refined(stored("tests/references/far_slab"), 0 if quick else 3)
    return stretched_box(5 if quick else 11)


def stretched_box(n: int) -> StoredMesh:
    """Hexahedra between a box of 1 × 0.2 × 1 and a cube of 8; n layers, each wider than the last, to every wall."""
    sides = [_stretched(half, count, n) for half, count in ((0.5, 6), (0.1, 3), (0.5, 6))]
    shape = tuple(len(axis) for axis in sides)
    places = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange(len(places)).reshape(shape)
    corners = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
    hexes = np.stack(
        [number[tuple(slice(a, a + s - 1) for a, s in zip(corner, shape, strict=True))].ravel() for corner in corners],
        axis=1,
    )
    half = np.array([0.5, 0.1, 0.5])
    hexes = hexes[~(np.abs(places[hexes].mean(axis=1)) < half).all(axis=1)]
    used, cells = np.unique(hexes, return_inverse=True)
    points = places[used]
    body = np.flatnonzero((np.abs(points) < half + 1e-9).all(axis=1))
    outer = np.flatnonzero((np.abs(points) > 4.0 - 1e-9).any(axis=1))
    patches = {"box": Patch("moving", body), "outer": Patch("fixed", outer)}
    return StoredMesh(points, CellTable.from_arrays({"hexahedron": cells.reshape(hexes.shape)}), patches)


def _stretched(half: float, count: int, n: int) -> Floats:
    """An axis: ``count`` equal intervals on the body, n on either side that grow to the wall at 4."""
    first = 2.0 * half / count
    low, high = 1.0, 4.0
    for _ in range(60):  # the ratio of the geometric series that reaches the wall, by bisection
        ratio = (low + high) / 2.0
        low, high = (ratio, high) if first * sum(ratio ** np.arange(1, n + 1)) < 4.0 - half else (low, ratio)
    steps = np.cumsum(ratio ** np.arange(1, n + 1))
    out = half + (4.0 - half) * steps / steps[-1]
    return np.concatenate([-out[::-1], np.linspace(-half, half, count + 1), out])


@dataclass(frozen=True, eq=False)
class Moving:
    """A mesh with a motion of its body, interpolated from all boundary nodes."""

    mesh: StoredMesh
    turn: Turn

    @cached_property
    def problem(self) -> VolumeProblem:
        """The arguments of the reductions."""
        points, roles = self.mesh.points, BoundaryRoles.from_patches(self.mesh.patches)
        radius = suggest_support_radius(points, roles)

        def interpolate(controls: Floats, values: Floats) -> Field:
            interpolant = factorize(controls, support_radius=radius).solve(values)
            return lambda places: evaluation.displacement(interpolant, places)

        positions = points.copy()
        positions[roles.moving] = self.turn(points[roles.moving])
        displacement = (positions - points)[roles.all]
        boundary = points[roles.all]
        return VolumeProblem(
            boundary=boundary,
            displacement=displacement,
            moving=np.isin(roles.all, roles.moving),
            nodes=points,
            standard=interpolate(boundary, displacement),
            interpolate=interpolate,
        )

    def quality(self, displacement: Floats) -> float:
        """Minimum size-skew with the nodes displaced and the boundary at its targets."""
        moved = self.mesh.points + displacement
        roles = BoundaryRoles.from_patches(self.mesh.patches)
        moved[roles.all] = self.problem.boundary + self.problem.displacement
        sizes = reference_sizes(self.mesh.points, self.mesh.cells)
        return float(cell_quality(moved, self.mesh.cells, sizes).metric("size-skew").min())


def run(quick: bool) -> Outcome:
    """Every reduction on every motion; the grid's order; quality against the number of sums."""
    rows: list[list[Any]] = []
    for name, turns in MOTIONS.items():
        mesh = body_mesh(name, quick=quick)
        for what, turn in list(turns.items())[:: 2 if quick else 1]:
            rows += _rows(name, what, Moving(mesh, turn))
    columns = (
        "mesh",
        "motion",
        "volume reduction",
        "minimum size-skew",
        "nodes at rest",
        "sums",
        "pairs",
        "CPU of evaluation",
        "of preparation",
    )
    caption = "Cost divided by the cost without reduction: places of sums, pairs of place and control point, CPU time."
    tables = [Table(columns, rows, caption, digits=3), _grid_orders(quick)]
    text = (
        "The reductions choose the sizes; nothing is corrected; preparation of the box includes the "
        "factorization of its control points. CPU shares come from one run each and mean little below a few ms."
    )
    picture = Picture(lambda figure: draw(figure, quick), "2D slab, +60°, by the size of box and wall distance.")
    return Outcome(tables, [picture], text)


def _rows(name: str, what: str, moving: Moving) -> list[list[Any]]:
    """One row a reduction."""
    problem, points = moving.problem, moving.mesh.points
    problem.standard(points)  # in the caches
    standard, whole = _timed(partial(problem.standard, points))
    heads = [f"{name}, {len(points)} nodes", what]
    rows: list[list[Any]] = [[*heads, "none", moving.quality(standard), None, 1.0, 1.0, 1.0, None]]
    for key, reduce in VOLUME_REDUCTIONS.items():
        reduce(problem)(points[:10])
        field, preparing = _timed(partial(reduce, problem))
        found, evaluating = _timed(partial(field, points))
        resting = None if key == "background-grid" else 1.0 - np.count_nonzero(found.evaluated) / len(points)
        sums, controls = found.places / len(points), found.control_points / len(problem.boundary)
        quality = moving.quality(found.displacement)
        shares = [resting, sums, sums * controls, evaluating / whole, preparing / whole]
        rows.append([*heads, key, quality, *shares])
    return rows


def _timed(action: Callable[[], Any]) -> tuple[Any, float]:
    """The result and the shortest CPU seconds of three runs."""
    seconds = []
    for _ in range(3):
        began = time.process_time()
        result = action()
        seconds.append(max(time.process_time() - began, 1e-6))
    return result, min(seconds)


def _grid_orders(quick: bool) -> Table:
    """Error of grid interpolation away from control points, against the spacing."""
    moving = Moving(body_mesh("2D slab", quick=True), MOTIONS["2D slab"]["+60°"])
    problem = moving.problem
    rng = np.random.default_rng(0)
    places = rng.uniform(-5.0, 5.0, (500 if quick else 3000, 2))
    body = np.abs(places) - np.array([0.5, 0.05])
    places = places[np.linalg.norm(np.maximum(body, 0.0), axis=1) > 0.7]
    exact = problem.standard(places)
    rows: list[list[Any]] = []
    before: dict[str, float] = {}
    for spacing in (0.4, 0.2, 0.1):
        row: list[Any] = [spacing]
        for interpolation in INTERPOLATIONS:
            grid = CartesianGrid.around(problem.nodes, spacing, interpolation)
            at = grid.places(places)
            numbers = grid.asked(at)
            found = grid.interpolate(at, numbers, problem.standard(grid.points(numbers, 2)))
            error = float(np.abs(found - exact).max() / problem.largest)
            row += [error, float(np.log2(before[interpolation] / error)) if interpolation in before else None]
            before[interpolation] = error
        rows.append(row)
    columns = ("spacing", "linear: largest error / displacement", "order", "cubic: largest error", "order ")
    return Table(columns, rows, "Interpolation on the background grid, at least 0.7 away from the slab.", digits=3)


def draw(figure: Any, quick: bool) -> None:
    """Minimum quality against the share of nodes that move."""
    moving = Moving(body_mesh("2D slab", quick=True), MOTIONS["2D slab"]["+60°"])
    points, axis = moving.mesh.points, figure.subplots(1, 1)
    for key, sizes in (("enclosing-box", (0.5, 1, 1.5, 2.5, 4, 5)), ("wall-function", (1, 1.5, 2, 3, 4, 6))):
        found = [_at_size(moving, key, size) for size in (sizes[::2] if quick else sizes)]
        axis.plot([f[0] for f in found], [f[1] for f in found], "o-", label=key)
    axis.axhline(moving.quality(moving.problem.standard(points)), color="0.5", linestyle="--", label="none")
    axis.set(xlabel="share of nodes that move", ylabel="minimum size-skew", xlim=(0, 1.02))
    axis.grid(alpha=0.3)
    axis.legend()


def _at_size(moving: Moving, key: str, size: float) -> tuple[float, float]:
    """Share of nodes that move, and minimum quality, with a given length."""
    found = VOLUME_REDUCTIONS[key](replace(moving.problem, length=size))(moving.mesh.points)
    share = np.count_nonzero(found.evaluated) / len(found.evaluated)
    return float(share), moving.quality(found.displacement)


def claims(outcome: Outcome) -> None:
    """Check that box and wall function keep two thirds of the quality, and the grid 99 %, with fewer pairs."""
    table = outcome.tables[0]
    none = 0.0
    for row in table.rows:
        key, quality, pairs = row[2], row[3], row[6]
        if key == "none":
            none = quality
        elif key == "background-grid":
            assert abs(quality - none) < 0.01
        else:
            assert quality > 0.65 * none
            assert pairs < 0.9
    orders = outcome.tables[1]
    assert all(1.7 < order < 2.4 for order in orders.column("order")[1:])
    assert all(3.2 < order < 4.6 for order in orders.column("order ")[1:])


STUDY = Study(
    title="What does a reduction of the volume nodes save, and what does it cost?",
    source="§2.2.1 (enclosing box, restricted wall function, background Cartesian grid)",
    run=run,
    claims=claims,
    functions=(
        "docs.studies.thesis._volume_reduction.VOLUME_REDUCTIONS",
        "docs.studies.thesis._volume_reduction.enclosing_box.reduce",
        "docs.studies.thesis._volume_reduction.wall_function.reduce",
        "docs.studies.thesis._volume_reduction.background_grid.reduce",
    ),
)
