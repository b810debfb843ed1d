"""A persistent coupling code: it repeats unanswered requests, resumes lost sessions, and checks everything.

Each call of the client must return its result or a typed error by its deadline. Its results must equal, bit for bit,
those of an undisturbed session in this process.
"""

import time
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeVar

import numpy as np
from mesh_motion_client import Keys, Mesh, MeshMotionError, Session, Timeout, Unavailable, connect
from mesh_motion_client.connection import DamagedReply
from mesh_motion_client.server import Server

from tests.faults.check import BrokenPromise, require
from tests.faults.client_mesh import client_mesh
from tests.faults.stand_in import grid_mesh
from tests.faults.undisturbed import Step, Undisturbed

_Answer = TypeVar("_Answer")

#: Seconds for a call that computes next to nothing, and for one that may wait for a process to start.
_QUICK, _SLOW = 0.8, 6.0
#: A call may take so long beyond its deadline: the machine is busy, and its clock is not the client's.
SLACK = 5.0
#: Seconds until a call that is repeated has its result.
PATIENCE = 90.0
#: Moves of a step, as factors of its motion.
_MOVES = (0.5, 1.0)
#: The only losses that a broken network may cause: no answer, another holder (a replayed JOIN or RESUME), another's
#: worker (a swapped connection), a trial that a restart has taken; besides a message of which frames were lost.
EXCUSED = ("DEADLINE_EXCEEDED", "UNAVAILABLE", "ABORTED.FENCED", "ABORTED.TRIAL_LOST", "UNAUTHENTICATED", "NOT_FOUND")


class Lost(Exception):
    """The session has another holder: it must be resumed."""


@dataclass(frozen=True)
class Work:
    """The work of a driver.

    ``options``: fields of OPEN; ``frame``: of its moves; ``again`` (Mesh or None): mesh for a RESUME; ``undisturbed``:
    makes the run that its own must equal; ``patience``: time for its calls in addition to the shortest one.
    """

    mesh: Mesh = field(default_factory=lambda: client_mesh(grid_mesh()))
    settings: Mapping[str, Any] = field(default_factory=lambda: {"support_radius": 2.0})
    options: Mapping[str, Any] = field(default_factory=dict)
    frame: Any = "committed"
    again: Mesh | None = None
    undisturbed: Callable[[], Any] = lambda: Undisturbed([grid_mesh()], _MOVES)
    patience: float = 1.0


