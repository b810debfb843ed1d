"""The errors of the server, each tied to its code on the wire.

::

    MeshMotionError
    ├── InvalidInput          the caller's data or settings are wrong; nothing was changed
    ├── SessionError          the request does not fit the session's state, owner or step
    ├── NumericalError        no acceptable motion was found (.best, .cells, .fraction); nothing was changed
    ├── ResourceError         a limit of this server was reached; nothing was changed
    ├── DeadlineExceeded      the time allowed is over; nothing was changed
    └── JournalError          the durable state cannot be written or trusted

Every message says what was expected, what came, and the way out; an error about data names the first offender. The
codes are those of SPEC.md, listed in :mod:`mesh_motion_protocol.errors`; a test keeps the two equal.
"""

from __future__ import annotations

from collections.abc import Sequence

__all__ = [
    "DeadlineExceeded",
    "InvalidInput",
    "JournalError",
    "MeshMotionError",
    "NumericalError",
    "ResourceError",
    "SessionError",
]


class MeshMotionError(Exception):
    """Base of every error this package raises on purpose.

    Parameters
    ----------
    message : str
        One line: what was expected, what came.
    code : str, optional
        The wire code; each subclass has its default.
    hint : str, optional
        The way out, one line; shown after the message.
    details : dict, optional
        Plain values (str, int, float, lists of them) for programs, for example ``{"node": 17, "value": "nan"}``.
    """

    default_code = "INTERNAL"

    def __init__(
        self, message: str, *, code: str | None = None, hint: str = "", details: dict[str, object] | None = None
    ) -> None:
        super().__init__(message)
        self.message = message
        self.code = code or self.default_code
        self.hint = hint
        self.details: dict[str, object] = dict(details or {})

    def __str__(self) -> str:
        return f"{self.message} ({self.hint})" if self.hint else self.message


class InvalidInput(MeshMotionError):
    """The caller's data or settings are wrong: shapes, values, names, an unusable mesh."""

    default_code = "INVALID_ARGUMENT"


class SessionError(MeshMotionError):
    """The request does not fit the session: its state, step, epoch, owner or existence."""

    default_code = "FAILED_PRECONDITION.STATE"


class NumericalError(MeshMotionError):
    """No acceptable motion was found.

    Parameters
    ----------
    best : float
        The best minimum quality that was found.
    cells : sequence of int
        The worst cells, worst first.
    fraction : float or None
        The largest fraction of the requested displacement known to give an acceptable mesh.
    """

    default_code = "FAILED_PRECONDITION.QUALITY"

    def __init__(
        self,
        message: str,
        *,
        best: float = float("-inf"),
        cells: Sequence[int] = (),
        fraction: float | None = None,
        hint: str = "",
        details: dict[str, object] | None = None,
        code: str | None = None,
    ) -> None:
        super().__init__(message, code=code, hint=hint, details=details)
        self.best = best
        self.cells = tuple(int(cell) for cell in cells)
        self.fraction = fraction


class ResourceError(MeshMotionError):
    """A limit of this server was reached: bytes, sessions, memory, disk."""

    default_code = "RESOURCE_EXHAUSTED.BYTES"


class DeadlineExceeded(MeshMotionError):
    """The time allowed is over."""

    default_code = "DEADLINE_EXCEEDED"


class JournalError(MeshMotionError):
    """The durable state cannot be written (the session freezes) or does not verify (nothing is guessed)."""

    default_code = "DATA_LOSS.CHECKSUM"
