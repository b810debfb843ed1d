"""What a monitor shows, as lines of text that fit a number of columns and rows."""

from __future__ import annotations

import textwrap
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.cells import cell_len
from rich.text import Text

from mesh_motion_server.watch.observation.series import PHASES
from mesh_motion_server.watch.terminal.chart import Curve, draw_chart, spark
from mesh_motion_server.watch.terminal.sources import Details, Message, SessionLine
from mesh_motion_server.watch.terminal.text import age, clip, number, plain

__all__ = ["KEYS", "WINDOWS", "View", "details_lines", "gone_lines", "help_lines", "session_lines"]

FloatArray = NDArray[np.float64]

#: Steps that the chart shows, the latest; 0: all.
WINDOWS = (0, 1000, 100)
KEYS = (
    ("↑ ↓  j k", "choose a session"),
    ("enter", "this session alone; again, or escape: back"),
    ("w", "chart all steps, the last 1000, the last 100"),
    ("?", "this help"),
    ("q", "quit"),
)
_STATES = {"TRIAL": "bold", "READY": "bold", "FAILED": "bold red", "FROZEN": "bold red", "SUSPENDED": "yellow"}
_KINDS = {"warning": "yellow", "refused": "bold magenta", "failed": "bold red"}
_MINIMUM, _MEAN = "bold cyan", "green"
#: Steps whose seconds and iterations are averaged for "now".
_RECENT = 50


@dataclass(frozen=True)
class View:
    """How much is shown.

    Attributes
    ----------
    columns, rows : int
    window : int
        One of :data:`WINDOWS`.
    now : float
        Unix time.
    wrapped : bool
        Whether messages may take several rows.
    """

    columns: int
    rows: int
    window: int = 0
    now: float = 0.0
    wrapped: bool = False


