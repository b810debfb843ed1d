"""A session's history as a monitor takes it in: at first the latest part, so that something is seen at once.

A history has up to half a gigabyte. Its end is shown while the whole is read from its begin, a piece at a time; then
the whole takes its place.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mesh_motion_server.watch.observation.follow import EventTail
from mesh_motion_server.watch.observation.series import Series
from mesh_motion_server.watch.terminal.sources import Details, Message
from mesh_motion_server.watch.terminal.text import number

__all__ = ["Recording", "Said"]

#: Read at once, bytes: some 10 ms.
_PIECE = 1 << 20
#: The end that is shown first: some thousand Moves.
_LATEST = 8 << 20
_MOST_MESSAGES = 400
#: A chart's columns are made again after so many times what making them takes.
_REST = 8.0


class Said:
    """What events say beside the columns: messages, worst cells, the trial, the mesh."""

    def __init__(self) -> None:
        self.messages: deque[Message] = deque(maxlen=_MOST_MESSAGES)
        self.worst: list[dict[str, Any]] = []
        self.trial = self.mesh = ""
        self.metric = ""
        self.threshold: float | None = None

    def add(self, event: Mapping[str, Any]) -> None:
        """Take an event in; unknown ones are passed over."""
        name, at, step = str(event["event"]), float(event["at"]), event.get("step")
        for warning in event.get("warnings", ()):
            self._say(at, "warning", step, warning)
        if name == "built":
            self._built(event)
        elif name == "moved":
            self._moved(event)
        elif name == "committed":
            self.trial, self.worst = "", event["quality"].get("worst") or self.worst
        elif name == "refused":
            hint = f" ({event['hint']})" if event.get("hint") else ""
            self._say(at, "refused", step, f"{event.get('request', '')}: {event.get('message', '')}{hint}")
        elif name == "rolled_back":  # as messages those of an implicit coupling would bury the refusals
            self.trial = ""
        elif name in ("suspended", "joined", "closed", "resumed", "frozen", "failed"):
            self.trial = ""
            self._say(at, name.replace("_", " "), step, event.get("message", ""))

    def _built(self, event: Mapping[str, Any]) -> None:
        cells = ", ".join(f"{count} {name}" for name, count in event.get("cells", {}).items())
        self.mesh = f"{event.get('nodes')} nodes, {cells}"
        settings = event.get("settings", {})
        self.metric, self.threshold = settings.get("quality_metric", ""), settings.get("quality_threshold")

    def _moved(self, event: Mapping[str, Any]) -> None:
        quality = event["quality"]
        self.metric, self.threshold = quality["metric"], quality["threshold"]
        lowest = quality["corrected"].get("metric", {}).get("min")
        self.trial = f"step {event['step']}, iteration {event['iteration']}: minimum {number(lowest)} predicted"

    def _say(self, at: float, kind: str, step: Any, text: Any) -> None:
        self.messages.append(Message(at, kind, None if step is None else int(step), str(text)))


class Recording:
    """The history of one session, read as it grows.

    Parameters
    ----------
    folder : Path
        The session's.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._tail = EventTail(folder)
        self._whole, self._said = Series(), Said()
        self._latest: Series | None = None
        self._early = Said()
        self._length, self._share = 1, -1.0
        self._columns: Any = {}
        self._shown = (-1, -1)
        self._rest_until = 0.0

    def read(self, seconds: float) -> None:
        """Take in what is new, for about so many seconds."""
        deadline = time.monotonic() + seconds
        if self._share < 0:
            self._share = 0.0
            self._read_latest()
        while events := self._tail.read(_PIECE, brief=True):
            for event in events:
                self._take(self._whole, self._said, event)
            if time.monotonic() >= deadline:
                break
        else:
            self._share = 1.0
            return
        if self._share < 1.0:
            self._share = min(1.0 - self._tail.behind() / self._length, 0.99)

    def details(self) -> Details:
        """What has been read so far."""
        series = self._whole if self._share == 1.0 or self._latest is None else self._latest
        stamp = (id(series), len(series))
        now = time.monotonic()
        if stamp != self._shown and (now >= self._rest_until or stamp[0] != self._shown[0]):
            self._columns, self._shown = series.columns(), stamp
            self._rest_until = now + _REST * (time.monotonic() - now)
        said = self._said if series is self._whole else self._early
        return Details(
            metric=said.metric or self._said.metric,
            threshold=said.threshold if said.threshold is not None else self._said.threshold,
            columns=self._columns,
            mesh=self._said.mesh or said.mesh,
            trial=said.trial,
            worst=said.worst,
            messages=list(said.messages),
            share_read=max(self._share, 0.0),
        )

    def _read_latest(self) -> None:
        """The end, unless it is the whole."""
        self._length = max(self._tail.behind(), 1)
        if self._length <= _LATEST:
            return
        self._latest = Series()
        for event in EventTail(self._folder, last_bytes=_LATEST).read(brief=True):
            self._take(self._latest, self._early, event)

    @staticmethod
    def _take(series: Series, said: Said, event: Mapping[str, Any]) -> None:
        """Take in an event; one that lacks what its kind has is passed over, another version may have written it."""
        try:
            series.add(event)
            said.add(event)
        except (KeyError, TypeError, ValueError, AttributeError):
            return
