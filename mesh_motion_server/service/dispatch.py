"""Takes a request and returns its replies: the whole server without a socket.

:class:`SessionHost` holds one session in one worker process. The transport gives it each decoded request as an
:class:`Envelope` and sends the returned envelopes; in-process users call :meth:`SessionHost.handle` directly. It is
single-threaded: one call at a time.

The checks of a request, in this order: session, partition and epoch (ABORTED.FENCED); whether its peer has joined
(UNAUTHENTICATED); whether it was made before (the stored reply, or ABORTED.CONFLICT or .STALE); whether it already
waits; then the request's command checks state and content. A collective request waits until all partitions have sent
it.
"""

from __future__ import annotations

import contextlib
import time
from collections import Counter
from collections.abc import Callable

from mesh_motion_protocol.errors import ResourceExhausted, SessionError
from mesh_motion_protocol.messages import Close, Join, Message, Ping, Pong, SessionMessage, Status

from mesh_motion_server.failpoints import failpoint
from mesh_motion_server.security.authorisation import not_found
from mesh_motion_server.service import close, join, status
from mesh_motion_server.service.envelope import Envelope
from mesh_motion_server.service.execution import Execution
from mesh_motion_server.service.failures import failure_reply, known_error
from mesh_motion_server.service.holders import Holders
from mesh_motion_server.service.recorder import Recorder
from mesh_motion_server.session.model import ModelBuilder, build_motion_model
from mesh_motion_server.session.replay import Progress, silent
from mesh_motion_server.session.session import Session
from mesh_motion_server.session.spec import SessionSpec
from mesh_motion_server.session.state import Operation, State
from mesh_motion_server.session.store import SessionStore
from mesh_motion_server.settings import ServerSettings, check_durability, check_evaluation


