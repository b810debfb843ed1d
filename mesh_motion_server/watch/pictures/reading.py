"""Read runs and meshes from a session folder, or from a folder that ``mesh-motion play`` wrote."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.mesh.finite_volume import FACE_METRICS
from mesh_motion_server.watch.pictures.before_after import MeshPair
from mesh_motion_server.watch.pictures.meshes import played_pair
from mesh_motion_server.watch.pictures.recorded import is_session, read_recorded, recorded_pair
from mesh_motion_server.watch.pictures.runs import METRICS, Run, is_played, read_played

__all__ = ["read_pair", "read_runs"]


def read_runs(folders: Sequence[Path], metric: str | None = None) -> list[Run]:
    """The history of each run, labels made distinct.

    Parameters
    ----------
    metric : str, optional
        One of :data:`~.runs.METRICS`.

    Raises
    ------
    InvalidInput
        If a folder is not a run.
    """
    _check(metric, METRICS)
    runs = [_read(folder, metric) for folder in folders]
    metrics = {run.metric for run in runs}
    if len(metrics) > 1:
        raise InvalidInput(
            f"the runs have different quality metrics: {', '.join(sorted(metrics))}",
            hint=f"--metric {METRICS[0]} draws one that all have",
        )
    counts = Counter(run.label for run in runs)
    return [
        replace(run, label=_distinct(run.label, folder)) if counts[run.label] > 1 else run
        for run, folder in zip(runs, folders, strict=True)
    ]


def read_pair(folder: Path, metric: str | None = None, first: int | None = None, last: int | None = None) -> MeshPair:
    """The meshes of a run before and after.

    Raises
    ------
    InvalidInput
        If it is not a run, or does not have these steps.
    """
    _check(metric, (*METRICS, *FACE_METRICS))
    if is_played(folder):
        return played_pair(folder, metric, first, last)
    if is_session(folder):
        return recorded_pair(folder, metric, first, last)
    raise _no_run(folder)


def _read(folder: Path, metric: str | None) -> Run:
    if is_played(folder):
        return read_played(folder, metric)
    if is_session(folder):
        return read_recorded(folder, metric)
    raise _no_run(folder)


def _no_run(folder: Path) -> InvalidInput:
    sessions = folder / "sessions"
    if sessions.is_dir():
        found = sorted(path.name for path in sessions.iterdir() if is_session(path))
        listed = ", ".join(found[:3]) + (" …" if len(found) > 3 else "") or "none"
        return InvalidInput(
            f"{folder}: a server's state folder, expected a session's; it has {listed}",
            hint=f"mesh-motion plot {sessions / (found[0] if found else 'SESSION')} …",
        )
    what = "neither a session's folder nor one that play wrote" if folder.is_dir() else "no such folder"
    return InvalidInput(f"{folder}: {what}", hint="a session's folder is STATE FOLDER/sessions/ID")


def _check(metric: str | None, known: Sequence[str]) -> None:
    if metric is not None and metric not in known:
        raise InvalidInput(f"--metric: expected one of {', '.join(known)}, got {metric!r}")


def _distinct(label: str, folder: Path) -> str:
    """A label that distinguishes runs of the same name."""
    return folder.name if folder.name != label else str(folder)
