"""Where the factorizations of a motion come from: made each time here, from a cache in a session."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.numerics.interpolation.evaluation import Evaluator, Prepared, PreparingEvaluator
from mesh_motion_server.numerics.interpolation.interpolant import Factorization, factorize
from mesh_motion_server.numerics.interpolation.kernels import Basis, basis_named, checked_radius
from mesh_motion_server.numerics.interpolation.two_scale.factorization import TwoScalePlan
from mesh_motion_server.numerics.interpolation.two_scale.interpolant import AnyInterpolant, TwoScaleInterpolant
from mesh_motion_server.numerics.mesh.point_digest import point_digest
from mesh_motion_server.numerics.method import Method

__all__ = [
    "CacheReport",
    "DeferredFactorization",
    "FactorSource",
    "Kept",
    "MakeEachTime",
    "Recorded",
    "factorization_of",
    "prepared_for",
    "two_scale_factorization_of",
]


class Kept(Protocol):
    """What can be kept."""

    @property
    def nbytes(self) -> int:
        """Memory it holds."""
        ...


K = TypeVar("K", bound=Kept)

CacheReport = dict[str, str | int | dict[str, int]]
"""``"reused"`` or ``"made"`` for each kind of what is kept, and ``bytes`` held of each."""


class FactorSource(Protocol):
    """Keeps what depends on a state of the mesh alone, for the motions that need the same again.

    Each thing is of a kind: a ``"factorization"``, or ``"operators"``: values at all nodes of the compact functions of
    the interpolation in two scales.
    """

    def get_or_make(self, key: bytes, make: Callable[[], K], kind: str = "factorization") -> tuple[K, bool]:
        """What belongs to ``key`` among its kind, and whether it was reused."""
        ...

    def held(self) -> dict[str, int]:
        """Bytes kept of each kind."""
        ...


class MakeEachTime:
    """A factor source that keeps nothing."""

    def get_or_make(self, key: bytes, make: Callable[[], K], kind: str = "factorization") -> tuple[K, bool]:
        """Make it."""
        del key, kind
        return make(), False

    def held(self) -> dict[str, int]:
        """Nothing."""
        return {}


class Recorded:
    """A factor source that tells what a motion found in another one.

    Parameters
    ----------
    source : FactorSource
    """

    def __init__(self, source: FactorSource) -> None:
        self._source = source
        self._reused: dict[str, bool] = {}

    def get_or_make(self, key: bytes, make: Callable[[], K], kind: str = "factorization") -> tuple[K, bool]:
        """What the other one has or makes."""
        found, reused = self._source.get_or_make(key, make, kind)
        self._reused[kind] = reused and self._reused.get(kind, True)
        return found, reused

    def held(self) -> dict[str, int]:
        """What the other one holds."""
        return self._source.held()

    def report(self) -> CacheReport:
        """``"reused"`` for each kind of which everything was found, ``"made"`` for others; ``bytes`` held of each."""
        found = {kind: "reused" if reused else "made" for kind, reused in self._reused.items()}
        return {**found, "bytes": self.held()}


def factorization_of(
    control_points: NDArray[np.float64], method: Method, factors: FactorSource
) -> tuple[Factorization, bool]:
    """The factorization for these control points (c, d), and whether it was reused.

    The key is a digest of all that determines it, so that a cache can never answer with another one.
    """
    basis, radius = method.basis, method.support_radius
    digest = hashlib.sha256(repr((basis, radius, control_points.shape)).encode())
    digest.update(np.ascontiguousarray(control_points).data)
    return factors.get_or_make(digest.digest(), lambda: factorize(control_points, basis=basis, support_radius=radius))


def two_scale_factorization_of(
    control_points: NDArray[np.float64], box: NDArray[np.float64], plan: TwoScalePlan, factors: FactorSource
) -> tuple[Factorization, bool]:
    """The factorization in two scales of control points (c, d) for places in a box (2, d), and whether it was reused.

    A session has one plan for as many control points, but for the radius, so that these and the box determine it.
    """
    digest = hashlib.sha256(repr(("two-scale", plan.support_radius, control_points.shape)).encode())
    digest.update(np.ascontiguousarray(box).data)
    digest.update(np.ascontiguousarray(control_points).data)
    return factors.get_or_make(digest.digest(), lambda: plan.factorize(control_points, box[0], box[1]))


def prepared_for(
    evaluator: Evaluator,
    interpolant: AnyInterpolant,
    points: NDArray[np.float64],
    factors: FactorSource,
    *,
    unasked: NDArray[np.int64],
) -> Prepared | None:
    """What the evaluator has prepared for an interpolant in two scales at points (n, d), but those ``unasked`` for.

    Where the evaluator prepares nothing, and for any other interpolant, None.
    """
    if not isinstance(interpolant, TwoScaleInterpolant) or not isinstance(evaluator, PreparingEvaluator):
        return None
    if not interpolant.levels:
        return None
    digest = hashlib.sha256(point_digest(points))
    digest.update(point_digest(interpolant.levels[-1].control_points))
    digest.update(np.ascontiguousarray(unasked).data)
    return factors.get_or_make(
        digest.digest(), lambda: evaluator.prepare(interpolant, points, unasked=unasked), "operators"
    )[0]


@dataclass(frozen=True, eq=False)
class DeferredFactorization:
    """The factorization of control points (nc, d), made (or found in the cache) when it is first solved with.

    A reduced motion needs that of all boundary nodes only where a correction asks for it.
    """

    control_points: NDArray[np.float64]
    method: Method
    factors: FactorSource

    @property
    def basis(self) -> Basis:
        return basis_named(self.method.basis)

    @property
    def support_radius(self) -> float:
        return checked_radius(self.method.support_radius, self.basis)

    @property
    def solver(self) -> str:
        return self._made.solver

    @property
    def nbytes(self) -> int:
        return self._made.nbytes

    def solve(self, values: NDArray[np.float64]) -> AnyInterpolant:
        """Interpolant of (nc, k) values."""
        return self._made.solve(values)

    @cached_property
    def _made(self) -> Factorization:
        return factorization_of(self.control_points, self.method, self.factors)[0]
