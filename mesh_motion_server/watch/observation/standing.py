"""What is said of a session that no process holds."""

from __future__ import annotations

__all__ = ["rests"]

#: What a session that nobody holds is after these events is where it can be resumed: a trial ends with its worker.
_WITHOUT_WORKER = ("READY", "TRIAL", "COMMITTING")


def rests(state: str, held: bool | None) -> bool:
    """Whether a session is at rest: nobody holds it (``held`` False), and nothing else is to be said of it, as that it
    was suspended, closed or failed.
    """
    return held is False and state in _WITHOUT_WORKER
