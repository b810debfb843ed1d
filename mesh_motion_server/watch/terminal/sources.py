"""The terminal's sources of sessions: the folders of a server (without a server), or the list of a running server."""

import math
import time
from collections import deque
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from mesh_motion_client import Keys, MeshMotionError, Server, connect

from mesh_motion_server import errors
from mesh_motion_server.session.spec import SPEC
from mesh_motion_server.watch.observation.follow import EventTail
from mesh_motion_server.watch.observation.series import Series
from mesh_motion_server.watch.observation.sessions import Sessions, SessionView, rests
from mesh_motion_server.watch.observation.verdict import Latest, Verdict, verdict
from mesh_motion_server.watch.terminal.text import number

__all__ = ["Details", "EndpointSource", "FolderSource", "SessionLine", "Source", "Unreadable"]

#: Bytes that are read at the end of a history: some thousand Moves, in less than a second.
_LATEST_BYTES = 8 << 20
_MOST_MESSAGES = 100
_UNKNOWN = Verdict("", "", "", 0.0)
_STATE_EVENTS = ("suspended", "joined", "closed", "resumed", "frozen", "failed")


class Unreadable(Exception):
    """The sessions cannot be read now; a later look may succeed. ``code`` is the code of the error."""

    def __init__(self, message: str, code: str = "UNAVAILABLE") -> None:
        super().__init__(message)
        self.code = code


@dataclass(frozen=True)
class SessionLine:
    """A session in the list: the last committed step, the run's final one (0: unknown), its lowest quality, the Unix
    times of the last event and the last commit, whether a process holds the session, and its verdict. None: unknown.
    """

    session: str
    label: str
    state: str
    step: int
    minimum: float | None = None
    changed_at: float | None = None
    committed_at: float | None = None
    is_live: bool | None = None
    verdict: Verdict = _UNKNOWN
    final_step: int = 0


@dataclass(frozen=True)
class Details:
    """The end of one session's history.

    Attributes
    ----------
    steps : int
        Committed steps that were read.
    last : dict of str to float
        The last committed step's columns, named as in :class:`mesh_motion_server.watch.observation.series.Series`.
    lowest : (int, float) or None
        Step and value of the lowest minimum of the steps that were read.
    trial : str
        A text on the trial since the last commit; empty: none.
    worst : list of dict
        The worst cells of the last commit, worst first, as SPEC.md's summaries have them.
    messages : list of dict
        Warnings, refusals, changes of the state: ``at`` (Unix time), ``kind``, ``step``, ``text``; oldest first.
    """

    metric: str
    threshold: float | None
    steps: int
    last: dict[str, float]
    lowest: tuple[int, float] | None
    trial: str
    worst: list[dict[str, Any]] = field(default_factory=list)
    messages: list[dict[str, Any]] = field(default_factory=list)


class Source(Protocol):
    """A source of sessions; ``where`` is its address as text."""

    where: str

    def sessions(self) -> list[SessionLine]:
        """All sessions, those that a process holds first, then by label; raises :class:`Unreadable`."""
        ...

    def details(self, session: str) -> Details | None:
        """Details of one session, None if there are none."""
        ...

    def close(self) -> None:
        """Release connections; may be called twice."""
        ...


class EndpointSource:
    """The sessions of a running server, as far as it lists them for this key; it sends no history, so no details."""

    def __init__(self, endpoint: str, keys: Keys | None = None, timeout: float = 5.0) -> None:
        self.where = endpoint
        self._keys, self._timeout = keys, timeout
        self._server: Server | None = None

    def sessions(self) -> list[SessionLine]:
        try:
            if self._server is None:
                self._server = connect(self.where, timeout=self._timeout, keys=self._keys)
            listed = self._server.sessions()
        except MeshMotionError as error:
            self.close()
            raise Unreadable(str(error), error.code) from error
        return _in_order(
            SessionLine(
                session=session["session"],
                label=str(session.get("label", "")),
                state=str(session.get("state", "")),
                step=int(session.get("step", 0)),
                is_live=session.get("worker") == "alive",
                verdict=Verdict(str(session.get("state", "")).lower(), "", "", 0.0),
            )
            for session in listed
        )

    def details(self, session: str) -> Details | None:
        del session
        return None

    def close(self) -> None:
        if self._server is not None:
            self._server.close()
        self._server = None


