"""Chapter 5's test cases (Tables 5.1, 5.2, 5.5, 5.6): a block or slab in the unit square, moved in one step."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from mesh_motion_numerics.correction.correction_problem import CorrectionProblem
from mesh_motion_numerics.correction.trial_nodes import TrialMesh
from mesh_motion_numerics.interpolation.interpolant import factorize
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.metrics import cell_quality, reference_sizes
from numpy.typing import NDArray

from docs.studies.thesis._predictors import InterpolantField

Floats = NDArray[np.float64]

REFERENCES = Path(__file__).parents[3] / "tests" / "references"

#: Name → mesh, translation, degrees about (0.5, 0.5).
CASES: dict[str, tuple[str, tuple[float, float], float]] = {
    "x": ("thesis_block", (-0.3, 0.0), 0.0),
    "x and y": ("thesis_block", (-0.25, -0.25), 0.0),
    "rotation": ("thesis_slab", (-0.2, -0.2), 60.0),
}


@dataclass(frozen=True, eq=False)
class BlockCase:
    """A standard motion of one step, as a problem for the corrections and as a field."""

    problem: CorrectionProblem
    field: InterpolantField
    body: NDArray[np.int64]

    @property
    def mesh(self) -> TrialMesh:
        """Signed size, the metric of the thesis' 2D results."""
        p = self.problem
        return TrialMesh(p.start, p.cells, p.reference_sizes, p.held, "size")

    @property
    def triangles(self) -> NDArray[np.int32]:
        """(m, 3) node numbers."""
        return self.problem.cells.blocks[0].nodes

    def smallest(self, points: Floats) -> float:
        """Minimum size of the mesh at points (n, 2), signed."""
        p = self.problem
        return float(cell_quality(points, p.cells, p.reference_sizes).metric("size").min())

    def moved(self, displacement: Floats) -> Floats:
        """(n, 2) positions after a displacement, with the boundary at its given positions."""
        return np.where(self.problem.held[:, None], self.problem.standard, self.problem.start + displacement)


def turned(x: Floats, translation: tuple[float, float], degrees: float) -> Floats:
    """Points (n, 2) rotated about (0.5, 0.5) and translated."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.asarray((x - 0.5) @ np.array([[c, s], [-s, c]]) + 0.5 + np.array(translation))


@cache
def block_case(name: str, support_radius: float = 0.5) -> BlockCase:
    """A case of :data:`CASES`."""
    mesh, translation, degrees = CASES[name]
    with np.load(REFERENCES / f"{mesh}.npz") as arrays:
        points, cells = arrays["points"], CellTable.from_arrays({"triangle": arrays["cells_triangle"]})
        body, outer = arrays["patch_block"], arrays["patch_outer"]
    control = np.concatenate([body, outer])
    target = points.copy()
    target[body] = turned(points[body], translation, degrees)
    factorization = factorize(points[control], support_radius=support_radius)
    field = InterpolantField(factorization.solve((target - points)[control]))
    standard = points + field.displacement(points)
    standard[control] = target[control]
    held = np.isin(np.arange(len(points)), control)
    sizes = reference_sizes(points, cells)
    problem = CorrectionProblem(points, standard, held, cells, sizes, factorization)
    return BlockCase(problem, field, body)


def draw_mesh(ax: Any, case: BlockCase, points: Floats, title: str) -> Any:
    """The mesh at points (n, 2), coloured by its size; inverted cells red."""
    p = case.problem
    quality = cell_quality(points, p.cells, p.reference_sizes).metric("size")
    # ten colours and lines without antialiasing keep the picture small
    shown = ax.tripcolor(*points.T, case.triangles, quality, cmap=colormaps["viridis"].resampled(10), vmin=0, vmax=1)
    ax.triplot(*points.T, case.triangles, color="k", lw=0.2, alpha=0.3, antialiased=False)
    bad = quality <= 0
    if bad.any():
        ax.triplot(*points.T, case.triangles[bad], color="r", lw=1)
    ax.set_aspect("equal")
    ax.set_axis_off()
    ax.set_title(f"{title}\nminimum size {quality.min():.3f}", fontsize=9)
    return shown
