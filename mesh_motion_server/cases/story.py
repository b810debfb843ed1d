"""Describes the events of a step: turns the events of a history into lines of text."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mesh_motion_server.watch.observation.fold import is_corrected
from mesh_motion_server.watch.observation.steps import events_of_step

Event = dict[str, Any]

#: Number of worst cells in the text for each motion; ``--json`` has all ten.
_NAMED_CELLS = 3


@dataclass(frozen=True)
class Story:
    """The events of a step."""

    step: int
    #: {"committed", "lost", "open"}. Lost: a crash reset the session to an earlier step (durability ``relaxed``), and
    #: the step was not begun again.
    outcome: str
    lines: list[str]  # all events as text, in time order
    events: list[Event]  # as recorded


def story_of_step(session_folder: Path, step: int) -> Story:
    """Return the story of a recorded step. Raises InvalidInput if the step is not recorded."""
    events = events_of_step(session_folder, step)
    outcome = _outcome(events, step)
    lines = [_headline(events, step, outcome), ""]
    for number, event in enumerate(events):
        first, *rest = _lines(event, _outcome(events[:number], step) == "committed")
        lines += [f"{_clock(event)}  {first}", *(f"{'':10}{line}" for line in rest)]
    return Story(step, outcome, lines, events)


# --- the parts --------------------------------------------------------------------------------------------------------


def _outcome(events: Sequence[Event], step: int) -> str:
    """The final outcome of the step."""
    outcome = "open"
    for event in events:
        if event["event"] == "committed" and event["step"] == step:
            outcome = "committed"
        elif event["event"] == "resumed" and event["step"] < step and outcome == "committed":
            outcome = "lost"
        elif event["event"] == "moved" and event["step"] == step and outcome == "lost":
            outcome = "open"
    return outcome


def _headline(events: Sequence[Event], step: int, outcome: str) -> str:
    moves = [event for event in events if event["event"] == "moved"]
    counts = {"iteration": len(moves)}
    for name, word in (("rolled_back", "roll-back"), ("refused", "refusal"), ("resumed", "resumption")):
        counts[word] = sum(event["event"] == name for event in events)
    counted = [f"{number} {word}{'s' if number > 1 else ''}" for word, number in counts.items() if number]
    seconds = sum(event.get("seconds_total", 0.0) for event in events)
    day = time.strftime("%Y-%m-%d", time.gmtime(events[0]["at"]))
    said = {"open": "not committed", "lost": "committed, and lost in a crash"}.get(outcome, outcome)
    return f"step {step}, {day} (UTC): {said}, {', '.join(counted)}; {_seconds(seconds)} in the server"


def _lines(event: Event, was_committed: bool) -> list[str]:
    """The text lines of an event, the first line without its time."""
    lines_of: Callable[[Event], list[str]] | None = {
        "moved": _move_lines,
        "committed": _commit_lines,
        "refused": _refusal_lines,
        "rolled_back": lambda e: [_roll_back_line(e["iteration"])],
        "resumed": lambda e: _resumption_lines(e, was_committed),
        "suspended": lambda _: ["suspended: no client was connected for the time of the lease"],
        "joined": lambda _: ["a client joined again"],
        "frozen": lambda e: [f"the session is FROZEN: {e['message']}"],
        "closed": lambda _: ["closed, and kept"],
        "failed": lambda e: [f"the session FAILED: {e['message']}"],
    }.get(event["event"])
    return lines_of(event) if lines_of else [str(event.get("message", event["event"]))]


def _move_lines(event: Event) -> list[str]:
    quality, correction = event["quality"], event["correction"]
    standard, corrected, metric = quality["standard"], quality["corrected"], quality["metric"]
    changed = is_corrected(correction)
    lines = [
        f"iteration {event['iteration']}: predicted minimum {metric} {_value(_lowest(standard))}"
        + (f", corrected {_value(_lowest(corrected))}" if changed else "")
        + f", threshold {quality['threshold']:g}"
    ]
    for name, summary in (("without correction", standard), ("corrected", corrected))[: 1 + changed]:
        lines += [f"{name}: {_distribution(summary)}{_inverted(summary)}"] if changed or _spread(summary) else []
        lines += [f"worst cells {'then' if changed else 'predicted'}: {_cells(summary['worst'])}"]
    if changed:
        reached = "reached" if correction["reached"] else "not reached"
        lines.append(f"correction: {_means(correction)}; {reached}")
        lines += [f"enrichment points at {_places(event['enrichment_points'])}"] if event["enrichment_points"] else []
    if correction["sub_steps"] > 1:
        lines.append(f"moved in {correction['sub_steps']} sub-steps")
    phases = ", ".join(f"{name} {_seconds(value)}" for name, value in event["seconds"].items() if name != "total")
    made = event["caches"].get("factorization")
    lines.append(f"time: {_seconds(event['seconds_total'])}: {phases}" + (f"; factorization {made}" if made else ""))
    return lines + [f"warning: {warning}" for warning in event["warnings"]]


def _commit_lines(event: Event) -> list[str]:
    summary = event["quality"]
    again = "; recorded when the session was resumed" if event.get("recovered") else ""
    lines = [f"committed: minimum {_value(_lowest(summary))}, {_distribution(summary)}{_inverted(summary)}{again}"]
    lines += [f"worst cells: {_cells(summary['worst'])}"] if summary.get("worst") else []
    return [*lines, f"state digest {event['digest'][:16]}…"]


def _roll_back_line(iteration: int) -> str:
    dropped = f"the trial of iteration {iteration} was dropped" if iteration else "there was no trial to drop"
    return f"rolled back: {dropped}"


def _refusal_lines(event: Event) -> list[str]:
    lines = [f"refused: {event['request']} of step {event['step']}: {event['code']}", event["message"]]
    details = event.get("details", {})
    if details.get("worst"):
        lines.append(f"cells: {_cells(details['worst'])}")
    return lines + ([f"way out: {event['hint']}"] if event.get("hint") else [])


def _resumption_lines(event: Event, was_committed: bool) -> list[str]:
    lost = ": the crash lost this step" if was_committed else ""
    return [f"resumed at step {event['step']}, epoch {event['epoch']}, by version {event['version']}{lost}"]


def _means(correction: dict[str, Any]) -> str:
    """For example "'optimised': 3 enrichment points, 12 freed nodes, 4 iterations"."""
    counts = [(correction["enrichment_points"], "enrichment point"), (correction["freed_nodes"], "freed node")]
    counts.append((correction["iterations"], "iteration"))
    parts = [f"{number} {word}{'s' if number != 1 else ''}" for number, word in counts if number]
    return f"'{correction['method']}': {', '.join(parts) or 'nothing to add'}"


def _lowest(summary: dict[str, Any]) -> float | None:
    lowest: float | None = summary.get("metric", {}).get("min")
    return lowest


def _spread(summary: dict[str, Any]) -> bool:
    return "p5" in summary.get("metric", {})


def _distribution(summary: dict[str, Any]) -> str:
    metric = summary.get("metric", {})
    names = [name for name in ("p1", "p5", "p50", "mean") if metric.get(name) is not None]
    return ", ".join(f"{name} {metric[name]:.3f}" for name in names) or f"minimum {_value(_lowest(summary))}"


def _inverted(summary: dict[str, Any]) -> str:
    return f", {summary['inverted']} inverted cells" if summary["inverted"] else ""


def _cells(worst: Sequence[dict[str, Any]]) -> str:
    several = any(cell["partition"] for cell in worst)
    named = []
    for cell in worst[:_NAMED_CELLS]:
        text = f"{cell['type']} {cell['cell']}" + (f" of partition {cell['partition']}" if several else "")
        text += f" at {_place(cell['centre'])}" if "centre" in cell else ""
        named.append(text + (f": {_value(cell['metric'])}" if "metric" in cell else ""))
    return "; ".join(named)


def _places(points: Sequence[Sequence[float]]) -> str:
    more = f" and {len(points) - 5} more" if len(points) > 5 else ""
    return ", ".join(map(_place, points[:5])) + more


def _place(point: Sequence[float | None]) -> str:
    return f"({', '.join('?' if x is None else f'{x:.4g}' for x in point)})"


def _value(value: float | None) -> str:
    return "that is not a number" if value is None else f"{value:.4f}"


def _seconds(value: float) -> str:
    return f"{value:.2f} s" if value >= 1 else f"{1000 * value:.1f} ms"


def _clock(event: Event) -> str:
    return time.strftime("%H:%M:%S", time.gmtime(event["at"]))
