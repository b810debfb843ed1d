"""What a history has: its steps in short, and all that happened while one of them was made."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.session.history.boundary import BoundaryLog
from mesh_motion_server.session.history.events import read_events
from mesh_motion_server.watch.observation.fold import StepFold, is_corrected

__all__ = ["HistoryDigest", "digest_of_history", "events_of_step"]

Event = dict[str, Any]


@dataclass(frozen=True)
class HistoryDigest:
    """A history in short.

    Attributes
    ----------
    first_step, last_step : int
        The committed steps that are recorded; 0 and 0: none.
    spans : list of (int, int)
        First and last of each row of them without a gap.
    open_step : int
        The step that something was asked of after the last commit; 0: none.
    worst_step : int
        Of the recorded ones, that with the lowest committed minimum; 0: none.
    worst_quality : float or None
        That minimum, of the session's quality metric.
    metric : str
    corrected_steps : int
        Of the recorded ones, those whose committed motion was corrected.
    refusals, rollbacks, resumptions, warnings : int
        Of all that is told, steps that a crash took back included.
    boundary_steps : int
        A replay is possible from step 1 up to this one.
    """

    first_step: int
    last_step: int
    spans: list[tuple[int, int]]
    open_step: int
    worst_step: int
    worst_quality: float | None
    metric: str
    corrected_steps: int
    refusals: int
    rollbacks: int
    resumptions: int
    warnings: int
    boundary_steps: int

    def as_dict(self) -> dict[str, Any]:
        """Plain values, as for JSON."""
        return asdict(self)

    @property
    def recorded(self) -> str:
        """Which steps there are, in words."""
        spans = ", ".join(f"{first} to {last}" if last > first else f"{first}" for first, last in self.spans)
        committed = f"steps {spans}" if spans else "no committed step"
        return committed + (f", and step {self.open_step} that is not committed" if self.open_step else "")


def digest_of_history(session_folder: Path) -> HistoryDigest:
    """A history in short; all zeros where there is none."""
    tally = _Tally()
    for event in read_events(session_folder):
        tally.take(event)
    lowest = tally.lowest
    worst = min(lowest, key=lambda step: lowest[step], default=0)
    return HistoryDigest(
        first_step=min(lowest, default=0),
        last_step=max(lowest, default=0),
        spans=_spans(list(lowest)),
        open_step=tally.opened,
        worst_step=worst,
        worst_quality=lowest[worst] if worst and math.isfinite(lowest[worst]) else None,
        metric=tally.metric,
        corrected_steps=len(tally.corrected),
        refusals=tally.counts["refused"],
        rollbacks=tally.counts["rolled_back"],
        resumptions=tally.counts["resumed"],
        warnings=tally.warnings,
        boundary_steps=BoundaryLog(session_folder).committed,
    )


class _Tally:
    """What the events so far come to; ``lowest`` is ascending by step."""

    def __init__(self) -> None:
        self.lowest: dict[int, float] = {}
        self.corrected: set[int] = set()
        self.counts = dict.fromkeys(("refused", "rolled_back", "resumed"), 0)
        self.metric, self.warnings, self.opened = "", 0, 0
        self._fold, self._is_corrected = StepFold(), False

    def take(self, event: Event) -> None:
        name, place = event["event"], self._fold.take(event)
        if place.is_fresh:
            self.opened, self._is_corrected = 0, False
        while place.undone and self.lowest and next(reversed(self.lowest)) >= place.undone:
            self.corrected.discard(self.lowest.popitem()[0])
        if name in self.counts:
            self.counts[name] += 1
        self.warnings += len(event.get("warnings", ()))
        if name in ("moved", "refused"):
            self.opened = place.step
        if name == "moved":
            self.metric, self._is_corrected = event["quality"]["metric"], is_corrected(event["correction"])
        elif name == "committed":
            value = event["quality"].get("metric", {}).get("min")
            self.lowest[place.step] = math.inf if value is None else value
            self.corrected |= {place.step} if self._is_corrected else set()
            self.opened, self._is_corrected = 0, False


def _spans(steps: list[int]) -> list[tuple[int, int]]:
    """Rows without a gap of ascending steps."""
    spans: list[tuple[int, int]] = []
    for step in steps:
        if spans and spans[-1][1] == step - 1:
            spans[-1] = (spans[-1][0], step)
        else:
            spans.append((step, step))
    return spans


def events_of_step(session_folder: Path, step: int) -> list[Event]:
    """All that happened while a step was made, and whatever was asked of it at other times; oldest first.

    A step that a crash has taken back has what took it back, and if it was made again both lives.

    Raises
    ------
    InvalidInput
        If it is not recorded; names what is.
    """
    fold, found, counts = StepFold(), [], False
    for event in read_events(session_folder):
        name, place = event["event"], fold.take(event)
        asked = name == "refused" and event["step"] == step
        is_lost = counts and 0 < place.undone <= step
        if name != "built" and (place.step == step or asked or is_lost):
            found.append(event)
        counts = (counts and not is_lost) or (name == "committed" and place.step == step)
    if any(event["event"] in ("moved", "committed", "refused") for event in found):
        return found
    raise _not_recorded(session_folder, step)


def _not_recorded(session_folder: Path, step: int) -> InvalidInput:
    if next(read_events(session_folder), None) is None:
        return InvalidInput(
            f"{session_folder}: no history is recorded there",
            hint="the server's setting history_bytes must not be 0, and its log tells whether the disk refused it",
        )
    recorded = digest_of_history(session_folder)
    hint = ""
    if recorded.first_step <= step <= recorded.last_step:
        hint = "the history had ended for a while: the server's log has the warning, and why"
    elif 0 < step < recorded.first_step:
        hint = "of the events the oldest go first: the server's setting history_bytes says how many are kept"
    return InvalidInput(f"{session_folder}: step {step} is not recorded; recorded are {recorded.recorded}", hint=hint)
