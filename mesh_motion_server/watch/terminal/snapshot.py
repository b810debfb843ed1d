"""One look at the sessions, as plain text or as JSON: for pipes, logs, and terminals that can do no more."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from itertools import chain
from typing import Any

from mesh_motion_server.errors import SessionError
from mesh_motion_server.watch.terminal.panels import View, details_lines, session_lines
from mesh_motion_server.watch.terminal.sources import Details, SessionLine, Source
from mesh_motion_server.watch.terminal.text import plain

__all__ = ["chosen_of", "named", "snapshot_text", "snapshot_values"]

_ROWS = 30
_COLUMNS = ("step", "actual_min", "actual_mean", "predicted_min", "iterations", "seconds_total")


def named(lines: Sequence[SessionLine], wanted: str) -> int | None:
    """Place of the session whose label it is, else of the first whose id begins so; None: there is none."""
    labelled = (place for place, line in enumerate(lines) if line.label == wanted)
    begun = (place for place, line in enumerate(lines) if wanted and line.session.startswith(wanted))
    return next(chain(labelled, begun), None)


def chosen_of(lines: list[SessionLine], wanted: str | None) -> int:
    """Place of the session that is :func:`named` so; None: of the one that changed last.

    Raises
    ------
    SessionError
        NOT_FOUND, if there is none.
    """
    if wanted is None:
        return max(range(len(lines)), key=lambda i: lines[i].changed_at or 0.0) if lines else -1
    place = named(lines, wanted)
    if place is not None:
        return place
    labels = ", ".join(plain(line.label) or line.session[:8] for line in lines[:5])
    raise SessionError(f"no session {plain(wanted)!r}; there are {labels or 'none'}", code="NOT_FOUND")


def snapshot_text(source: Source, wanted: str | None, columns: int) -> str:
    """The list of sessions and all about one of them, without colour.

    Raises
    ------
    Unreadable, SessionError
    """
    lines = source.sessions()
    chosen = chosen_of(lines, wanted)
    now = time.time()
    rows = [f"{plain(source.where)}: {len(lines)} session{'s' if len(lines) != 1 else ''}"]
    verdict = source.verdict(lines)
    rows += [verdict] if verdict else []
    if lines:
        rows += [row.plain.rstrip() for row in session_lines(lines, -1, View(columns, len(lines) + 1, now=now))]
        view = View(columns, _ROWS, now=now, wrapped=True)
        details = source.details(lines[chosen].session, math.inf)
        rows += ["", *(row.plain.rstrip() for row in details_lines(lines[chosen], details, view))]
    return "\n".join(rows)


def snapshot_values(source: Source, wanted: str | None) -> dict[str, Any]:
    """The same as plain values, labels and messages as they are.

    Raises
    ------
    Unreadable, SessionError
    """
    lines = source.sessions()
    chosen = chosen_of(lines, wanted)
    values: dict[str, Any] = {"where": source.where, "sessions": [line.as_dict() for line in lines]}
    if lines:
        details = source.details(lines[chosen].session, math.inf)
        values["chosen"] = {"session": lines[chosen].session} | (_plain_details(details) if details else {})
    return values


def _plain_details(details: Details) -> dict[str, Any]:
    columns = details.columns
    last = {name: _finite(columns[name][-1]) for name in _COLUMNS if name in columns and len(columns[name])}
    lowest = columns.get("actual_min")
    known = lowest is not None and len(lowest) > 0 and not all(map(math.isnan, lowest))
    place = min(range(len(lowest)), key=lambda i: (math.isnan(lowest[i]), lowest[i])) if known else -1  # type: ignore[arg-type, index]
    return {
        "metric": details.metric,
        "threshold": details.threshold,
        "steps": len(columns.get("step", ())),
        "last": last,
        "lowest": {"step": int(columns["step"][place]), "minimum": float(lowest[place])} if known else None,  # type: ignore[index]
        "trial": details.trial,
        "worst": details.worst,
        "messages": [
            {"at": message.at, "kind": message.kind, "step": message.step, "text": message.text}
            for message in details.messages
        ],
        "lacks": details.lacks,
    }


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
