"""The state of a session, collected from its events."""

from collections import deque
from collections.abc import Iterable, Mapping
from contextlib import suppress
from typing import Any

import numpy as np
from mesh_motion_numerics.arrays import Floats
from mesh_motion_protocol.headroom import headroom_in_words

from mesh_motion_server.watch.observation.series import Series

#: Largest number of points of a request; as in pictures/history.py, more of them would share pixels.
MOST_POINTS = 5000
#: Number of the latest warnings, refusals and state changes that are kept.
_NOTABLE = 200
_NOTED = ("refused", "resumed", "suspended", "joined", "closed", "frozen", "failed", "boundary_ended", "built")
#: Significant digits that a chart shows.
_DIGITS = 5


class Followed:
    """The history of one session, or its end.

    Attributes
    ----------
    events : int
        Number of events added.
    built : dict
        The event that describes the mesh; empty until it is known.
    """

    def __init__(self) -> None:
        self.events = 0
        self.built: dict[str, Any] = {}
        self._series = Series()
        self._notable: deque[dict[str, Any]] = deque(maxlen=_NOTABLE)
        self._counted = 0
        self._moved: dict[str, Any] = {}
        self._committed: dict[str, Any] = {}

    def detail(self) -> dict[str, Any]:
        """All data except the series."""
        moved = self._moved
        return {
            "built": self.built,
            "step": self._committed.get("step", 0),
            "moved": {
                name: moved[name] for name in ("step", "iteration", "correction", "seconds_total") if name in moved
            },
            "standard": moved["quality"]["standard"].get("metric", {}) if moved else {},
            "corrected": moved["quality"]["corrected"].get("metric", {}) if moved else {},
            "actual": self._committed["quality"].get("metric", {}) if self._committed else {},
            "faces": moved.get("faces", {}),
            "ahead": headroom_in_words(moved.get("headroom", {})),
            "worst": self._worst(),
            "notable": list(reversed(self._notable)),
            "counted": self._counted,
            "open_refusals": self._series.open_refusals,
        }

    def series(self, first: int | None, points: int) -> dict[str, Any]:
        """Columns of the steps from ``first`` on, thinned to ``points`` points and the latest step."""
        found = self._series.columns(min(points, MOST_POINTS), first=first)
        step = self._committed.get("step", 0)
        if len(found["step"]) and found["step"][-1] < step:
            newest = self._series.columns(first=step)
            found = {name: np.concatenate([column, newest[name]]) for name, column in found.items()}
        return {"columns": {name: plain_column(column) for name, column in found.items()}}

    def take(self, events: Iterable[Mapping[str, Any]]) -> None:
        """Add the next events; skip incomplete events, which another version may have written."""
        for event in events:
            self.events += 1
            with suppress(KeyError, TypeError, ValueError, AttributeError):
                self._take(event)

    def _take(self, event: Mapping[str, Any]) -> None:
        kind = event["event"]
        self._series.add(event)
        if kind == "resumed" and self._committed.get("step", 0) > event["step"]:
            self._committed = {}  # the step was lost in a crash
        if kind == "built":
            self.built = dict(event)
        if kind in ("moved", "committed"):
            setattr(self, f"_{kind}", dict(event))
        if kind in ("rolled_back", "resumed"):
            self._moved = {}  # the trial of this prediction no longer exists
        if kind in _NOTED and kind != "built":
            self._note({name: event[name] for name in event if name != "details"})
        for warning in event.get("warnings", ()):
            self._note({"at": event["at"], "event": "warning", "step": event.get("step", 0), "message": warning})

    def _note(self, message: dict[str, Any]) -> None:
        """Keep a message; a repeat of the newest message only increases its count."""
        self._counted += 1
        same = ("event", "code", "message", "request")
        newest = self._notable[-1] if self._notable else {}
        if newest and all(newest.get(name) == message.get(name) for name in same):
            since = newest.get("since", newest["at"])
            self._notable[-1] = message | {"times": newest.get("times", 1) + 1, "since": since}
        else:
            self._notable.append(message)

    def _worst(self) -> dict[str, Any]:
        """The worst cells of the last evaluation: a trial's prediction, or the committed coordinates."""
        moved, committed = self._moved, self._committed
        if moved and moved.get("at", 0) > committed.get("at", 0):
            return {"of": "predicted", "step": moved["step"], "cells": moved["quality"]["corrected"].get("worst", [])}
        if committed and committed["quality"].get("worst"):
            return {"of": "committed", "step": committed["step"], "cells": committed["quality"]["worst"]}
        quality = self.built.get("quality") or {}
        return {"of": "uploaded", "step": 0, "cells": quality.get("worst", [])}


def plain_column(column: Floats) -> list[float | None]:
    """Numbers (n,) with the digits that a chart shows, times to milliseconds; None for NaN and infinity."""
    finite = np.isfinite(column)
    safe = np.where(finite, column, 0.0)
    scale = 10.0 ** np.maximum(3, _DIGITS - 1 - np.floor(np.log10(np.maximum(np.abs(safe), 1e-12))))
    whole = np.rint(safe) == safe
    rounded = np.where(whole, safe, np.rint(safe * scale) / scale)
    values: list[float | None] = rounded.tolist()
    for place in np.flatnonzero(~finite).tolist():
        values[place] = None
    return values
