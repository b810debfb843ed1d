"""What a monitor is told: the sessions there are, and what is known of one of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = ["Details", "Message", "SessionLine", "Source", "Unreadable", "in_order"]

Columns = Mapping[str, NDArray[np.float64]]


class Unreadable(Exception):
    """There is nothing to be shown now, and why, with the code of the error; it may come back."""

    def __init__(self, message: str, code: str = "UNAVAILABLE") -> None:
        super().__init__(message)
        self.code = code


@dataclass(frozen=True)
class SessionLine:
    """A session in a list.

    Attributes
    ----------
    session, label, state : str
    step : int
        Last committed one.
    minimum : float or None
        Of the committed coordinates' quality; None: not known.
    changed_at : float or None
        Unix time of the last event.
    is_live : bool or None
        Whether a process holds it; None: not known.
    is_recorded : bool
        Whether it has a history.
    """

    session: str
    label: str
    state: str
    step: int
    minimum: float | None = None
    changed_at: float | None = None
    is_live: bool | None = None
    is_recorded: bool = True

    def as_dict(self) -> dict[str, Any]:
        """Plain values, as for JSON."""
        return asdict(self)


@dataclass(frozen=True)
class Message:
    """Something that people should read.

    Attributes
    ----------
    at : float
        Unix time.
    kind : str
        warning, refused, failed, resumed, suspended, closed, frozen, joined.
    step : int or None
    text : str
    """

    at: float
    kind: str
    step: int | None
    text: str


@dataclass(frozen=True, eq=False)
class Details:
    """What is known of one session.

    Attributes
    ----------
    metric : str
    threshold : float or None
    columns : dict of str to (s,) arrays
        As :meth:`mesh_motion_server.watch.observation.series.Series.columns` has them.
    mesh : str
        The mesh in words.
    trial : str
        What is being tried since the last commit, in words; empty: nothing.
    worst : list of dict
        The worst cells of the last commit, worst first, as SPEC.md's summaries have them.
    messages : list of Message
        Oldest first.
    share_read : float
        Below 1: earlier steps are still being read.
    lacks : str
        What cannot be shown, and why; empty: nothing.
    """

    metric: str
    threshold: float | None
    columns: Columns
    mesh: str = ""
    trial: str = ""
    worst: list[dict[str, Any]] = field(default_factory=list)
    messages: list[Message] = field(default_factory=list)
    share_read: float = 1.0
    lacks: str = ""


class Source(Protocol):
    """Where a monitor looks. Its methods may take long and are called by one thread at a time."""

    #: Where that is, for people.
    where: str

    def sessions(self) -> list[SessionLine]:
        """All sessions.

        Raises
        ------
        Unreadable
        """
        ...

    def details(self, session: str, seconds: float) -> Details | None:
        """What is known of one session, None if nothing is; takes about so many seconds at most, and may be asked again
        for the rest.

        Raises
        ------
        Unreadable
        """
        ...

    def verdict(self, lines: list[SessionLine]) -> str:
        """What is to be said of all of them together; empty: nothing."""
        ...

    def close(self) -> None:
        """Let go of what is held; idempotent."""
        ...


def in_order(lines: list[SessionLine]) -> list[SessionLine]:
    """Those that a process holds first, then by label: an order that stays as long as none comes or goes."""
    return sorted(lines, key=lambda line: (not line.is_live, not line.label, line.label, line.session))