def session_lines(lines: Sequence[SessionLine], chosen: int, view: View) -> list[Text]:
    """A heading and one row a session, those around the chosen one (-1: none) where there are too many."""
    fields = _fields(view.columns)
    room = max(view.rows - 1, 1)
    first = min(max(chosen - room // 2, 0), max(len(lines) - room, 0))
    shown = f"{first + 1}–{min(first + room, len(lines))} of {len(lines)}" if len(lines) > room else "label"
    heads = ((shown if name == "label" else name, size) for name, size in fields)
    rows = [Text(clip("  " + "".join(_cell(name, size) for name, size in heads), view.columns), style="dim")]
    for place, line in enumerate(lines[first : first + room], start=first):
        values = _values(line, view.now)
        row = Text("● " if line.is_live else "○ ", style="green" if line.is_live else "dim")
        for name, size in fields:
            style = _STATES.get(line.state, "") if name == "state" else ""
            row.append(_cell(values[name], size), style=style)
        if place == chosen:
            row.append(" " * max(view.columns - cell_len(row.plain), 0))
            row.stylize("reverse")
        row.truncate(view.columns)
        rows.append(row)
    return rows


def details_lines(line: SessionLine, details: Details | None, view: View) -> list[Text]:
    """Everything about one session, in the order of its weight: the chart gets what room is left."""
    head = _head(line, details, view)
    if details is None:
        return [*head, Text("nothing is known of it", style="dim")][: view.rows]
    below: list[Text] = [*_iterations(details, view), *_phases(details, view)]
    notes = _notes(details, view)
    left = view.rows - len(head) - len(below) - len(notes)
    worst = _worst(details, view)[: max(1, left // 5)] if left > 8 else []
    messages_room = max(left // 4, 2) if left > 6 else 0
    messages = _messages(details.messages, view, messages_room)
    chart = _chart(details, view, left - len(worst) - len(messages))
    return [*head, *chart, *below, *worst, *messages, *notes][: view.rows]


def gone_lines(line: SessionLine, details: Details | None, view: View) -> list[Text]:
    """Of a session that was shown and is in the list no more: that it is gone, and what was known of it."""
    name = f"{plain(line.label)} ({line.session[:8]})" if line.label else line.session
    told = [
        Text(clip(f"{name} is there no more: it was discarded", view.columns), style="bold yellow"),
        Text(clip("↑ ↓ choose another session; this was it:", view.columns), style="dim"),
    ]
    left = max(view.rows - len(told), 0)
    return [*told, *details_lines(line, details, replace(view, rows=left))][: max(view.rows, 0)]


def help_lines() -> list[Text]:
    """What the keys do and the signs mean."""
    width = max(cell_len(key) for key, _ in KEYS) + 3
    rows = [Text(f"{key:<{width}}", style="bold").append(what, style="not bold") for key, what in KEYS]
    signs = (
        ("●  ○", "a process holds the session; nobody does"),
        ("⣀⠤⠒", "minimum of the committed quality"),
        ("⠂ ⠂ ⠂", "its mean"),
        ("╌╌╌", "the threshold below which motions are corrected"),
        ("▲", "a motion was refused for this step"),
    )
    return [*rows, Text(), *(Text(f"{sign:<{width}}").append(what) for sign, what in signs)]


# --- sessions --------------------------------------------------------------------------------------------------------


def _fields(columns: int) -> list[tuple[str, int]]:
    """Names and widths of what there is room for; negative widths are aligned to the right."""
    fields = [("state", 10), ("step", -8), ("minimum", -9)]
    if columns >= 64:
        fields.append(("changed", -11))
    if columns >= 84:
        fields.append(("session", -10))
    name = max(columns - 2 - sum(abs(size) for _, size in fields), 6)
    return [("label", min(name, 44)), *fields]


def _values(line: SessionLine, now: float) -> dict[str, str]:
    changed = f"{age(now - line.changed_at, short=True)} ago" if line.changed_at else ""
    return {
        "label": plain(line.label) or line.session[:8],
        "state": plain(line.state),
        "step": str(line.step),
        "minimum": number(line.minimum),
        "changed": changed,
        "session": line.session[:8],
    }


def _cell(text: str, size: int) -> str:
    """The text in its column, which ends in a blank or begins with one."""
    text = clip(text, abs(size) - 1)
    blank = " " * (abs(size) - cell_len(text))
    return text + blank if size > 0 else blank + text


# --- one session -----------------------------------------------------------------------------------------------------


def _head(line: SessionLine, details: Details | None, view: View) -> list[Text]:
    """Who it is and where it stands."""
    title = Text(plain(line.label) or line.session, style="bold")
    title.append(f"  {line.session[:8]}  ", style="dim not bold") if line.label else title.append("  ")
    title.append(plain(line.state), style=_STATES.get(line.state, "not bold"))
    title.append(f", step {line.step}", style="not bold")
    if line.changed_at:
        title.append(f", {age(view.now - line.changed_at)} ago", style="dim not bold")
    title.truncate(view.columns)
    if details is None:
        return [title]
    reading = f"reading earlier steps: {100 * details.share_read:.0f} %" if details.share_read < 1.0 else ""
    second = " · ".join(part for part in (reading, plain(details.trial), plain(details.mesh)) if part)
    return [title, Text(clip(second, view.columns), style="yellow" if reading else "dim")] if second else [title]


def _chart(details: Details, view: View, rows: int) -> list[Text]:
    """The legend and the chart; nothing where there are not enough rows."""
    if rows < 2:
        return []
    if not len(details.columns.get("step", ())):
        return [Text("no commit was seen yet" if details.lacks else "no step was committed yet", style="dim")]
    columns = {name: values[-view.window :] for name, values in details.columns.items()}
    steps, lowest, mean = columns["step"], columns["actual_min"], columns["actual_mean"]
    refused = steps[columns["refusals"] > 0] if "refusals" in columns else np.array([])
    legend = Text(clip(plain(details.metric), 24))
    legend.append("  minimum", style=_MINIMUM).append(f" {number(float(lowest[-1]))}")
    if np.isfinite(lowest).any():
        worst = int(np.nanargmin(lowest))
        legend.append(f", lowest {number(float(lowest[worst]))} in step {steps[worst]:.0f}")
    legend.append("  mean", style=_MEAN).append(f" {number(float(mean[-1]))}")
    if details.threshold is not None:
        legend.append(f"  ╌ {details.threshold:g}", style="dim")
    legend.truncate(view.columns)
    curves = [Curve(mean, _MEAN, every=2), Curve(lowest, _MINIMUM)]
    size = (view.columns, max(rows - 1, 0))
    return [legend, *draw_chart(steps, curves, size, level=details.threshold, marks=refused)]


def _iterations(details: Details, view: View) -> list[Text]:
    """Bars of the coupling iterations a step."""
    values = details.columns.get("iterations")
    if values is None or not len(values):
        return []
    shown = values[-view.window :]
    text = f" now {shown[-1]:.0f}, most {shown.max():.0f}"
    row = Text("iterations ").append(spark(shown, max(view.columns - 11 - len(text), 0)), style="blue").append(text)
    row.truncate(view.columns)
    return [row]


def _phases(details: Details, view: View) -> list[Text]:
    """What each phase took lately, a step, and its share."""
    columns = details.columns
    if "seconds_total" not in columns or not len(columns["seconds_total"]):
        return []
    whole = _recent(columns["seconds_total"])
    factor, unit = (1.0, "s") if whole >= 1.0 else (1e3, "ms")
    parts = [f"{phase} {factor * _recent(columns[f'seconds_{phase}']):.2g}" for phase in PHASES]
    row = Text(f"a step     {factor * whole:.3g} {unit}: ").append(", ".join(parts))
    row.truncate(view.columns)
    return [row]


def _recent(values: FloatArray) -> float:
    known = values[-_RECENT:]
    known = known[np.isfinite(known)]
    return float(known.mean()) if len(known) else float("nan")


def _worst(details: Details, view: View) -> list[Text]:
    """The worst cells of the last commit, a row each."""
    rows = []
    for place, cell in enumerate(details.worst):
        name = "worst      " if place == 0 else " " * 11
        rows.append(Text(clip(name + _cell_words(cell), view.columns)))
    return rows


def _cell_words(cell: dict[str, Any]) -> str:
    """A cell as its sender calls it, its value and its place."""
    centre = ", ".join(f"{value:.4g}" for value in cell.get("centre") or ())
    partition = f" of partition {cell['partition']}" if cell.get("partition") else ""
    place = f" at ({centre})" if centre else ""
    return plain(f"{number(cell.get('metric'))}  {cell.get('type', 'cell')} {cell.get('cell', '')}{partition}{place}")


def _messages(messages: Sequence[Message], view: View, rows: int) -> list[Text]:
    """The latest messages, the newest last."""
    found: list[Text] = []
    for message in reversed(messages):
        if len(found) >= rows:
            break
        clock = time.strftime("%H:%M:%S", time.localtime(message.at))
        step = f" step {message.step}" if message.step is not None else ""
        words = f"{clock}{step} {message.kind} {plain(message.text)}".rstrip()
        style = _KINDS.get(message.kind, "dim")
        if view.wrapped:
            pieces = textwrap.wrap(words, max(view.columns, 20), subsequent_indent="         ")
        else:
            pieces = [clip(words, view.columns)]
        if found and len(found) + len(pieces) > rows:
            break
        found = [Text(piece, style=style) for piece in pieces] + found
    return found[:rows]


def _notes(details: Details, view: View) -> list[Text]:
    """What cannot be shown."""
    if not details.lacks:
        return []
    return [Text(piece, style="dim") for piece in textwrap.wrap(plain(details.lacks), max(view.columns, 20))]
