"""Summarize the steps of a history, and list all events of one step."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.session.history.boundary import BoundaryLog
from mesh_motion_server.session.history.events import read_events
from mesh_motion_server.watch.observation.fold import StepFold
from mesh_motion_server.watch.observation.series import Series

Event = dict[str, Any]


@dataclass(frozen=True)
class HistoryDigest:
    """Summary of the committed steps of a history."""

    spans: list[tuple[int, int]]  # first and last step of each range without a gap
    worst_step: int  # the recorded step with the lowest committed minimum; 0: none
    worst_quality: float | None  # the minimum of that step, in the session's quality metric
    metric: str
    corrected_steps: int  # number of recorded steps with enrichment points or freed nodes
    #: refusals, rollbacks: refused Moves and roll-backs in these steps
    refusals: int
    rollbacks: int
    boundary_steps: int  # a replay is possible from step 1 up to this one

    @property
    def recorded(self) -> str:
        """A text that names the recorded steps."""
        spans = ", ".join(f"{first} to {last}" if last > first else f"{first}" for first, last in self.spans)
        return f"steps {spans}" if spans else "no committed step"


def digest_of_history(session_folder: Path) -> HistoryDigest:
    """Summarize a history; all zeros if there is none."""
    series = Series(read_events(session_folder))
    columns = series.columns()
    steps, minima = columns["step"].astype(int).tolist(), columns["actual_min"]
    worst = int(np.nanargmin(minima)) if np.isfinite(minima).any() else -1
    return HistoryDigest(
        spans=_spans(steps),
        worst_step=steps[worst] if worst >= 0 else 0,
        worst_quality=float(minima[worst]) if worst >= 0 else None,
        metric=series.metric,
        corrected_steps=int(np.count_nonzero((columns["enrichment_points"] > 0) | (columns["freed_nodes"] > 0))),
        refusals=int(columns["refusals"].sum()) + series.open_refusals,
        rollbacks=int(columns["rollbacks"].sum()),
        boundary_steps=BoundaryLog(session_folder).committed,
    )


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

    A step that was lost in a crash includes the event that reset it, and all attempts if it was made again. Raises
    InvalidInput if it is not recorded; names the recorded steps.
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
            hint="the server's setting history_bytes must not be 0, and its log says whether the disk refused it",
        )
    recorded = digest_of_history(session_folder)
    hint, first, last = "", min(recorded.spans, default=(0, 0))[0], max(recorded.spans, default=(0, 0))[1]
    if first <= step <= last:
        hint = "the history was interrupted: a warning in the server's log gives the reason"
    elif 0 < step < first:
        hint = "the oldest events are removed first: the server's setting history_bytes limits what is kept"
    return InvalidInput(f"{session_folder}: step {step} is not recorded; recorded are {recorded.recorded}", hint=hint)
