"""The list of the server's sessions with a few figures each, from their folders and the list of workers."""

import math
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

from mesh_motion_server.session.listing import UNREADABLE
from mesh_motion_server.session.state import State
from mesh_motion_server.watch.observation.sessions import Sessions, SessionView
from mesh_motion_server.watch.observation.verdict import Latest, Recent, lost_files, verdict

#: Maximum number of listed sessions, the last changed first.
_LISTED = 200
#: Values for a session that the supervisor does not know.
_UNHELD = ("", "none")
#: Unknown values of a session whose mesh is not stored.
_UNKNOWN: dict[str, Any] = {
    "label": "",
    "built": False,
    "durability": "",
    "spark": [],
    "recorded": False,
} | dict.fromkeys(("dimension", "partitions", "committed_at", "hourly", "minimum", "threshold", "changed_at"))
_UNKNOWN |= {"final_step": 0, "iteration": 0}


class Overview:
    """Makes the list."""

    def __init__(self, state_folder: Path) -> None:
        self._sessions = Sessions(state_folder)
        self._latest: dict[str, Latest] = {}
        self._stored: set[str] = set()  # sessions stored at the last call, and those that still have a worker

    def listed(self, live: list[list[Any]] | None = None) -> list[dict[str, Any]]:
        """The sessions, the last changed first; if there are too many, those with a worker stay in the list.

        Parameters
        ----------
        live : list of [session, worker, state, step, epoch], optional
            As reported by the supervisor; without it, a session has a worker if a process holds its folder.
        """
        known = {entry[0]: entry for entry in live or ()}
        stored = self._sessions.views()
        first = sorted(stored, key=lambda view: known.get(view.session, _UNHELD)[1] != "alive")[:_LISTED]
        chosen = {view.session for view in first}
        views = [view for view in stored if view.session in chosen]
        self._latest = {view.session: self._latest.get(view.session) or Latest(Path(view.folder)) for view in views}
        unknown = "none" if live is not None else ""
        listed = [self._entry(view, known.get(view.session), unknown) for view in views]
        names = {view.session for view in stored}
        self._stored = names | (self._stored & known.keys())
        # A session whose mesh is not built yet has no stored data for the list. A session that is no longer stored is
        # being discarded; its worker ends soon.
        new = [_unbuilt(entry) for name, entry in known.items() if name not in self._stored and entry[1] != "dead"]
        return [*new, *listed]

    def _entry(self, view: SessionView, live: list[Any] | None, unknown: str) -> dict[str, Any]:
        recent = Recent() if view.state == UNREADABLE else self._latest[view.session].read()
        worker = unknown or ("none" if view.held is False else "alive")
        state, step = view.state, view.step
        if live is not None:
            worker = live[1]
            state, step = (live[2], max(step, live[3])) if worker == "alive" else (state, step)
        if worker == "none" and state in ("TRIAL", "COMMITTING"):
            state = "READY"  # a trial ends with its worker
        reported = recent.rests.get("event") == "failed"  # failed by itself, with its own reason
        lost = worker != "alive" and view.state in (UNREADABLE, State.FAILED) and not reported
        minima = [None if math.isnan(commit.minimum) else round(commit.minimum, 6) for commit in recent.commits]
        return {
            "session": view.session,
            "label": view.label,
            "built": True,
            "dimension": view.dimension,
            "partitions": view.partitions,
            "durability": view.durability,
            "state": state,
            "worker": worker,
            "step": step,
            "minimum_of": recent.commits[-1].step if recent.commits else step,
            "committed_at": recent.commits[-1].at if recent.commits else None,
            "hourly": recent.hourly,
            "final_step": recent.final_step,
            "iteration": recent.iteration if worker == "alive" else 0,
            "minimum": minima[-1] if minima else None,
            "threshold": recent.threshold,
            "spark": minima,
            "recorded": view.recorded,
            # compare every event, because a refusal changes neither state nor step
            "version": f"{view.changed_at:.6f}-{view.state}-{view.step}-{recent.events}",
            "changed_at": max(view.changed_at, recent.changed_at),
            "verdict": asdict(lost_files(state) if lost else verdict(recent, time.time(), worker=worker)),
        }


def _unbuilt(live: list[Any]) -> dict[str, Any]:
    """A session whose mesh is not stored."""
    session, worker, state, step, epoch = live
    found = {"session": session, "worker": worker, "state": state, "step": step, "minimum_of": step}
    return _UNKNOWN | found | {"version": f"new-{epoch}-{state}", "verdict": asdict(verdict(Recent(), 0.0))}
