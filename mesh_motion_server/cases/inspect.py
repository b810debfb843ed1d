"""Inspect the sessions of a running server, or those stored in a folder."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from mesh_motion_client import Keys, connect
from mesh_motion_protocol.errors import InvalidInput
from rich.console import RenderableType

from mesh_motion_server.cases.story import story_of_step
from mesh_motion_server.session.inspection import Inspection, inspect_session, is_session_folder
from mesh_motion_server.session.spec import SPEC
from mesh_motion_server.watch.observation.steps import HistoryDigest, digest_of_history
from mesh_motion_server.watch.terminal.console import Table, inert


@dataclass(frozen=True)
class Found:
    """The result of an inspection."""

    values: dict[str, Any]  # plain values, for programs
    table: RenderableType  # the same as a table to print
    damaged: list[str]  # sessions whose files do not verify


def list_sessions(endpoint: str, timeout: float, keys: Keys | None = None) -> Found:
    """List the sessions of a running server.

    Raises mesh_motion_client.MeshMotionError if no server answers within ``timeout`` seconds.
    """
    with connect(endpoint, timeout=timeout, keys=keys) as server:
        sessions, name = server.sessions(), server.welcome.server
    columns = ["session", "label", "state", "step", "partitions", "worker"]
    columns += ["owner"] if any("owner" in session for session in sessions) else []
    table = _table_of_sessions(f"{name} at {endpoint}", len(sessions), *columns)
    for session in sessions:
        table.add_row(*(str(session.get(column, "")) for column in columns))
    return Found({"server": name, "endpoint": endpoint, "sessions": sessions}, table, [])


def inspect_folder(folder: Path) -> Found:
    """Describe the session in a folder, or all sessions of a state folder.

    Raises InvalidInput if there is no such folder, or neither a session nor a state folder in it.
    """
    if is_session_folder(folder):
        inspection, history = inspect_session(folder), digest_of_history(folder)
        values = asdict(inspection) | {"history": asdict(history)}
        return Found(values, _details(inspection, history), _damaged([inspection]))
    sessions = folder / "sessions"
    if not sessions.is_dir():
        raise InvalidInput(
            f"{folder}: neither a session's folder nor a server's state folder",
            hint="a state folder has a folder 'sessions'; serve --state DIR chooses it",
        )
    found = [inspect_session(path) for path in sorted(sessions.iterdir()) if is_session_folder(path)]
    values = {"folder": str(folder), "sessions": [asdict(inspection) for inspection in found]}
    return Found(values, _overview(folder, found), _damaged(found))


def inspect_step(folder: Path, step: int) -> Found:
    """Describe the events of a step of the session in a folder. Only the history is read; nothing is verified.

    Raises InvalidInput if the folder is not a session folder, or the step is not recorded.
    """
    if not (folder / SPEC).is_file():
        raise InvalidInput(f"{folder}: not a session's folder", hint="give a folder below STATE FOLDER/sessions")
    story = story_of_step(folder, step)
    values = {"session": folder.name, "step": step, "outcome": story.outcome, "events": story.events}
    return Found(values, inert(*story.lines), [])


def _damaged(found: list[Inspection]) -> list[str]:
    return [Path(inspection.folder).resolve().name for inspection in found if inspection.state == "damaged"]


def _overview(folder: Path, found: list[Inspection]) -> Table:
    """One row per session."""
    table = _table_of_sessions(str(folder), len(found), "session", "label", "judged", "step", "nodes", "partitions")
    for i in found:
        table.add_row(i.session, i.label, i.state, str(i.step), str(i.nodes), str(i.partitions))
    return table


def _table_of_sessions(where: str, count: int, *columns: str) -> Table:
    """An empty table, in which a long label shortens no session's id, which other commands need."""
    table = Table(*columns, title=f"{where}: {count} sessions", box=None)
    table.columns[0].min_width = 32
    return table


def _details(inspection: Inspection, history: HistoryDigest) -> Table:
    """All details of one session."""
    table = Table(show_header=False, box=None, pad_edge=False)
    names = ("session", "label", "state", "durability", "step", "stored_step", "epoch", "dimension")
    for name in (*names, "partitions", "nodes", "digest"):
        table.add_row(name.replace("_", " "), str(getattr(inspection, name)))
    table.add_row("settings", ", ".join(f"{key} = {value}" for key, value in inspection.settings.items()))
    for check in inspection.checks:
        table.add_row("check", f"{check.name}: {'verified' if check.passed else check.message}")
    for line in _history(history):
        table.add_row("history", line)
    return table


def _history(history: HistoryDigest) -> list[str]:
    """Summary of the recorded history in a few lines."""
    if not history.spans:
        return ["none"]
    lines = [f"{history.recorded}; replay possible up to step {history.boundary_steps}"]
    if history.worst_quality is not None:
        lines.append(f"worst step {history.worst_step}: minimum {history.metric} {history.worst_quality:.4f}")
    counts = {"corrected": history.corrected_steps, "refusals": history.refusals, "roll-backs": history.rollbacks}
    return [*lines, ", ".join(f"{number} {word}" for word, number in counts.items())]
