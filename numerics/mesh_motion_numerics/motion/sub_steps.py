"""Sub-steps: a large motion in legs; each leg is corrected before the next begins, so that the mesh is always valid.

One step is enough for most motions, even with large rotations. If it ends in a mesh that cannot be untangled, the mesh
is led to the targets: every leg starts from the valid mesh of the leg before and moves the boundary a little further
along its way (:mod:`.body_paths`). The length of a leg adapts: after a leg whose plain interpolation inverts no cell,
it is doubled, until a leg fails; a leg that fails is halved. No choice depends on computing time or on earlier motions.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import NamedTuple

from mesh_motion_protocol.errors import InvalidInput, QualityRefused

from mesh_motion_numerics.arrays import Floats

_FIRST, _LONGEST, _SHORTEST = 1 / 4, 1 / 2, 1 / 8
#: Largest number of legs of all ways together: a motion that reaches its end takes about four, and a refusal should not
#: take much longer.
_MOST_TRIES = 16


class Leg(NamedTuple):
    """A leg that ended in a valid mesh (n, d): whether it was easy, and the iterations of its correction."""

    points: Floats
    easy: bool
    iterations: int


@dataclass(frozen=True, eq=False)
class Walk:
    """The progress of a mesh along a way."""

    points: Floats  # (n, d), mesh length unit. The last valid mesh
    fraction: float  # fraction of the way; 1 at its end
    #: legs, tries: number of legs that ended in a valid mesh; number of all legs, failed ones included
    legs: int
    tries: int
    iterations: int  # sum over the corrections of the legs
    refusal: QualityRefused | None  # the error of the last leg that failed


def furthest_walk(
    start: Floats, ways: Iterable[Callable[[float], Floats]], move: Callable[[Floats, Floats], Leg]
) -> Walk:
    """The walk along the first way that reaches its end, else the walk that came furthest; see :func:`walk`."""
    furthest: Walk | None = None
    left = _MOST_TRIES
    for way in ways:
        found = walk(start, way, move, left)
        left -= found.tries
        if furthest is None or found.fraction > furthest.fraction:
            furthest = found
        if furthest.fraction == 1.0 or not left:
            break
    if furthest is None:
        raise InvalidInput("expected at least one way, got none")
    return furthest


def walk(
    start: Floats, way: Callable[[float], Floats], move: Callable[[Floats, Floats], Leg], most: int = _MOST_TRIES
) -> Walk:
    """Lead a mesh along a way as far as valid meshes are found.

    Parameters
    ----------
    start : (n, d) array, mesh length unit
        A valid mesh, at fraction 0.
    way : callable
        Fraction → (k, d) positions of the moving nodes.
    move : callable
        (mesh (n, d), positions (k, d)) → :class:`Leg`; raises QualityRefused if no valid mesh is found.
    most : int
        Largest number of legs that are tried.
    """
    points, fraction, length, longest = start, 0.0, _FIRST, _LONGEST
    legs = tries = iterations = 0
    refusal = None
    while fraction < 1.0 and length >= _SHORTEST and tries < most:
        tries += 1
        further = min(fraction + length, 1.0)  # exact, because they are sums of powers of two
        try:
            leg = move(points, way(further))
        except QualityRefused as error:
            refusal = error
            length = longest = (further - fraction) / 2.0
            continue
        points, fraction = leg.points, further
        legs, iterations = legs + 1, iterations + leg.iterations
        if leg.easy:
            length = min(2.0 * length, longest)
    return Walk(points, fraction, legs, tries, iterations, refusal)
