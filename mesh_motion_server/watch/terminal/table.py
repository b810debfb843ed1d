"""The sessions at one time: a table and the details of one session, for a screen, as text or as JSON values."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from mesh_motion_protocol.errors import SessionError
from rich.console import Group, RenderableType

from mesh_motion_server.watch.observation.series import PHASES
from mesh_motion_server.watch.observation.verdict import Verdict, duration, server_gone
from mesh_motion_server.watch.terminal.console import Table, inert
from mesh_motion_server.watch.terminal.sources import FolderSource
from mesh_motion_server.watch.terminal.text import number, plain

_TONES = {"good": "green", "warn": "bold yellow", "bad": "bold red", "": ""}
_KINDS = {"warning": "yellow", "refused": "bold magenta", "failed": "bold red"}
#: Cells and messages shown: with the other lines they fill live.py's _ROWS_OF_DETAILS.
_WORST = 3
_MESSAGES = 10


@dataclass(frozen=True)
class Look:
    """The state at one time: the sessions, the index of the chosen one (-1: none), its details."""

    sessions: list[dict[str, Any]]
    chosen: int = -1
    details: dict[str, Any] | None = None


def look_at(source: FolderSource, wanted: str | None) -> Look:
    """Read the sessions, and the details of ``wanted`` (a label or the beginning of an id), else of the last changed.

    Raises Unreadable as :meth:`~.sources.FolderSource.sessions`, and SessionError (NOT_FOUND) if no session matches.
    """
    sessions = source.sessions()
    chosen = _place(sessions, wanted)
    return Look(sessions, chosen, source.details(sessions[chosen]["session"]) if chosen >= 0 else None)


def without_server(look: Look, since: float) -> Look:
    """The last look, for a folder that has not been readable since a Unix time."""
    gone = {"verdict": asdict(server_gone(since))}
    return replace(look, sessions=[entry | gone for entry in look.sessions])


def _place(sessions: Sequence[dict[str, Any]], wanted: str | None) -> int:
    if wanted is None:
        return max(range(len(sessions)), key=lambda i: sessions[i]["changed_at"] or 0.0, default=-1)
    places = [i for i, entry in enumerate(sessions) if entry["label"] == wanted]
    places += [i for i, entry in enumerate(sessions) if wanted and entry["session"].startswith(wanted)]
    if places:
        return places[0]
    labels = ", ".join(plain(entry["label"]) or entry["session"][:8] for entry in sessions[:5])
    raise SessionError(f"no session {plain(wanted)!r}; there are {labels or 'none'}", code="NOT_FOUND")


def rendered(where: str, look: Look, trouble: str = "", most_rows: int | None = None) -> RenderableType:
    """The look for a console; from a longer list ``most_rows`` sessions around the chosen one."""
    count = len(look.sessions)
    rows: list[RenderableType] = [inert(f"{where}: {count} session{'s' if count != 1 else ''}", style="bold")]
    if look.sessions and all(entry["worker"] == "none" for entry in look.sessions):
        trouble = trouble or "no process holds a session: the table comes from stored files"
    if trouble:
        rows.append(inert(trouble, style="bold yellow"))
    if look.sessions:
        rows.append(_table(look, most_rows or count))
    if look.chosen >= 0:
        entry = look.sessions[look.chosen]
        stands = Verdict(**entry["verdict"])
        rows += ["", inert(entry["label"] or entry["session"], style="bold")]
        rows.append(inert(stands.line(time.time()), style=_TONES[stands.tone]))
        if look.details is not None:
            rows += _details(entry, look.details)
    return Group(*rows)


def _table(look: Look, most_rows: int) -> Table:
    table = Table(box=None, pad_edge=False, header_style="dim")
    for name in ("", "label", "verdict", "since", "step", "minimum", "committed", "session"):
        right = name in ("since", "step", "minimum", "committed")
        table.add_column(name, justify="right" if right else "left", no_wrap=True, max_width=44)
    first = min(max(look.chosen - most_rows // 2, 0), max(len(look.sessions) - most_rows, 0))
    now = time.time()
    for place, entry in enumerate(look.sessions[first : first + most_rows], start=first):
        stands, held = Verdict(**entry["verdict"]), entry["worker"] != "none"
        # for a running session this is the time of the last commit, which has its own column
        since = duration(now - stands.since) if stands.since and stands.kind != "running" else ""
        step, end = entry["step"], entry["final_step"]
        committed = f"{duration(now - entry['committed_at'])} ago" if entry["committed_at"] else ""
        table.add_row(
            inert("●" if held else "○", style="green" if held else "dim"),
            inert(entry["label"] or "–", style="bold" if place == look.chosen else ""),
            inert(stands.kind, style=_TONES[stands.tone]),
            *map(inert, (since, f"{step} of {end}" if end >= step > 0 else str(step))),
            *map(inert, (number(entry["minimum"]), committed, entry["session"][:8])),
        )
    return table


def _details(entry: Mapping[str, Any], details: Mapping[str, Any]) -> list[RenderableType]:
    rows: list[RenderableType] = []
    moved = details["moved"]
    if entry["iteration"] and moved:
        lowest = number(details["corrected"].get("min"))
        rows.append(inert(f"step {moved['step']}, iteration {moved['iteration']}: minimum {lowest} predicted"))
    rows += _quality(entry, details)
    rows += [inert(details["ahead"])] if details["ahead"] else []
    rows += [inert(f"worst  {_cell_words(cell)}") for cell in details["worst"]["cells"][:_WORST]]
    for event in reversed(details["notable"][:_MESSAGES]):
        clock = time.strftime("%H:%M:%S", time.localtime(event["at"]))
        step = f" step {event['step']}" if event.get("step") is not None else ""
        words = f"{clock}{step} {event['event']} {plain(_message(event))}".rstrip()
        rows.append(inert(words, style=_KINDS.get(event["event"], "dim")))
    return rows


def _message(event: Mapping[str, Any]) -> str:
    request = f"{event['request']}: " if event.get("request") else ""
    hint = f" ({event['hint']})" if event.get("hint") else ""
    times = f", {event['times']} times" if event.get("times", 1) > 1 else ""
    return f"{request}{event.get('message', '')}{hint}{times}"


def _quality(entry: Mapping[str, Any], details: Mapping[str, Any]) -> list[RenderableType]:
    """Quality, iterations and seconds of the last committed step."""
    last, lowest = details["last"], details["lowest"]
    if not last:
        return [inert("no step was committed yet", style="dim")]
    metric = details["built"].get("settings", {}).get("quality_metric", "quality")
    words = f"{plain(metric)}  minimum {number(last['actual_min'])}, mean {number(last['actual_mean'])}"
    if entry["threshold"] is not None:
        words += f", threshold {entry['threshold']:g}"
    if lowest is not None:
        words += f"; the lowest is {number(lowest['minimum'])} in step {lowest['step']}"
        words += "" if details["read"] == 1 else f" ({details['read']:.0%} of the history is read)"
    known = {name: value or 0.0 for name, value in last.items()}
    phases = ", ".join(f"{phase} {known[f'seconds_{phase}']:.2g}" for phase in PHASES)
    return [inert(words), inert(f"{known['iterations']:.0f} iterations, {known['seconds_total']:.3g} s: {phases}")]


def _cell_words(cell: dict[str, Any]) -> str:
    """Text with a cell's value, the client's name for it, and its position."""
    centre = ", ".join(f"{value:.4g}" for value in cell.get("centre") or ())
    partition = f" of partition {cell['partition']}" if cell.get("partition") else ""
    place = f" at ({centre})" if centre else ""
    return plain(f"{number(cell.get('metric'))}  {cell.get('type', 'cell')} {cell.get('cell', '')}{partition}{place}")


def values_of(where: str, look: Look) -> dict[str, Any]:
    """The look as plain values for JSON; labels and messages unchanged."""
    values: dict[str, Any] = {"where": where, "sessions": look.sessions}
    if look.chosen >= 0:
        values["chosen"] = {"session": look.sessions[look.chosen]["session"]} | (look.details or {})
    return values
