"""The sessions, their owners, and the control requests that were already made.

Values only: no process, no socket. The supervisor uses them.
"""

import hmac
from bisect import bisect_right
from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import msgpack
from mesh_motion_protocol.digests import request_digest
from mesh_motion_protocol.errors import MeshMotionError, SessionError
from mesh_motion_protocol.limits import HEADER_BYTES
from mesh_motion_protocol.messages import Message

from mesh_motion_server.security.authorisation import not_found
from mesh_motion_server.session.listing import StoredSession
from mesh_motion_server.session.store import SessionStore
from mesh_motion_server.transport.processes import Child

#: Number of control requests of a user whose replies are kept.
_REMEMBERED = 1024
#: Number of sessions with a failed worker that are kept.
_FALLEN = 1024
#: Largest number of sessions in one LISTED.
_LISTED = 200
#: Bytes of these entries; the difference is for the rest of the header.
_LISTED_BYTES = HEADER_BYTES - 1024


@dataclass(eq=False)
class Asked:
    """A control request and the newest connection that sent it, which gets the reply."""

    peer: bytes
    user: str
    request: Message
    content: bytes
    reply: bytes | None = None


@dataclass(eq=False)
class Live:
    """A session that has a worker, or had one since this server started.

    ``owner`` is the public key of the user who opened it, empty on a server without keys. ``status`` is PROBED's
    ``worker``: starting, alive or dead. ``asked`` is the OPEN or RESUME that waits for the worker; ``deadline`` is when
    that wait ends; ``queue`` holds further RESUMEs, and requests that take this session's place. ``failure`` and
    ``over`` come from the worker's last report: why it could not start, and that it ended normally. ``suspended_at`` is
    when the lease ended on the monotonic clock, None while a client has it; ``giving_way``: the worker ends because its
    place is needed.
    """

    session: str
    token: bytes = field(repr=False)
    owner: str
    child: Child
    label: str = ""
    partitions: int = 1
    status: str = "starting"
    endpoint: str = ""
    epoch: int = 0
    state: str = "NEW"
    step: int = 0
    asked: Asked | None = None
    reclaiming: bool = False
    deadline: float | None = None
    queue: deque[Asked] = field(default_factory=deque)
    failure: MeshMotionError | None = None
    over: bool = False
    suspended_at: float | None = None
    giving_way: bool = False

    def note_suspended(self, suspended: bool, now: float) -> None:
        """Note the worker's report whether its lease has ended."""
        if suspended != (self.suspended_at is not None):
            self.suspended_at = now if suspended else None

    def listed(self) -> dict[str, Any]:
        """Return the session's entry in LISTED."""
        worker = "alive" if self.status in ("alive", "starting") else "none"
        return {"session": self.session, "label": self.label, "state": self.state, "step": self.step,
                "partitions": self.partitions, "worker": worker}  # fmt: skip


class RequestBook:
    """Control requests by user and id: a repeat gets the stored reply, or replaces the waiting one.

    Ids are separate for each user: a user cannot get another user's reply (with its token) by using the same id, and
    cannot make the server forget another user's request. Waiting requests are kept.
    """

    def __init__(self) -> None:
        self._users: dict[str, OrderedDict[tuple[bytes, int], Asked]] = {}

    def enter(self, peer: bytes, user: str, request: Message) -> tuple[Asked, bool]:
        """Return the entry of a request, and whether it is new.

        Raises SessionError: ABORTED.CONFLICT if the id was used for different content.
        """
        own = self._users.setdefault(user, OrderedDict())
        key, content = (request.client, request.sequence), request_digest(request)
        known = own.get(key)
        if known is None:
            answered = (key for key, asked in own.items() if asked.reply is not None)
            if len(own) >= _REMEMBERED and (oldest := next(answered, None)) is not None:
                del own[oldest]
            own[key] = asked = Asked(peer, user, request, content)
            return asked, True
        if known.content != content:
            raise SessionError(
                f"request {request.sequence} was already sent with other content",
                code="ABORTED.CONFLICT",
                hint="use a new sequence for a new request",
            )
        known.peer = peer
        return known, False

    def forget(self, asked: Asked) -> None:
        """Forget a request that failed without any effect: a repeat is a new attempt."""
        own = self._users.get(asked.user, OrderedDict())
        own.pop((asked.request.client, asked.request.sequence), None)
        if not own:
            self._users.pop(asked.user, None)


class Registry:
    """The live sessions, and the store for all others."""

    def __init__(self, store: SessionStore) -> None:
        self._store = store
        self.live: dict[str, Live] = {}

    def owner(self, session: str) -> str | None:
        """Return the public key of a session's owner, empty if opened without keys; None if there is no such session.

        Raises DataLoss if the owner of the stored session cannot be read.
        """
        live = self.live.get(session)
        if live is not None:
            return live.owner
        return self._store.owner(session)

    def authorised(self, session: str, token: bytes) -> Live | None:
        """Return the live session, or None for one that only the store has.

        Raises SessionError: NOT_FOUND, the same for an unknown session and a wrong token.
        """
        live = self.live.get(session)
        if live is None:
            self._store.check_token(session, token)
            return None
        if not hmac.compare_digest(live.token, token):
            raise not_found(session)
        return live

    def overseen(self, session: str) -> Live | None:
        """Like :meth:`authorised`, for a user who needs no token."""
        if self.owner(session) is None:
            raise not_found(session)
        return self.live.get(session)

    def forget_fallen(self) -> None:
        """Keep only the latest sessions whose worker failed and that were not resumed: the others are in the store."""
        fallen = [live.session for live in self.live.values() if live.status == "dead"]
        for session in fallen[:-_FALLEN]:
            del self.live[session]

    def working(self) -> list[Live]:
        """Return the sessions with a worker that still serves them."""
        return [live for live in self.live.values() if live.status != "dead" and live.state != "CLOSED"]

    def page(self, after: str, shown: Callable[[str], bool]) -> tuple[list[tuple[str, dict[str, Any]]], bool]:
        """LISTED's sessions after ``after`` with their owners, and whether there are more; reads only this page.

        ``shown`` takes an owner and returns whether the asking user may see the owner's sessions.
        """
        names = sorted(self.live.keys() | set(self._store.names()))
        page: list[tuple[str, dict[str, Any]]] = []
        for name in names[bisect_right(names, after) :]:
            owner = self._owner_listed(name)
            if owner is None or not shown(owner):
                continue
            if len(page) == _LISTED:
                return page, True
            live = self._serving(name)
            page.append((owner, live.listed() if live is not None else _stored(self._store.describe(name))))
        return page, False

    def _serving(self, session: str) -> Live | None:
        """Return the live session; None after CLOSE was answered: then the store decides whether it exists."""
        live = self.live.get(session)
        return None if live is None or live.state == "CLOSED" else live

    def _owner_listed(self, session: str) -> str | None:
        live = self._serving(session)
        return live.owner if live is not None else self._store.owner_listed(session)

    def of(self, child: Child) -> Live | None:
        """Return the session of a worker, None for the template."""
        return next((live for live in self.live.values() if live.child is child), None)


def _stored(entry: StoredSession) -> dict[str, Any]:
    return {"session": entry.session, "label": entry.label, "state": str(entry.state), "step": entry.step,
            "partitions": entry.partitions, "worker": "none"}  # fmt: skip


def fit(entries: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return as many entries of LISTED as fit into one header: labels may be long."""
    room, count = _LISTED_BYTES, 0
    for entry in entries:
        room -= len(msgpack.packb(entry))
        if room < 0:
            break
        count += 1
    return entries[:count]
