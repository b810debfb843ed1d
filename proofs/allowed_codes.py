"""Which error codes a request may be answered with, by its type, read from SPEC.md: section by section."""

from __future__ import annotations

from functools import cache

__all__ = ["allowed_codes"]

#: Sections 3 to 6: frames that are no message, or none of this version.
_FRAMES = (
    "INVALID_ARGUMENT.HEADER", "INVALID_ARGUMENT.VALUE", "INVALID_ARGUMENT.DTYPE", "INVALID_ARGUMENT.SHAPE",
    "INVALID_ARGUMENT.FRAMES", "INVALID_ARGUMENT.NONFINITE", "RESOURCE_EXHAUSTED.BYTES", "UNIMPLEMENTED.VERSION",
    "UNIMPLEMENTED.MESSAGE",
)  # fmt: skip
#: Section 20: a key that is on no list; roles; sessions of others; a list that cannot be used.
_RIGHTS = ("UNAUTHENTICATED", "PERMISSION_DENIED", "NOT_FOUND", "UNAVAILABLE")
#: Sections 8, 9 and 11: address, epoch, state.
_SESSION = ("ABORTED.FENCED", "FAILED_PRECONDITION.STATE", "RESOURCE_EXHAUSTED.DISK")
#: Section 10.
_ONCE = ("ABORTED.CONFLICT", "ABORTED.STALE")
#: Section 9.
_COLLECTIVE = (*_ONCE, "INVALID_ARGUMENT.PARTITION", "DEADLINE_EXCEEDED", "ABORTED")
_START = ("RESOURCE_EXHAUSTED.SESSIONS", "RESOURCE_EXHAUSTED.DISK", "RESOURCE_EXHAUSTED.MEMORY", "UNAVAILABLE.DRAINING",
          "UNAVAILABLE.WORKER", "UNAVAILABLE.STARTING", "ABORTED.CONFLICT")  # fmt: skip

#: What is particular to a type.
_OWN: dict[str, tuple[str, ...]] = {
    "HELLO": (),
    "PING": (),
    "LIST": (),
    "PROBE": ("DATA_LOSS.CHECKSUM",),
    "OPEN": (*_START, "INVALID_ARGUMENT.SETTINGS", "UNIMPLEMENTED"),
    "RESUME": (*_START, "FAILED_PRECONDITION.STATE", "DATA_LOSS.CHECKSUM", "DATA_LOSS.RECOVERY_DIVERGED"),
    "JOIN": _SESSION,
    "UPLOAD": (*_SESSION, *_ONCE, "RESOURCE_EXHAUSTED.MEMORY"),
    "BUILD": (*_SESSION, *_COLLECTIVE, "INVALID_ARGUMENT", "INVALID_ARGUMENT.MESH", "INVALID_ARGUMENT.MESH_DEGENERATE",
              "INVALID_ARGUMENT.SETTINGS", "RESOURCE_EXHAUSTED.MEMORY"),
    "MOVE": (*_SESSION, *_COLLECTIVE, "FAILED_PRECONDITION.STEP", "FAILED_PRECONDITION.QUALITY",
             "RESOURCE_EXHAUSTED.MEMORY", "INVALID_ARGUMENT", "INVALID_ARGUMENT.SETTINGS"),
    "JUDGE": (*_SESSION, *_COLLECTIVE, "FAILED_PRECONDITION.STEP", "FAILED_PRECONDITION.QUALITY", "INVALID_ARGUMENT",
              "ABORTED.TRIAL_LOST"),
    "COMMIT": (*_SESSION, *_COLLECTIVE, "FAILED_PRECONDITION.STEP", "ABORTED.TRIAL_LOST"),
    "ROLLBACK": (*_SESSION, *_COLLECTIVE, "FAILED_PRECONDITION.STEP"),
    "FETCH": _SESSION,
    "STATUS": _SESSION,
    "CLOSE": _SESSION,
}  # fmt: skip


@cache
def allowed_codes(kind: str) -> frozenset[str]:
    """Of a request of this type; ``""`` is one whose type cannot be read, or a reply."""
    return frozenset((*_FRAMES, *_RIGHTS, *_OWN[kind])) if kind in _OWN else frozenset((*_FRAMES, *_RIGHTS))
