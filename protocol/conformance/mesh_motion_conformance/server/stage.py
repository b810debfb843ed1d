"""The environment of the cases for servers: the endpoint, and a few shared sessions.

Opening a session may take a server seconds. A request that is refused changes nothing (7.2), so hundreds of cases can
use one session; :meth:`Stage.session` brings it into the state that a case needs, from any earlier state.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from typing import Any, TypeVar

from mesh_motion_conformance.case import Suite, Unmet
from mesh_motion_conformance.checks import answered, check_identity
from mesh_motion_conformance.line import Ended, Line, Silence
from mesh_motion_conformance.server.mesh import SQUARE, WITHOUT_VOLUME, Part, boundary
from mesh_motion_conformance.server.requests import Header, Request
from mesh_motion_conformance.server.session import Session
from mesh_motion_conformance.show import show_frames
from mesh_motion_conformance.wire import Malformed, Message

__all__ = ["Stage", "suite"]

Seen = TypeVar("Seen")

#: The cases for servers; each module of a section adds its own.
suite = Suite()

#: Sessions in a row that could not be opened, after which no other is tried.
_FAILED_OPENINGS = 2


class Stage:
    """A server under test.

    Parameters
    ----------
    endpoint : str
        Endpoint of the server's control socket.
    seconds, opening_seconds : float
        The longest waits: for a reply, for one to OPEN, RESUME, BUILD.
    patience : float
        Cases that need a longer time of the server, such as the end of a lease, are skipped.
    """

    def __init__(
        self, endpoint: str, *, seconds: float = 10.0, opening_seconds: float = 120.0, patience: float = 5.0
    ) -> None:
        self.endpoint, self.seconds, self.opening_seconds, self.patience = endpoint, seconds, opening_seconds, patience
        self.sent = ""
        self._control: Line | None = None
        self._limits: dict[str, int] = {}
        self._sessions: dict[str, Session] = {}
        self._of_case: list[Session] = []
        self._lines: list[Line] = []
        self._failed_openings = 0

    # --- asking ------------------------------------------------------------------------------------------------------

    @property
    def control(self) -> Line:
        """The connection to the control endpoint that most cases use."""
        if self._control is None:
            self._control = self.line(self.endpoint)
        return self._control

    def line(self, endpoint: str | None = None) -> Line:
        """A further connection, by default to the control endpoint; closed after the run."""
        line = Line(endpoint or self.endpoint, self.seconds)
        self._lines.append(line)
        return line

    def ask(
        self,
        request: Request,
        line: Line | None = None,
        *,
        sequence: int | None = None,
        client: bytes | None = None,
        change: Callable[[Header], Any] | None = None,
        seconds: float | None = None,
    ) -> Message:
        """Send a request and return its reply, after a check of its id and its fields."""
        line = line or self.control
        number, who = line.next() if sequence is None else sequence, client or line.client
        self.put(line, request.frames(who, number, change))
        reply = line.receive(seconds)
        check_identity(reply, who, number)
        return reply

    def put(self, line: Line, frames: list[bytes]) -> None:
        """Send frames as they are."""
        self.sent = show_frames(frames)
        line.send(frames)

    def limits(self) -> dict[str, int]:
        """WELCOME's limits."""
        if not self._limits:
            self._limits = answered(self.ask(Request("HELLO")), "WELCOME").fields["limits"]
        return self._limits

    def until(self, look: Callable[[], Seen], good: Callable[[Seen], bool]) -> Seen:
        """Look repeatedly; return what is seen when it is good, or after the longest wait for a reply."""
        deadline = time.monotonic() + self.seconds
        while not good(seen := look()) and time.monotonic() < deadline:
            time.sleep(0.02)
        return seen

    # --- sessions ----------------------------------------------------------------------------------------------------

    def open(
        self,
        *parts: Part,
        **others: Any,
    ) -> Session:
        """A new session, in state NEW and joined by all of its partitions; ``others``: further fields of OPEN.

        It is discarded after the case, unless it is shared.
        """
        if self._failed_openings >= _FAILED_OPENINGS:
            raise Unmet("a session", f"none after {self._failed_openings} tries to open one")
        parts = parts or (SQUARE,)
        fields = {"dimension": parts[0].points.shape[1], "label": "conformance", "partitions": len(parts), **others}
        try:
            reply = answered(self.ask(Request("OPEN", fields), seconds=self.opening_seconds), "OPENED")
            session = Session(self, reply, parts)
            self._of_case.append(session)
            session.join()
        except Exception:
            self._failed_openings += 1
            raise
        self._failed_openings = 0
        return session

    def session(self, state: str, kind: str = "shared") -> Session:
        """A shared session in this state; ``kind`` names it, so that several can exist at once.

        Possible states are NEW, OPENING, READY and TRIAL.
        """
        key = f"{kind} {'READY' if state in ('READY', 'TRIAL') else state}"
        return self.kept(key, self.open, lambda session: session.reach(state))

    def kept(self, key: str, make: Callable[[], Session], look: Callable[[Session], Any] = Session.status) -> Session:
        """A shared session, which does not end with the case; opened once, and again after it was lost."""
        session = self._sessions.get(key)
        if session is not None:
            try:
                look(session)
                return session
            except (Unmet, Silence, Ended, Malformed):
                self._sessions.pop(key).discard()
        sent = self.sent
        session = self._sessions[key] = make()
        self._of_case.remove(session)
        look(session)
        self.sent = sent
        return session

    def judging(self, state: str = "TRIAL") -> Session:
        """A shared session whose client evaluates the field, READY or TRIAL."""
        return self.kept("client evaluation", self.outer).reach("READY").reach(state)

    def outer(self, part: Part | None = None, settings: dict[str, Any] = WITHOUT_VOLUME) -> Session:
        """A new session whose client evaluates the field."""
        return self.open(part or boundary(), settings=settings, evaluation="client")

    # --- between the cases -------------------------------------------------------------------------------------------

    def between(self) -> None:
        """Every request is answered by exactly one reply (2.5)."""
        for line in self._open_lines():
            if line.pending():
                stray = line.receive(0.0)
                self.mend()
                raise Unmet("exactly one reply to a request (SPEC 2.5)", f"another one: {show_frames(stray.frames)}")
        self._discard()

    def _discard(self) -> None:
        """End the sessions that only the last case used."""
        while self._of_case:
            self._of_case.pop().discard()

    def mend(self) -> None:
        """Drop late replies, sessions of the case, and a control connection that may have ended."""
        self._discard()
        for line in self._open_lines():
            with contextlib.suppress(Silence):
                while True:
                    with contextlib.suppress(Malformed, Ended):
                        line.receive(0.02)
        if self._control is not None:
            self._control.close()
            self._lines.remove(self._control)
            self._control = None

    def close(self) -> None:
        """End all sessions and connections."""
        for session in self._sessions.values():
            session.discard()
        for line in self._lines:
            line.close()

    def _open_lines(self) -> list[Line]:
        self._lines = [line for line in self._lines if not line.closed]
        return self._lines
