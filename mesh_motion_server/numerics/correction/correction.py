"""The correction of a predicted motion, by name: nothing, the thesis' methods, optimised enrichment, freed trial nodes.

It runs between "predict" and "displace": it takes the node positions of the standard motion and returns better ones.
Held nodes keep their standard positions bitwise, and no node of the mesh has moved yet.

==================  =====================================================================================
none                the standard motion, whatever its quality
imposed-gradient    thesis chapter 4, in 1D: :mod:`.enrichment.imposed_gradient`; thesis §5.1.2, in 2D and 3D:
                    :mod:`.enrichment.imposed_jacobian`
explicit            thesis Algorithm 1: one enrichment point after the other, :mod:`.enrichment.explicit_iterations`
enrichment          all coefficients of all points at once: :mod:`.enrichment.coefficients`
optimised           trial nodes freed as needed: :mod:`.trial_nodes`; in 1D the exact optimum: :mod:`.equal_stretch`
==================  =====================================================================================

``in_time`` says how the corrections of successive motions are related: each one is independent and follows its
threshold and target ("independent"), or they are a smooth function of the boundary ("smooth", for ``optimised`` only:
:mod:`.smooth_in_time`).

``optimised`` frees nodes and does not start with an enrichment: from plain RBF positions the freed nodes reach the
threshold in less time than the setup of an enrichment takes, at every measured size, and end at a better quality.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.errors import NumericalError
from mesh_motion_server.numerics.blas import one_blas_thread
from mesh_motion_server.numerics.correction.correction_problem import (
    IN_TIME,
    SMALL_MESH,
    TARGETS,
    CorrectionProblem,
    CorrectionSettings,
    goal,
    target_quality,
)
from mesh_motion_server.numerics.correction.enrichment.coefficients import optimised_enrichment, optimised_placement
from mesh_motion_server.numerics.correction.enrichment.explicit_iterations import ExplicitSettings, explicit_iterations
from mesh_motion_server.numerics.correction.enrichment.imposed_gradient import ImposedGradient, enriched_displacement
from mesh_motion_server.numerics.correction.enrichment.imposed_jacobian import ImposedSettings, imposed_jacobians
from mesh_motion_server.numerics.correction.enrichment.placement import gap_middle
from mesh_motion_server.numerics.correction.enrichment.space import EnrichmentSpace
from mesh_motion_server.numerics.correction.equal_stretch import equal_stretch
from mesh_motion_server.numerics.correction.free_region import cells_of_nodes
from mesh_motion_server.numerics.correction.near_rest import NEAR_REST, leans, nearer_rest, raises, reshaped, spoils
from mesh_motion_server.numerics.correction.smooth_in_time import SmoothInTime, travel
from mesh_motion_server.numerics.correction.trial_nodes import Polished, Stage, TrialMesh, polish, reach, signed
from mesh_motion_server.numerics.quality.metrics import CellQuality

__all__ = [
    "CORRECTIONS",
    "IN_TIME",
    "TARGETS",
    "Correction",
    "CorrectionProblem",
    "CorrectionSettings",
    "correct",
]

Floats = NDArray[np.float64]

_WORST = 10  # number of cells that a refusal names
#: A large mesh is raised to this multiple of the threshold if that is cheap: the next step uses up a smaller margin.
_AMPLE = 2.5


@dataclass(frozen=True, eq=False)
class Correction:
    """What the correction did.

    Attributes
    ----------
    points : (n, d) array, mesh length unit
        Corrected trial positions.
    method : str
        "none" if the standard motion was not changed, otherwise the correction.
    minimum : float
        Smallest quality of all cells; negative where a cell is inverted (only with correction "none").
    reached : bool
        Whether the minimum is at or above the threshold.
    enrichment_points : (K, d) array, mesh length unit
    freed_nodes : int
        Number of trial nodes that moved individually.
    iterations : int
    history : tuple of Stage
        The stages of the minimisation, if nodes were freed.
    quality : CellQuality or None
        Of every cell at ``points``; None if only the minimum was needed, and known.
    """

    points: Floats
    method: str
    minimum: float
    reached: bool
    enrichment_points: Floats
    freed_nodes: int = 0
    iterations: int = 0
    history: tuple[Stage, ...] = ()
    quality: CellQuality | None = None


@dataclass(frozen=True, eq=False)
class _Found:
    """The result of a method; the mesh is judged afterwards."""

    points: Floats
    enrichment_points: Floats | None = None
    freed_nodes: int = 0
    iterations: int = 0
    history: tuple[Stage, ...] = ()


def correct(problem: CorrectionProblem, settings: CorrectionSettings) -> Correction:
    """Correct a predicted motion if it is below the threshold.

    Parameters
    ----------
    problem : CorrectionProblem
    settings : CorrectionSettings

    Raises
    ------
    NumericalError
        If no valid mesh was found; carries the best minimum quality found and the worst cells.
    """
    p = problem
    reference = p.start if p.reference is None else p.reference
    mesh = TrialMesh(reference, p.cells, p.reference_sizes, p.held, settings.quality_metric, elsewhere=p.elsewhere)
    if settings.in_time == "smooth":
        return _smooth_in_time(problem, settings, mesh)
    lifts = raises(problem, settings)
    enough = max(NEAR_REST, goal(settings)) if lifts else goal(settings)
    if p.known is not None and p.valid is None and (settings.correction == "none" or p.known >= enough):
        return _judged(problem, settings, _Found(p.begin), "none", p.known)
    before = mesh.cell_quality(p.begin)
    quality = signed(before, mesh.metric)
    least = float(quality.min())
    good = p.valid is None and least >= goal(settings)
    if settings.correction == "none" or (good and not (lifts and leans(problem, mesh, before))):
        return _judged(problem, settings, _Found(p.begin), "none", least, before)
    found = _Found(p.begin)
    if good:
        with one_blas_thread():
            found = _freed(nearer_rest(problem, mesh.released(p.constraint), before))
    elif p.valid is None or settings.correction == "optimised":
        with one_blas_thread():
            found = CORRECTIONS[settings.correction](problem, settings, mesh, quality)
    after = before if found.points is p.begin else mesh.cell_quality(found.points)
    corrected = signed(after, mesh.metric)
    # a method may fail or lower the quality: then the mesh stays as it was
    if not good and (
        corrected.min() < least
        or (least > 0.0 and spoils(before, after, mesh.metric, float(corrected.min() / least), p.elsewhere))
    ):
        found, after, corrected = _Found(p.begin), before, quality
    if not corrected.min() > 0.0:
        raise _refusal(corrected, settings)
    method = "none" if good and found.points is p.begin else settings.correction
    return _judged(problem, settings, found, method, float(corrected.min()), after)


def _smooth_in_time(problem: CorrectionProblem, settings: CorrectionSettings, mesh: TrialMesh) -> Correction:
    """The correction that is a smooth function of the boundary; the quality is judged but never switches it."""
    if mesh.held.all():
        quality = mesh.cell_quality(problem.standard)
        minimum = float(signed(quality, mesh.metric).min())
        return _judged(problem, settings, _Found(problem.standard), "none", minimum, quality)
    with one_blas_thread():
        smooth = problem.smooth or SmoothInTime.build(mesh)
        travelled = travel(mesh.reference, problem.standard, mesh.held)
        found = smooth.correct(problem.standard, travelled, problem.near, problem.valid)
    quality = mesh.cell_quality(found.points)
    corrected = signed(quality, mesh.metric)
    if not corrected.min() > 0.0:
        raise _refusal(corrected, settings)
    freed = _Found(found.points, None, found.freed, found.iterations, found.history)
    return _judged(problem, settings, freed, settings.correction, float(corrected.min()), quality)


def _judged(
    problem: CorrectionProblem,
    settings: CorrectionSettings,
    found: _Found,
    method: str,
    minimum: float,
    quality: CellQuality | None = None,
) -> Correction:
    """The correction, with the smallest quality of its mesh."""
    none = np.empty((0, problem.start.shape[1]))
    return Correction(
        points=found.points,
        method=method,
        minimum=minimum,
        reached=minimum >= settings.quality_threshold,
        enrichment_points=none if found.enrichment_points is None else found.enrichment_points,
        freed_nodes=found.freed_nodes,
        iterations=found.iterations,
        history=found.history,
        quality=quality,
    )


def _refusal(quality: Floats, settings: CorrectionSettings) -> NumericalError:
    """The error for a mesh that stays invalid, with its quality (m,)."""
    worst = np.argsort(quality, kind="stable")[:_WORST]
    inverted = int(np.count_nonzero(~(quality > 0.0)))
    return NumericalError(
        f"no valid mesh found: {inverted} inverted cells, best minimum {settings.quality_metric} "
        f"{float(quality[worst[0]]):.4g}, correction {settings.correction!r}",
        best=float(quality[worst[0]]),
        cells=worst.tolist(),
        hint="take a smaller step",
    )


def _optimised(problem: CorrectionProblem, settings: CorrectionSettings, mesh: TrialMesh, quality: Floats) -> _Found:
    """Free trial nodes: all for the maximum, a growing region for the threshold."""
    if problem.start.shape[1] == 1:
        return _Found(equal_stretch(problem.begin, mesh), freed_nodes=int(np.count_nonzero(~mesh.held)))
    mesh = mesh.released(problem.constraint)
    if mesh.held.all() or not _could_be_valid(mesh, quality):
        return _Found(problem.begin)
    target = target_quality(problem, settings)
    found: Polished
    if np.isfinite(target):
        found = reach(problem.begin, mesh, target, quality=quality)
        if settings.target == "auto" and mesh.metric == "relative-size-skew" and found.minimum >= target:
            found = _raised(found, mesh, _AMPLE * target)
    elif raises(problem, settings):
        found = reshaped(problem, mesh)
    else:
        found = polish(problem.begin, mesh, mesh.free(~mesh.held))
    return _freed(found)


def _freed(found: Polished) -> _Found:
    """The result of freeing nodes."""
    return _Found(found.points, None, found.freed, found.iterations, found.history)


def _raised(found: Polished, mesh: TrialMesh, target: float) -> Polished:
    """Raise a mesh that meets the threshold towards a higher target, as far as freeing few nodes allows."""
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


def _could_be_valid(mesh: TrialMesh, quality: Floats) -> bool:
    """Whether all cells without a free node, which no correction can repair, are valid by the quality (m,) of cells."""
    return bool((quality[~cells_of_nodes(mesh.cells, ~mesh.held)] > 0.0).all())


def _enrichment(problem: CorrectionProblem, settings: CorrectionSettings, mesh: TrialMesh, quality: Floats) -> _Found:
    """Enrichment points with all coefficients optimised."""
    if settings.max_enrichment_points == 0:
        return _Found(problem.standard)
    p, count, radius = problem, settings.max_enrichment_points, settings.enrichment_radius
    placement = optimised_placement(p.start, p.cells, quality, count=count, radius=radius)
    space = EnrichmentSpace(placement, p.factorization, p.evaluator)
    found = optimised_enrichment(mesh, p.start, p.standard, space, target=target_quality(problem, settings))
    return _Found(found.points, found.enrichment_points, 0, found.iterations)


def _explicit(problem: CorrectionProblem, settings: CorrectionSettings, mesh: TrialMesh, quality: Floats) -> _Found:
    """The thesis' explicit iterations."""
    del quality
    found = explicit_iterations(
        problem,
        ExplicitSettings(
            enrichment_radius=settings.enrichment_radius,
            threshold=settings.quality_threshold,
            max_points=settings.max_enrichment_points,
            metric=mesh.metric,
        ),
    )
    return _Found(found.points, found.enrichment_points, 0, len(found.history) - 1)


