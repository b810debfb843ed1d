"""The source of a motion's factorizations: without a session they are made each time, in a session kept in a cache."""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Protocol, TypeVar

import mesh_motion_kernels as kernels
import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.interpolation.evaluation import NearOperator
from mesh_motion_numerics.interpolation.interpolant import Factorization, Interpolant, factorize
from mesh_motion_numerics.interpolation.two_scale.factorization import TwoScalePlan
from mesh_motion_numerics.interpolation.two_scale.interpolant import AnyInterpolant
from mesh_motion_numerics.method import Method

K = TypeVar("K")


class FactorSource(Protocol):
    """Keeps data that depend only on a state of the mesh, for later motions that need them again.

    Each object has a kind: ``"factorization"``, or ``"operators"``: values at all nodes of the compact functions of the
    interpolation in two scales.
    """

    def get_or_make(self, key: bytes, make: Callable[[], K], kind: str = "factorization") -> tuple[K, bool]:
        """Return the object with this ``key`` and kind, and whether it was reused."""
        ...


class MakeEachTime:
    """A factor source that keeps nothing."""

    def get_or_make(self, key: bytes, make: Callable[[], K], kind: str = "factorization") -> tuple[K, bool]:
        """Make the object."""
        del key, kind
        return make(), False


@dataclass
class Recorded:
    """A factor source that records what a motion found in another one."""

    source: FactorSource
    #: ``"reused"`` for each kind whose objects were all found, otherwise ``"made"``.
    found: dict[str, str] = field(default_factory=dict, init=False)

    def get_or_make(self, key: bytes, make: Callable[[], K], kind: str = "factorization") -> tuple[K, bool]:
        """The object from the other source, and whether it was reused."""
        found, reused = self.source.get_or_make(key, make, kind)
        if not reused or kind not in self.found:  # "made" stays, whatever is reused after it
            self.found[kind] = "reused" if reused else "made"
        return found, reused


def point_digest(points: Floats) -> bytes:
    """32 bytes that identify the shape and the bits of points (n, d): the key of cached results for them.

    Two states with the same digest have the same bits, except for a negligible probability: blocks of coordinates are
    hashed on all threads by four lanes of multiplications and rotations each (the round of xxHash), and their 256 bits
    each by SHA-256. It is one pass over the coordinates at memory speed; SHA-256 over all of them would take ten times
    as long.
    """
    lanes = kernels.hash_blocks(np.ascontiguousarray(points).reshape(-1).view(np.uint64))
    return hashlib.sha256(repr(points.shape).encode() + lanes.tobytes()).digest()


def factorization_of(control_points: Floats, method: Method, factors: FactorSource) -> Factorization:
    """Return the factorization for these control points (c, d).

    The key is a digest of all its inputs, so a cache never returns a wrong factorization.
    """
    basis, radius = method.basis, method.support_radius
    digest = hashlib.sha256(repr((basis, radius, control_points.shape)).encode())
    digest.update(point_digest(control_points))
    make = partial(factorize, control_points, basis=basis, support_radius=radius)
    return factors.get_or_make(digest.digest(), make)[0]


def two_scale_factorization_of(
    control_points: Floats, box: Floats, plan: TwoScalePlan, factors: FactorSource
) -> Factorization:
    """Return the factorization in two scales of control points (c, d) for places in a box (2, d).

    In a session the plan depends only on the number of control points, the radius and the smoothing; so these, the
    points and the box identify the factorization.
    """
    # the word separates these keys from those of factorizations in one scale
    digest = hashlib.sha256(repr(("two-scale", plan.support_radius, plan.smoothing, control_points.shape)).encode())
    digest.update(np.ascontiguousarray(box).data)
    digest.update(point_digest(control_points))
    return factors.get_or_make(digest.digest(), partial(plan.factorize, control_points, *box))[0]


def operators_of(
    levels: Sequence[Interpolant], points: Floats, factors: FactorSource, *, skipped: Integers
) -> tuple[NearOperator, ...]:
    """The operator of each compact level at points (n, d), except the ``skipped`` rows (r,)."""
    if not levels:
        return ()
    places = hashlib.sha256(point_digest(points))  # once: all nodes take the longest to hash
    places.update(np.ascontiguousarray(skipped).data)
    found = []
    for level in levels:
        digest = places.copy()
        digest.update(repr(level.support_radius).encode() + point_digest(level.control_points))
        make = partial(NearOperator.build, level, points, skipped=skipped)
        found.append(factors.get_or_make(digest.digest(), make, "operators")[0])
    return tuple(found)


@dataclass(frozen=True, eq=False)
class DeferredFactorization:
    """The factorization of control points (nc, d), made (or found in the cache) at its first use.

    A reduced motion needs the factorization of all boundary nodes only if a correction uses it.
    """

    control_points: Floats
    method: Method
    factors: FactorSource

    def solve(self, values: Floats) -> AnyInterpolant:
        """Return the interpolant of (nc, k) values."""
        return self._made.solve(values)

    @cached_property
    def _made(self) -> Factorization:
        return factorization_of(self.control_points, self.method, self.factors)
