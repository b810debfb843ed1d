"""A coupling code that keeps at it: repeats what was not answered, resumes what was lost, and trusts nothing.

Each call of the client must return its result or a typed error by its deadline. Results are compared, bit for bit, with
those of a session in this process that nobody disturbs.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

import numpy as np
from mesh_motion_client import Keys, Mesh, MeshMotionError, Patch, Session, Timeout, Unavailable, connect
from mesh_motion_client.connection import DamagedReply
from mesh_motion_client.server import Server
from mesh_motion_protocol.messages import Commit, Fetch, Move

from mesh_motion_server.prove.check import BrokenPromise, require
from mesh_motion_server.prove.driver import make_driver
from mesh_motion_server.prove.model_files import ModelFiles
from mesh_motion_server.prove.stand_in import grid_mesh
from mesh_motion_server.session.store import SessionStore

__all__ = ["Driver", "Lost", "Undisturbed"]

_Answer = TypeVar("_Answer")

#: Seconds for a call that computes next to nothing, and for one that may wait for a process to start.
_QUICK, _SLOW = 0.8, 6.0
#: What a call may take beyond its deadline: the machine is busy, and its clock is not the client's.
SLACK = 5.0
#: Seconds until a call that is repeated has its result.
PATIENCE = 90.0
#: Moves of a step, as factors of its motion.
_MOVES = (0.5, 1.0)
#: What a broken network may cost, and nothing else: no answer, another holder (a replayed JOIN or RESUME), another's
#: worker (a swapped connection), a trial that a restart has taken; besides a message of which frames were lost.
_EXCUSED = ("DEADLINE_EXCEEDED", "UNAVAILABLE", "ABORTED.FENCED", "ABORTED.TRIAL_LOST", "UNAUTHENTICATED", "NOT_FOUND")


class Lost(Exception):
    """The session is not ours any more: it is to be resumed."""


@dataclass(frozen=True)
class Expected:
    """One step undisturbed: what is sent, and what is answered."""

    rows: list[Any]
    displacements: list[Any]
    digest: bytes
    points: Any


class Undisturbed:
    """The same session, in this process."""

    def __init__(self) -> None:
        self._driver = make_driver(SessionStore("/undisturbed", files=ModelFiles()), [grid_mesh()])
        self._driver.open()
        self._steps: dict[int, Expected] = {}

    def at(self, step: int) -> Expected:
        """The next step, or one that was asked for before."""
        if step not in self._steps:
            self._steps = {step: self._advance(step)} | {k: v for k, v in self._steps.items() if k == step - 1}
        return self._steps[step]

    def _advance(self, step: int) -> Expected:
        """To and fro, so small that the mesh is as good after ten thousand steps."""
        sign = 0.01 if step % 2 else -0.01
        (motion,) = self._driver.displacement((step + 1) // 2)
        rows = [sign * factor * motion for factor in _MOVES]
        moved = [self._driver.ask(Move, step=step, displacement=each) for each in rows]
        committed = self._driver.ask(Commit, step=step)
        points = np.asarray(self._driver.ask(Fetch).points)
        return Expected(rows, [np.asarray(reply.displacement) for reply in moved], committed.digest, points)


class Driver:
    """One user's client behind a network.

    Parameters
    ----------
    endpoint : str
        As seen through the network.
    keys : Keys or None

    Attributes
    ----------
    errors : Counter
        Codes of the errors that calls have raised.
    under_way : (str, float) or None
        The call that has not returned, and its deadline.
    """

    def __init__(self, endpoint: str, keys: Keys | None) -> None:
        self.endpoint, self.keys = endpoint, keys
        self.errors: Counter[str] = Counter()
        self.under_way: tuple[str, float] | None = None
        self.acknowledged = 0
        self._committing = False
        grid = grid_mesh()
        patches = {name: Patch(patch.role, patch.nodes) for name, patch in grid.patches.items()}
        self._mesh = Mesh(grid.points, {"triangle": np.asarray(grid.cells["triangle"])}, patches)
        self._server: Server | None = None
        self._session: Session | None = None
        self._undisturbed = Undisturbed()

    # --- what it does ------------------------------------------------------------------------------------------------

    def open(self) -> None:
        """Another session, from scratch."""
        self._undisturbed, self.acknowledged, self._committing = Undisturbed(), 0, False
        while not self._opened():
            pass

    def _opened(self) -> bool:
        """Whether there was a session, with our mesh, before it was lost."""
        self.discard()
        # HELLO, then three tries at most, each OPEN, JOIN, four UPLOADs, BUILD, CLOSE
        seconds = _QUICK + 3 * (2 * _SLOW + 6 * _QUICK)
        self._session = self._again(
            "OPEN", seconds, lambda: self._connected().open(self._mesh, {"support_radius": 2.0})
        )
        require(self._session.step == 0, f"a new session is at step {self._session.step}")
        try:
            reference = self._again_here("FETCH", lambda s: s.points("reference", timeout=_QUICK))
        except Lost:
            return False
        require(np.array_equal(reference, self._mesh.points), "the mesh that was uploaded has other coordinates")
        return True

    def resume(self) -> None:
        """As another process would that has the credentials, after this one has ended."""
        old = self._session
        require(old is not None, "there is no session to resume")
        self._disconnect()
        credentials = old.credentials  # type: ignore[union-attr]
        self._session = self._again("RESUME", _SLOW + 2 * _QUICK, lambda: self._connected().resume(credentials))
        self._close(old)
        step = self._session.step
        admitted = (self.acknowledged, self.acknowledged + self._committing)
        require(step in admitted, f"resumed at step {step}, {self.acknowledged} was acknowledged")

    def step(self) -> None:
        """The next one, whatever it takes."""
        deadline = time.monotonic() + PATIENCE
        while not self._stepped():
            require(time.monotonic() < deadline, f"step {self.acknowledged + 1} is not reached: {dict(self.errors)}")
            self.resume()

    def step_of_doubt(self) -> bool:
        """A step whose requests and answers may be changed on the way, up to the first error.

        Returns
        -------
        bool
            Whether a wrong result was taken for a right one.
        """
        session, expected = self._here, self._undisturbed.at(self.acknowledged + 1)
        right = True
        try:
            for rows, displacement in zip(expected.rows, expected.displacements, strict=True):
                moved = self._once("MOVE", _QUICK, partial(session.move, rows, timeout=_QUICK))
                right = right and np.array_equal(moved.displacement, displacement)
            committed = self._once("COMMIT", _QUICK, lambda: session.commit(timeout=_QUICK))
            right = right and committed.digest == expected.digest
            points = self._once("FETCH", _QUICK, lambda: session.points(timeout=_QUICK))
            right = right and np.array_equal(points, expected.points)
        except MeshMotionError as error:
            self.errors[error.code] += 1
        return not right

    def check_points(self) -> None:
        """The committed coordinates."""
        try:
            points = self._again_here("FETCH", lambda s: s.points(timeout=_QUICK))
        except Lost:
            self.resume()
            return
        expected = self._undisturbed.at(self.acknowledged).points
        require(np.array_equal(points, expected), f"the coordinates of step {self.acknowledged} differ")

    def discard(self) -> None:
        """End the session, if it can be done."""
        self._close(self._session, "discard")
        self._session = None

    def close(self) -> None:
        """End everything."""
        self.discard()
        self._disconnect()

    def _stepped(self) -> bool:
        """Whether the next step was taken before the session was lost."""
        step = self.acknowledged + 1
        expected = self._undisturbed.at(step)
        try:
            if self._here.step < step:
                self._move_and_commit(step, expected)
        except Lost:
            return False
        self.acknowledged, self._committing = step, False
        return True

    def _move_and_commit(self, step: int, expected: Expected) -> None:
        self._committing = False
        for number, (rows, displacement) in enumerate(zip(expected.rows, expected.displacements, strict=True), 1):
            moved = self._again_here("MOVE", partial(Session.move, displacements=rows, timeout=_QUICK))
            require(np.array_equal(moved.displacement, displacement), f"MOVED {number} of step {step} is another array")
            require(moved.step == step, f"MOVED says step {moved.step}, not {step}")
            require(moved.iteration <= number, f"{moved.iteration} moves of step {step} were executed, {number} made")
        self._committing = True
        committed = self._again_here("COMMIT", lambda s: s.commit(timeout=_QUICK))
        require(committed.step == step, f"COMMITTED says step {committed.step}, not {step}")
        require(committed.digest == expected.digest, f"the digest of step {step} differs from an undisturbed run")

    # --- calls -------------------------------------------------------------------------------------------------------

    @property
    def _here(self) -> Session:
        require(self._session is not None, "there is no session")
        return self._session  # type: ignore[return-value]

    def _again_here(self, what: str, action: Callable[[Session], _Answer]) -> _Answer:
        """A call of the session, until it has its result.

        Raises
        ------
        Lost
            On an error that repeating will not cure.
        """
        session = self._here
        return self._again(what, _QUICK, lambda: action(session), lost=True)

    def _again(self, what: str, seconds: float, action: Callable[[], _Answer], *, lost: bool = False) -> _Answer:
        """A call, until it has its result; each try by its deadline, with a typed error or none."""
        deadline = time.monotonic() + PATIENCE
        while True:
            try:
                return self._once(what, seconds, action)
            except MeshMotionError as error:
                self.errors[error.code] += 1
                self._require_excused(what, error)
                require(time.monotonic() < deadline, f"{what} has no result within {PATIENCE} s: {error}")
                if lost and not isinstance(error, (Timeout, Unavailable, DamagedReply)):
                    raise Lost from error

    def _require_excused(self, what: str, error: MeshMotionError) -> None:
        excused = error.code.startswith(_EXCUSED) or isinstance(error, DamagedReply)
        require(excused, f"{what} raised {error.code}: {error}")

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
            self._server = connect(self.endpoint, timeout=_QUICK, compute_timeout=_SLOW, keys=self.keys)
        return self._server

    def _disconnect(self) -> None:
        if self._server is not None:
            self._server.close()
            self._server = None

    def _close(self, session: Session | None, outcome: Any = "keep") -> None:
        """A session that may be gone already; one that was resumed since is not ended by it."""
        if session is None:
            return
        try:
            self._once("CLOSE", 2 * _QUICK, lambda: session.close(outcome))
        except MeshMotionError as error:
            self.errors[error.code] += 1
