"""The strongest correction: trial positions of nodes are freed and moved to raise the mesh's worst quality.

The boundary is held in the positions of the motion; no node of the mesh has moved yet. :func:`polish` frees a region
and follows a continuation from a mild p-mean of the distortion to a sharp one with projected Gauss–Newton iterations
(:mod:`.newton`). If cells are inverted it untangles first, and measures the corners of cells against the reference
mesh. In a valid mesh it measures whole cells with the metric, which for quads and hexahedra gives up to twice the
quality. :func:`reach` frees only the nodes of the bad cells and grows the region until the threshold is met, so the
cost depends on the bad region and not on the mesh.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.correction.boundary_constraint import BoundaryConstraint, RegionConstraint
from mesh_motion_numerics.correction.distortion import PNorm, determinants
from mesh_motion_numerics.correction.free_region import FreeRegion, free_region, grow, nodes_of_cells
from mesh_motion_numerics.correction.linked_unknowns import StepSolver
from mesh_motion_numerics.correction.newton import Accuracy, newton
from mesh_motion_numerics.correction.part_of_mesh import Elsewhere
from mesh_motion_numerics.correction.region_measure import RegionMeasure
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.metrics import AtRest, CellQuality, cell_quality, subset_quality

LEVELS = tuple(PNorm(p, m, of="cells") for p, m in ((2, 1), (8, 2), (24, 4), (60, 8), (150, 16), (400, 40)))
"""Continuation: with a sharper start, or half the iterations a level, the result has a third of the quality."""

SIZE_WEIGHTS = {
    "size-skew": 0.5,
    "size-skew-root": 1.0,
    "size-skew-product": 1.0,
    "size": 1.0,
    "skew": 0.01,
    "relative-size-skew": 0.5,
}
"""Weight of the size in the distortion, for each metric that judges."""

LAST_LEVEL = PNorm(1000, 100, of="cells")
"""One more level, if the maximum is wanted for a region small enough for :data:`EXACTING`."""

EXACTING = Accuracy(full_step_gain=1e-4, least_decrement=1e-4, least_gain=1e-6)
"""It takes 1.8 times the time for 0.5 % of the maximum on average, 1 % and up to 4 % if cells are not simplices."""

_MILD_GAIN = 0.02  # over p: a full step with a smaller gain ends a mild p-mean, the start of sharper ones
_LEVEL_ITERATIONS = 24  # with 12 a half-turned body among 11 000 triangles ends at 0.20 instead of 0.46, no sooner
_EXACTING_UNKNOWNS = 10_000  # twice the time: tetrahedra 1 s, hexahedra 7 s
_UNTANGLED = 1e-2  # smallest determinant for the barrier; nearer to 0 the barrier's steps stay short
_VALID = 1e-3  # determinant that untangling must reach before it may stop because of a small gain
_SLOW = 1.5
_STAGES, _STAGE_ITERATIONS = 25, 4
_STALL = 0.85  # if untangling keeps more than this share of the least determinant over two stages, it will not succeed
_EARLY_RISE, _TAIL = 1.5, 0.65  # largest gain of the remaining levels: after the second level, after a later one
MARGIN = 1.15  # a region that failed grows by the cells that are nearly bad
_LEAST_GROWTH, _MOST_GROWTH = 1.4, 3.0
_ALL = 0.6  # above this share of the free nodes a region saves nothing: free all nodes
_TINY = 1e-300


class Stage(NamedTuple):
    """One minimised p-mean: its norm, free nodes and iterations, and the smallest quality so far."""

    norm: PNorm
    free: int
    iterations: int
    minimum: float


@dataclass(frozen=True, eq=False)
class TrialMesh:
    """The input of a correction: the mesh, its held nodes, and the metric that judges it."""

    #: (n, d), mesh length unit. Nodes of the reference mesh, the ideal shape of cells that are not simplices.
    reference: Floats
    cells: CellTable
    reference_sizes: AtRest  # (m,), length^d, or CellsAtRest
    held: Marks  # (n,). Nodes that must not move
    metric: str = "size-skew"  # One of :data:`~mesh_motion_numerics.quality.metrics.QUALITY_METRICS`
    #: The constraint of nodes that are not held but may move only with restrictions.
    constraint: BoundaryConstraint | None = None
    elsewhere: Elsewhere | None = None  # The rest of the mesh, if this is a region of it

    @property
    def may_move(self) -> int:
        """Number of nodes that are not held, of the whole mesh."""
        return int(np.count_nonzero(~self.held)) + (0 if self.elsewhere is None else self.elsewhere.free)

    def released(self, constraint: BoundaryConstraint | None) -> TrialMesh:
        """The mesh in which the nodes that a constraint releases are no longer held."""
        if constraint is None:
            return self
        return replace(self, held=self.held & ~constraint.released, constraint=constraint)

    def quality(self, points: Floats) -> Floats:
        """The metric (m,) of every cell; negative where a cell is inverted."""
        return signed(self.cell_quality(points), self.metric)

    def cell_quality(self, points: Floats) -> CellQuality:
        """Size, skew and validity of every cell."""
        return cell_quality(points, self.cells, self.reference_sizes)

    def quality_of(self, points: Floats, numbers: Integers) -> Floats:
        """The metric of the cells with the numbers (k,), in the form of :meth:`quality`."""
        return signed(subset_quality(points, self.cells, self.reference_sizes, numbers), self.metric)

    def free(self, marked: Marks) -> FreeRegion:
        """The region in which the marked (n) nodes and those tied to them are free, except held nodes."""
        marked = marked if self.constraint is None else self.constraint.closed(marked)
        free = marked & ~self.held
        if self.elsewhere is not None:
            self.elsewhere.require_here(free)
        return free_region(self.reference, self.cells, self.reference_sizes, free)


def signed(quality: CellQuality, metric: str) -> Floats:
    """The metric (m,) of cells; negative where any corner is inverted, whatever the metric says."""
    values = quality.metric(metric)
    return np.where(quality.inverted, np.minimum(-np.abs(values), -_TINY), values)


def region_quality(points: Floats, region: FreeRegion, metric: str) -> Floats:
    """The metric (k,) of the cells of a region at its local points (l, d)."""
    return signed(cell_quality(points, region.cells, region.reference_sizes), metric)


@dataclass(frozen=True, eq=False)
class Polished:
    """Corrected trial positions."""

    points: Floats  # (n, d), mesh length unit
    #: Smallest quality over the mesh (in :func:`polish`: over the region); negative if the mesh stays tangled.
    minimum: float
    freed: int = 0  # Number of nodes that were free at the end
    iterations: int = 0
    history: tuple[Stage, ...] = ()
    forecast: float = math.inf  # Estimate of the quality after all levels, if some were skipped
    quality: Floats | None = None  # (m,), of :func:`reach` only. The metric of every cell at ``points``


@dataclass(eq=False)
class _Search:
    """The best positions (l, d) seen in a region, judged by the true quality."""

    region: FreeRegion
    metric: str
    target: float
    points: Floats
    solve: StepSolver | None = None
    constraint: RegionConstraint | None = None
    measure: RegionMeasure | None = None
    minimum: float = -math.inf
    history: list[Stage] = field(default_factory=list)

    def judge(self, points: Floats) -> bool:
        """Keep the points if they are better; return whether the target is met."""
        quality = region_quality(points, self.region, self.metric)
        if quality.min() > self.minimum:
            self.points, self.minimum = points, float(quality.min())
        return self.met

    @property
    def met(self) -> bool:
        return self.minimum >= self.target

    @property
    def exacting(self) -> bool:
        """Whether the exact maximum is the target, nodes move freely, and there are few of them."""
        unknowns = self.region.n_free * self.points.shape[1]
        return self.solve is None and math.isinf(self.target) and unknowns <= _EXACTING_UNKNOWNS

    def accuracy(self, norm: PNorm) -> Accuracy:
        """The criterion for the end of the descent of one p-mean."""
        if self.exacting and not norm.epsilon:
            return EXACTING
        rough = Accuracy()
        return rough if norm.epsilon else replace(rough, full_step_gain=max(rough.full_step_gain, _MILD_GAIN / norm.p))

    def descend(self, points: Floats, norm: PNorm, iterations: int) -> Floats:
        """Run Newton iterations with one p-mean; judge the points during them and at the end."""
        norm = replace(norm, size_weight=SIZE_WEIGHTS[self.metric])
        result = newton(
            points,
            self.region,
            norm,
            iterations=iterations,
            good_enough=self.judge,
            solve=self.solve,
            constraint=self.constraint,
            accuracy=self.accuracy(norm),
            earlier=self.measure,
        )
        self.measure = result.measure
        self.judge(result.points)
        self.history.append(Stage(norm, self.region.n_free, result.iterations, self.minimum))
        return result.points

    def forecast(self) -> float:
        """Estimate the quality that the sharper p-means will reach, from the levels so far; inf before the second."""
        reached = [stage.minimum for stage in self.history if stage.norm.epsilon == 0.0]
        if len(reached) < 2:
            return math.inf
        if len(reached) == 2:
            return _EARLY_RISE * reached[-1]
        return reached[-1] + _TAIL * (reached[-1] - reached[-2])


def polish(
    points: Floats,
    mesh: TrialMesh,
    region: FreeRegion,
    *,
    target: float = math.inf,
    thorough: bool = True,
    solve: StepSolver | None = None,
) -> Polished:
    """Raise the worst quality of a region.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
        Trial positions of all nodes.
    region : FreeRegion
        From ``mesh.free``.
    target : float
        Stop as soon as every cell of the region is at least this good.
    thorough : bool
        Run all levels, even if they will not reach the target.
    solve : StepSolver, optional
        Restricts the steps to a space of displacements; by default every free node moves on its own.

    Returns
    -------
    Polished
        The best of all positions found, including the given ones; nodes that are not free keep their bits.
    """
    constraint = None if mesh.constraint is None else mesh.constraint.of(region)
    search = _Search(region, mesh.metric, target, points[region.nodes], solve, constraint)
    barrier = search.judge(search.points) or _descend_all(search, thorough)
    moved = points.copy()
    moved[region.free] = search.points[: region.n_free]
    iterations = sum(stage.iterations for stage in search.history)
    forecast = search.forecast() if barrier else search.minimum
    return Polished(moved, search.minimum, region.n_free, iterations, tuple(search.history), forecast)


def _descend_all(search: _Search, thorough: bool) -> bool:
    """Untangle, then run all useful levels; return whether the barrier could be used."""
    local, barrier = _untangle(search, search.points)
    levels = (*LEVELS, LAST_LEVEL) if search.exacting else LEVELS
    for norm in levels if barrier else ():
        if search.met or (not thorough and search.forecast() < search.target):
            break
        local = search.descend(local, norm, _LEVEL_ITERATIONS)
    return barrier


def untangle(points: Floats, region: FreeRegion, metric: str) -> Floats:
    """Positions (l, d) of a region with positive determinants, or the last positions tried if that fails."""
    return _untangle(_Search(region, metric, math.inf, points), points)[0]


def _untangle(search: _Search, points: Floats) -> tuple[Floats, bool]:
    """Untangled positions (l, d), and whether all determinants are positive."""
    least = [float(determinants(points, search.region.simplices).min())]
    while least[-1] <= _UNTANGLED and len(least) <= _STAGES and not search.met:
        if len(least) > 3 and least[-1] < _STALL * least[-3] < 0.0:
            break
        if len(least) > 1 and _VALID < least[-1] < _SLOW * least[-2]:
            break
        epsilon = max(1e-3, 0.5 * abs(least[-1])) if least[-1] < 0.0 else 1e-2
        points = search.descend(points, PNorm(2, 1, epsilon), _STAGE_ITERATIONS)
        least.append(float(determinants(points, search.region.simplices).min()))
    return points, least[-1] > 0.0


def reach(
    points: Floats, mesh: TrialMesh, target: float, *, most: float = math.inf, quality: Floats | None = None
) -> Polished:
    """Free the nodes of the cells below a threshold, and more nodes only while it is not met.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
    target : float
        Quality that every cell must reach.
    most : float
        Largest number of freed nodes; if more are needed, the best result so far is returned.
    quality : (m,) array, optional
        The metric of every cell at ``points``, if it is known.

    Notes
    -----
    The first region has neither rings of neighbours nor a margin: both are expensive and often not needed. The next
    region is larger by the factor by which the first result was below the target.
    """
    may_move = ~mesh.held
    quality = mesh.quality(points) if quality is None else quality
    best = Polished(points, float(quality.min()))
    bad = nodes_of_cells(mesh.cells, quality < target, len(points))
    free = bad & may_move
    while best.minimum < target and free.any():
        count = int(np.count_nonzero(free))
        if count > most:
            break
        everything = count > _ALL * mesh.may_move or count <= best.freed  # too large, or cannot grow
        region = mesh.free(may_move if everything else free)
        found = polish(best.points, mesh, region, target=target, thorough=everything)
        now = quality.copy()
        now[region.cell_numbers] = region_quality(found.points[region.nodes], region, mesh.metric)
        bad |= nodes_of_cells(mesh.cells, np.minimum(quality, now) < MARGIN * target, len(points))
        quality = now if now.min() > best.minimum else quality
        best = _better(best, found, float(now.min()))
        if everything:
            break
        growth = _MOST_GROWTH if found.forecast <= 0.0 else target / found.forecast
        free = _grown(mesh, free | (bad & may_move), min(max(growth, _LEAST_GROWTH), _MOST_GROWTH) * region.n_free)
    return replace(best, quality=quality)


def _better(best: Polished, found: Polished, minimum: float) -> Polished:
    """The better positions of the two, with the iterations and history of both."""
    if minimum > best.minimum:
        best = replace(best, points=found.points, minimum=minimum)
    return replace(
        best, freed=found.freed, iterations=best.iterations + found.iterations, history=best.history + found.history
    )


def _grown(mesh: TrialMesh, marked: Marks, least: float) -> Marks:
    """Add rings of neighbours, at least one, until ``least`` nodes are free."""
    while True:
        larger = grow(mesh.cells, marked, 1) & ~mesh.held
        if np.count_nonzero(larger) >= least or np.array_equal(larger, marked):
            return larger
        marked = larger
