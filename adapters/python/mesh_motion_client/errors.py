"""What a client raises: the server's error codes as exceptions, with the server's hint.

::

    MeshMotionError            .code .message .hint .details
    ├── InvalidInput           the request or the mesh is wrong
    ├── SessionError           it does not fit the session: its state, its step, its owner
    │   └── StepsLost          committed steps of a session with durability "relaxed" are lost: .step .lost
    ├── QualityRefused         no acceptable mesh was found: .best .fraction .worst
    ├── ResourceExhausted      a limit of the server
    ├── Unavailable            no answer, or the server is stopping
    ├── Timeout                no answer within the time allowed; the same call may be repeated
    ├── DataLoss               stored data cannot be trusted
    ├── Unsupported            the server does not offer this, or speaks another version
    └── ServerFault            a defect of the server
"""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from typing import Any

from mesh_motion_protocol.messages import ErrorReply

__all__ = [
    "DataLoss",
    "InvalidInput",
    "MeshMotionError",
    "MeshMotionWarning",
    "QualityRefused",
    "ResourceExhausted",
    "ServerFault",
    "SessionError",
    "StepsLost",
    "Timeout",
    "Unavailable",
    "Unsupported",
    "error_from",
    "meant",
]


class MeshMotionWarning(UserWarning):
    """What the server warns of in a reply, as ``warnings.warn`` shows it; the reply has it as ``warnings`` too."""


class MeshMotionError(Exception):
    """Base of all errors of the client.

    Parameters
    ----------
    message : str
        What was expected and what came.
    code : str, optional
        An error code of SPEC.md.
    hint : str, optional
        The way out.
    details : dict, optional
        Names the first offender, for programs.
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
    """The request does not fit the session: its state, its step, its owner or its existence."""

    default_code = "FAILED_PRECONDITION.STATE"


class StepsLost(SessionError):
    """Steps that were committed did not survive a crash: the session has durability "relaxed" and goes on before them.

    Nothing of the call took effect. ``session.step`` is where the session stands; the same moves and commits from there
    give the same coordinates again.

    Attributes
    ----------
    step : int
        The last committed step that is left.
    lost : int
        How many are lost.
    """

    default_code = "ABORTED.STEPS_LOST"

    @property
    def step(self) -> int:
        """The last committed step that is left."""
        return int(self.details.get("expected", 1)) - 1

    @property
    def lost(self) -> int:
        """How many are lost."""
        return int(self.details.get("got", 1)) - 1 - self.step


class QualityRefused(MeshMotionError):
    """No acceptable mesh was found for the displacement; the session is as before.

    Attributes
    ----------
    best : float or None
        The best minimum quality that was found.
    fraction : float or None
        The largest fraction of the displacement that gives an acceptable mesh.
    worst : list of dict
        The worst cells, as in the quality report.
    """

    default_code = "FAILED_PRECONDITION.QUALITY"

    @property
    def best(self) -> float | None:
        """The best minimum quality that was found."""
        return self.details.get("best")

    @property
    def fraction(self) -> float | None:
        """The largest fraction of the displacement that gives an acceptable mesh."""
        return self.details.get("fraction")

    @property
    def worst(self) -> list[dict[str, Any]]:
        """The worst cells, as in the quality report."""
        return list(self.details.get("worst", []))


class ResourceExhausted(MeshMotionError):
    """A limit of the server: bytes, sessions, memory, disk."""

    default_code = "RESOURCE_EXHAUSTED"


class Unavailable(MeshMotionError):
    """No server answers, or it is stopping."""

    default_code = "UNAVAILABLE"


class Timeout(MeshMotionError):
    """No answer within the time allowed. The same call may be repeated: it executes once."""

    default_code = "DEADLINE_EXCEEDED"


class DataLoss(MeshMotionError):
    """Stored data cannot be trusted; nothing is guessed."""

    default_code = "DATA_LOSS"


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
    """The exception for an ERROR; an unknown detail falls back to its canonical name."""
    kind = _BY_CODE.get(reply.code) or _BY_CODE.get(reply.code.partition(".")[0], ServerFault)
    return kind(reply.message, code=reply.code, hint=reply.hint, details=reply.details)


def meant(word: str, known: Iterable[str]) -> str:
    """A hint "did you mean …?" with the known word that is most similar; empty if there is none."""
    alike = get_close_matches(word, list(known), n=1)
    return f"did you mean {alike[0]!r}?" if alike else ""
