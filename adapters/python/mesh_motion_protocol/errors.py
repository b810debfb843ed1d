"""The error codes of protocol 1.0, and the exceptions of client, server and numerics, each tied to its codes.

::

    MeshMotionError            .code .message .hint .details
    ├── InvalidInput           the request, the mesh or a setting is wrong
    ├── SessionError           it does not fit the session: its state, its step, its owner
    │   └── StepsLost          committed steps of a session with durability "relaxed" are lost: .step .lost
    ├── QualityRefused         no acceptable mesh was found: .best .fraction .worst
    ├── ResourceExhausted      a limit of the server
    ├── Unavailable            no answer, or the server is stopping
    ├── Timeout                not done within the time allowed; the same call may be repeated
    ├── DataLoss               stored data cannot be written or trusted
    ├── Unsupported            the server does not offer this, or speaks another version
    └── ServerFault            a defect of the server

A code is one of gRPC's canonical names, with a detail after a dot where programs may want to distinguish cases. A
program that does not know a detail treats the code as its canonical name.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mesh_motion_protocol.message import ErrorReply

__all__ = [
    "ERROR_CODES",
    "DataLoss",
    "ErrorCode",
    "InvalidInput",
    "MeshMotionError",
    "MeshMotionWarning",
    "ProtocolError",
    "QualityRefused",
    "ResourceExhausted",
    "ServerFault",
    "SessionError",
    "StepsLost",
    "Timeout",
    "Unavailable",
    "Unsupported",
    "brief",
    "brief_details",
    "error_code",
    "error_from",
    "meant",
]

#: Largest number of characters in an error's message, and in each text of its details.
_MESSAGE, _DETAIL = 1000, 200


@dataclass(frozen=True)
class ErrorCode:
    """One error code.

    Attributes
    ----------
    code : str
        ``CANONICAL`` or ``CANONICAL.DETAIL``.
    retryable : bool
        The same request, unchanged, may succeed later.
    state : {"unchanged", "FROZEN", "FAILED"}
        The session's state after the error.
    hint : str
        A way out of the error, shown if the sender gives no hint.
    """

    code: str
    retryable: bool
    state: str
    meaning: str
    hint: str


def _codes(*rows: tuple[str, bool, str, str, str]) -> dict[str, ErrorCode]:
    return {row[0]: ErrorCode(*row) for row in rows}


_SAME = "unchanged"
ERROR_CODES: dict[str, ErrorCode] = _codes(
    ("INVALID_ARGUMENT", False, _SAME, "the request's content is wrong", "correct what the message names"),
    ("INVALID_ARGUMENT.HEADER", False, _SAME, "frame 0 is not the header of a message", "see the SPEC, section Header"),
    ("INVALID_ARGUMENT.VALUE", False, _SAME, "a field has a value outside its choices or range", "use a listed value"),
    ("INVALID_ARGUMENT.DTYPE", False, _SAME, "an array has a dtype that its field does not admit", "send <f8 or <i8"),
    ("INVALID_ARGUMENT.SHAPE", False, _SAME, "an array has a shape that its field does not admit", "send that shape"),
    ("INVALID_ARGUMENT.FRAMES", False, _SAME, "array frames differ from frame 0's declaration", "chunk as SPEC says"),
    ("INVALID_ARGUMENT.NONFINITE", False, _SAME, "a number is NaN or infinite", "look at the sender's solver first"),
    ("INVALID_ARGUMENT.SETTINGS", False, _SAME, "a setting is unknown or has a wrong value", "see the SPEC, Settings"),
    ("INVALID_ARGUMENT.MESH", False, _SAME, "the mesh is unusable", "`mesh-motion check` lists all problems"),
    ("INVALID_ARGUMENT.MESH_DEGENERATE", False, _SAME, "a cell has no volume or is inverted", "repair that cell"),
    ("INVALID_ARGUMENT.PARTITION", False, _SAME, "the partitions' requests or meshes do not fit together",
     "send the same step, frame and settings from all partitions"),
    ("FAILED_PRECONDITION", False, _SAME, "the request does not fit the session", "ask STATUS"),
    ("FAILED_PRECONDITION.STATE", False, _SAME, "the session's state does not admit the request", "ask STATUS"),
    ("FAILED_PRECONDITION.STEP", False, _SAME, "the request names a step that is not the next one", "ask STATUS"),
    ("FAILED_PRECONDITION.QUALITY", False, _SAME, "no acceptable mesh was found for the displacement",
     "move the fraction that stays valid, in smaller steps"),
    ("ABORTED", True, _SAME, "the request was overtaken", "send STATUS, then decide"),
    ("ABORTED.FENCED", False, _SAME, "the session was resumed by another holder", "discard the session, or RESUME"),
    ("ABORTED.STALE", False, _SAME, "the request is older than the replies still remembered", "ask STATUS"),
    ("ABORTED.CONFLICT", False, _SAME, "this request id was used before with other content", "use a new sequence"),
    ("ABORTED.TRIAL_LOST", False, _SAME, "the trial did not survive a restart", "repeat the MOVE, then COMMIT"),
    ("ABORTED.STEPS_LOST", False, _SAME, "with durability \"relaxed\": committed steps did not survive a restart",
     "continue from the session's step"),
    ("RESOURCE_EXHAUSTED", True, _SAME, "a limit of the server is reached", "request less, or raise the limit"),
    ("RESOURCE_EXHAUSTED.BYTES", False, _SAME, "more bytes than the limit", "send in parts, or raise the limit"),
    ("RESOURCE_EXHAUSTED.SESSIONS", True, _SAME, "as many sessions as the limit", "close one, or raise the limit"),
    ("RESOURCE_EXHAUSTED.DISK", True, "FROZEN", "the journal's disk is full or failing", "make room, then RESUME"),
    ("RESOURCE_EXHAUSTED.MEMORY", False, _SAME, "the worker's memory limit is reached", "raise the worker's limit"),
    ("UNAVAILABLE", True, _SAME, "the server cannot answer now", "try again"),
    ("UNAVAILABLE.DRAINING", True, _SAME, "the server is stopping", "try again after its restart"),
    ("UNAVAILABLE.STARTING", True, _SAME, "the server or the session's worker is starting", "try again in a second"),
    ("UNAVAILABLE.WORKER", True, _SAME, "the session's worker ended", "RESUME the session"),
    ("DATA_LOSS", False, "FAILED", "stored data cannot be trusted", "restore the state folder from a backup"),
    ("DATA_LOSS.CHECKSUM", False, "FAILED", "a checksum of the journal is wrong",
     "restore the state folder from a backup"),
    ("DATA_LOSS.RECOVERY_DIVERGED", False, "FAILED", "replay did not reproduce the committed state",
     "resume the session with the version and on the machine that computed the step, and close it there"),
    ("UNAUTHENTICATED", False, _SAME, "the sender is not known", "JOIN first, with the session's token"),
    ("PERMISSION_DENIED", False, _SAME, "the sender may not do this", "use the owner's key and token"),
    ("NOT_FOUND", False, _SAME, "there is no such session for this sender", "check the session id and its token"),
    ("DEADLINE_EXCEEDED", True, _SAME, "not done within the time allowed", "try again, or allow more time"),
    ("UNIMPLEMENTED", False, _SAME, "the server does not offer this", "WELCOME lists what it offers"),
    ("UNIMPLEMENTED.VERSION", False, _SAME, "no common protocol version", "update the older side"),
    ("UNIMPLEMENTED.MESSAGE", False, _SAME, "this endpoint does not take messages of this type", "see the SPEC"),
    ("INTERNAL", False, _SAME, "a defect of the server", "report it, with the server's log"),
)  # fmt: skip


def error_code(code: str) -> ErrorCode:
    """Look a code up; an unknown detail gives its canonical name, an unknown name INTERNAL."""
    return ERROR_CODES.get(code) or ERROR_CODES.get(code.partition(".")[0]) or ERROR_CODES["INTERNAL"]


def brief(text: str, most: int = _MESSAGE) -> str:
    """Shorten a text to fit into a reply; of a long text the two ends are kept."""
    return text if len(text) <= most else f"{text[: most // 2]} … {text[-most // 2 :]}"


def brief_details(details: dict[str, Any]) -> dict[str, Any]:
    """Return the details of an error, with each text in them shortened."""
    return {key: brief(value, _DETAIL) if isinstance(value, str) else value for key, value in details.items()}


class MeshMotionWarning(UserWarning):
    """A warning that the server sends in a reply, shown by ``warnings.warn``; the reply has it in ``warnings`` too."""


class MeshMotionError(Exception):
    """Base of all errors that client, server and numerics raise on purpose.

    Parameters
    ----------
    message : str
        One line: what was expected, what came.
    code : str, optional
        One of :data:`ERROR_CODES`; each subclass has its default.
    hint : str, optional
        A way out of the error, one line; shown after the message.
    details : dict, optional
        Plain values (str, int, float, lists of them) for programs, for example ``{"node": 17, "value": "nan"}``.
    """

    default_code = "INTERNAL"

    def __init__(
        self, message: str, *, code: str | None = None, hint: str = "", details: dict[str, Any] | None = None
    ) -> None:
        super().__init__(message)
        self.message = message
        self.code = code or self.default_code
        self.hint = hint
        self.details: dict[str, Any] = dict(details or {})

    def __str__(self) -> str:
        return f"{self.message} ({self.hint})" if self.hint else self.message


class InvalidInput(MeshMotionError):
    """The request or the mesh is wrong; nothing was changed."""

    default_code = "INVALID_ARGUMENT"


class SessionError(MeshMotionError):
    """The request does not fit the session's state, step, owner or existence; nothing was changed."""

    default_code = "FAILED_PRECONDITION.STATE"


