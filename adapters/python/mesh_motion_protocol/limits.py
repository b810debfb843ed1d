"""Every limit of protocol 1.0, with its value, its unit and its subject. WELCOME announces all of them.

Limits marked ``fixed`` belong to the protocol: both ends rely on them before any WELCOME. The others are a server's
choice; the values here are its defaults.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = [
    "CONTAINER_ITEMS",
    "FRAME_BYTES",
    "HEADER_BYTES",
    "HEADER_DEPTH",
    "LIMITS",
    "MESSAGE_BYTES",
    "NAME_BYTES",
    "Limit",
    "default_limits",
]

#: Size of frame 0, packed. A quality report with ten worst cells takes about 2 KiB.
HEADER_BYTES = 64 * 1024
#: Items of one msgpack array or map: a header of empty maps must not unpack to hundreds of megabytes.
CONTAINER_ITEMS = 256
#: Nesting of msgpack arrays and maps; the header's own map is level 1.
HEADER_DEPTH = 12
#: Size of one raw frame. On ipc, 16 MiB frames gave the highest throughput, 3.9 GB/s.
FRAME_BYTES = 16 * 1024 * 1024
#: Size of all arrays of one message.
MESSAGE_BYTES = 2 * 1024**3
#: Size of a name, in UTF-8: of a patch, for example.
NAME_BYTES = 256


@dataclass(frozen=True)
class Limit:
    """One limit: ``value`` in ``unit``; ``fixed`` by the protocol, or else chosen by a server."""

    name: str
    value: int
    unit: str
    fixed: bool
    meaning: str


LIMITS: dict[str, Limit] = {
    limit.name: limit
    for limit in (
        Limit("max_header_bytes", HEADER_BYTES, "bytes", True, "frame 0"),
        Limit("max_header_depth", HEADER_DEPTH, "levels", True, "nesting of maps and arrays in frame 0"),
        Limit("max_container_items", CONTAINER_ITEMS, "items", True, "one map or array in frame 0"),
        Limit("max_chunk_bytes", FRAME_BYTES, "bytes", True, "one frame of an array"),
        Limit("max_message_bytes", MESSAGE_BYTES, "bytes", False, "all arrays of one message"),
        Limit("max_label_characters", 200, "characters", False, "OPEN's label"),
        Limit("max_partitions", CONTAINER_ITEMS, "partitions", False, "partitions of one session"),
        Limit("max_sessions", 64, "sessions", False, "sessions with a worker at the same time"),
        Limit("max_session_bytes", 4 << 30, "bytes", False, "uploaded mesh of one session, all partitions"),
        Limit("stored_replies", 8, "replies", False, "replies kept for repeated requests, per client"),
        Limit("stored_reply_bytes", 32 << 20, "bytes", False, "arrays of all kept replies of a session"),
        Limit("collective_timeout_ms", 120_000, "ms", False, "a collective request waits for the other partitions"),
        Limit("lease_ms", 60_000, "ms", False, "a session without any connection keeps its trial"),
        Limit("idle_ms", 3_600_000, "ms", False, "a session without any connection keeps its worker"),
        Limit("drain_ms", 30_000, "ms", False, "a stopping server lets running requests finish"),
    )
}


def default_limits() -> dict[str, int]:
    """Name → value of every limit, as WELCOME carries them."""
    return {limit.name: limit.value for limit in LIMITS.values()}
