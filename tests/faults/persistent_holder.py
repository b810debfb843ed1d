"""Holds a session through whatever breaks, by what SPEC.md says alone.

A request is repeated by the same id until it is answered; without an answer PROBE shows whether the worker lives;
then the holder joins again, after a RESUME if the worker is gone. Every reply must stay true: a step that was
acknowledged is never lost, an epoch is never given twice, and an error has a known code and passes.
"""

import time
import uuid
from collections import Counter
from dataclasses import replace
from typing import Any

from mesh_motion_protocol.errors import ERROR_CODES
from mesh_motion_protocol.messages import Build, Close, Commit, ErrorReply, Join, Message, Probe, Resume

from tests.faults.check import BrokenPromise, require
from tests.faults.failing_server import FailingServer
from tests.faults.waiting import PATIENCE
from tests.faults.wire import Wire

PARTITIONS = 2
#: Silence after which the user looks whether anybody is there; it doubles from look to look.
SILENCE, _LONGEST_SILENCE = 0.3, 5.0
#: Between two looks at a worker that starts.
_PAUSE = 0.05
#: Refusals of one task: a single fault causes some in a row, but they pass.
_MOST_REFUSALS = 20
#: Nothing that breaks in the server may make one of these the answer to a request that is right.
_NEVER = {"ABORTED.CONFLICT", "ABORTED.STALE", "FAILED_PRECONDITION.STEP", "DATA_LOSS.CHECKSUM", "PERMISSION_DENIED"}
_LOST = {"ABORTED.TRIAL_LOST", "FAILED_PRECONDITION.STATE"}
_SPOILT = {"FROZEN", "FAILED"}


class SessionLost(Exception):
    """There is no such session: right for one that was never built, or discarded."""


class TrialLost(Exception):
    """A COMMIT came after what it should commit was lost."""


