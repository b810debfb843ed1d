"""Where the factorizations of a motion come from: made each time here, from a cache in a session."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.numerics.interpolant import Factorization, Interpolant, factorize
from mesh_motion_server.numerics.kernels import Basis, basis_named, checked_radius
from mesh_motion_server.numerics.method import Method

__all__ = ["DeferredFactorization", "FactorSource", "MakeEachTime", "factorization_of"]


class FactorSource(Protocol):
    """Keeps factorizations between the motions that need the same one."""

    def get_or_make(self, key: bytes, make: Callable[[], Factorization]) -> tuple[Factorization, bool]:
        """The factorization of ``key``, and whether it was reused."""
        ...


class MakeEachTime:
    """A factor source that keeps nothing."""

    def get_or_make(self, key: bytes, make: Callable[[], Factorization]) -> tuple[Factorization, bool]:
        """Make it."""
        del key
        return make(), False


def factorization_of(
    control_points: NDArray[np.float64], method: Method, factors: FactorSource
) -> tuple[Factorization, bool]:
    """The factorization for these control points (c, d), and whether it was reused.

    The key is a digest of all that determines it, so that a cache can never answer with another one.
    """
    radius = method.support_radius
    digest = hashlib.sha256(
        repr((method.basis, radius, method.polynomial, method.solver, control_points.shape)).encode()
    )
    digest.update(np.ascontiguousarray(control_points).data)
    return factors.get_or_make(
        digest.digest(),
        lambda: factorize(
            control_points,
            basis=method.basis,
            support_radius=radius,
            solver=method.solver,
            polynomial=method.polynomial,
        ),
    )


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

    def solve(self, values: NDArray[np.float64]) -> Interpolant:
        """Interpolant of (nc, k) values."""
        return self._made.solve(values)

    @cached_property
    def _made(self) -> Factorization:
        return factorization_of(self.control_points, self.method, self.factors)[0]
