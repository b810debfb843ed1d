"""Where the factorizations of a motion come from: made each time here, from a cache in a session."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.numerics.interpolant import Factorization, factorize
from mesh_motion_server.numerics.kernels import Basis, basis_named, checked_radius
from mesh_motion_server.numerics.method import Method
from mesh_motion_server.numerics.two_scale.factorization import TwoScalePlan
from mesh_motion_server.numerics.two_scale.interpolant import AnyInterpolant

__all__ = ["DeferredFactorization", "FactorSource", "MakeEachTime", "factorization_of", "two_scale_factorization_of"]


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

    The key is a digest of all that determines it, so that a cache can never answer with another one. Without a plan for
    two scales the solver "two-scale" is "auto".
    """
    radius = method.support_radius
    solver = "auto" if method.solver == "two-scale" else method.solver
    digest = hashlib.sha256(repr((method.basis, radius, method.polynomial, solver, control_points.shape)).encode())
    digest.update(np.ascontiguousarray(control_points).data)
    return factors.get_or_make(
        digest.digest(),
        lambda: factorize(
            control_points, basis=method.basis, support_radius=radius, solver=solver, polynomial=method.polynomial
        ),
    )


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