class SessionHost:
    """One session and the requests made to it.

    Parameters
    ----------
    session : Session
    clock : callable
        Monotonic seconds; all deadlines use it.

    Attributes
    ----------
    closed : bool
        CLOSE was answered for every partition that had joined: send the replies, then end the process.
    """

    def __init__(
        self, session: Session, store: SessionStore, *, limits: ServerSettings, clock: Callable[[], float]
    ) -> None:
        self._session = session
        self._store = store
        self._holders = Holders(session)
        self._recorder = Recorder(session)
        self._execution = Execution(session, limits=limits, clock=clock, recorder=self._recorder)
        self._counts: Counter[str] = Counter()
        self._discard = False
        self.closed = False

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
        """Create a session; ``build_model`` builds its model.

        Raises InvalidInput if the basis or the durability level is not offered, or the client cannot evaluate this
        motion. Raises ResourceExhausted if the disk has no room for it or fails.
        """
        limits = limits or ServerSettings()
        check_durability(spec.durability, limits.durability)
        check_evaluation(spec.evaluation, spec.settings, spec.time_levels)
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
        progress: Progress = silent,
    ) -> SessionHost:
        """Open a stored session at its last committed step under a new epoch; call ``progress`` per recomputed step.

        Raises SessionError: NOT_FOUND, or UNAVAILABLE.STARTING while another process holds it. Raises DataLoss if the
        stored data does not verify, or the disk fails.
        """
        limits = limits or ServerSettings()
        folder = store.open(session, token)
        try:
            reopened = Session.reopen(folder, limits, build_model, progress)
        except BaseException:
            folder.release()
            raise
        host = cls(reopened, store, limits=limits, clock=clock)
        host._recorder.resumed()
        return host

    # --- where it stands -------------------------------------------------------------------------------------------

    @property
    def session(self) -> str:
        """The session's id."""
        return self._session.spec.session

    @property
    def label(self) -> str:
        """The label given in OPEN."""
        return self._session.spec.label

    @property
    def partitions(self) -> int:
        """Number of partitions that must join."""
        return self._session.spec.partitions

    @property
    def state(self) -> State:
        """The state, as in the session table."""
        return self._session.state

    @property
    def epoch(self) -> int:
        """The epoch; each RESUME raises it."""
        return self._session.epoch

    @property
    def step(self) -> int:
        """The last committed step."""
        return self._session.step

    @property
    def iteration(self) -> int:
        """Number of moves of the open trial, 0 without a trial."""
        return self._session.iteration

    @property
    def next_deadline(self) -> float | None:
        """Time on the clock at which :meth:`expire` has to be called next."""
        return self._execution.deadline

    # --- what it does ----------------------------------------------------------------------------------------------

    def handle(self, envelope: Envelope) -> list[Envelope]:
        """Return the replies that can be sent after this request; an error is also a reply."""
        return self._answered(envelope, self._handle)

    def oversee(self, envelope: Envelope) -> list[Envelope]:
        """Answer STATUS and CLOSE of a user who need not have joined; transport has checked the user's right.

        STATUS contains no coordinates. CLOSE applies to all partitions: waiting requests are answered with ABORTED, and
        the session is closed.
        """
        return self._answered(envelope, self._oversee)

    def expire(self, now: float) -> list[Envelope]:
        """Answer a collective request that has waited too long; it has changed nothing."""
        return self._execution.expire(now)

    def reclaim(self, token: bytes) -> int:
        """RESUME while this process holds the session: fence the old holder and drop the trial.

        Raises SessionError: NOT_FOUND for a wrong token; FAILED_PRECONDITION.STATE or RESOURCE_EXHAUSTED.DISK when the
        session must be opened again in another process. Raises DataLoss if the disk fails during the call.

        Returns
        -------
        int
            The new epoch.
        """
        if not self._session.spec.admits(token):
            raise not_found(self.session)
        epoch = self._session.resume()
        self._holders.clear()
        self._execution.forget_waiting()
        self._discard = False  # a new holder does not inherit the choice of earlier holders, as in a new process
        self._recorder.resumed()
        return epoch

    def suspend(self) -> list[Envelope]:
        """The lease ended: every client has to join again; a session without a mesh is closed."""
        closes = self._session.admit(Operation.LEASE_END) is State.CLOSED
        if not closes:
            self._session.suspend()
            self._recorder.suspended()
        abandoned = self._execution.abandon(
            SessionError("the lease ended while the request waited", code="ABORTED", hint="JOIN again")
        )
        if closes:
            self.close()
            self.closed = True
        return abandoned

    def close(self) -> None:
        """Release files and lock; a built session stays resumable. Idempotent."""
        if self._session.state is State.CLOSED:
            return
        self._execution.forget_waiting()
        self._session.close()
        with contextlib.suppress(ResourceExhausted):  # the next start removes the rest
            self._delete_unless_kept(discard=False)

    # --- inside ----------------------------------------------------------------------------------------------------

    def _answered(self, envelope: Envelope, answer: Callable[[Envelope], list[Envelope]]) -> list[Envelope]:
        """Return the replies, or the error."""
        try:
            replies = answer(envelope)
        except Exception as error:
            refusal = failure_reply(envelope.message, known_error(error), self._session)
            self._recorder.refused(envelope.message, refusal, by_holder=self._holders.has_joined(envelope.peer))
            replies = [Envelope(envelope.peer, refusal)]
        self._counts.update(reply.message.type for reply in replies)
        return replies

    def _oversee(self, envelope: Envelope) -> list[Envelope]:
        request, peer = envelope.message, envelope.peer
        if isinstance(request, Status):
            self._holders.check_address(request)
            reply = status.answer(self._session, request, self._execution.missing, dict(self._counts))
            return [Envelope(peer, status.without_places(reply))]
        if isinstance(request, Close):
            self._holders.check_address(request)
            return self._close_partition(peer, request, others=0)
        raise SessionError(f"{request.type} needs a JOIN", code="PERMISSION_DENIED")

    def _handle(self, envelope: Envelope) -> list[Envelope]:
        request, peer = envelope.message, envelope.peer
        if isinstance(request, Ping):
            return [Envelope(peer, Pong(client=request.client, sequence=request.sequence))]
        if not isinstance(request, SessionMessage):
            raise SessionError(f"a session does not take {request.type}", code="UNIMPLEMENTED.MESSAGE")
        self._holders.check_address(request)
        if isinstance(request, Join):
            was_suspended = self._session.state is State.SUSPENDED
            reply: Message = join.answer(self._session, request)
            if was_suspended:
                self._recorder.joined()
            failpoint("request.join")
            self._holders.join(peer, request.partition)
            return [Envelope(peer, reply)]
        self._holders.check_joined(peer, request.partition)
        if isinstance(request, Status):
            waiting_for, counts = self._execution.missing, dict(self._counts)
            return [Envelope(peer, status.answer(self._session, request, waiting_for, counts))]
        if isinstance(request, Close):
            return self._close_partition(peer, request, others=self._holders.others(request.partition))
        return self._execution.execute(peer, request)

    def _close_partition(self, peer: bytes, request: Close, *, others: int) -> list[Envelope]:
        """Remove one partition; the last one, with no ``others``, closes the session."""
        reply = close.answer(self._session, request)
        discard = self._discard or request.outcome == "discard"
        if not others:
            self._delete_unless_kept(discard=discard)  # first, because nothing has changed if the disk refuses
        self._discard = discard
        replies = self._execution.abandon(
            SessionError(f"partition {request.partition} closed the session", code="ABORTED", hint="ask STATUS")
        )
        self._holders.leave(request.partition)
        if not others:
            self.closed = True  # even if the rest fails: no client can join a closed session, so the process must end
            failpoint("request.close.left")
            self._holders.clear()
            if not discard and self._session.is_built:
                self._recorder.closed()
            self._session.close(keep=not discard)
        return [*replies, Envelope(peer, reply)]

    def _delete_unless_kept(self, *, discard: bool) -> None:
        """Delete the session on ``discard``, or if it was never built."""
        if discard or not self._session.is_built:
            failpoint("request.discard")
            self._store.discard(self.session)
            self._session.history.close()
