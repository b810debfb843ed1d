"""Summarize the steps of a history, and list all events of one step."""

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
    """Summary of a history.

    Attributes
    ----------
    first_step, last_step : int
        First and last recorded committed step; 0 and 0: none.
    spans : list of (int, int)
        First and last step of each range without a gap.
    open_step : int
        The step that has requests after the last commit; 0: none.
    worst_step : int
        The recorded step with the lowest committed minimum; 0: none.
    worst_quality : float or None
        The minimum of that step, in the session's quality metric.
    corrected_steps : int
        Number of recorded steps whose committed motion was corrected.
    refusals, rollbacks, resumptions, warnings : int
        Counts over the whole history, including steps that were lost in a crash.
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
        """A text that names the recorded steps."""
        spans = ", ".join(f"{first} to {last}" if last > first else f"{first}" for first, last in self.spans)
        committed = f"steps {spans}" if spans else "no committed step"
        return committed + (f", and step {self.open_step} that is not committed" if self.open_step else "")


def digest_of_history(session_folder: Path) -> HistoryDigest:
    """Summarize a history; all zeros if there is none."""
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
    """Totals of the events so far; ``lowest`` is ascending by step."""

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
    """Ranges without a gap of ascending steps."""
    spans: list[tuple[int, int]] = []
    for step in steps:
        if spans and spans[-1][1] == step - 1:
            spans[-1] = (spans[-1][0], step)
        else:
            spans.append((step, step))
    return spans


def events_of_step(session_folder: Path, step: int) -> list[Event]:
    """All events during a step, and other events that name it, oldest first.

    A step that was lost in a crash includes the event that reset it, and all attempts if it was made again.

    Raises
    ------
    InvalidInput
        If it is not recorded; names the recorded steps.
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
