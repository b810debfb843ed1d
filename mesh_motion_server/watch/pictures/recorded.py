"""Runs and meshes of stored sessions: their history, and the last stored state."""

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.session.journal.filesystem import PosixFileSystem
from mesh_motion_server.session.listing import Listing
from mesh_motion_server.session.spec import SPEC
from mesh_motion_server.watch.observation.follow import events_in_brief
from mesh_motion_server.watch.observation.mesh_view import StoredMesh
from mesh_motion_server.watch.observation.series import PHASES, Series
from mesh_motion_server.watch.pictures.before_after import MeshPair
from mesh_motion_server.watch.pictures.meshes import pair_of
from mesh_motion_server.watch.pictures.runs import Quality, Refused, Run
from mesh_motion_server.watch.terminal.text import plain

__all__ = ["is_session", "read_recorded", "recorded_pair"]

_NAMES = ("min", "mean", "p1", "p5", "p50")


def is_session(folder: Path) -> bool:
    """Whether the folder has a stored session."""
    return (folder / SPEC).is_file()


def read_recorded(folder: Path, metric: str | None = None) -> Run:
    """The run of a stored session, from its history.

    Parameters
    ----------
    metric : str, optional
        One of :data:`~.runs.METRICS`; None: the session's own.

    Raises
    ------
    InvalidInput
        If it has no history.
    JournalError
        If its ``spec.json`` cannot be read.
    """
    series, refused, own = Series(), [], ""
    for event in events_in_brief(folder):
        own = own or event.get("quality", {}).get("metric", "") if event["event"] == "moved" else own
        if event["event"] == "refused" and isinstance(event.get("step"), int):
            refused.append(Refused(event["step"], str(event.get("code", "")), str(event.get("message", ""))))
        with suppress(KeyError, TypeError, AttributeError):  # another version may have written it
            series.add(_of_metric(event, metric) if metric else event)
    if not len(series):
        raise InvalidInput(
            f"{folder}: its history has no committed step",
            hint="sessions of a server with history_bytes = 0, or of an older one, have no history",
        )
    return _run(series.columns(), _label(folder), metric or own, tuple(refused), is_own=metric in (None, own))


def recorded_pair(
    folder: Path, metric: str | None = None, first: int | None = None, last: int | None = None
) -> MeshPair:
    """The uploaded mesh of a stored session, and its last stored state.

    Parameters
    ----------
    metric : str, optional
        None: the session's own.
    first, last : int, optional
        Only these two steps are stored; other steps are refused.

    Raises
    ------
    InvalidInput
        If other steps are asked for.
    JournalError
        If its files do not verify.
    """
    stored = StoredMesh(folder)
    step, _, points = stored.coordinates()
    if first not in (None, 0) or last not in (None, step):
        raise InvalidInput(
            f"--steps: of a session the mesh is stored as uploaded and after step {step} only, got "
            f"{'' if first is None else first}:{'' if last is None else last}",
            hint="mesh-motion play --from-journal makes the other steps again, and plot draws what it writes",
        )
    metric = metric or Listing(PosixFileSystem()).spec(folder).settings.quality_metric
    mesh = stored.mesh
    pair = pair_of(mesh.points, mesh.cells, mesh.points, points, steps=(0, step), metric=metric)
    return MeshPair(_label(folder), metric, *pair, _enrichment(folder, step, mesh.points.shape[1]))


def _run(columns: Mapping[str, Any], label: str, metric: str, refused: tuple[Refused, ...], *, is_own: bool) -> Run:
    """The columns of a series as a run."""
    known = columns["threshold"][np.isfinite(columns["threshold"])]
    return Run(
        label=label,
        metric=metric,
        threshold=float(known[-1]) if is_own and len(known) else None,
        step=columns["step"].astype(np.int64),
        actual=Quality(*(columns[f"actual_{name}"] for name in _NAMES)),
        predicted=Quality(*(columns[f"predicted_{name}"] for name in _NAMES)),
        standard=columns["standard_min"],
        iterations=columns["iterations"],
        enrichment_points=np.nan_to_num(columns["enrichment_points"]),
        seconds={phase: columns[f"seconds_{phase}"] for phase in PHASES},
        total_seconds=columns["seconds_total"],
        non_orthogonality=columns["non_orthogonality"],
        refused=refused,
    )


def _of_metric(event: Mapping[str, Any], metric: str) -> Mapping[str, Any]:
    """The event with another metric's numbers instead of those of the session's metric."""
    key = metric.replace("-", "_")
    if event["event"] == "committed":
        return {**event, "quality": {**event["quality"], "metric": event["quality"].get(key, {})}}
    if event["event"] == "moved":
        quality = event["quality"]
        others = {
            which: {**quality[which], "metric": quality[which].get(key, {})} for which in ("standard", "corrected")
        }
        return {**event, "quality": {**quality, **others}}
    return event


def _enrichment(folder: Path, step: int, dimension: int) -> Any:
    """(k, d) where enrichment functions were added in a step, by its last Move."""
    places: list[list[float]] = []
    for event in events_in_brief(folder):
        if event["event"] == "moved" and event.get("step") == step:
            places = event.get("enrichment_points", [])
    return np.array(places, dtype=np.float64).reshape(len(places), dimension)


def _label(folder: Path) -> str:
    return plain(Listing(PosixFileSystem()).spec(folder).label) or folder.name[:8]