class PersistentHolder:
    """Holds one session of two partitions, over all its connections and epochs.

    ``step``: the last acknowledged one; ``committing``: whether the next step's COMMIT waits for its reply; ``built``:
    whether the mesh is known to be durable; ``refusals``: errors that it was answered with, by code.
    """

    def __init__(self, server: FailingServer) -> None:
        self.server = server
        self.session, self.step = "", 0
        self.committing = self.built = self.leaving = False
        self.refusals: Counter[str] = Counter()
        self._client, self._sequence = uuid.uuid4().bytes, 0
        self._token, self._endpoint, self._epoch = b"", "", 0
        self._control: Wire | None = None
        self._lines: list[Wire] = []
        self.begin()

    def begin(self) -> None:
        """A new task: it has so much time, and so many refusals."""
        self._deadline = time.monotonic() + PATIENCE
        self._patience, self._refused = SILENCE, 0

    def disconnect(self) -> None:
        """Close the connections to the worker."""
        while self._lines:
            self._lines.pop().close()

    def end(self) -> None:
        """Close all connections."""
        self.disconnect()
        if self._control is not None:
            self._control.close()
            self._control = None

    # --- one request -------------------------------------------------------------------------------------------------

    def new(self, kind: Any, partition: int, **fields: Any) -> Any:
        self._sequence += 1
        known = {"client": self._client, "sequence": self._sequence, "session": self.session, "partition": partition}
        return kind(**known | {"epoch": self._epoch} | fields)

    def deliver(self, requests: list[Any]) -> list[Any]:
        """The replies to requests of different partitions, each sent until it is answered by no error."""
        replies: dict[int, Any] = {}
        while len(replies) < len(requests):
            if not self._lines:
                replies.clear()
                self.connect()
                if self._needless(requests[0]):
                    return []
            waiting = [request for request in requests if request.partition not in replies]
            for request in waiting:
                self._lines[request.partition].send(replace(request, epoch=self._epoch))
            answers = {r.partition: self._lines[r.partition].receive(r, self._patience) for r in waiting}
            good = {p: answer for p, answer in answers.items() if answer is not None and answer.type != "ERROR"}
            replies |= good
            if len(good) < len(answers):
                self._bad(requests[0], [answer for answer in answers.values() if answer and answer.type == "ERROR"])
        self._patience = SILENCE
        return [replies[request.partition] for request in requests]

    def _bad(self, request: Any, errors: list[ErrorReply]) -> None:
        """Errors or silence: join again, which shows what there is to be done."""
        self.disconnect()
        for error in errors:
            self._refusal(request, error)
            if isinstance(request, Commit) and error.code in _LOST and error.state == "READY":
                raise TrialLost
        if not errors:
            self._require_time(request.type)
            self._patience = min(2 * self._patience, _LONGEST_SILENCE)

    def _refusal(self, request: Message, error: ErrorReply) -> None:
        """Count an error, which must be one that may come."""
        self.refusals[error.code] += 1
        self._refused += 1
        message = f"{request.type} is answered {error.code}: {error.message}"
        require(error.code in ERROR_CODES and error.code not in _NEVER, message)
        require(self._refused <= _MOST_REFUSALS, f"{message}; again and again")
        self._require_time(request.type)

    def _require_time(self, what: str) -> None:
        if time.monotonic() > self._deadline:
            raise BrokenPromise(f"{what}: nothing within {PATIENCE:.0f} s; {self.server.last_words()}")

    def _needless(self, request: Any) -> bool:
        """A BUILD that was made before its reply was lost."""
        return isinstance(request, Build) and self.built

    # --- connections -------------------------------------------------------------------------------------------------

    def connect(self) -> None:
        """Join on new connections, after a RESUME if no worker serves the session."""
        while not self._lines:
            self._require_time("JOIN")
            probed = self.ask(Probe, session=self.session, token=self._token)
            if probed.worker == "starting":
                time.sleep(_PAUSE)
                continue
            if probed.worker != "alive" or probed.epoch != self._epoch:
                self.resume()
            else:
                self._endpoint = probed.endpoint
            self.join()

    def join(self) -> None:
        """New connections to the endpoint, both joined; none if that fails."""
        self.disconnect()
        self._lines = [Wire(self._endpoint) for _ in range(PARTITIONS)]
        joins = [self.new(Join, p, token=self._token) for p in range(PARTITIONS)]
        for line, join in zip(self._lines, joins, strict=True):
            line.send(join)
        replies = [line.receive(join, self._patience) for line, join in zip(self._lines, joins, strict=True)]
        states = {reply.state for reply in replies if reply is not None}
        for join, reply in zip(joins, replies, strict=True):
            if reply is None or reply.type == "ERROR":
                self._bad(join, [reply] if reply else [])
        if not self._lines:
            if states & {"COMMITTING"}:
                self.resume()
            return
        self._take(replies[0].step)
        self.built = self.built or not states & {"NEW", "OPENING"}
        if states & _SPOILT:
            self._reopen()

    def _reopen(self) -> None:
        """CLOSE a session that says it cannot go on, and RESUME it, as its hint says."""
        for p, line in enumerate(self._lines):
            request = self.new(Close, p)
            line.send(request)
            line.receive(request, self._patience)
        self.disconnect()
        self.resume()

    def resume(self) -> None:
        resumed = self.ask(Resume, session=self.session, token=self._token)
        require(resumed.epoch > self._epoch, f"RESUME gives epoch {resumed.epoch} after epoch {self._epoch}")
        self._endpoint, self._epoch = resumed.endpoint, resumed.epoch
        self._take(resumed.step)

    def _take(self, step: int) -> None:
        """A step that the server gives: the acknowledged one, or the one that waits for its reply."""
        possible = (self.step, self.step + 1) if self.committing else (self.step,)
        require(step in possible, f"the session is at step {step}, step {self.step} was acknowledged")

    def ask(self, kind: Any, **fields: Any) -> Any:
        """A control request until it is answered by no error; NOT_FOUND is for the session to judge."""
        self._sequence += 1
        request = kind(client=self._client, sequence=self._sequence, **fields)
        while True:
            self._require_time(request.type)
            self.server.ensure()
            self._control = self._control or Wire(self.server.endpoint)
            self._control.send(request)
            reply = self._control.receive(request, self._patience)
            if reply is None:
                self._control.close()
                self._control = None
                self._patience = min(2 * self._patience, _LONGEST_SILENCE)
                continue
            if reply.type != "ERROR":
                return reply
            if reply.code == "NOT_FOUND":
                require(not self.built or self.leaving, f"{request.type}: there is no session {self.session} any more")
                raise SessionLost
            self._refusal(request, reply)
            time.sleep(_PAUSE)
            self._sequence += 1
            request = replace(request, sequence=self._sequence)