class StepsLost(SessionError):
    """Committed steps of a session with durability "relaxed" were lost in a crash; it goes on from an earlier step.

    The call had no effect. ``session.step`` is the step of the session now; the same moves and commits from there give
    the same coordinates again.

    Attributes
    ----------
    step : int
        The last committed step that was not lost.
    lost : int
        Number of lost steps.
    """

    default_code = "ABORTED.STEPS_LOST"

    @property
    def step(self) -> int:
        """The last committed step that was not lost."""
        return int(self.details.get("expected", 1)) - 1

    @property
    def lost(self) -> int:
        """Number of lost steps."""
        return int(self.details.get("got", 1)) - 1 - self.step


class QualityRefused(MeshMotionError):
    """No acceptable mesh was found for the displacement; nothing was changed.

    Attributes
    ----------
    best : float
        The best minimum quality that was found; -inf if none is known.
    fraction : float or None
        The largest fraction of the displacement that is known to give an acceptable mesh.
    cells : tuple of int
        The worst cells, worst first, if the numerics raised the error.
    worst : list of dict
        The worst cells as in the quality report, if a server sent the error.
    """

    default_code = "FAILED_PRECONDITION.QUALITY"

    def __init__(
        self,
        message: str,
        *,
        best: float = -math.inf,
        cells: Iterable[int] = (),
        fraction: float | None = None,
        code: str | None = None,
        hint: str = "",
        details: dict[str, Any] | None = None,
    ) -> None:
        super().__init__(message, code=code, hint=hint, details=details)
        self.best: float = self.details.get("best", best)
        self.fraction: float | None = self.details.get("fraction", fraction)
        self.cells = tuple(int(cell) for cell in cells)

    @property
    def worst(self) -> list[dict[str, Any]]:
        """The worst cells, as in the quality report."""
        return list(self.details.get("worst", []))


