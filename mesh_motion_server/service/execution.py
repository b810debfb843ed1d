"""Executes each command once; a collective one when all partitions have sent it."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from mesh_motion_protocol.errors import MeshMotionError, SessionError, Timeout
from mesh_motion_protocol.messages import Committed, ErrorReply, Message, SessionMessage

from mesh_motion_server.failpoints import failpoint
from mesh_motion_server.service import build, commit, correct, differentiate, fetch, judge, move, rollback, upload
from mesh_motion_server.service.commands import Collective, Single, id_of
from mesh_motion_server.service.envelope import Envelope
from mesh_motion_server.service.failures import failure_reply, known_error
from mesh_motion_server.service.gathering import Arrival, Gathering
from mesh_motion_server.service.recorder import Recorder
from mesh_motion_server.session.journal.replies import ReplyTable
from mesh_motion_server.session.session import Session
from mesh_motion_server.settings import ServerSettings

#: Request type → command. JOIN, STATUS and CLOSE need more than the session; :mod:`.dispatch` handles them.
COMMANDS: dict[str, Single | Collective] = {
    "UPLOAD": Single(upload.answer, executes_once=True),
    "FETCH": Single(fetch.answer, executes_once=False),
    "BUILD": Collective(build.check, build.run),
    "MOVE": Collective(move.check, move.run),
    "TANGENT": Collective(differentiate.check_tangent, differentiate.tangent),
    "COTANGENT": Collective(differentiate.check_cotangent, differentiate.cotangent),
    "JUDGE": Collective(judge.check, judge.run),
    "CORRECT": Collective(correct.check, correct.run),
    "COMMIT": Collective(commit.check, commit.run),
    "ROLLBACK": Collective(rollback.check, rollback.run),
}

#: Bytes that a stored reply takes without its arrays.
_HEADER_BYTES = 4096


class Execution:
    """The requests that change a session: the waiting ones, and the replies to the executed ones.

    Parameters
    ----------
    session : Session
        The replies to its journaled commits are restored.
    clock : callable
        Monotonic seconds.
    recorder : Recorder
        Gets the result of each request.
    """

    def __init__(
        self, session: Session, *, limits: ServerSettings, clock: Callable[[], float], recorder: Recorder
    ) -> None:
        self._session = session
        self._recorder = recorder
        self._timeout = limits.collective_timeout_seconds
        self._clock = clock
        holders = session.spec.partitions
        self._stored: ReplyTable[Message] = ReplyTable(limits.stored_replies, limits.stored_reply_bytes, holders)
        self._gathering: Gathering | None = None
        for entry in session.commits:
            for request_id, reply in commit.replies_of(entry):
                self._stored.store(request_id, reply, _sealed(reply))
        failpoint("request.replies.known")

    @property
    def deadline(self) -> float | None:
        """Time on the clock at which :meth:`expire` has to be called next."""
        return self._gathering.deadline if self._gathering else None

    @property
    def missing(self) -> list[int]:
        """Partitions that a collective request is still waiting for."""
        return self._gathering.missing if self._gathering else []

    def execute(self, peer: bytes, request: SessionMessage) -> list[Envelope]:
        """Execute a command of the table once."""
        command = COMMANDS[request.type]
        if isinstance(command, Single) and not command.executes_once:
            return [Envelope(peer, command.answer(self._session, request))]
        request_id = id_of(request)
        stored = self._stored.find(request_id)
        if stored is not None:
            return [_answer_to(Arrival(peer, request, request_id), stored)]
        arrival = Arrival(peer, request, request_id)
        if isinstance(command, Collective):
            return self._gather(arrival, command)
        self._require_idle(request.partition)
        return self._answer([arrival], lambda: [command.answer(self._session, request)])

    def _gather(self, arrival: Arrival, command: Collective) -> list[Envelope]:
        """Let the request wait for the other partitions, or run the command if it is the last one."""
        gathering = self._gathering
        if gathering is not None and gathering.repeats(arrival):
            # the reply goes to the latest sender, and the first arrays may be in memory that is given back
            again = replace(arrival, checked=command.check(self._session, arrival.request))
            gathering.arrivals[arrival.request.partition] = again
            return []
        try:
            arrival = replace(arrival, checked=command.check(self._session, arrival.request))
        except Exception:
            self._stored.store(arrival.request_id, None)
            raise
        replies: list[Envelope] = []
        if gathering is None:
            deadline = self._clock() + self._timeout
            gathering = self._gathering = Gathering(self._session.spec.partitions, deadline)
        else:
            replies += self._overtake(gathering, arrival)
            if gathering.arrivals and not self._agrees(gathering, arrival, replies):
                return replies
        gathering.arrivals[arrival.request.partition] = arrival
        if not gathering.complete:
            failpoint("request.gather.first")
            return replies
        self._gathering = None
        arrivals = gathering.in_order()
        return replies + self._answer(arrivals, lambda: command.run(self._session, [a.checked for a in arrivals]))

    def _overtake(self, gathering: Gathering, arrival: Arrival) -> list[Envelope]:
        """Refuse the waiting request of a partition that sends a new one."""
        earlier = gathering.arrivals.pop(arrival.request.partition, None)
        if earlier is None:
            return []
        error = SessionError(
            f"request {earlier.request.sequence} was overtaken by request {arrival.request.sequence}",
            code="ABORTED.STALE",
            hint="wait for a reply before the next request",
        )
        return [self._refusal(earlier.peer, earlier.request, error)]

    def _agrees(self, gathering: Gathering, arrival: Arrival, replies: list[Envelope]) -> bool:
        """Whether the request agrees with the waiting ones; otherwise all of them are refused."""
        try:
            gathering.check_agreement(arrival)
        except MeshMotionError as error:
            replies += self.abandon(error)
            replies.append(self._refusal(arrival.peer, arrival.request, error))
            return False
        return True

    def _answer(self, arrivals: Sequence[Arrival], run: Callable[[], Sequence[Message]]) -> list[Envelope]:
        """Run the command, store and address the replies; on a failure every partition gets the error."""
        started, parts, iteration = time.perf_counter(), self._session.upload.count, self._session.iteration
        try:
            failpoint("request.execute")
            replies = run()
            failpoint("request.unstored")
        except Exception as error:
            self._session.upload.back_to(parts)  # a refused part may be sent again with another id
            return self._failed(arrivals, known_error(error))
        seconds = time.perf_counter() - started
        for arrival, reply in zip(arrivals, replies, strict=True):
            self._stored.store(arrival.request_id, reply, _sealed(reply))
        failpoint("request.stored")
        reply = move.of_all(replies)
        self._recorder.executed(reply, seconds, iteration)  # last: the reply is stored, even if counting fails
        return [_answer_to(a, reply) for a, reply in zip(arrivals, replies, strict=True)]

    def _failed(self, arrivals: Sequence[Arrival], error: MeshMotionError) -> list[Envelope]:
        """Return the refusals; a commit that became durable before the failure gets its journaled reply."""
        journaled = {known: reply for entry in self._session.commits for known, reply in commit.replies_of(entry)}
        replies: list[Committed | ErrorReply] = []
        for arrival in arrivals:
            made = journaled.get(arrival.request_id)
            self._stored.store(arrival.request_id, made, _sealed(made) if made else 0)
            replies.append(made or failure_reply(arrival.request, error, self._session))
        if isinstance(replies[0], Committed):
            self._recorder.executed(replies[0], 0.0, 0)
        else:
            self._recorder.refused(arrivals[0].request, replies[0])
        return [Envelope(a.peer, reply) for a, reply in zip(arrivals, replies, strict=True)]

    def _require_idle(self, partition: int) -> None:
        """Raise if the partition has a request waiting: it may send nothing else."""
        if self._gathering is not None and partition in self._gathering.arrivals:
            raise SessionError(
                f"partition {partition} has a request waiting for the partitions {self._gathering.missing}",
                hint="wait for its reply",
                details={"missing": self._gathering.missing},
            )

    def abandon(self, error: MeshMotionError) -> list[Envelope]:
        """Refuse all waiting requests; they may be made again."""
        gathering, self._gathering = self._gathering, None
        if gathering is None:
            return []
        return [self._refusal(a.peer, a.request, error) for a in gathering.in_order()]

    def expire(self, now: float) -> list[Envelope]:
        """Refuse a collective request that has waited too long; it has changed nothing."""
        if self._gathering is None or now < self._gathering.deadline:
            return []
        missing = self.missing
        return self.abandon(
            Timeout(
                f"partitions {', '.join(map(str, missing))} did not make the request within {self._timeout:g} s",
                hint="check that their processes run; then repeat the request",
                details={"missing": missing},
            )
        )

    def forget_waiting(self) -> None:
        """Drop the waiting requests without an answer: their senders are fenced or gone."""
        self._gathering = None

    def _refusal(self, peer: bytes, request: Message, error: MeshMotionError) -> Envelope:
        refusal = failure_reply(request, error, self._session)
        self._recorder.refused(request, refusal)
        return Envelope(peer, refusal)


def _answer_to(arrival: Arrival, reply: Message) -> Envelope:
    return Envelope(arrival.peer, reply, getattr(arrival.request, "memory", {}))


def _sealed(reply: Message) -> int:
    """Make the arrays read-only, so that an in-process receiver cannot change the stored reply; return its bytes."""
    nbytes = _HEADER_BYTES
    for array in vars(reply).values():
        if isinstance(array, np.ndarray):
            array.flags.writeable = False
            nbytes += array.nbytes
    return nbytes