class Driver:
    """One user's client behind a network.

    ``endpoint``: the proxy's endpoint; ``keys`` (Keys or None). ``errors``: codes of the errors that calls have raised;
    ``under_way`` (str, float) or None: the running call and its deadline.
    """

    def __init__(self, endpoint: str, keys: Keys | None, work: Work) -> None:
        self.endpoint, self.keys, self._work = endpoint, keys, work
        self.errors: Counter[str] = Counter()
        self.under_way: tuple[str, float] | None = None
        self._server: Server | None = None
        self._session: Session | None = None

    @property
    def _quick(self) -> float:
        return _QUICK * self._work.patience

    # --- what it does ------------------------------------------------------------------------------------------------

    def open(self) -> None:
        self._undisturbed, self.acknowledged, self._committing = self._work.undisturbed(), 0, False
        while not self._opened():
            pass

    def _opened(self) -> bool:
        """Whether there was a session, with our mesh, before it was lost."""
        self.discard()
        # HELLO, then three tries at most, each OPEN, JOIN, four UPLOADs, BUILD, CLOSE
        seconds, work = self._quick + 3 * (2 * _SLOW + 6 * self._quick), self._work
        self._session = self._again(
            "OPEN", seconds, lambda: self._connected().open(work.mesh, work.settings, **work.options)
        )
        require(self._session.step == 0, f"a new session is at step {self._session.step}")
        try:
            reference = self._again_here("FETCH", lambda s: s.points("reference", timeout=self._quick))
        except Lost:
            return False
        require(np.array_equal(reference, work.mesh.points), "the mesh that was uploaded has other coordinates")
        return True

    def resume(self) -> None:
        """Resume like another process with the credentials, after this one has ended."""
        old = self._session
        require(old is not None, "there is no session to resume")
        self._disconnect()
        credentials = old.credentials  # type: ignore[union-attr]
        self._session = self._again(
            "RESUME", _SLOW + 2 * self._quick, lambda: self._connected().resume(credentials, self._work.again)
        )
        self._close(old)
        step = self._session.step
        admitted = (self.acknowledged, self.acknowledged + self._committing)
        require(step in admitted, f"resumed at step {step}, {self.acknowledged} was acknowledged")

    def step(self) -> None:
        deadline = time.monotonic() + PATIENCE
        while not self._stepped():
            require(time.monotonic() < deadline, f"step {self.acknowledged + 1} is not reached: {dict(self.errors)}")
            self.resume()

    def abandon(self) -> None:
        (rows,) = self._undisturbed.step(self.acknowledged + 1).given[-1]
        with suppress(Lost):
            self._again_here("MOVE", lambda s: s.move(0.5 * rows, frame=self._work.frame, timeout=self._quick))
        self.resume()

    def step_of_doubt(self) -> bool:
        """A step with requests and answers that may be changed by the network, up to the first error.

        Returns whether a wrong result was accepted.
        """
        session, expected = self._here, self._undisturbed.step(self.acknowledged + 1)
        right = True
        try:
            for (rows,), (displacement,) in zip(expected.given, expected.displacements, strict=True):
                moved = self._once("MOVE", _QUICK, partial(session.move, rows, frame="committed", timeout=_QUICK))
                right = right and np.array_equal(moved.displacement, displacement)
            committed = self._once("COMMIT", _QUICK, lambda: session.commit(timeout=_QUICK))
            right = right and committed.digest == expected.digest
            points = self._once("FETCH", _QUICK, lambda: session.points(timeout=_QUICK))
            right = right and np.array_equal(points, expected.points[0])
        except MeshMotionError as error:
            self.errors[error.code] += 1
        return not right

    def check_points(self) -> None:
        try:
            points = self._again_here("FETCH", lambda s: s.points(timeout=self._quick))
        except Lost:
            self.resume()
            return
        expected = self._undisturbed.points(self.acknowledged)[0]
        require(np.array_equal(points, expected), f"the coordinates of step {self.acknowledged} differ")

    def discard(self) -> None:
        self._close(self._session, "discard")
        self._session = None

    def close(self) -> None:
        self.discard()
        self._disconnect()

    def _stepped(self) -> bool:
        """Whether the next step was taken before the session was lost."""
        step = self.acknowledged + 1
        expected = self._undisturbed.step(step)
        try:
            if self._here.step < step:
                self._move_and_commit(step, expected)
        except Lost:
            return False
        self.acknowledged, self._committing = step, False
        return True

    def _move_and_commit(self, step: int, expected: Step) -> None:
        self._committing = False
        moves = zip(expected.given, expected.displacements, strict=True)
        for number, ((rows,), (displacement,)) in enumerate(moves, 1):
            moved = self._again_here(
                "MOVE", partial(Session.move, displacements=rows, frame=self._work.frame, timeout=self._quick)
            )
            require(np.array_equal(moved.displacement, displacement), f"MOVED {number} of step {step} is another array")
            require(moved.step == step, f"MOVED says step {moved.step}, not {step}")
            once = moved.iteration <= number or self._work.again  # else a call is MOVE, JUDGE, …: it may end after MOVE
            require(once, f"{moved.iteration} moves of step {step} were executed, {number} made")
        self._committing = True
        committed = self._again_here("COMMIT", lambda s: s.commit(timeout=self._quick))
        require(committed.step == step, f"COMMITTED says step {committed.step}, not {step}")
        same = committed.digest == expected.digest or not expected.digest
        require(same, f"the digest of step {step} differs from an undisturbed run")

    # --- calls -------------------------------------------------------------------------------------------------------

    @property
    def _here(self) -> Session:
        require(self._session is not None, "there is no session")
        return self._session  # type: ignore[return-value]

    def _again_here(self, what: str, action: Callable[[Session], _Answer]) -> _Answer:
        """Repeat a call of the session until it has its result.

        Raises Lost on an error that a repetition cannot solve.
        """
        session = self._here
        return self._again(what, self._quick, lambda: action(session), lost=True)

    def _again(self, what: str, seconds: float, action: Callable[[], _Answer], *, lost: bool = False) -> _Answer:
        """Repeat a call until it has its result; each try ends by its deadline, with a result or a typed error."""
        deadline = time.monotonic() + PATIENCE
        while True:
            try:
                return self._once(what, seconds, action)
            except MeshMotionError as error:
                self.errors[error.code] += 1
                excused = error.code.startswith(EXCUSED) or isinstance(error, DamagedReply)
                require(excused, f"{what} raised {error.code}: {error}")
                require(time.monotonic() < deadline, f"{what} has no result within {PATIENCE} s: {error}")
                if lost and not isinstance(error, (Timeout, Unavailable, DamagedReply)):
                    raise Lost from error

    def _once(self, what: str, seconds: float, action: Callable[[], _Answer]) -> _Answer:
        begun = time.monotonic()
        self.under_way = (what, begun + seconds + SLACK)
        try:
            return action()
        except (MeshMotionError, BrokenPromise):
            raise
        except Exception as error:
            raise BrokenPromise(f"{what} raised {type(error).__name__}: {error}") from error
        finally:
            self.under_way = None
            late = time.monotonic() - begun - seconds
            require(late < SLACK, f"{what} returned {late:.1f} s after its deadline")

    def _connected(self) -> Server:
        if self._server is None:
            self._server = connect(self.endpoint, timeout=self._quick, compute_timeout=_SLOW, keys=self.keys)
        return self._server

    def _disconnect(self) -> None:
        if self._server is not None:
            self._server.close()
            self._server = None

    def _close(self, session: Session | None, outcome: Any = "keep") -> None:
        """Discard a session that may have ended already; a session that was resumed since stays."""
        if session is None:
            return
        try:
            self._once("CLOSE", 2 * self._quick, lambda: session.close(outcome))
        except MeshMotionError as error:
            self.errors[error.code] += 1
