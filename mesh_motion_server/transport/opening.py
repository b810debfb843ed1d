"""What of an OPEN can be refused before a worker is taken."""

from __future__ import annotations

from mesh_motion_protocol.messages import Open

from mesh_motion_server.errors import InvalidInput, ResourceError
from mesh_motion_server.settings import MethodSettings, ServerSettings, check_durability

__all__ = ["check_open"]


def check_open(request: Open, limits: ServerSettings) -> str:
    """Check an OPEN against the server's limits.

    Returns
    -------
    str
        The durability in force.

    Raises
    ------
    InvalidInput
        Naming the field or the setting, and its value.
    ResourceError
        If more bytes are asked for than a session may have.
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
        raise ResourceError(
            f"bytes_reserved must be at most {limits.max_session_bytes}, got {request.bytes_reserved}",
            hint="raise the server's max_session_bytes",
            details={"field": "bytes_reserved", "expected": limits.max_session_bytes, "got": request.bytes_reserved},
        )
    MethodSettings.from_mapping(request.settings)
    return check_durability(request.durability)