class ResourceExhausted(MeshMotionError):
    """A limit of the server: bytes, sessions, memory, disk."""

    default_code = "RESOURCE_EXHAUSTED.BYTES"


class Unavailable(MeshMotionError):
    """No server answers, or the server is stopping."""

    default_code = "UNAVAILABLE"


class Timeout(MeshMotionError):
    """No answer within the allowed time. The same call may be repeated: it executes only once."""

    default_code = "DEADLINE_EXCEEDED"


class DataLoss(MeshMotionError):
    """Stored data cannot be written or trusted; the server does not guess."""

    default_code = "DATA_LOSS.CHECKSUM"


class Unsupported(MeshMotionError):
    """The server does not offer this, or speaks another version."""

    default_code = "UNIMPLEMENTED"


class ServerFault(MeshMotionError):
    """A defect of the server: its log says more."""


_BY_CODE: dict[str, type[MeshMotionError]] = {
    "FAILED_PRECONDITION.QUALITY": QualityRefused,
    "ABORTED.STEPS_LOST": StepsLost,
    "INVALID_ARGUMENT": InvalidInput,
    "FAILED_PRECONDITION": SessionError,
    "ABORTED": SessionError,
    "NOT_FOUND": SessionError,
    "UNAUTHENTICATED": SessionError,
    "PERMISSION_DENIED": SessionError,
    "RESOURCE_EXHAUSTED": ResourceExhausted,
    "UNAVAILABLE": Unavailable,
    "DEADLINE_EXCEEDED": Timeout,
    "DATA_LOSS": DataLoss,
    "UNIMPLEMENTED": Unsupported,
}


def error_from(reply: ErrorReply) -> MeshMotionError:
    """Return the exception for an ERROR; an unknown detail gives that of its canonical name."""
    kind = _BY_CODE.get(reply.code) or _BY_CODE.get(reply.code.partition(".")[0], ServerFault)
    return kind(reply.message, code=reply.code, hint=reply.hint, details=reply.details)


def meant(word: str, known: Iterable[str]) -> str:
    """Return a hint "did you mean …?" with the most similar known word; empty if there is none."""
    alike = get_close_matches(word, list(known), n=1)
    return f"did you mean {alike[0]!r}?" if alike else ""


class ProtocolError(Exception):
    """Frames that are not a message, or a message that cannot be put into frames.

    Parameters
    ----------
    message : str
        One line: what was expected, what came.
    code : str
        One of :data:`ERROR_CODES`.
    details : dict, optional
        Plain values that name the offender, for example ``{"field": "step"}``.

    Attributes
    ----------
    client : bytes
    sequence : int
        The request id if it could still be read, else zeros: a reply can then be matched with its request.
    """

    def __init__(self, message: str, *, code: str, details: dict[str, object] | None = None) -> None:
        self.message = brief(message)
        super().__init__(self.message)
        self.code = code
        self.hint = error_code(code).hint
        self.details: dict[str, object] = brief_details(details or {})
        self.client = b"\0" * 16
        self.sequence = 0
