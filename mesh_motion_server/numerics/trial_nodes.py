"""The strongest correction: trial positions of nodes are freed and moved to lower the mesh's worst distortion.

The boundary is held where the motion puts it; no node of the mesh has moved yet. :func:`polish` frees a region and
follows a continuation from a mild p-mean to a sharp one with projected Gauss–Newton iterations (:mod:`.newton`),
untangling first where cells are inverted. :func:`reach` frees the nodes of the bad cells only and grows the region
until a threshold holds, so that the cost follows the bad region and not the mesh.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.numerics.cells import CellTable
from mesh_motion_server.numerics.distortion import PNorm, determinants
from mesh_motion_server.numerics.free_region import FreeRegion, free_region, grow, nodes_of_cells
from mesh_motion_server.numerics.metrics import cell_quality
from mesh_motion_server.numerics.newton import newton

__all__ = ["Polished", "TrialMesh", "polish", "reach"]

LEVELS = (PNorm(2, 1), PNorm(8, 2), PNorm(24, 4), PNorm(60, 8), PNorm(150, 16))
"""Continuation: starting sharper, or with fewer iterations a level, ends at a third of the quality."""

_UNTANGLED = 1e-3  # least determinant from which the barrier is used
_STAGES = 15
_STAGE_ITERATIONS = 4
_MARGIN = 1.15
_ALL = 0.6  # past this share of the free nodes a region does not pay: free all


@dataclass(frozen=True, eq=False)
class TrialMesh:
    """What a correction works on: the mesh, which nodes are held, and how quality is judged.

    Attributes
    ----------
    reference : (n, d) array, mesh length unit
        Nodes of the reference mesh, the ideal shape of cells that are no simplices.
    cells : CellTable
    reference_sizes : (m,) array, length^d
    held : (n,) bool array
        Nodes that must not move.
    metric : str
        One of :data:`~mesh_motion_server.numerics.metrics.QUALITY_METRICS`.
    """

    reference: NDArray[np.float64]
    cells: CellTable
    reference_sizes: NDArray[np.float64]
    held: NDArray[np.bool_]
    metric: str = "size-skew"

    def quality(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """The metric (m,) of every cell; at most 0 where a cell is inverted."""
        return signed_quality(points, self.cells, self.reference_sizes, self.metric)

    def free(self, marked: NDArray[np.bool_]) -> FreeRegion:
        """The region in which the marked (n) nodes are free, but for the held ones."""
        return free_region(self.reference, self.cells, self.reference_sizes, marked & ~self.held)


def signed_quality(
    points: NDArray[np.float64], cells: CellTable, reference_sizes: NDArray[np.float64], metric: str
) -> NDArray[np.float64]:
    """The metric (m,) of every cell; ≤ −1e−300 where any corner is inverted, whatever the metric says."""
    quality = cell_quality(points, cells, reference_sizes)
    values = quality.metric(metric)
    return np.where(quality.inverted, np.minimum(-np.abs(values), -_TINY), values)


_TINY = 1e-300


@dataclass(frozen=True, eq=False)
class Polished:
    """Corrected trial positions.

    Attributes
    ----------
    points : (n, d) array, mesh length unit
    minimum : float
        Smallest quality over the mesh (over the region, for a single :func:`polish`); ≤ 0 where it stays tangled.
    freed : int
        Number of nodes that were free at the end.
    iterations : int
    history : tuple of (str, int, float)
        What was done, on how many free nodes, and the smallest quality after it.
    """

    points: NDArray[np.float64]
    minimum: float
    freed: int
    iterations: int
    history: tuple[tuple[str, int, float], ...] = ()


@dataclass(eq=False)
class _Search:
    """The best positions (l, d) seen in a region, judged by the true quality."""

    region: FreeRegion
    metric: str
    target: float
    points: NDArray[np.float64]
    minimum: float = -math.inf
    iterations: int = 0
    history: list[tuple[str, int, float]] = field(default_factory=list)

    def judge(self, points: NDArray[np.float64]) -> bool:
        """Remember the points if they are better; whether the target is met."""
        minimum = float(signed_quality(points, self.region.cells, self.region.reference_sizes, self.metric).min())
        if minimum > self.minimum:
            self.points, self.minimum = points, minimum
        return self.minimum >= self.target

    def descend(self, points: NDArray[np.float64], norm: PNorm, iterations: int) -> NDArray[np.float64]:
        """Newton iterations with one p-mean; judges on the way and at the end."""
        result = newton(points, self.region, norm, iterations=iterations, good_enough=self.judge)
        self.judge(result.points)
        self.iterations += result.iterations
        label = f"untangle ε = {norm.epsilon:.1e}" if norm.epsilon else f"p = {norm.p:g}, m = {norm.m:g}"
        self.history.append((label, self.region.n_free, self.minimum))
        return result.points


def polish(
    points: NDArray[np.float64],
    mesh: TrialMesh,
    region: FreeRegion,
    *,
    target: float = math.inf,
) -> Polished:
    """Lower the worst distortion of a region.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
        Trial positions of all nodes.
    mesh : TrialMesh
    region : FreeRegion
        From ``mesh.free``.
    target : float
        Stop as soon as every cell of the region is at least this good.

    Returns
    -------
    Polished
        The best of all positions met, the given ones included.
    """
    local = points[region.nodes]
    search = _Search(region, mesh.metric, target, local)
    met = search.judge(local)
    if not met:
        local, barrier = _untangle(search, local)
        if barrier:
            for norm in LEVELS:
                if search.minimum >= target:
                    break
                local = search.descend(local, norm, 12)
    moved = points.copy()
    moved[region.free] = search.points[: region.n_free]
    return Polished(moved, search.minimum, region.n_free, search.iterations, tuple(search.history))


def _untangle(search: _Search, points: NDArray[np.float64]) -> tuple[NDArray[np.float64], bool]:
    """Positions (l, d) with positive determinants, and whether they are."""
    least = determinants(points, search.region.simplices).min()
    for _ in range(_STAGES):
        if least > _UNTANGLED:
            break
        epsilon = max(1e-3, 0.5 * abs(least)) if least < 0.0 else 1e-2
        points = search.descend(points, PNorm(2, 1, epsilon), _STAGE_ITERATIONS)
        least = determinants(points, search.region.simplices).min()
        if search.minimum >= search.target:
            break
    return points, bool(least > 0.0)


def reach(points: NDArray[np.float64], mesh: TrialMesh, target: float) -> Polished:
    """Free the nodes of the cells below a threshold, and more of them only while it is not met.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
    mesh : TrialMesh
    target : float
        Quality that every cell shall reach.
    """
    n, n_free = len(points), int(np.count_nonzero(~mesh.held))
    quality = mesh.quality(points)
    margin, rings, iterations, history = 1.0, 0, 0, []
    marked = np.zeros(n, dtype=bool)
    freed = 0
    while quality.min() < target:
        marked |= nodes_of_cells(mesh.cells, quality < margin * target, n)
        free = grow(mesh.cells, marked, rings) & ~mesh.held
        if np.count_nonzero(free) > _ALL * n_free:
            free = ~mesh.held
        if not free.any():
            break
        region = mesh.free(free)
        polished = polish(points, mesh, region, target=target)
        points, freed, iterations = polished.points, region.n_free, iterations + polished.iterations
        history += polished.history
        quality = mesh.quality(points)
        if freed == n_free:
            break
        margin, rings = _MARGIN, max(1, 2 * rings)
    return Polished(points, float(quality.min()), freed, iterations, tuple(history))
