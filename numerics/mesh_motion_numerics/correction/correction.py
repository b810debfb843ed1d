"""The correction of a predicted motion, by name: nothing, the thesis' methods, optimised enrichment, freed trial nodes.

The correction runs between "predict" and "displace": it takes the node positions of the standard motion and returns
better ones. Held nodes keep their standard positions bitwise, and no node of the mesh has moved yet.

==================  =====================================================================================
none                the standard motion, without regard to its quality
imposed-gradient    thesis chapter 4, in 1D: :mod:`.enrichment.imposed_gradient`; thesis §5.1.2, in 2D and 3D:
                    :mod:`.enrichment.imposed_jacobian`
explicit            thesis Algorithm 1: one enrichment point after the other, :mod:`.enrichment.explicit_iterations`
enrichment          all coefficients of all points at once: :mod:`.enrichment.coefficients`
optimised           trial nodes freed as needed: :mod:`.trial_nodes`; in 1D the exact optimum: :mod:`.equal_stretch`
==================  =====================================================================================

These corrections use a threshold and a target, and treat each motion separately. ``correction = "smooth"`` is in
another module (:mod:`.smooth_motion`): its mesh is a smooth function of the boundary.

``optimised`` frees nodes and does not start with an enrichment: from plain RBF positions the freed nodes reach the
threshold in less time than the setup of an enrichment takes, at every measured size, and end at a better quality.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from mesh_motion_protocol.errors import QualityRefused

from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.blas import one_blas_thread
from mesh_motion_numerics.correction.correction_problem import SMALL_MESH, CorrectionProblem, goal, target_quality
from mesh_motion_numerics.correction.enrichment.coefficients import optimised_enrichment, optimised_placement
from mesh_motion_numerics.correction.enrichment.explicit_iterations import ExplicitSettings, explicit_iterations
from mesh_motion_numerics.correction.enrichment.imposed_gradient import ImposedGradient, enriched_displacement
from mesh_motion_numerics.correction.enrichment.imposed_jacobian import ImposedSettings, imposed_jacobians
from mesh_motion_numerics.correction.enrichment.placement import gap_middle
from mesh_motion_numerics.correction.enrichment.space import EnrichmentSpace
from mesh_motion_numerics.correction.equal_stretch import equal_stretch
from mesh_motion_numerics.correction.free_region import cells_of_nodes
from mesh_motion_numerics.correction.part_of_mesh import Elsewhere
from mesh_motion_numerics.correction.trial_nodes import Polished, TrialMesh, polish, reach, signed
from mesh_motion_numerics.interpolation.kernels import basis_named, checked_radius
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.quality.metrics import CellQuality
from mesh_motion_numerics.quality.quality_summary import smallest

_WORST = 10  # number of cells that a refusal names
#: A large mesh is raised to this multiple of the threshold if that is cheap: it leaves a margin for the next step.
_AMPLE = 2.5
#: A quality change by less than this factor does not count.
_NOTICED = 1.01


@dataclass(frozen=True, eq=False)
class Correction:
    """The result of the correction."""

    points: Floats  # (n, d), mesh length unit. Corrected trial positions
    enrichment_points: Floats  # (K, d), mesh length unit
    freed_nodes: int = 0  # Number of trial nodes that moved individually
    iterations: int = 0
    method: str = "none"  # "none" if the standard motion was not changed, otherwise the correction
    #: Smallest quality of all cells; negative where a cell is inverted (only with correction "none").
    minimum: float = float("nan")
    reached: bool = False  # Whether the minimum is at or above the threshold
    #: Quality of every cell at ``points``; None if only the minimum was needed and known.
    quality: CellQuality | None = None
    warnings: tuple[str, ...] = ()


def correct(problem: CorrectionProblem, method: Method) -> Correction:
    """Correct a predicted motion if it is below the threshold.

    Raises QualityRefused if no valid mesh was found; carries the best minimum quality found and the worst cells.

    Parameters
    ----------
    method : Method
        The method, with its enrichment radius set.
    """
    p = problem
    reference = p.start if p.reference is None else p.reference
    mesh = TrialMesh(reference, p.cells, p.reference_sizes, p.held, method.quality_metric, elsewhere=p.elsewhere)
    unchanged = Correction(p.begin, p.begin[:0])
    if p.known is not None and p.valid is None and (method.correction == "none" or p.known >= goal(method)):
        return _judged(unchanged, method, p.known)
    before = mesh.cell_quality(p.begin)
    quality = signed(before, mesh.metric)
    least = float(quality.min())
    if method.correction == "none" or (p.valid is None and least >= goal(method)):
        return _judged(unchanged, method, least, before)
    found = unchanged
    if p.valid is None or method.correction == "optimised":
        with one_blas_thread():
            found = CORRECTIONS[method.correction](problem, method, mesh, quality)
    after = before if found.points is p.begin else mesh.cell_quality(found.points)
    corrected = signed(after, mesh.metric)
    # a method may fail or lower the quality: then the mesh stays as it was
    gain = float(corrected.min() / least) if least > 0.0 else math.inf
    if corrected.min() < least or (least > 0.0 and spoils(before, after, mesh.metric, gain, p.elsewhere)):
        found, after, corrected = unchanged, before, quality
    if not corrected.min() > 0.0:
        raise _refusal(corrected, method)
    return _judged(replace(found, method=method.correction), method, float(corrected.min()), after)


def _judged(found: Correction, method: Method, minimum: float, quality: CellQuality | None = None) -> Correction:
    """Return the correction, with the smallest quality of its mesh."""
    return replace(found, minimum=minimum, reached=minimum >= method.quality_threshold, quality=quality)


def _refusal(quality: Floats, method: Method) -> QualityRefused:
    """The error for a mesh that stays invalid, with its quality (m,)."""
    worst = smallest(quality, _WORST)
    inverted = int(np.count_nonzero(~(quality > 0.0)))
    return QualityRefused(
        f"no valid mesh found: {inverted} inverted cells, best minimum {method.quality_metric} "
        f"{float(quality[worst[0]]):.4g}, correction {method.correction!r}",
        best=float(quality[worst[0]]),
        cells=worst.tolist(),
        hint="take a smaller step",
    )


def _optimised(problem: CorrectionProblem, method: Method, mesh: TrialMesh, quality: Floats) -> Correction:
    """Free trial nodes: all nodes for the maximum, a growing region for the threshold."""
    if problem.start.shape[1] == 1:
        freed = int(np.count_nonzero(~mesh.held))
        points = equal_stretch(problem.begin, mesh)
        return Correction(points, points[:0], freed)
    found = _with_trial_nodes(problem, method, mesh.released(problem.constraint), quality)
    walls = problem.constraint if problem.constraint is not None and problem.constraint.sliding is not None else None
    if found is not None and walls is not None and found.minimum < method.quality_threshold:
        # nodes on a curved wall can stop the iterations early
        held = mesh.released(walls.with_walls_held())
        alone = _with_trial_nodes(problem, method, held, quality) or found
        found = max(found, alone, key=lambda one: one.minimum)
    if found is None:
        return Correction(problem.begin, problem.begin[:0])
    return Correction(found.points, found.points[:0], found.freed, found.iterations)


def _with_trial_nodes(problem: CorrectionProblem, method: Method, mesh: TrialMesh, quality: Floats) -> Polished | None:
    """Free trial nodes of a mesh with this quality (m,); None if this cannot make it valid."""
    if mesh.held.all() or not _could_be_valid(mesh, quality):
        return None
    target = target_quality(problem, method)
    if not np.isfinite(target):
        return polish(problem.begin, mesh, mesh.free(~mesh.held))
    found = reach(problem.begin, mesh, target, quality=quality)
    if method.correction_target is None and mesh.metric == "relative-size-skew" and found.minimum >= target:
        return _raised(found, mesh, _AMPLE * target)
    return found


def _raised(found: Polished, mesh: TrialMesh, target: float) -> Polished:
    """Raise a mesh that meets the threshold towards a higher target, as far as is possible with few free nodes."""
    most = SMALL_MESH[mesh.reference.shape[1]]
    more = reach(found.points, mesh, target, most=most, quality=found.quality)
    if not more.minimum > found.minimum:
        return found
    return replace(
        more,
        freed=max(found.freed, more.freed),
        iterations=found.iterations + more.iterations,
        history=found.history + more.history,
    )


def spoils(
    before: CellQuality, after: CellQuality, metric: str, gain: float = 1.0, elsewhere: Elsewhere | None = None
) -> bool:
    """Whether the smallest relative skew or size falls by more than the factor ``gain``."""
    if metric != "relative-size-skew":
        return False
    others = (math.inf, math.inf) if elsewhere is None else elsewhere.extremes
    extremes = zip(before.relative_extremes(), after.relative_extremes(), others, strict=True)
    return any(min(own, other) > max(gain, _NOTICED) * min(new, other) for own, new, other in extremes)


def _could_be_valid(mesh: TrialMesh, quality: Floats) -> bool:
    """Whether all cells without a free node are valid by the quality (m,): no correction can repair such cells."""
    return bool((quality[~cells_of_nodes(mesh.cells, ~mesh.held)] > 0.0).all())


def _enrichment(problem: CorrectionProblem, method: Method, mesh: TrialMesh, quality: Floats) -> Correction:
    """Enrichment points with all coefficients optimised."""
    if method.max_enrichment_points == 0:
        return Correction(problem.standard, problem.standard[:0])
    p, count, radius = problem, method.max_enrichment_points, _radius(method)
    placement = optimised_placement(p.start, p.cells, quality, count=count, radius=radius)
    space = EnrichmentSpace(placement, p.factorization)
    found = optimised_enrichment(mesh, p.start, p.standard, space, target=target_quality(problem, method))
    return Correction(found.points, placement.points, iterations=found.iterations)


def _explicit(problem: CorrectionProblem, method: Method, mesh: TrialMesh, quality: Floats) -> Correction:
    """The thesis' explicit iterations."""
    del quality
    settings = ExplicitSettings(
        enrichment_radius=_radius(method),
        threshold=method.quality_threshold,
        max_points=method.max_enrichment_points,
        metric=mesh.metric,
    )
    found = explicit_iterations(problem, settings)
    return Correction(found.points, found.enrichment_points, iterations=len(found.history) - 1)


