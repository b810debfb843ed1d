"""Radii that are not given: from the mesh, and the support radius, where asked, from each motion.

The second predicts the motion with several radii and takes the best.

Each motion is judged by itself, so that it depends on the model, the committed points and the targets as with a single
radius: a resumed session, a repeated step and the other order of the coupling iterations give the same bits. From the
reference mesh ("absolute") each radius is factorized once; otherwise once a step. Every motion is interpolated and
predicted as often as there are radii, and nodes jump where another one becomes the best. The mesh's own radius
therefore stays until another is clearly better: small motions, which no radius tells apart, never leave it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.numerics.interpolation.factor_source import Recorded
from mesh_motion_server.numerics.interpolation.support_radius import (
    candidate_support_radii,
    suggest_enrichment_radius,
    suggest_support_radius,
)
from mesh_motion_server.numerics.mesh.roles import BoundaryRoles
from mesh_motion_server.numerics.method import Method
from mesh_motion_server.numerics.motion.standard_motion import StandardMotion, StandardTrial
from mesh_motion_server.numerics.quality.quality_summary import Judgement

__all__ = ["PredictedMotion", "best_predicted", "with_other_radii", "with_radii"]

#: Of the larger minimum quality: what another radius has to gain.
_CLEARLY = 0.02


@dataclass(frozen=True, eq=False)
class PredictedMotion:
    """A standard motion and what it is predicted to give.

    Attributes
    ----------
    motion : StandardMotion
    trial : StandardTrial
    quality : Judgement
    factors : Recorded
        What was found in the cache for it.
    """

    motion: StandardMotion
    trial: StandardTrial
    quality: Judgement
    factors: Recorded


def with_radii(method: Method, points: NDArray[np.float64], roles: BoundaryRoles) -> Method:
    """The method with the radii that it leaves to us chosen from the mesh with nodes at ``points`` (n, d)."""
    radius = method.support_radius
    if radius is None:
        radius = suggest_support_radius(points, roles)
    enrichment_radius = method.enrichment_radius
    if enrichment_radius is None:
        enrichment_radius = suggest_enrichment_radius(points, roles, radius)
    return replace(method, support_radius=radius, enrichment_radius=enrichment_radius)


def with_other_radii(motion: StandardMotion, enrichment_radius: float | None) -> tuple[StandardMotion, ...]:
    """The standard motion with the mesh's other candidates for the support radius, descending.

    Their enrichment radius is ``enrichment_radius``, mesh length unit, or by default the motion's own, at most R.
    """
    method = motion.method
    own = float(method.enrichment_radius or 0.0)
    return tuple(
        replace(
            motion,
            method=replace(method, support_radius=radius, enrichment_radius=enrichment_radius or min(own, radius)),
            plans=motion.plans.with_support_radius(radius),
        )
        for radius in candidate_support_radii(motion.reference, motion.roles, float(method.support_radius or 0.0))
    )


def best_predicted(candidates: Sequence[PredictedMotion]) -> PredictedMotion:
    """The first, unless the minimum quality of another is clearly above it: then the best of all."""
    first = candidates[0]
    best = max(candidates, key=lambda candidate: candidate.quality.metric.min)  # the first of equals
    before, after = first.quality.metric.min, best.quality.metric.min
    return best if after - before > _CLEARLY * max(abs(before), abs(after)) else first
