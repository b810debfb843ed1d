"""Carries a session's requests to its worker, so that each executes only once, whatever fails on the way.

Every request has an id; a request that was sent twice executes once. When the connection ends, PROBE says whether the
worker is alive: if it is, the request is sent again on a new connection. If the worker is gone, the session is resumed
from its journal and the request is sent again; if a trial was lost, its MOVE and JUDGE are sent first.
"""

from __future__ import annotations

import os
import threading
import time
import uuid
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

from mesh_motion_protocol.digests import request_digest
from mesh_motion_protocol.errors import MeshMotionError, SessionError, StepsLost, Timeout, Unavailable
from mesh_motion_protocol.messages import Join, Joined, Message, Move, Probe, Probed, Resume, Resumed, SessionMessage

from mesh_motion_client.connection import Connection, ConnectionLost, DamagedReply, check_process, seconds_left, turn
from mesh_motion_client.control import Control
from mesh_motion_client.credentials import Credentials
from mesh_motion_client.reply_memory import ReplyMemory

__all__ = ["Courier"]

_Reply = TypeVar("_Reply", bound=Message)

#: Number of broken connections that one request survives.
_ATTEMPTS = 5
#: Seconds for a PROBE while the worker computes a request: silence of the gateway alone ends nothing.
_PROBE_SECONDS = 2.0
#: Pause between two PROBEs of a worker that is starting; after two broken connections the next one waits four times
#: longer.
_PAUSE_SECONDS = 0.1


