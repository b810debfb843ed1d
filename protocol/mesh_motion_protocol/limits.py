"""Every limit of protocol 1.0: its value, its unit, what it bounds. WELCOME announces all of them.

Limits marked ``fixed`` belong to the protocol: both ends count on them before any WELCOME. The others are a server's
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
    "Limit",
    "default_limits",
]

#: Frame 0, packed. A quality report with ten worst cells takes about 2 KiB.
HEADER_BYTES = 64 * 1024
#: Items of one msgpack array or map: a header of empty maps may not unpack to hundreds of megabytes.
CONTAINER_ITEMS = 256
#: Nesting of msgpack arrays and maps, the header's own map being level 1.
HEADER_DEPTH = 12
#: One raw frame. On ipc, 16 MiB frames gave the highest throughput, 3.9 GB/s.
FRAME_BYTES = 16 * 1024 * 1024
#: All arrays of one message.
MESSAGE_BYTES = 2 * 1024**3


@dataclass(frozen=True)
class Limit:
    """One limit: ``value`` in ``unit``; ``fixed`` by the protocol or a server's choice."""

    name: str
    value: int
    unit: str
    fixed: bool
    meaning: str


LIMITS: dict[str, Limit] = {
    limit.name: limit
    for limit in (
        Limit("header_bytes", HEADER_BYTES, "bytes", True, "frame 0"),
        Limit("header_depth", HEADER_DEPTH, "levels", True, "nesting of maps and arrays in frame 0"),
        Limit("container_items", CONTAINER_ITEMS, "items", True, "one map or array in frame 0"),
        Limit("frame_bytes", FRAME_BYTES, "bytes", True, "one frame of an array"),
        Limit("message_bytes", MESSAGE_BYTES, "bytes", False, "all arrays of one message"),
        Limit("partitions", 256, "partitions", False, "partitions of one session"),
        Limit("sessions", 64, "sessions", False, "sessions with a worker at the same time"),
        Limit("session_bytes", 4 * 1024**3, "bytes", False, "uploaded mesh of one session, all partitions"),
        Limit("replies_remembered", 4, "replies", False, "stored replies for repeated requests, per client"),
        Limit("collective_wait_seconds", 600, "s", False, "a collective request waits for the other partitions"),
        Limit("lease_seconds", 3600, "s", False, "a session without any connection keeps its worker"),
        Limit("drain_seconds", 60, "s", False, "a stopping server lets running requests finish"),
    )
}


def default_limits() -> dict[str, int]:
    """Name → value of every limit, as WELCOME carries them."""
    return {limit.name: limit.value for limit in LIMITS.values()}
