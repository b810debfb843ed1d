"""Where the factorizations of a motion come from: made each time here, from a cache in a session."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.numerics.interpolant import Factorization, factorize
from mesh_motion_server.numerics.method import Method

__all__ = ["FactorSource", "MakeEachTime", "factorization_of"]


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
