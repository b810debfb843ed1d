"""The named cases of the correction: meshes, motions, and the best minimum size-skew known for each."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from frame_meshes import ring_grid
from mesh_motion_numerics.correction.correction_problem import CorrectionProblem
from mesh_motion_numerics.correction.trial_nodes import TrialMesh
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.interpolant import Factorization, factorize
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.quality.metrics import reference_sizes

REFERENCES = Path(__file__).parent.parent / "references"
RADIUS = 0.5


@dataclass(frozen=True, eq=False)
class BodyMesh:
    """A mesh with a held outer boundary and a body that moves."""

    points: np.ndarray
    cells: CellTable
    outer: np.ndarray
    body: np.ndarray

    @property
    def patches(self) -> dict[str, Patch]:
        return {"body": Patch("moving", self.body), "outer": Patch("fixed", self.outer)}

    @property
    def held(self) -> np.ndarray:
        marked = np.zeros(len(self.points), dtype=bool)
        marked[self.outer] = marked[self.body] = True
        return marked

    @property
    def sizes(self) -> np.ndarray:
        return reference_sizes(self.points, self.cells)

    @property
    def trial(self) -> TrialMesh:
        return TrialMesh(self.points, self.cells, self.sizes, self.held)


def ring(rings: int = 24, ratio: float = 10.0, around: int = 48) -> BodyMesh:
    """A circle in a circle of ``ratio`` times its radius, in triangles; the rings grow by the same factor each."""
    points, quads = ring_grid(ratio ** (np.arange(rings + 1) / rings), around)
    cells = CellTable.from_arrays({"triangle": np.concatenate([quads[:, [0, 2, 3]], quads[:, [0, 1, 2]]])})
    return BodyMesh(points, cells, np.arange(rings * around, len(points)), np.arange(around))


@cache
def stored(name: str) -> BodyMesh:
    with np.load(REFERENCES / f"{name}.npz") as data:
        cells = {key.removeprefix("cells_"): data[key] for key in data if key.startswith("cells_")}
        body = data["patch_body"] if "patch_body" in data else data["patch_block"]
        return BodyMesh(data["points"], CellTable.from_arrays(cells), data["patch_outer"], body)


@cache
def boundary_factor(mesh: BodyMesh) -> Factorization:
    return factorize(mesh.points[mesh.held], support_radius=RADIUS)


def moved(mesh: BodyMesh, displacement: np.ndarray) -> CorrectionProblem:
    """The standard motion for a displacement (n, d); only the boundary's rows are used."""
    held, factor = mesh.held, boundary_factor(mesh)
    standard = mesh.points + evaluation.displacement(factor.solve(displacement[held]), mesh.points)
    standard[held] = mesh.points[held] + displacement[held]
    return CorrectionProblem(mesh.points, standard, held, mesh.cells, mesh.sizes, factor)


def rigid(mesh: BodyMesh, translation: tuple[float, ...], degrees: float = 0.0) -> np.ndarray:
    """Displacement (n, d): the body translated and rotated about the centre (in 3D about the z axis)."""
    angle, centre = np.deg2rad(degrees), mesh.points - 0.5
    turned = centre.copy()
    turned[:, 0] = np.cos(angle) * centre[:, 0] - np.sin(angle) * centre[:, 1]
    turned[:, 1] = np.sin(angle) * centre[:, 0] + np.cos(angle) * centre[:, 1]
    displacement = np.zeros_like(mesh.points)
    displacement[mesh.body] = (turned - centre + np.asarray(translation))[mesh.body]
    return displacement


def bent(mesh: BodyMesh, displacement: np.ndarray, height: float) -> np.ndarray:
    """Add a bend of the body in y, quadratic along z."""
    along = (mesh.points[mesh.body, 2] - 0.4) / 0.2
    displacement[mesh.body, 1] += height * along**2
    return displacement


def squeezed(mesh: BodyMesh, distance: float) -> np.ndarray:
    """Two bodies, left and right of the middle, move towards each other."""
    displacement = np.zeros_like(mesh.points)
    displacement[mesh.body, 0] = np.where(mesh.points[mesh.body, 0] < 0.5, distance, -distance)
    return displacement


CASES = {
    "dx -0.3": ("thesis_block", lambda m: rigid(m, (-0.3, 0.0))),
    "dx dy -0.25": ("thesis_block", lambda m: rigid(m, (-0.25, -0.25))),
    "-0.2, -0.2, +60°": ("correction_slab", lambda m: rigid(m, (-0.2, -0.2), 60.0)),
    "dx -0.38": ("thesis_block", lambda m: rigid(m, (-0.38, 0.0))),
    "rotate 90°": ("thesis_block", lambda m: rigid(m, (0.0, 0.0), 90.0)),
    "rotate 180°": ("thesis_block", lambda m: rigid(m, (0.0, 0.0), 180.0)),
    "squeeze between two blocks": ("correction_two_blocks", lambda m: squeezed(m, 0.125)),
    "3D box 0.25 + bend": ("correction_box", lambda m: bent(m, rigid(m, (0.25, 0.0, 0.0)), 0.1)),
    "3D box + 60° + bend": ("correction_box", lambda m: bent(m, rigid(m, (0.15, 0.1, 0.0), 60.0), 0.1)),
    "3D rotate 90°": ("correction_box", lambda m: rigid(m, (0.0, 0.0, 0.0), 90.0)),
}
"""Mesh and displacement by name."""


@cache
def case(name: str) -> CorrectionProblem:
    reference, displacement = CASES[name]
    mesh = stored(reference)
    return moved(mesh, displacement(mesh))


# mesh, translation, degrees about (0.5, 0.5); Tables 5.2, 5.5, 5.6
THESIS = {
    "x": ("thesis_block", (-0.3, 0.0), 0.0),
    "xy": ("thesis_block", (-0.25, -0.25), 0.0),
    "rotation": ("thesis_slab", (-0.2, -0.2), 60.0),
}


def thesis_case(name: str) -> CorrectionProblem:
    reference, translation, degrees = THESIS[name]
    mesh = stored(reference)
    return moved(mesh, rigid(mesh, translation, degrees))