def _imposed_gradient(problem: CorrectionProblem, method: Method, mesh: TrialMesh, quality: Floats) -> Correction:
    """The thesis' imposed gradient: of the boundary's straight line in 1D, of corrected cells in 2D and 3D."""
    if problem.cells.dimension == 1:
        return _imposed_slope(problem, method, quality)
    radius, most = _radius(method), method.max_enrichment_points
    settings = ImposedSettings(enrichment_radius=radius, threshold=goal(method), max_points=most)
    found = imposed_jacobians(problem, mesh, settings)
    return Correction(found.points, found.enrichment_points, iterations=len(found.minima) - 1)


def _imposed_slope(problem: CorrectionProblem, method: Method, quality: Floats) -> Correction:
    """Thesis chapter 4: a point in the middle of the gap that holds the worst cell."""
    p = problem
    boundary = np.flatnonzero(p.held)
    points = gap_middle(p.start, p.cells, quality, p.held)
    support = checked_radius(method.support_radius, basis_named(method.basis))
    radii = ImposedGradient(support, _radius(method), basis=method.basis)
    displacement = p.standard[boundary] - p.start[boundary]
    moved = p.start + enriched_displacement(p.start, p.start[boundary], displacement, points, radii)
    moved[boundary] = p.standard[boundary]
    return Correction(moved, points, iterations=1)


def _radius(method: Method) -> float:
    """R_l, mesh length unit."""
    assert method.enrichment_radius is not None  # set when the mesh is prepared
    return method.enrichment_radius


CORRECTIONS: dict[str, Callable[[CorrectionProblem, Method, TrialMesh, Floats], Correction]] = {
    "imposed-gradient": _imposed_gradient,
    "explicit": _explicit,
    "enrichment": _enrichment,
    "optimised": _optimised,
}
"""Correction by name: from the quality (m,) of all cells where it begins; what it finds is judged afterwards."""
