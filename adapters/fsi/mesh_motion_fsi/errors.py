"""The errors of a coupled computation.

::

    FsiError
    ├── SetupError          the participants do not fit together
    ├── ParticipantError    a participant ended, or does not answer
    ├── NotConvergedError   a window's iterations did not converge
    └── RecordError         a run cannot be continued
"""

from __future__ import annotations

__all__ = ["FsiError", "NotConvergedError", "ParticipantError", "RecordError", "SetupError"]


class FsiError(Exception):
    """Base class; ``hint`` is the way out."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(f"{message} ({hint})" if hint else message)
        self.hint = hint


class SetupError(FsiError):
    """The participants, meshes or settings do not fit together."""


class ParticipantError(FsiError):
    """A participant ended or does not answer."""


class NotConvergedError(FsiError):
    """The iterations of a window did not converge."""


class RecordError(FsiError):
    """The run in the folder cannot be continued."""
