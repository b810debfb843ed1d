"""Exactly once: the stored replies of recent requests, by (client, sequence).

A repeat with the same content gets the stored reply; with other content ABORTED.CONFLICT. The last K replies of each
client are kept, all together within a byte budget. A repeat of a dropped one gets ABORTED.STALE, because executing it
again could do harm. A failed request had no effect and is executed again when it is repeated.
"""

from collections import OrderedDict
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from mesh_motion_protocol.errors import SessionError

T = TypeVar("T")

#: Maximum number of clients; the client that was silent longest is forgotten first.
_MAX_CLIENTS = 1024


@dataclass(frozen=True)
class RequestId:
    """Identifies a request."""

    client: bytes  # 16-byte UUID of the client
    sequence: int
    content: bytes  # sha256 of the request's content without its epoch: a repeat after RESUME is the same request


@dataclass(slots=True)
class _Stored(Generic[T]):
    """A request's content, and its reply once there is one."""

    content: bytes
    reply: T | None = None
    nbytes: int = 0


@dataclass(slots=True)
class _Client(Generic[T]):
    """One client's recent requests by sequence; ``floor``: the highest dropped sequence."""

    stored: dict[int, _Stored[T]] = field(default_factory=dict)
    floor: int = 0


class ReplyTable(Generic[T]):
    """Stored replies of recent requests.

    Parameters
    ----------
    per_client : int
        Number of replies that are kept per client.
    byte_budget : int
        Limit for all replies together; the newest reply of each holder is kept in any case.
    holders : int
        Number of clients that hold the session: the clients that were answered last.
    """

    def __init__(self, per_client: int, byte_budget: int, holders: int = 1) -> None:
        self._per_client = per_client
        self._budget = byte_budget
        self._holders = holders
        self._clients: OrderedDict[bytes, _Client[T]] = OrderedDict()
        self._nbytes = 0

    @property
    def nbytes(self) -> int:
        """Bytes of all stored replies."""
        return self._nbytes

    def find(self, request: RequestId) -> T | None:
        """The stored reply; None if the request must be executed.

        Raises SessionError: ABORTED.CONFLICT: the request id was used for another request. ABORTED.STALE: the request
        is too old to be known.
        """
        client = self._clients.get(request.client)
        if client is None:
            return None
        known = client.stored.get(request.sequence)
        if known is not None:
            return self._same(known, request).reply
        if request.sequence <= client.floor:
            raise SessionError(
                f"request {request.sequence} is older than the replies kept ({client.floor + 1} and later)",
                code="ABORTED.STALE",
                hint="give new requests increasing numbers; STATUS returns the session's step",
                details={"sequence": request.sequence, "oldest": min(client.floor + 1, 2**63 - 1)},
            )
        return None

    def store(self, request: RequestId, reply: T | None, nbytes: int = 0) -> None:
        """Store a request and its reply. None: the request failed and may be repeated only with the same content."""
        client = self._clients.setdefault(request.client, _Client())
        self._clients.move_to_end(request.client)
        previous = client.stored.pop(request.sequence, None)
        self._nbytes += nbytes - (previous.nbytes if previous else 0)
        client.stored[request.sequence] = _Stored(request.content, reply, nbytes)
        self._shrink(client)

    def _same(self, known: _Stored[T], request: RequestId) -> _Stored[T]:
        """The stored entry, if the request repeats it."""
        if known.content == request.content:
            return known
        raise SessionError(
            f"request {request.sequence} was already sent with other content",
            code="ABORTED.CONFLICT",
            hint="a new request needs a new sequence number",
            details={"sequence": request.sequence},
        )

    def _shrink(self, newest: _Client[T]) -> None:
        """Drop the oldest replies: of this client beyond K, of silent clients, then of all while over the budget."""
        while len(newest.stored) > self._per_client:
            self._drop_first(newest)
        while len(self._clients) > _MAX_CLIENTS:
            _, forgotten = self._clients.popitem(last=False)
            self._nbytes -= sum(entry.nbytes for entry in forgotten.stored.values())
        if self._nbytes > self._budget:
            self._keep_to_budget()

    def _keep_to_budget(self) -> None:
        """Drop replies of clients that no longer hold the session, longest silent first; then all but the newest."""
        clients = list(self._clients.values())
        for left, some in ((0, clients[: -self._holders]), (1, clients[-self._holders :])):
            for client in some:
                while self._nbytes > self._budget and len(client.stored) > left:
                    self._drop_first(client)

    def _drop_first(self, client: _Client[T]) -> None:
        sequence = next(iter(client.stored))
        entry = client.stored.pop(sequence)
        if not client.stored:
            client.stored = {}  # an emptied dict keeps its memory
        client.floor = max(client.floor, sequence)
        self._nbytes -= entry.nbytes
