"""The step of an event, and the steps that a crash has undone: common to all readers of a history.

A history may begin at any step, because the oldest segments are removed, and may lack steps if recording stopped for a
while. So steps are not counted; the step comes from the events that name it. A ``resumed`` event undoes the later
steps, which a crash may have lost (durability ``relaxed``), and all uncommitted work.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Place:
    """The step of an event, and its effect on other steps."""

    step: int  # the step that was in progress; 0: unknown
    undone: int = 0  # the steps from this one on are undone; 0: none
    is_fresh: bool = False  # whether earlier events of an uncommitted step belong to another step, or were dropped


class StepFold:
    """Processes the events, oldest first."""

    def __init__(self) -> None:
        self._working = 0

    def take(self, event: Mapping[str, Any]) -> Place:
        """Take the next event; return its place."""
        name, before = event["event"], self._working
        if name == "built" and not (event.get("recovered") or event.get("kept")):
            self._working = 1
        elif name in ("moved", "rolled_back", "committed") or (name == "refused" and not before):
            self._working = int(event["step"])
        elif name == "resumed":
            self._working = int(event["step"]) + 1
            return Place(self._working, undone=self._working, is_fresh=True)
        place = Place(self._working, is_fresh=self._working != before)
        if name == "committed":
            self._working += 1
            return Place(place.step, undone=place.step, is_fresh=place.is_fresh)
        return place


def is_corrected(correction: Mapping[str, Any]) -> bool:
    """Whether MOVED's correction says that the motion was corrected."""
    return bool(correction["iterations"]) or correction["method"] != "none"


def number_of(value: float | None) -> float:
    """A recorded number; NaN if there is none."""
    return math.nan if value is None else float(value)