def _imposed_gradient(
    problem: CorrectionProblem, settings: CorrectionSettings, mesh: TrialMesh, quality: Floats
) -> _Found:
    """The thesis' imposed gradient: that of the boundary's straight line in 1D, of corrected cells in 2D and 3D."""
    p = problem
    if p.cells.dimension == 1:
        return _imposed_slope(problem, settings, quality)
    found = imposed_jacobians(
        problem,
        mesh,
        ImposedSettings(
            enrichment_radius=settings.enrichment_radius,
            threshold=goal(settings),
            max_points=settings.max_enrichment_points,
        ),
    )
    return _Found(found.points, found.enrichment_points, 0, len(found.minima) - 1)


def _imposed_slope(problem: CorrectionProblem, settings: CorrectionSettings, quality: Floats) -> _Found:
    """Thesis chapter 4: a point in the middle of the gap that holds the worst cell."""
    p = problem
    boundary = np.flatnonzero(p.held)
    points = gap_middle(p.start, p.cells, quality, p.held)
    support, basis = p.factorization.support_radius, p.factorization.basis.name
    radii = ImposedGradient(support, settings.enrichment_radius, basis=basis)
    displacement = p.standard[boundary] - p.start[boundary]
    moved = p.start + enriched_displacement(p.start, p.start[boundary], displacement, points, radii)
    moved[boundary] = p.standard[boundary]
    return _Found(moved, points, 0, 1)


CORRECTIONS: dict[str, Callable[[CorrectionProblem, CorrectionSettings, TrialMesh, Floats], _Found]] = {
    "imposed-gradient": _imposed_gradient,
    "explicit": _explicit,
    "enrichment": _enrichment,
    "optimised": _optimised,
}
"""Correction by name: from the quality (m,) of all cells where it begins; what it finds is judged afterwards."""
