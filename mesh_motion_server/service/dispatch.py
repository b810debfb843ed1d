"""A request in, its replies out: the whole server without a socket.

:class:`SessionHost` holds one session in one worker process. Transport hands it each decoded request as an
:class:`Envelope` and sends the envelopes it returns; in-process users call :meth:`SessionHost.handle` themselves.
Single-threaded: one call at a time.

A request passes these gates, in this order: session, partition and epoch (ABORTED.FENCED); whether its peer has joined
(UNAUTHENTICATED); whether it was made before (the stored reply, or ABORTED.CONFLICT or .STALE); whether it waits
already; then its command checks state and content. A collective request waits until all partitions have made it.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from mesh_motion_protocol.digests import request_digest
from mesh_motion_protocol.messages import Close, Join, Message, Ping, Pong, SessionMessage, Status

from mesh_motion_server.errors import MeshMotionError, SessionError
from mesh_motion_server.service import build, close, commit, fetch, join, move, rollback, status, upload
from mesh_motion_server.service.commands import Collective, Single
from mesh_motion_server.service.failures import error_reply, known_error
from mesh_motion_server.service.gathering import Arrival, Gathering
from mesh_motion_server.service.holders import Holders
from mesh_motion_server.session.model import ModelBuilder, build_motion_model, check_basis
from mesh_motion_server.session.replies import ReplyTable, RequestId
from mesh_motion_server.session.session import Session
from mesh_motion_server.session.spec import SessionSpec
from mesh_motion_server.session.state import State
from mesh_motion_server.session.store import SessionStore
from mesh_motion_server.settings import ServerSettings, check_durability

__all__ = ["COMMANDS", "Envelope", "SessionHost", "SessionSpec"]

#: Request type → command. JOIN, STATUS and CLOSE need more than the session and are dispatched apart.
COMMANDS: dict[str, Single | Collective] = {
    "UPLOAD": Single(upload.answer, executes_once=True),
    "FETCH": Single(fetch.answer, executes_once=False),
    "BUILD": Collective(build.check, build.run),
    "MOVE": Collective(move.check, move.run),
    "COMMIT": Collective(commit.check, commit.run),
    "ROLLBACK": Collective(rollback.check, rollback.run),
}

#: What a stored reply takes beside its arrays.
_HEADER_BYTES = 4096


@dataclass(frozen=True)
class Envelope:
    """A message and the peer it came from or goes to.

    Attributes
    ----------
    peer : bytes
        Whatever transport identifies a connection by; opaque here.
    message : Message
    """

    peer: bytes
    message: Message


class SessionHost:
    """One session and the requests made to it.

    Parameters
    ----------
    session : Session
    store : SessionStore
    limits : ServerSettings
    clock : callable
        Monotonic seconds; deadlines are on it.

    Attributes
    ----------
    closed : bool
        CLOSE was answered for every partition that had joined: send the replies, then end.
    """

    def __init__(
        self, session: Session, store: SessionStore, *, limits: ServerSettings, clock: Callable[[], float]
    ) -> None:
        self._session = session
        self._store = store
        self._limits = limits
        self._clock = clock
        self._holders = Holders(session)
        self._stored: ReplyTable[Message] = ReplyTable(limits.stored_replies, limits.stored_reply_bytes)
        self._gathering: Gathering | None = None
        self._counts: Counter[str] = Counter()
        self._discard = False
        self.closed = False
        for entry in session.commits:
            for request_id, reply in commit.replies_of(entry):
                self._stored.store(request_id, reply, _nbytes(reply))

    @classmethod
    def create(
        cls,
        spec: SessionSpec,
        store: SessionStore,
        *,
        limits: ServerSettings | None = None,
        clock: Callable[[], float] = time.monotonic,
        build_model: ModelBuilder = build_motion_model,
    ) -> SessionHost:
        """A new session.

        Raises
        ------
        InvalidInput
            If the basis or the durability level is not offered.
        ResourceError
            If the disk does not take it.
        """
        check_durability(spec.durability)
        check_basis(spec.settings.basis)
        limits = limits or ServerSettings()
        session = Session(store.create(spec), limits, build_model)
        return cls(session, store, limits=limits, clock=clock)

    @classmethod
    def resume(
        cls,
        session: str,
        token: bytes,
        store: SessionStore,
        *,
        limits: ServerSettings | None = None,
        clock: Callable[[], float] = time.monotonic,
        build_model: ModelBuilder = build_motion_model,
    ) -> SessionHost:
        """A stored session, at its last committed step and under a new epoch.

        Raises
        ------
        SessionError
            NOT_FOUND, or UNAVAILABLE.STARTING while another process holds it.
        JournalError
            If what is stored does not verify, or the disk fails.
        """
        limits = limits or ServerSettings()
        folder = store.open(session, token)
        try:
            reopened = Session.reopen(folder, limits, build_model)
        except BaseException:
            folder.release()
            raise
        return cls(reopened, store, limits=limits, clock=clock)

    # --- where it stands -------------------------------------------------------------------------------------------

    @property
    def session(self) -> str:
        """The session's id."""
        return self._session.spec.session

    @property
    def label(self) -> str:
        """As given in OPEN."""
        return self._session.spec.label

    @property
    def partitions(self) -> int:
        """How many have to join."""
        return self._session.spec.partitions

    @property
    def state(self) -> State:
        """A state of the session table."""
        return self._session.state

    @property
    def epoch(self) -> int:
        """Raised by each RESUME."""
        return self._session.epoch

    @property
    def step(self) -> int:
        """The last committed step."""
        return self._session.step

    @property
    def iteration(self) -> int:
        """Moves of the open trial, 0 without one."""
        return self._session.iteration

    @property
    def next_deadline(self) -> float | None:
        """When :meth:`expire` will have something to do, on the clock."""
        return self._gathering.deadline if self._gathering else None

    # --- what it does ----------------------------------------------------------------------------------------------

    def handle(self, envelope: Envelope) -> list[Envelope]:
        """The replies that are due because of this request; an error is a reply too."""
        try:
            replies = self._handle(envelope)
        except Exception as error:
            replies = [self._refusal(envelope.peer, envelope.message, known_error(error))]
        self._counts.update(reply.message.type for reply in replies)
        return replies

    def expire(self, now: float) -> list[Envelope]:
        """Answer a collective request that has waited too long; nothing was changed by it."""
        gathering = self._gathering
        if gathering is None or now < gathering.deadline:
            return []
        missing = gathering.missing
        seconds = self._limits.collective_timeout_seconds
        return self._abandon(
            SessionError(
                f"partitions {', '.join(map(str, missing))} did not make the request within {seconds:g} s",
                code="DEADLINE_EXCEEDED",
                hint="look whether their processes live; then make the request again",
                details={"missing": missing},
            )
        )

    def reclaim(self, token: bytes) -> int:
        """RESUME while this process holds the session: fence the old holder, drop the trial.

        Returns
        -------
        int
            The new epoch.

        Raises
        ------
        SessionError
            NOT_FOUND for a wrong token; FAILED_PRECONDITION.STATE or RESOURCE_EXHAUSTED.DISK when the session must be
            opened anew in another process.
        JournalError
            If the disk fails now.
        """
        if not self._session.spec.admits(token):
            raise SessionError(f"there is no session {self.session} for this token", code="NOT_FOUND")
        epoch = self._session.resume()
        self._holders.clear()
        self._gathering = None
        return epoch

    def suspend(self) -> list[Envelope]:
        """The lease ended: nobody speaks for the session until somebody joins again."""
        self._session.suspend()
        self._holders.clear()
        return self._abandon(
            SessionError("the lease ended while the request waited", code="ABORTED", hint="JOIN again")
        )

    def close(self) -> None:
        """Give files and lock back; the session stays resumable if it was built. Idempotent."""
        if self._session.state is State.CLOSED:
            return
        self._end(discard=False)

    # --- inside ----------------------------------------------------------------------------------------------------

    def _handle(self, envelope: Envelope) -> list[Envelope]:
        request, peer = envelope.message, envelope.peer
        if isinstance(request, Ping):
            return [Envelope(peer, Pong(client=request.client, sequence=request.sequence))]
        if not isinstance(request, SessionMessage):
            raise SessionError(f"a session does not take {request.type}", code="UNIMPLEMENTED.MESSAGE")
        self._holders.check_address(request)
        if isinstance(request, Join):
            reply: Message = join.answer(self._session, request)
            self._holders.join(peer, request.partition)
            return [Envelope(peer, reply)]
        self._holders.check_joined(peer, request.partition)
        if isinstance(request, Status):
            waiting_for = self._gathering.missing if self._gathering else []
            return [Envelope(peer, status.answer(self._session, request, waiting_for, dict(self._counts)))]
        if isinstance(request, Close):
            return self._close_partition(peer, request)
        return self._execute(peer, request)

    def _execute(self, peer: bytes, request: SessionMessage) -> list[Envelope]:
        """A command of the table, executed once."""
        command = COMMANDS[request.type]
        if isinstance(command, Single) and not command.executes_once:
            return [Envelope(peer, command.answer(self._session, request))]
        request_id = RequestId(request.client, request.sequence, request_digest(request))
        stored = self._stored.find(request_id)
        if stored is not None:
            return [Envelope(peer, stored)]
        arrival = Arrival(peer, request, request_id)
        if isinstance(command, Collective):
            return self._gather(arrival, command)
        self._require_idle(request.partition)
        return self._answer([arrival], lambda: [command.answer(self._session, request)])

    def _gather(self, arrival: Arrival, command: Collective) -> list[Envelope]:
        """Let the request wait for the other partitions, or run when it is the last one."""
        gathering = self._gathering
        if gathering is not None and gathering.repeats(arrival):
            return []
        try:
            command.check(self._session, arrival.request)
        except Exception:
            self._stored.store(arrival.request_id, None)
            raise
        replies: list[Envelope] = []
        if gathering is None:
            deadline = self._clock() + self._limits.collective_timeout_seconds
            gathering = self._gathering = Gathering(self.partitions, deadline)
        else:
            replies += self._overtake(gathering, arrival)
            if gathering.arrivals and not self._agrees(gathering, arrival, replies):
                return replies
        gathering.arrivals[arrival.request.partition] = arrival
        if not gathering.complete:
            return replies
        self._gathering = None
        arrivals = gathering.in_order()
        requests, ids = [a.request for a in arrivals], [a.request_id for a in arrivals]
        return replies + self._answer(arrivals, lambda: command.run(self._session, requests, ids))

    def _overtake(self, gathering: Gathering, arrival: Arrival) -> list[Envelope]:
        """A partition that asks anew while it waits gives its waiting request up."""
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
        """Whether the request asks for what the others ask for; otherwise all of them are refused."""
        try:
            gathering.check_agreement(arrival)
        except MeshMotionError as error:
            replies += self._abandon(error)
            replies.append(self._refusal(arrival.peer, arrival.request, error))
            return False
        return True

    def _answer(self, arrivals: Sequence[Arrival], run: Callable[[], Sequence[Message]]) -> list[Envelope]:
        """Run, remember and address the replies; a failure is everybody's reply."""
        try:
            replies = run()
        except Exception as error:
            known = known_error(error)
            for arrival in arrivals:
                self._stored.store(arrival.request_id, None)
            return [self._refusal(a.peer, a.request, known) for a in arrivals]
        for arrival, reply in zip(arrivals, replies, strict=True):
            self._stored.store(arrival.request_id, reply, _nbytes(reply))
        return [Envelope(a.peer, reply) for a, reply in zip(arrivals, replies, strict=True)]

    def _require_idle(self, partition: int) -> None:
        """A partition that waits in a collective request asks for nothing else."""
        if self._gathering is not None and partition in self._gathering.arrivals:
            raise SessionError(
                f"partition {partition} has a request waiting for the partitions {self._gathering.missing}",
                hint="wait for its reply",
                details={"missing": self._gathering.missing},
            )

    def _abandon(self, error: MeshMotionError) -> list[Envelope]:
        """Refuse all requests that wait; they may be made again."""
        gathering, self._gathering = self._gathering, None
        if gathering is None:
            return []
        return [self._refusal(a.peer, a.request, error) for a in gathering.in_order()]

    def _close_partition(self, peer: bytes, request: Close) -> list[Envelope]:
        """One partition leaves; the last one to leave closes the session."""
        reply = close.answer(self._session, request)
        self._discard = self._discard or request.outcome == "discard"
        replies = self._abandon(
            SessionError(f"partition {request.partition} closed the session", code="ABORTED", hint="ask STATUS")
        )
        self._holders.leave(request.partition)
        if not len(self._holders):
            self._end(discard=self._discard)
            self.closed = True
        return [*replies, Envelope(peer, reply)]

    def _end(self, *, discard: bool) -> None:
        """Close the session; one that was never built is not worth keeping."""
        discard = discard or not self._session.is_built
        self._gathering = None
        self._session.close()
        if discard:
            self._store.discard(self.session)

    def _refusal(self, peer: bytes, request: Message, error: MeshMotionError) -> Envelope:
        return Envelope(peer, error_reply(request, error, self._session))


def _nbytes(reply: Message) -> int:
    """Memory a stored reply takes."""
    arrays = (value for value in vars(reply).values() if isinstance(value, np.ndarray))
    return _HEADER_BYTES + sum(array.nbytes for array in arrays)
