"""A request in, its replies out: the whole server without a socket.

:class:`SessionHost` holds one session in one worker process. Transport hands it each decoded request as an
:class:`Envelope` and sends the envelopes it returns; in-process users call :meth:`SessionHost.handle` themselves.
Single-threaded: one call at a time::

    store = SessionStore(root)                  mesh_motion_server.session.store
        store.sessions() -> list[StoredSession(session, label, dimension, partitions, step, state)]
        store.check_token(session, token)       NOT_FOUND alike for an unknown session and a wrong token
        store.discard(session)
    SessionHost.create(spec, store, limits=ServerSettings(), clock=time.monotonic) -> SessionHost
    SessionHost.resume(session, token, store, limits=…, clock=…) -> SessionHost      raises the epoch
        host.session, .label: str    .partitions, .epoch, .step, .iteration: int    .state: State
        host.closed: bool                       CLOSE was answered: send its replies, then end the worker
        host.handle(envelope) -> [envelope]     never raises; collective requests answer all once all came
        host.next_deadline: float | None        when expire() will have something to do, on the clock given
        host.expire(now) -> [envelope]          DEADLINE_EXCEEDED, naming the missing partitions
        host.reclaim(token) -> int              RESUME of a live worker: the new epoch; SessionError: start a new worker
        host.suspend() -> [envelope]            the lease ended
        host.close()                            drain: files and lock are given back; the session stays resumable
"""

from __future__ import annotations

from dataclasses import dataclass

from mesh_motion_protocol.messages import Message

from mesh_motion_server.session.spec import SessionSpec

__all__ = ["Envelope", "SessionSpec"]


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