class FolderSource:
    """The sessions of a state folder, or the one session of its own folder; it may be created later, and removed."""

    def __init__(self, folder: Path) -> None:
        self.where = str(folder)
        is_session = (folder / SPEC).is_file() or (folder / "history").is_dir()
        self._only = folder.name if is_session else None
        self._root = folder.parent.parent if is_session else folder
        self._sessions = Sessions(self._root)
        self._history: _HistoryEnd | None = None
        self._latest: dict[str, Latest] = {}

    def sessions(self) -> list[SessionLine]:
        if not self._root.is_dir():
            raise Unreadable("the folder is not there (yet)")
        try:
            views = [view for view in self._sessions.views() if self._only in (None, view.session)]
            self._latest = {view.session: self._latest.get(view.session) or Latest(Path(view.folder)) for view in views}
            return _in_order(_line(view, self._latest[view.session]) for view in views)
        except (OSError, errors.MeshMotionError) as error:
            raise Unreadable(f"the folder cannot be read: {error}") from error

    def details(self, session: str) -> Details | None:
        folder = self._sessions.folder / session
        if not folder.is_dir():
            return None
        if self._history is None or self._history.folder != folder:
            self._history = _HistoryEnd(folder)
        return self._history.details()

    def close(self) -> None:
        """See :class:`Source`."""


def _line(view: SessionView, latest: Latest) -> SessionLine:
    recent = latest.read()
    last = recent.commits[-1] if recent.commits else None
    return SessionLine(
        session=view.session,
        label=view.label,
        state="at rest" if rests(view.state, view.held) else view.state,
        step=view.step,
        minimum=None if last is None or math.isnan(last.minimum) else last.minimum,
        changed_at=view.changed_at,
        committed_at=last.at if last else None,
        is_live=view.held,
        verdict=verdict(recent, time.time(), worker="none" if view.held is False else "alive"),
        final_step=recent.final_step,
    )


class _HistoryEnd:
    """The end of one session's history, read while it grows."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._tail = EventTail(folder, last_bytes=_LATEST_BYTES)
        self._series = Series()
        self._messages: deque[dict[str, Any]] = deque(maxlen=_MOST_MESSAGES)
        self._worst: list[dict[str, Any]] = []
        self._trial = ""
        self._threshold: float | None = None

    def details(self) -> Details:
        while events := self._tail.read(brief=True):
            for event in events:
                self._series.add(event)
                with suppress(KeyError, TypeError, ValueError, AttributeError):  # written by another version
                    self._take(event)
        columns = self._series.columns()
        minima = columns["actual_min"]
        place = int(np.nanargmin(minima)) if np.isfinite(minima).any() else -1
        return Details(
            metric=self._series.metric,
            threshold=self._threshold,
            steps=len(self._series),
            last={name: float(column[-1]) for name, column in columns.items()} if len(self._series) else {},
            lowest=(int(columns["step"][place]), float(minima[place])) if place >= 0 else None,
            trial=self._trial,
            worst=self._worst,
            messages=list(self._messages),
        )

    def _take(self, event: Mapping[str, Any]) -> None:
        name = event["event"]
        for warning in event.get("warnings", ()):
            self._add_message(event, "warning", warning)
        if name == "moved":
            quality = event["quality"]
            self._threshold = quality["threshold"]
            lowest = number(quality["corrected"].get("metric", {}).get("min"))
            self._trial = f"step {event['step']}, iteration {event['iteration']}: minimum {lowest} predicted"
        elif name == "refused":
            hint = f" ({event['hint']})" if event.get("hint") else ""
            self._add_message(event, name, f"{event.get('request', '')}: {event.get('message', '')}{hint}")
        else:
            self._trial = ""
            if name == "committed":
                self._worst = event["quality"].get("worst") or self._worst
            elif name in _STATE_EVENTS:
                self._add_message(event, name, event.get("message", ""))

    def _add_message(self, event: Mapping[str, Any], kind: str, text: Any) -> None:
        self._messages.append({"at": float(event["at"]), "kind": kind, "step": event.get("step"), "text": str(text)})


def _in_order(lines: Iterable[SessionLine]) -> list[SessionLine]:
    """The lines in an order that is stable while no session is added or removed."""
    return sorted(lines, key=lambda line: (not line.is_live, not line.label, line.label, line.session))
