"""The motion of a session as a function of its boundary, for automatic differentiation and optimisers."""

from __future__ import annotations

import threading

import numpy as np
from mesh_motion_protocol.errors import InvalidInput, SessionError
from numpy.typing import NDArray

from mesh_motion_client.moved import Moved
from mesh_motion_client.session import Session

__all__ = ["MotionFunction", "no_second_derivative"]

Array = NDArray[np.float64]


class MotionFunction:
    """Displacements of all nodes as a function of those of the moving nodes, with its derivatives at any argument.

    Each new argument is a trial of the session; nothing is committed. A derivative is computed at the trial of its
    argument; if the session has another trial by then, the trial is made again. Threads take turns, because JAX calls
    from its own threads.

    Parameters
    ----------
    session : Session
        A session of one partition, with derivatives.

    Raises
    ------
    InvalidInput
        If the session's method has no derivatives.
    """

    def __init__(self, session: Session) -> None:
        if session.derivatives is False:
            raise InvalidInput(
                "the session's method has no derivatives",
                hint="session.tangent names the key; docs/derivatives.md lists what has no derivative",
            )
        self.session = session
        self._latest: tuple[Array, Moved] | None = None
        self._turn = threading.Lock()

    def value(self, displacement: Array) -> Array:
        """(n, d) displacements of all nodes for (k, d) of the moving nodes, both since the reference mesh.

        Raises
        ------
        QualityRefused
            If no acceptable mesh is found.
        """
        with self._turn:
            return self._at(displacement).displacement

    def tangent(self, displacement: Array, velocity: Array) -> Array:
        """J v at the ``displacement``: see :meth:`.session.Session.tangent`."""
        with self._turn:
            return self._at(displacement).tangent(velocity)

    def cotangent(self, displacement: Array, weights: Array) -> Array:
        """Jᵀ w at the ``displacement``: see :meth:`.session.Session.cotangent`."""
        with self._turn:
            return self._at(displacement).cotangent(weights)

    def _at(self, displacement: Array) -> Moved:
        """Return the trial of these displacements: the latest trial if it has them and still exists, else a new one."""
        if self._latest is not None and np.array_equal(displacement, self._latest[0]):
            moved = self._latest[1]
            try:
                self.session.state_of(moved.step, moved.iteration)
            except SessionError:
                pass  # the trial is made again below
            else:
                return moved
        self._latest = None
        moved = self.session.move(displacement)
        self._latest = np.array(displacement), moved  # a copy: optimisers change their array in place
        return moved


def no_second_derivative() -> InvalidInput:
    """Return the error of a framework's function that differentiates a derivative by the displacement."""
    return InvalidInput(
        "the motion has no second derivative: this differentiates J v or Jᵀ w by the displacement",
        hint="differences of first derivatives give second ones",
    )
