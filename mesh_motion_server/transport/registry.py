"""Which sessions there are, who may see them, and which control requests were already made.

Values only: no process, no socket. The supervisor acts on it.
"""

from __future__ import annotations

import hmac
from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import msgpack
from mesh_motion_protocol.digests import request_digest
from mesh_motion_protocol.limits import HEADER_BYTES
from mesh_motion_protocol.messages import Message

from mesh_motion_server.errors import MeshMotionError, SessionError
from mesh_motion_server.security.authorisation import not_found
from mesh_motion_server.transport.processes import Child

__all__ = ["Asked", "Live", "Registry", "RequestBook", "fit"]

#: Control requests whose replies are remembered.
_REMEMBERED = 1024
#: Sessions in one LISTED.
_LISTED = 200
#: Bytes of their entries, which leave room for the rest of the header.
_LISTED_BYTES = HEADER_BYTES - 1024


@dataclass(eq=False)
class Asked:
    """A control request and where its reply goes: the newest connection that sent it."""

    peer: bytes
    user: str
    request: Message
    content: bytes
    reply: bytes | None = None


@dataclass(eq=False)
class Live:
    """A session that has, or had since this server started, a worker.

    ``owner`` is the public key of who opened it, empty on a server without keys. ``status`` is PROBED's ``worker``:
    starting, alive or dead. ``asked`` is the OPEN or RESUME that waits for the worker; ``deadline`` is when that wait
    ends; ``queue`` holds further RESUMEs. ``failure`` and ``over`` are the worker's last words: why it could not start,
    that it ended as it should.
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

    def listed(self) -> dict[str, Any]:
        """Its entry in LISTED."""
        worker = "alive" if self.status in ("alive", "starting") else "none"
        return {"session": self.session, "label": self.label, "state": self.state, "step": self.step,
                "partitions": self.partitions, "worker": worker}  # fmt: skip


class RequestBook:
    """Control requests by user and id: a repeat gets the stored reply, or takes the place of the one that waits.

    The ids are the users' own: nobody gets a reply, and the token in it, by using another one's id.
    """

    def __init__(self) -> None:
        self._known: OrderedDict[tuple[str, bytes, int], Asked] = OrderedDict()

    def enter(self, peer: bytes, user: str, request: Message) -> tuple[Asked, bool]:
        """The entry of a request, and whether it is new.

        Raises
        ------
        SessionError
            ABORTED.CONFLICT if the id was used for another content.
        """
        key, content = (user, request.client, request.sequence), request_digest(request)
        known = self._known.get(key)
        if known is None:
            self._known[key] = asked = Asked(peer, user, request, content)
            while len(self._known) > _REMEMBERED:
                self._known.popitem(last=False)
            return asked, True
        if known.content != content:
            raise SessionError(
                f"request {request.sequence} was already made with another content",
                code="ABORTED.CONFLICT",
                hint="use a new sequence for a new request",
            )
        known.peer = peer
        return known, False

    def forget(self, asked: Asked) -> None:
        """The request failed without any effect: a repeat is a new try."""
        self._known.pop((asked.user, asked.request.client, asked.request.sequence), None)


class Registry:
    """The live sessions and, behind them, the store.

    Parameters
    ----------
    store : SessionStore
    """

    def __init__(self, store: Any) -> None:
        self._store = store
        self.live: dict[str, Live] = {}

    def owner(self, session: str) -> str | None:
        """The public key of a session's owner, empty for one opened without keys; None if there is no such session.

        Raises
        ------
        JournalError
            If the stored session does not say.
        """
        live = self.live.get(session)
        if live is not None:
            return live.owner
        owner: str | None = self._store.owner(session)
        return owner

    def authorised(self, session: str, token: bytes) -> Live | None:
        """The live session, or None for one that only the store has.

        Raises
        ------
        SessionError
            NOT_FOUND, alike for an unknown session and a wrong token.
        """
        live = self.live.get(session)
        if live is None:
            self._store.check_token(session, token)
            return None
        if not hmac.compare_digest(live.token, token):
            raise not_found(session)
        return live

    def overseen(self, session: str) -> Live | None:
        """Like :meth:`authorised`, for somebody who needs no token."""
        if self.owner(session) is None:
            raise not_found(session)
        return self.live.get(session)

    def working(self) -> int:
        """Sessions with a worker."""
        return sum(live.status != "dead" for live in self.live.values())

    def page(self, after: str, shown: Callable[[str], bool]) -> tuple[list[tuple[str, dict[str, Any]]], bool]:
        """LISTED's sessions behind ``after`` with their owners, and whether there are more.

        ``shown`` says of an owner whether the asker may see the sessions.
        """
        entries = {s.session: (s.owner, _stored(s)) for s in self._store.sessions()}
        entries |= {live.session: (live.owner, live.listed()) for live in self.live.values()}
        behind = [entries[name] for name in sorted(entries) if name > after and shown(entries[name][0])]
        return behind[:_LISTED], len(behind) > _LISTED

    def of(self, child: Child) -> Live | None:
        """The session of a worker, None for the spare."""
        return next((live for live in self.live.values() if live.child is child), None)


def _stored(entry: Any) -> dict[str, Any]:
    return {"session": entry.session, "label": entry.label, "state": str(entry.state), "step": entry.step,
            "partitions": entry.partitions, "worker": "none"}  # fmt: skip


def fit(entries: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """As many of LISTED's sessions as fit into one header: labels may be long."""
    room, count = _LISTED_BYTES, 0
    for entry in entries:
        room -= len(msgpack.packb(entry))
        if room < 0:
            break
        count += 1
    return entries[:count]
