"""The sessions at one time: a table and the details of one session, for a screen, as text or as JSON values."""

import math
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from mesh_motion_server.errors import SessionError
from mesh_motion_server.watch.observation.series import PHASES
from mesh_motion_server.watch.observation.verdict import server_gone
from mesh_motion_server.watch.terminal.sources import Details, SessionLine, Source
from mesh_motion_server.watch.terminal.text import age, number, plain

__all__ = ["Look", "look_at", "rendered", "values_of", "without_server"]

_TONES = {"good": "green", "warn": "bold yellow", "bad": "bold red", "": ""}
_KINDS = {"warning": "yellow", "refused": "bold magenta", "failed": "bold red"}
_COLUMNS = ("step", "actual_min", "actual_mean", "predicted_min", "iterations", "seconds_total")
_WORST = 3
_MESSAGES = 10


@dataclass(frozen=True)
class Look:
    """The state at one time: the sessions, the index of the chosen one (-1: none), its details."""

    lines: list[SessionLine]
    chosen: int = -1
    details: Details | None = None


def look_at(source: Source, wanted: str | None) -> Look:
    """Read the sessions, and the details of ``wanted`` (a label or the beginning of an id), else of the last changed.

    Raises
    ------
    Unreadable
    SessionError
        NOT_FOUND, if no session matches.
    """
    lines = source.sessions()
    chosen = _place(lines, wanted)
    return Look(lines, chosen, source.details(lines[chosen].session) if chosen >= 0 else None)


def without_server(look: Look, since: float) -> Look:
    """The last look, for a server that has not been readable since a Unix time."""
    return replace(look, lines=[replace(line, verdict=server_gone(since)) for line in look.lines])


def _place(lines: Sequence[SessionLine], wanted: str | None) -> int:
    if wanted is None:
        return max(range(len(lines)), key=lambda i: lines[i].changed_at or 0.0, default=-1)
    places = [i for i, line in enumerate(lines) if line.label == wanted]
    places += [i for i, line in enumerate(lines) if wanted and line.session.startswith(wanted)]
    if places:
        return places[0]
    labels = ", ".join(plain(line.label) or line.session[:8] for line in lines[:5])
    raise SessionError(f"no session {plain(wanted)!r}; there are {labels or 'none'}", code="NOT_FOUND")


def rendered(where: str, look: Look, trouble: str = "", most_rows: int | None = None) -> RenderableType:
    """The look for a console; of a longer list ``most_rows`` sessions around the chosen one."""
    count = len(look.lines)
    rows: list[RenderableType] = [Text(f"{plain(where)}: {count} session{'s' if count != 1 else ''}", style="bold")]
    if look.lines and all(line.is_live is False for line in look.lines):
        trouble = trouble or "no process holds a session: these are files"
    if trouble:
        rows.append(Text(plain(trouble), style="bold yellow"))
    if look.lines:
        rows.append(_table(look, most_rows or count))
    if look.chosen >= 0:
        line = look.lines[look.chosen]
        rows += ["", Text(plain(line.label) or line.session, style="bold")]
        rows.append(Text(plain(line.verdict.line(time.time())), style=_TONES[line.verdict.tone]))
    if look.details is not None:
        rows += _details(look.details)
    return Group(*rows)


def _table(look: Look, most_rows: int) -> Table:
    table = Table(box=None, pad_edge=False, header_style="dim")
    for name in ("", "label", "verdict", "since", "step", "minimum", "committed", "session"):
        right = name in ("since", "step", "minimum", "committed")
        table.add_column(name, justify="right" if right else "left", no_wrap=True, max_width=44)
    first = min(max(look.chosen - most_rows // 2, 0), max(len(look.lines) - most_rows, 0))
    now = time.time()
    for place, line in enumerate(look.lines[first : first + most_rows], start=first):
        stands = line.verdict
        # for a running session this is the time of the last commit, which has its own column
        since = age(now - stands.since) if stands.since and stands.kind != "running" else ""
        step = f"{line.step} of {line.final_step}" if line.final_step >= line.step > 0 else str(line.step)
        committed = f"{age(now - line.committed_at)} ago" if line.committed_at else ""
        table.add_row(
            Text("●" if line.is_live else "○", style="green" if line.is_live else "dim"),
            Text(plain(line.label) or "–", style="bold" if place == look.chosen else ""),
            Text(plain(stands.kind), style=_TONES[stands.tone]),
            *map(Text, (since, step, number(line.minimum), committed, line.session[:8])),
        )
    return table


def _details(details: Details) -> list[Text]:
    rows = [Text(plain(details.trial))] if details.trial else []
    rows += _quality(details) + [Text(f"worst  {_cell_words(cell)}") for cell in details.worst[:_WORST]]
    for message in details.messages[-_MESSAGES:]:
        clock = time.strftime("%H:%M:%S", time.localtime(message["at"]))
        step = f" step {message['step']}" if message["step"] is not None else ""
        words = f"{clock}{step} {message['kind']} {plain(message['text'])}".rstrip()
        rows.append(Text(words, style=_KINDS.get(message["kind"], "dim")))
    return rows


def _quality(details: Details) -> list[Text]:
    """Quality, iterations and seconds of the last committed step."""
    last = details.last
    if not last:
        return [Text("no step was committed yet", style="dim")]
    words = f"{plain(details.metric)}  minimum {number(last['actual_min'])}, mean {number(last['actual_mean'])}"
    if details.threshold is not None:
        words += f", threshold {details.threshold:g}"
    if details.lowest is not None:
        words += (
            f"; of the last {details.steps} steps the lowest is {details.lowest[1]:.3f} in step {details.lowest[0]}"
        )
    phases = ", ".join(f"{phase} {last[f'seconds_{phase}']:.2g}" for phase in PHASES)
    return [Text(words), Text(f"{last['iterations']:.0f} iterations, {last['seconds_total']:.3g} s: {phases}")]


def _cell_words(cell: dict[str, Any]) -> str:
    """Text with a cell's value, the client's name for it, and its position."""
    centre = ", ".join(f"{value:.4g}" for value in cell.get("centre") or ())
    partition = f" of partition {cell['partition']}" if cell.get("partition") else ""
    place = f" at ({centre})" if centre else ""
    return plain(f"{number(cell.get('metric'))}  {cell.get('type', 'cell')} {cell.get('cell', '')}{partition}{place}")


def values_of(where: str, look: Look) -> dict[str, Any]:
    """The look as plain values for JSON; labels and messages unchanged."""
    values: dict[str, Any] = {"where": where, "sessions": [asdict(line) for line in look.lines]}
    if look.chosen < 0:
        return values
    values["chosen"] = {"session": look.lines[look.chosen].session}
    if look.details is not None:
        last = {name: value for name in _COLUMNS if math.isfinite(value := look.details.last.get(name, math.nan))}
        lowest = look.details.lowest
        shown = {"step": lowest[0], "minimum": lowest[1]} if lowest else None
        values["chosen"] |= asdict(look.details) | {"last": last, "lowest": shown}
    return values
