"""What a method accepts: how far it corrects, what it refuses or warns of, and which part of a refusal would do."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from mesh_motion_server.errors import NumericalError
from mesh_motion_server.numerics.correction_problem import CorrectionSettings
from mesh_motion_server.numerics.method import Method
from mesh_motion_server.numerics.quality_summary import Judgement

__all__ = [
    "correction_settings",
    "largest_accepted",
    "quality_warnings",
    "quick_method",
    "reduction_warnings",
    "refuse_unacceptable",
]

#: Halvings of the search for the largest valid fraction of a refused displacement: known to 1/2⁵ ≈ 3 %.
_FRACTION_HALVINGS = 5
_JUST_VALID = 0.01  # a threshold: a mesh that is barely valid is no help for the step that follows


def correction_settings(method: Method, enrichment_radius: float) -> CorrectionSettings:
    """What a method asks of its correction; ``enrichment_radius`` in mesh length units."""
    return CorrectionSettings(
        correction=method.correction,
        quality_metric=method.quality_metric,
        quality_threshold=method.quality_threshold,
        target=method.correction_target,
        enrichment_radius=enrichment_radius,
        max_enrichment_points=method.max_enrichment_points,
        enrichment_function=method.enrichment_function,
        enrichment_placement=method.enrichment_placement,
        explicit_decomposition=method.explicit_decomposition,
        in_time=method.correction_in_time,
    )


def refuse_unacceptable(method: Method, quality: Judgement, reached: bool) -> None:
    """Refuse an inverted mesh, or one that has not ``reached`` the threshold where that is not wanted.

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
    """What is kept although it is not as it should be."""
    name, threshold = method.quality_metric, method.quality_threshold
    found = []
    if quality.inverted:
        found.append(f"{quality.inverted} inverted cells kept, as allow_invalid asks")
    if not reached:
        found.append(f"minimum {name} {quality.metric.min:.4g} stays below the threshold {threshold:.4g}")
    return found


def reduction_warnings(method: Method, error: float, control_points: int) -> list[str]:
    """Of an ``error`` (a share of the largest displacement) that a reduction left above its tolerance."""
    if error <= method.reduction_tolerance:
        return []
    return [
        f"reduction {method.reduction!r} left an error of {error:.2g} of the largest displacement with "
        f"{control_points} control points; it was corrected near the surface"
    ]


def quick_method(method: Method) -> Method:
    """The method with a correction that goes no further than what makes a motion acceptable.

    Where a mesh below the threshold is accepted, that is any valid one, which frees the nodes of inverted cells only.
    """
    threshold = method.quality_threshold if method.refuse_below_threshold else _JUST_VALID
    return replace(
        method,
        correction_target="threshold",
        correction_in_time="independent",
        quality_threshold=min(threshold, method.quality_threshold),
    )


def largest_accepted(quickly: Callable[[float], bool], accepts: Callable[[float], bool]) -> float:
    """Largest tested fraction of a displacement that is accepted; 0 if none is.

    By bisection with the trials of ``quickly``; what that ends at is taken back until ``accepts`` has it too.
    """
    low, high = 0.0, 1.0
    for _ in range(_FRACTION_HALVINGS):
        middle = 0.5 * (low + high)
        if quickly(middle):
            low = middle
        else:
            high = middle
    back = high - low
    while low > 0.0 and not accepts(low):
        low, back = max(low - back, 0.0), 2.0 * back
    return low
