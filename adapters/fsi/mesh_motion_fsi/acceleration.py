"""Acceleration of a fixed-point iteration x ← H(x): Aitken's relaxation and the quasi-Newton method IQN-ILS.

``x`` are the displacements given to the fluid, ``H(x)`` those that the solid returned; the residual is r = H(x) - x.
IQN-ILS approximates the inverse of the residual's Jacobian from differences of the iterations so far (Degroote, Bathe
and Vierendeels 2009): with differences of residuals as the columns of V and differences of answers as the columns of W,

    x ← H(x) + W c,    c = argmin ‖V c + r‖,

also from the windows before. Columns that are nearly combinations of newer ones hold noise rather than directions: they
are dropped while V is orthogonalized, newest first (filter QR2 of Haelterman, Bogaers, Scheufele, Uekermann and Mehl
2016). On a linear problem with n unknowns it is exact after n + 1 differences.

References
----------
J. Degroote, K.-J. Bathe, J. Vierendeels, Performance of a new partitioned procedure versus a monolithic procedure in
fluid-structure interaction, Computers and Structures 87 (2009) 793-801.
R. Haelterman et al., Improving the performance of the partitioned QN-ILS procedure for fluid-structure interaction
problems: filtering, Computers and Structures 171 (2016) 9-17.
U. Küttler, W. A. Wall, Fixed-point fluid-structure interaction solvers with dynamic relaxation, Computational Mechanics
43 (2008) 61-72.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mesh_motion_fsi.errors import SetupError

__all__ = ["ACCELERATIONS", "Acceleration", "Aitken", "ConstantRelaxation", "QuasiNewton"]

Vector = NDArray[np.float64]


class Acceleration(Protocol):
    """The methods that the coupling needs of an acceleration."""

    def next(self, x: Vector, answer: Vector) -> Vector:
        """The next x (n,) from the last one and its answer H(x) (n,)."""

    def end_window(self) -> None:
        """End a converged window; another begins."""

    def state(self) -> dict[str, Vector]:
        """Arrays that a later run needs to continue in the same way."""

    def restore(self, state: Mapping[str, Vector]) -> None:
        """Take up a state."""


class ConstantRelaxation:
    """x ← x + ω r."""

    def __init__(self, omega: float = 0.5) -> None:
        if not 0.0 < omega <= 1.0:
            raise SetupError(f"the relaxation factor must be above 0 and at most 1, not {omega!r}")
        self.omega = omega

    def next(self, x: Vector, answer: Vector) -> Vector:
        """A share of the way."""
        return x + self.omega * (answer - x)

    def end_window(self) -> None:
        """Nothing is kept."""

    def state(self) -> dict[str, Vector]:
        """Nothing is kept."""
        return {}

    def restore(self, state: Mapping[str, Vector]) -> None:
        """Nothing is kept."""


class Aitken:
    """Relaxation with a factor from the last two residuals (Küttler and Wall 2008, eq. 44).

    Parameters
    ----------
    omega : float
        The first factor of the first window; a later window begins with the size of the last factor, at most this one.
    """

    def __init__(self, omega: float = 0.5) -> None:
        self._most = ConstantRelaxation(omega).omega
        self.omega = omega
        self._residual: Vector | None = None

    def next(self, x: Vector, answer: Vector) -> Vector:
        """A share of the residual; the success of the last step determines it."""
        residual = answer - x
        if self._residual is not None:
            change = residual - self._residual
            size = float(change @ change)
            if size > 0.0:
                self.omega *= -float(self._residual @ change) / size
        self._residual = residual
        return x + self.omega * residual

    def end_window(self) -> None:
        """The factor's size is kept."""
        self._residual = None
        self.omega = float(np.clip(abs(self.omega), 0.01 * self._most, self._most))

    def state(self) -> dict[str, Vector]:
        """The factor."""
        return {"omega": np.array([self.omega])}

    def restore(self, state: Mapping[str, Vector]) -> None:
        """The factor."""
        self.omega = float(state["omega"][0])


class QuasiNewton:
    """IQN-ILS.

    Parameters
    ----------
    omega : float
        Relaxation of the first iteration, before there is a difference.
    windows : int
        Number of earlier windows whose differences are used.
    filter_limit : float
        A column is dropped if less than this share of its norm is orthogonal to the newer columns.
    """

    def __init__(self, omega: float = 0.5, *, windows: int = 8, filter_limit: float = 1e-2) -> None:
        self._first = ConstantRelaxation(omega)
        self._limit = filter_limit
        #: per window the differences of residuals and of answers, newest first
        self._windows: deque[list[tuple[Vector, Vector]]] = deque([[]], maxlen=windows + 1)
        self._last: tuple[Vector, Vector] | None = None

    def next(self, x: Vector, answer: Vector) -> Vector:
        """The quasi-Newton step."""
        residual = answer - x
        if self._last is not None:
            before, answered = self._last
            self._windows[0].insert(0, (residual - before, answer - answered))
        self._last = residual, answer
        basis, triangle, columns = self._filtered()
        if not columns:
            return self._first.next(x, answer)
        c = np.linalg.solve(triangle, -(basis.T @ residual))
        return answer + np.stack(columns, axis=1) @ c

    def _filtered(self) -> tuple[Vector, Vector, list[Vector]]:
        """Q (n, m) and R (m, m) of the kept columns of V, and the matching columns of W."""
        q: list[Vector] = []
        rows: list[Vector] = []
        kept: list[Vector] = []
        for v, w in (pair for window in self._windows for pair in window):
            if len(q) == len(v):
                break
            size = float(np.linalg.norm(v))
            coefficients = np.zeros(len(q))
            rest = v
            for _ in range(2):  # twice is enough (Giraud and others 2005)
                share = np.array([float(column @ rest) for column in q])
                rest = rest - sum((a * column for a, column in zip(share, q, strict=True)), np.zeros_like(v))
                coefficients += share
            new = float(np.linalg.norm(rest))
            if new > self._limit * size:
                q.append(rest / new)
                rows.append(np.append(coefficients, new))
                kept.append(w)
        triangle = np.zeros((len(q), len(q)))
        for i, row in enumerate(rows):
            triangle[: i + 1, i] = row
        return np.stack(q, axis=1) if q else np.zeros((0, 0)), triangle, kept

    def end_window(self) -> None:
        """Keep the differences as those of a past window."""
        self._last = None
        if self._windows[0]:
            self._windows.appendleft([])

    def state(self) -> dict[str, Vector]:
        """All differences, with their number in each window."""
        pairs = [pair for window in self._windows for pair in window]
        return {
            "counts": np.array([float(len(window)) for window in self._windows]),
            "v": np.array([v for v, _ in pairs]),
            "w": np.array([w for _, w in pairs]),
        }

    def restore(self, state: Mapping[str, Vector]) -> None:
        """Take up the differences."""
        pairs = iter(list(zip(state["v"], state["w"], strict=True)))
        self._windows.clear()
        self._windows.extend([next(pairs) for _ in range(int(count))] for count in state["counts"])


#: By name, as settings have it.
ACCELERATIONS: dict[str, type[ConstantRelaxation] | type[Aitken] | type[QuasiNewton]] = {
    "constant": ConstantRelaxation,
    "aitken": Aitken,
    "iqn-ils": QuasiNewton,
}
