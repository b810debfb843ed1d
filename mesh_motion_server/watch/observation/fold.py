"""Which step an event belongs to, and which steps a crash has taken back: told once, for all who read a history.

A history may begin anywhere, the oldest segments being removed, and may lack steps in between, having ended for a
while. So no step is counted: each is taken from the events that name it. A ``resumed`` takes back the steps above its
own, which a crash may have cost (durability ``relaxed``), and whatever was begun and not committed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

__all__ = ["Place", "StepFold", "is_corrected"]


@dataclass(frozen=True)
class Place:
    """Where an event stands.

    Attributes
    ----------
    step : int
        The step that was being made; 0: the history does not tell.
    undone : int
        The steps from this one on do not count any more; 0: all go on to count.
    is_fresh : bool
        Whether what was told before of a step that is not committed belongs to another one, or was dropped.
    """

    step: int
    undone: int = 0
    is_fresh: bool = False


class StepFold:
    """Follows the events, oldest first."""

    def __init__(self) -> None:
        self._working = 0

    def take(self, event: Mapping[str, Any]) -> Place:
        """Where the next event stands."""
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
