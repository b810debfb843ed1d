"""Boundaries and their motions, for the studies of point reduction."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.interpolant import factorize
from mesh_motion_numerics.interpolation.two_scale.interpolant import AnyInterpolant
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.quality.metrics import cell_quality, reference_sizes
from mesh_motion_numerics.reduction import Level, Reduced, ReductionProblem
from mesh_motion_numerics.reduction.reduced_motion import BASIS, boundary_spacing, near_surface_radius
from numpy.typing import NDArray

from docs.studies.moved_bodies import ROOT, StoredMesh, Turn, stored

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Half-open boxes: the wing in the unit cube of the comparison with other systems.
_LOW, _HIGH = np.array([0.3, 0.47, 0.4]), np.array([0.7, 0.53, 0.6])


def _box(low: Floats, high: Floats, spacing: float) -> Floats:
    """(n, 3) nodes of a grid on the faces of a box, each once."""
    axes = [np.linspace(a, b, max(2, round((b - a) / spacing) + 1)) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return grid[((grid == low) | (grid == high)).any(axis=1)]


def bent(points: Floats, rise: float) -> Floats:
    """(n, 3) displacement of a cantilever along x from 0.3 to 0.7 whose tip rises."""
    t = (points[:, 0] - _LOW[0]) / (_HIGH[0] - _LOW[0])
    moved = np.zeros_like(points)
    moved[:, 1] = rise * t**2 * (3.0 - t) / 2.0
    return moved


@cache
def surface_problem(spacing: float, *, tolerance: float = 1e-3, max_points: int = 0) -> ReductionProblem:
    """A thin wing that bends by 0.16 in a unit cube whose nodes are three times as far apart; no volume."""
    wing, walls = _box(_LOW, _HIGH, spacing), _box(np.zeros(3), np.ones(3), 3.2 * spacing)
    displacement = np.concatenate([bent(wing, 0.16), np.zeros_like(walls)])
    points = np.concatenate([wing, walls])
    return ReductionProblem(points, displacement, support_radius=0.5, tolerance=tolerance, max_points=max_points)


@dataclass(frozen=True, eq=False)
class MeshMotion:
    """A mesh and the motion of its boundary.

    Attributes
    ----------
    boundary : (nb,) int64 array
        Nodes with a prescribed displacement, including fixed nodes.
    displacement : (nb, d) array
    """

    title: str
    mesh: StoredMesh
    boundary: Indices
    displacement: Floats
    support_radius: float

    def problem(self, tolerance: float) -> ReductionProblem:
        """The reduction of its boundary."""
        points = self.mesh.points[self.boundary]
        return ReductionProblem(points, self.displacement, support_radius=self.support_radius, tolerance=tolerance)

    def all_nodes(self) -> tuple[Level]:
        """The interpolation from all boundary nodes."""
        full = factorize(self.mesh.points[self.boundary], support_radius=self.support_radius)
        return (full.solve(self.displacement),)

    def displaced(self, levels: tuple[AnyInterpolant, ...]) -> Floats:
        """(n, d) nodes displaced by a sum of levels."""
        return self.mesh.points + sum(evaluation.displacement(level, self.mesh.points) for level in levels)

    def snapped(self, positions: Floats) -> Floats:
        """(n, d) nodes displaced as before, with the boundary nodes at their given positions."""
        exact = positions.copy()
        exact[self.boundary] = self.mesh.points[self.boundary] + self.displacement
        return exact

    def corrected(self, reduced: Reduced) -> tuple[AnyInterpolant, ...]:
        """The levels of a reduction and the near-surface correction of the remaining error."""
        points = self.mesh.points[self.boundary]
        moving = np.linalg.norm(self.displacement, axis=1) > 0.0
        radius = near_surface_radius(boundary_spacing(points[moving]), reduced.max_error, self.support_radius)
        return (*reduced.levels, factorize(points, basis=BASIS, support_radius=radius).solve(reduced.error))

    def quality(self, positions: Floats) -> float:
        """Minimum size-skew with the nodes at the positions (n, d)."""
        mesh = self.mesh
        sizes = reference_sizes(mesh.points, mesh.cells)
        return float(cell_quality(positions, mesh.cells, sizes).metric("size-skew").min())


def mesh_motion(title: str, mesh: StoredMesh, moved: dict[str, Floats], support_radius: float) -> MeshMotion:
    """All patches' nodes, the named patches displaced."""
    displacement = np.zeros_like(mesh.points)
    for name, of_patch in moved.items():
        displacement[mesh.patches[name].nodes] = of_patch
    boundary = np.unique(np.concatenate([patch.nodes for patch in mesh.patches.values()]))
    return MeshMotion(title, mesh, boundary, displacement[boundary], support_radius)


def block(shift: tuple[float, float] = (-0.1, -0.1), degrees: float = 30.0) -> MeshMotion:
    """The thesis' slab, translated and rotated."""
    mesh = stored("tests/references/correction_slab")
    body = mesh.points[mesh.patches["body"].nodes]
    title = f"slab in a square, {shift} and {degrees:+.0f}°"
    return mesh_motion(title, mesh, {"body": Turn(shift, degrees)(body) - body}, 0.5)


def wing(fraction: float = 0.5) -> MeshMotion:
    """The tapered wing of the examples, at a fraction of its bending and twisting; the walls are fixed."""
    mesh = stored("examples/tapered_wing/mesh")
    with np.load(ROOT / "examples/tapered_wing/motion.npz") as motion:
        table = motion["displacement"]
        rows = table[round(fraction * len(table)) - 1]
    return mesh_motion(f"tapered wing, {fraction:.0%} of its motion", mesh, {"wing": rows}, 1.0)


def layered(first_layer: float = 2e-4, *, around: int = 120, layers: int = 36) -> MeshMotion:
    """A thin ellipse in quadrilaterals whose layers grow from ``first_layer`` (chord 0.2); it bends like a fish."""
    angle = 2 * np.pi * np.arange(around) / around
    ellipse = np.column_stack([0.1 * np.cos(angle), 0.02 * np.sin(angle)])
    normal = np.column_stack([0.2 * np.cos(angle), np.sin(angle)])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    height = first_layer * (1.2 ** np.arange(layers + 1) - 1.0) / 0.2  # each layer a fifth higher than the last
    points = np.concatenate([ellipse + h * normal for h in height])
    row = np.arange(around)
    quads = np.concatenate(
        [
            np.column_stack([k + row, k + around + row, k + around + (row + 1) % around, k + (row + 1) % around])
            for k in range(0, layers * around, around)
        ]
    )
    patches = {"body": Patch("moving", row), "outer": Patch("fixed", layers * around + row)}
    mesh = StoredMesh(points, CellTable.from_arrays({"quad": quads}), patches)
    x = ellipse[:, 0] / 0.2 + 0.5
    bent_line = np.column_stack([np.zeros(around), 0.05 * np.sin(2.0 * np.pi * x) * x])
    return mesh_motion(f"ellipse with layers from {first_layer:g}", mesh, {"body": bent_line}, 0.5)