class Courier:
    """The line from one partition to the session's worker.

    Parameters
    ----------
    control : Control
        For PROBE and RESUME.
    shares_memory : bool
        Whether the server writes large arrays to memory that a MOVE offers.

    Attributes
    ----------
    step, iteration : int
        The last step known to be committed, and the number of moves since then.
    trial : tuple of requests
        The MOVE that made the open trial, and the JUDGE that completed it where the client judges.
    may_resume : bool
        Whether this partition may resume the session by itself when its worker is gone: only if the session is built
        and has no other client.
    """

    def __init__(
        self, control: Control, credentials: Credentials, partition: int, *, shares_memory: bool = False
    ) -> None:
        self.step = self.iteration = 0
        self.trial: tuple[SessionMessage, ...] = ()
        self.may_resume = False
        self._process = os.getpid()
        self._turn = threading.RLock()
        self._control = control
        self._credentials = credentials
        self._partition = partition
        self._client = uuid.uuid4().bytes
        self._sequence = 0
        self._epoch = 0
        self._memory = ReplyMemory() if shares_memory else None
        self._data: Connection | None = None
        self._unanswered: SessionMessage | None = None
        self._resuming = False

    @property
    def address(self) -> dict[str, Any]:
        """The fields that all requests to the worker share."""
        return {
            "client": self._client,
            "session": self._credentials.session,
            "epoch": self._epoch,
            "partition": self._partition,
        }

    def join(self, endpoint: str, epoch: int, seconds: float) -> Joined:
        """Connect to the worker and prove the right to the session.

        Raises
        ------
        StepsLost
            If committed steps are lost; the connection is open, and :attr:`step` is the session's last step.
        """
        self.disconnect()
        self._epoch = epoch
        connection = self._control.data_connection(endpoint)
        self._sequence += 1
        join = Join(**self.address, sequence=self._sequence, token=self._credentials.token)
        deadline = time.monotonic() + seconds
        try:
            joined = _expect(connection.request(join, deadline, partial(self._watch, deadline)), Joined)
        except BaseException:
            connection.close()  # no partition has joined on this connection: no request may follow
            raise
        self._data = connection
        self._take_step(joined.step)
        return joined

    def _take_step(self, step: int) -> None:
        """Take the session's step from the reply; it may be earlier than a step that was answered before."""
        known = self.step
        if step >= known:
            return
        self.step, self.iteration, self.trial, self._unanswered = step, 0, (), None
        raise StepsLost(
            f"step {known} was committed, but after a restart the session stands at step {step}",
            hint="continue from session.step: the same moves and commits give the same coordinates again",
            details={"expected": step + 1, "got": known + 1},
        )

    def deliver(self, message: SessionMessage, kind: type[_Reply], seconds: float) -> _Reply:
        """Send a request until it is answered.

        Raises
        ------
        Timeout
            The same request may be delivered again; it keeps its id.
        Unavailable, MeshMotionError
        """
        check_process(self._process)
        deadline = time.monotonic() + seconds
        with turn(self._turn, deadline):
            return self._delivered(message, kind, deadline)

    def _delivered(self, message: SessionMessage, kind: type[_Reply], deadline: float) -> _Reply:
        self._control.waits_until = deadline
        message = self._unanswered = self._numbered(message)
        broken: ConnectionLost | None = None
        for attempt in range(_ATTEMPTS):
            if attempt > 1:  # a server may need a moment to notice that its worker is gone
                time.sleep(min(2**attempt * _PAUSE_SECONDS, seconds_left(deadline)))
            try:
                reply = _expect(self._request(message, deadline), kind)
            except ConnectionLost as error:
                broken = error
                self.disconnect()
            except (Timeout, DamagedReply):
                self.disconnect()  # it may be lost without an event; a late reply must not be confused with a later one
                raise
            except Unavailable:
                raise
            except MeshMotionError as error:
                if error.code != "ABORTED.TRIAL_LOST" or not self.trial:
                    self._unanswered = None
                    raise
                broken = self._repeat_trial(deadline)
            else:
                self._unanswered = None
                return reply
        raise Unavailable(f"{message.type} broke {_ATTEMPTS} connections, the last so: {broken}") from broken

    def disconnect(self) -> None:
        """Close the connection; the next request opens another one."""
        if self._data is not None:
            self._data.close()
            self._data = None

    def _request(self, message: SessionMessage, deadline: float) -> Message:
        """Send one request under the current epoch, on a new connection if the old one is gone."""
        if self._data is None or self._data.closed:
            self._recover(deadline)
        if self._data is None:
            raise ConnectionLost("there is no connection")
        message, watch = replace(message, epoch=self._epoch), partial(self._watch, deadline)
        if self._memory is None or not isinstance(message, Move):
            return self._data.request(message, deadline, watch)
        memory = self._memory.take()
        if memory is not None:
            message = replace(message, memory=memory.offer)
        reply = self._data.request(message, deadline, watch, memory)
        self._memory.give_back(memory, reply)
        return reply

    def _repeat_trial(self, deadline: float) -> ConnectionLost | None:
        """Make the lost trial again: MOVE, and JUDGE if any, are functions of the committed state."""
        try:
            for request in self.trial:
                self._sequence += 1
                self._request(replace(request, sequence=self._sequence), deadline)
        except ConnectionLost as error:
            self.disconnect()
            return error
        return None

    def _numbered(self, message: SessionMessage) -> SessionMessage:
        """Give the request the next sequence number. A request that repeats an unanswered one keeps its id."""
        before = self._unanswered
        if before is not None and request_digest(before) == request_digest(message):
            return replace(message, sequence=before.sequence)
        self._sequence += 1
        return replace(message, sequence=self._sequence)

    def _ask(self, kind: type[Message], expected: type[_Reply], seconds: float) -> _Reply:
        fields = {"session": self._credentials.session, "token": self._credentials.token}
        return self._control.ask(kind, expected, seconds, **fields)

    def _watch(self, deadline: float) -> None:
        """Check that the worker is alive and still serves this holder while it computes a request."""
        try:
            probed = self._ask(Probe, Probed, min(_PROBE_SECONDS, seconds_left(deadline)))
        except (Timeout, Unavailable):
            return
        if probed.worker in ("dead", "none"):
            raise ConnectionLost(f"the session's worker is {probed.worker}")
        self._check_unfenced(probed)

    def _recover(self, deadline: float) -> None:
        """Connect again: to the same worker, or to another one that resumes from the journal."""
        probed = self._ask(Probe, Probed, seconds_left(deadline))
        while probed.worker == "starting" and seconds_left(deadline):
            time.sleep(_PAUSE_SECONDS)
            probed = self._ask(Probe, Probed, seconds_left(deadline))
        if probed.worker == "alive" and not self._resuming:
            self._check_unfenced(probed)
            self.join(probed.endpoint, probed.epoch, seconds_left(deadline))
        elif self.may_resume:
            resumed = self._resume(seconds_left(deadline))
            self.join(resumed.endpoint, resumed.epoch, seconds_left(deadline))
        else:
            raise Unavailable(
                f"the session's worker is {probed.worker}",
                code="UNAVAILABLE.WORKER",
                hint="resume the session from one partition and join it from the others; a session "
                "that was never built must be opened again",
            )

    def _resume(self, seconds: float) -> Resumed:
        """Send RESUME. An unanswered RESUME may have executed, so it is repeated with the same id."""
        self._resuming = True
        try:
            resumed = self._ask(Resume, Resumed, seconds)
        except MeshMotionError as error:
            self._resuming = isinstance(error, (Timeout, Unavailable, DamagedReply))
            raise
        self._resuming = False
        return resumed

    def _check_unfenced(self, probed: Probed) -> None:
        if probed.epoch > self._epoch:
            raise SessionError(
                f"the session was resumed by another holder (epoch {probed.epoch})",
                code="ABORTED.FENCED",
                hint="discard this session, or resume it again from here",
            )


def _expect(reply: Message, kind: type[_Reply]) -> _Reply:
    """Return the reply with the type that the connection has checked by name."""
    if not isinstance(reply, kind):
        raise TypeError(f"expected {kind.type}, got {reply.type}")
    return reply
