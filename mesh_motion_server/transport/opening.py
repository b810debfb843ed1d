"""Checks that can refuse an OPEN before a worker is started."""

from mesh_motion_protocol.errors import InvalidInput, ResourceExhausted
from mesh_motion_protocol.messages import Open

from mesh_motion_server.operation.disk_watch import DiskWatch
from mesh_motion_server.operation.room import available_memory
from mesh_motion_server.settings import MethodSettings, ServerSettings, check_durability, check_evaluation

__all__ = ["check_open", "check_room"]


def check_open(request: Open, limits: ServerSettings) -> str:
    """Check an OPEN against the server's limits.

    Returns
    -------
    str
        The durability level to use.

    Raises
    ------
    InvalidInput
        The message names the field or the setting, and its value.
    ResourceExhausted
        If the request asks for more bytes than a session may have.
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

    Raises
    ------
    ResourceExhausted
        RESOURCE_EXHAUSTED.DISK or .SESSIONS, with the remaining amount; a later request may succeed.
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
