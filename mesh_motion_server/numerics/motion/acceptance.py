"""What a method accepts: how far it corrects, what it refuses or warns of, which part of a refused motion it takes."""

from __future__ import annotations

import math
from collections.abc import Callable

from mesh_motion_server.errors import NumericalError
from mesh_motion_server.numerics.correction.correction_problem import CorrectionSettings
from mesh_motion_server.numerics.method import Method
from mesh_motion_server.numerics.quality.quality_summary import Judgement

__all__ = [
    "correction_settings",
    "largest_accepted",
    "quality_warnings",
    "reduction_warnings",
    "refuse_unacceptable",
]

#: Bisection steps of the search for the largest fraction that is valid without a correction: accurate to 1/2⁵ ≈ 3 %.
_HALVINGS = 5
#: Shares of the rest of the displacement beyond that fraction that are tried.
_SHARES = (0.7, 0.3)
_LEAST = 0.004


def correction_settings(method: Method, enrichment_radius: float) -> CorrectionSettings:
    """The correction settings of a method; ``enrichment_radius`` in mesh length units."""
    return CorrectionSettings(
        correction=method.correction,
        quality_metric=method.quality_metric,
        quality_threshold=method.quality_threshold,
        target=method.correction_target,
        enrichment_radius=enrichment_radius,
        max_enrichment_points=method.max_enrichment_points,
        in_time=method.correction_in_time,
    )


def refuse_unacceptable(method: Method, quality: Judgement, reached: bool) -> None:
    """Refuse an inverted mesh, or one below the threshold (not ``reached``) if the method does not accept that.

    Raises
    ------
    NumericalError
        With the best minimum quality and the worst cells.
    """
    worst = [cell.number for cell in quality.worst]
    name, best = method.quality_metric, quality.metric.min
    if quality.inverted and not method.allow_invalid:
        raise NumericalError(
            f"no valid mesh found: {quality.inverted} inverted cells, best minimum {name} {best:.4g}, "
            f"correction {method.correction!r}",
            best=best,
            cells=worst,
        )
    if not reached and method.refuse_below_threshold:
        raise NumericalError(
            f"minimum {name} {best:.4g} stays below the threshold {method.quality_threshold:.4g}",
            best=best,
            cells=worst,
        )


def quality_warnings(method: Method, quality: Judgement, reached: bool) -> list[str]:
    """Warnings about a mesh that is accepted although its quality is too low."""
    name, threshold = method.quality_metric, method.quality_threshold
    found = []
    if quality.inverted:
        found.append(f"{quality.inverted} inverted cells kept, as allow_invalid asks")
    if not reached:
        found.append(f"minimum {name} {quality.metric.min:.4g} stays below the threshold {threshold:.4g}")
    return found


def reduction_warnings(method: Method, error: float, control_points: int) -> list[str]:
    """A warning if a reduction left an ``error`` (a share of the largest displacement) above its tolerance."""
    if error <= method.reduction_tolerance:
        return []
    return [
        f"reduction {method.reduction!r} left an error of {error:.2g} of the largest displacement with "
        f"{control_points} control points; it was corrected near the surface"
    ]


def largest_accepted(accepts: Callable[[float], bool], valid: Callable[[float], bool]) -> float:
    """The largest accepted fraction of a refused displacement among the few that are tried; 0 if none is accepted.

    Corrections are expensive, so only few fractions are tried: first between the largest fraction at which the motion
    is ``valid`` without a correction and 1, then from that fraction down.

    Returns
    -------
    float
        A multiple of a thousandth: exactly the fraction that was tried, so three digits print it exactly.
    """
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if valid(middle):
            low = middle
        else:
            high = middle
    tried = (low + share * (1.0 - low) for share in (*_SHARES, 0.0))
    for fraction in (math.floor(1000.0 * fraction) / 1000.0 for fraction in tried):
        if fraction > 0.0 and accepts(fraction):
            return fraction
    while low > _LEAST:
        low *= 0.5
        fraction = math.floor(1000.0 * low) / 1000.0
        if accepts(fraction):
            return fraction
    return 0.0
