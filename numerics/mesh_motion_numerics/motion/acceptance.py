"""The motions that a method accepts: refusals, warnings, and the accepted part of a refused motion."""

import math
from collections.abc import Callable

import numpy as np
from mesh_motion_protocol.errors import QualityRefused

from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.quality.quality_summary import Judgement

#: Accuracy of a fraction that a bisection finds, as a share of it: for an estimate, and for what takes longer to test.
#: They are not 1/64 and 1/32 because fractions are rounded down to thousandths.
_FINE, _COARSE = 1 / 60, 1 / 31
#: No smaller fraction is looked for.
_LEAST = 0.004
#: A fraction that is valid without a correction, and is enough even where steps are corrected anyway.
_ENOUGH = 0.25
#: Shares of the range between the largest fraction that is valid without a correction and the largest possible one, at
#: which a correction is tried.
_SHARES = (0.3, 0.7)
#: A fraction of the largest possible one, tried first: closer to it the correction takes many times as long.
_NEARLY = 0.95
#: As a share of the mesh's diagonal: a longer displacement is probably in another unit.
_FARTHEST = 2.0


def refuse_unacceptable(method: Method, quality: Judgement, reached: bool) -> list[str]:
    """Refuse an inverted mesh, or one below the threshold (not ``reached``) if the method does not accept that.

    Raises QualityRefused; the error has the best minimum quality and the worst cells.

    Returns
    -------
    list of str
        Warnings about a mesh that is accepted although its quality is too low.
    """
    name, threshold, best = method.quality_metric, method.quality_threshold, quality.metric.min
    if quality.inverted and not method.allow_invalid:
        raise QualityRefused(
            f"no valid mesh found: {quality.inverted} inverted cells, best minimum {name} {best:.4g}, "
            f"correction {method.correction!r}",
            best=best,
            cells=[cell.number for cell in quality.worst],
        )
    if not reached and method.refuse_below_threshold:
        raise QualityRefused(
            f"minimum {name} {best:.4g} stays below the threshold {threshold:.4g}",
            best=best,
            cells=[cell.number for cell in quality.worst],
        )
    found = []
    if quality.inverted:
        found.append(f"{quality.inverted} inverted cells are kept, because allow_invalid is set")
    if not reached:
        found.append(f"minimum {name} {best:.4g} stays below the threshold {threshold:.4g}")
    return found


def other_unit(points: Floats, displacement: Floats, nearest: float = 0.0) -> str:
    """Ask whether a displacement (k, d) is in the unit of the mesh (n, d), if it is far larger than the mesh.

    The question is also asked if the displacement is not 0 and smaller than the share ``nearest`` of the mesh's
    diagonal.
    """
    far = float(np.linalg.norm(displacement, axis=1).max(initial=0.0))
    extent = float(np.linalg.norm(np.ptp(points, axis=0)))
    if far == 0.0 or nearest * extent <= far <= _FARTHEST * extent:
        return ""
    return (
        f"the motion's largest displacement is {far:.3g} and the mesh's extent {extent:.3g}: "
        "do both have the same unit?"
    )


def largest_accepted(
    accepts: Callable[[float], bool],
    valid: Callable[[float], bool],
    possible: Callable[[float], bool],
    *,
    whole: bool,
    settled: Callable[[], bool],
    corrected: bool = True,
    expected: Callable[[float], bool] | None = None,
) -> float:
    """The largest accepted fraction of a refused displacement among the few that are tried; 0 if none is accepted.

    A motion that is ``valid`` without a correction is accepted, and is cheap to test. A correction takes as long as
    many answers, most of all one that finds no mesh. So if the boundary alone forbids the whole displacement, the
    result is the largest valid fraction, unless it is small because the committed mesh was corrected: then answers take
    long too, and a fraction just below the largest ``possible`` one is tried. If that is refused, or the boundary
    forbids nothing, a few fractions between the valid and the possible one are tried: the smallest first, until one is
    refused.

    Parameters
    ----------
    accepts, valid, possible : callable
        Fraction → whether the motion is accepted; whether it is accepted without a correction; whether a valid mesh may
        exist.
    whole : bool
        Whether the whole displacement is possible.
    settled : callable
        Whether the committed mesh needs no correction.
    corrected : bool
        Whether a motion that is not ``valid`` may be accepted.
    expected : callable, optional
        A cheap estimate of ``valid``.

    Returns
    -------
    float
        A multiple of a thousandth: exactly the fraction that was tried, so three digits print it exactly.
    """
    low = 0.0 if expected is None else _bisected(expected, 1.0, _FINE)
    if not low or not valid(low):
        low = _bisected(valid, low or 1.0, _COARSE) if valid(_LEAST) else 0.0
    if not corrected:
        return low
    most, shares = 1.0, list(_SHARES)
    if not whole:
        if low >= _ENOUGH or (low and settled()):
            return low
        most, shares = _bisected(possible, 1.0, _FINE), shares[:1]
        nearly = _thousandths(_NEARLY * most)
        if nearly > low and accepts(nearly):
            return nearly
    found = low
    for fraction in (_thousandths(low + share * (most - low)) for share in shares):
        if fraction <= low or not accepts(fraction):
            break
        found = fraction
    return found


def _bisected(holds: Callable[[float], bool], high: float, accuracy: float) -> float:
    """The largest fraction found at which a condition holds that does not hold at ``high``; 0 if there is none."""
    low, above = 0, round(1000 * high)  # thousandths
    while above > 1000 * _LEAST and above - low > max(accuracy * above, 1):
        middle = (low + above) // 2
        low, above = (middle, above) if holds(middle / 1000) else (low, middle)
    return low / 1000 if low >= 1000 * _LEAST else 0.0


def _thousandths(fraction: float) -> float:
    """The fraction, rounded down."""
    return math.floor(1000.0 * fraction) / 1000.0


def way_out(fraction: float | None) -> str:
    """The hint of a refusal, by the acceptable ``fraction`` of the displacement: 0 for none, None if it is unknown."""
    if fraction is None:
        return "the time allowed ended before an acceptable fraction was found; allow more, or take a smaller step"
    if fraction > 0.0:
        return f"a fraction of {fraction:.3g} of this displacement is acceptable; take a smaller step"
    return "no tested fraction of this displacement is acceptable; the domain may have to be remeshed"
