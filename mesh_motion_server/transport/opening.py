"""Checks that can refuse an OPEN before a worker is started, and which session gives its place up to another one.

A session whose lease has ended needs no worker: it is stored, and RESUME starts another. So the one that has been
suspended for longest gives way to a request that finds no place, port or memory for its own worker.
"""

from mesh_motion_protocol.errors import InvalidInput, MeshMotionError, ResourceExhausted
from mesh_motion_protocol.messages import Open

from mesh_motion_server.operation.disk_watch import DiskWatch
from mesh_motion_server.operation.room import available_memory
from mesh_motion_server.settings import MethodSettings, ServerSettings, check_durability, check_evaluation
from mesh_motion_server.transport.registry import Live, Registry

_NO_PLACE = "RESOURCE_EXHAUSTED.SESSIONS"


def check_open(request: Open, limits: ServerSettings) -> str:
    """Check an OPEN against the server's limits.

    Raises InvalidInput; the message names the field or the setting, and its value. Raises ResourceExhausted if the
    request asks for more bytes than a session may have.

    Returns
    -------
    str
        The durability level to use.
    """
    if request.partitions > limits.max_partitions:
        raise InvalidInput(
            f"partitions must be at most {limits.max_partitions}, got {request.partitions}",
            code="INVALID_ARGUMENT.VALUE",
            details={"field": "partitions", "expected": limits.max_partitions, "got": request.partitions},
        )
    if len(request.label) > limits.max_label_characters:
        raise InvalidInput(
            f"label must have at most {limits.max_label_characters} characters, got {len(request.label)}",
            code="INVALID_ARGUMENT.VALUE",
            details={"field": "label", "expected": limits.max_label_characters, "got": len(request.label)},
        )
    if request.bytes_reserved > limits.max_session_bytes:
        raise ResourceExhausted(
            f"bytes_reserved must be at most {limits.max_session_bytes}, got {request.bytes_reserved}",
            hint="raise the server's max_session_bytes",
            details={"field": "bytes_reserved", "expected": limits.max_session_bytes, "got": request.bytes_reserved},
        )
    check_evaluation(request.evaluation, MethodSettings.from_mapping(request.settings), request.time_levels)
    return check_durability(request.durability, limits.durability)


def check_room(request: Open, limits: ServerSettings, disk: DiskWatch) -> None:
    """Refuse a new session that would take the disk or memory reserve of the running sessions.

    Raises ResourceExhausted: RESOURCE_EXHAUSTED.DISK or .SESSIONS, with the remaining amount; a later request may
    succeed.
    """
    free, wanted = disk.fresh().free, limits.reserve_disk_bytes + request.bytes_reserved
    if free < wanted:
        raise ResourceExhausted(
            f"the disk of the state folder has {free} bytes left, a new session needs {wanted}",
            code="RESOURCE_EXHAUSTED.DISK",
            hint="make room on the server's disk, discard old sessions, or lower reserve_disk_bytes",
            details={"free": free, "expected": wanted},
        )
    memory, wanted = available_memory(), limits.reserve_memory_bytes + request.bytes_reserved
    if memory is not None and memory < wanted:
        raise ResourceExhausted(
            f"the server has {memory} bytes of memory left, a new session needs {wanted}",
            code="RESOURCE_EXHAUSTED.SESSIONS",
            hint="close a session, or give the machine or its container more memory",
            details={"free": memory, "expected": wanted},
        )


class QuotaReached(ResourceExhausted):
    """A user has as many sessions as each user may have; only another one of his can give way."""

    def __init__(self, user: str, most: int) -> None:
        super().__init__(
            f"{most} sessions of this key are open, which is the limit of each key on this server",
            code=_NO_PLACE,
            hint="close one, or raise max_sessions_per_key",
            details={"expected": most},
        )
        self.user = user


def check_place(registry: Registry, settings: ServerSettings, user: str) -> None:
    """Raise if there is no place for one more worker, or none for this user.

    Raises ResourceExhausted: RESOURCE_EXHAUSTED.SESSIONS.
    """
    working, most = registry.working(), settings.max_sessions_per_key
    if user and most is not None and sum(live.owner == user for live in working) >= most:
        raise QuotaReached(user, most)
    if len(working) >= settings.max_sessions:
        raise ResourceExhausted(
            f"{settings.max_sessions} sessions are open, which is the limit of this server",
            code=_NO_PLACE,
            hint="close one, or raise max_sessions",
            details={"expected": settings.max_sessions},
        )


def gives_way(registry: Registry, error: MeshMotionError) -> Live | None:
    """Return the session that gives way to the request that this error refuses, marked so; None if there is none."""
    if error.code != _NO_PLACE:
        return None
    owner = error.user if isinstance(error, QuotaReached) else None
    live = min((live for live in registry.working() if _may(live, owner)), key=_since, default=None)
    if live is not None:
        live.giving_way = True
    return live


def _may(live: Live, owner: str | None) -> bool:
    idle = live.status == "alive" and live.suspended_at is not None and live.asked is None
    return idle and not live.giving_way and owner in (None, live.owner)


def _since(live: Live) -> float:
    return live.suspended_at or 0.0
