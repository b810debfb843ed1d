"""The rights to send requests for a partition: only the peer that joined it last, under the current epoch."""

from __future__ import annotations

from mesh_motion_protocol.errors import InvalidInput, SessionError
from mesh_motion_protocol.messages import SessionMessage

from mesh_motion_server.security.authorisation import not_found
from mesh_motion_server.session.session import Session


class Holders:
    """The peers that joined."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._peers: dict[int, bytes] = {}

    def others(self, partition: int) -> int:
        """Number of other partitions that have a peer."""
        return len(self._peers.keys() - {partition})

    def check_address(self, request: SessionMessage) -> None:
        """Check session id, partition and epoch of a request.

        Raises SessionError: NOT_FOUND for another session, ABORTED.FENCED for another epoch. Raises InvalidInput for a
        partition that does not exist.
        """
        spec = self._session.spec
        if request.session != spec.session:  # first: other answers would describe a session to a stranger
            raise not_found(request.session)
        if not 0 <= request.partition < spec.partitions:
            raise InvalidInput(
                f"partition {request.partition} is not in 0 … {spec.partitions - 1}",
                code="INVALID_ARGUMENT.VALUE",
                details={"partition": request.partition, "partitions": spec.partitions},
            )
        current = self._session.epoch
        if request.epoch != current:
            resumed = request.epoch < current  # each RESUME raises the epoch, and nothing lowers it
            reason = "the session was resumed by another holder" if resumed else "the server never issued it"
            raise SessionError(
                f"epoch {request.epoch} is not the current one: {reason}",
                code="ABORTED.FENCED",
                details={"epoch": request.epoch},
            )

    def check_joined(self, peer: bytes, partition: int) -> None:
        """Raise UNAUTHENTICATED unless this peer joined this partition last."""
        if self._peers.get(partition) != peer:
            raise SessionError(
                f"this connection has not joined partition {partition}",
                code="UNAUTHENTICATED",
                hint="send JOIN with the session's token first",
                details={"partition": partition},
            )

    def has_joined(self, peer: bytes) -> bool:
        """Whether the peer holds a partition."""
        return peer in self._peers.values()

    def join(self, peer: bytes, partition: int) -> None:
        """Make the peer the holder of the partition."""
        self._peers[partition] = peer

    def leave(self, partition: int) -> None:
        """Remove the partition's peer."""
        self._peers.pop(partition, None)

    def clear(self) -> None:
        """Remove all peers: every client has to join again."""
        self._peers.clear()
