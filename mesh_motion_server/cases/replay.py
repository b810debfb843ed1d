"""Replay a stored session: its boundary motion from its reference mesh, with its own or other settings.

For each step, the replay makes the committed Move again, in its own frame, and commits it. Earlier coupling iterations,
trials that were rolled back and restarts do not affect the committed state: with the same settings and the same version
on the same machine, the state digests are equal, bit for bit.
"""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from mesh_motion_client import Keys, Mesh, Patch, Session
from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.mesh.roles import nodes_with
from mesh_motion_protocol.errors import InvalidInput, MeshMotionError

from mesh_motion_server import __version__
from mesh_motion_server.cases.comparison import Comparison, Replayed, write_comparison
from mesh_motion_server.cases.driver import passing_session
from mesh_motion_server.cases.outputs import SERIES, run_folder, write_points
from mesh_motion_server.cases.recorded import Recorded, difference_velocity, read_recorded
from mesh_motion_server.cases.records import StepRecord
from mesh_motion_server.cases.results import Results
from mesh_motion_server.files import VtuSeries
from mesh_motion_server.session.history.boundary import BoundaryStep
from mesh_motion_server.settings import MethodSettings
from mesh_motion_server.watch.observation.series import Series, of_metric

Progress = Callable[[int, int, StepRecord], None]


class Runner(Protocol):
    """An open session in the form that a client has."""

    def move(self, displacements: Any, *, frame: Any, report: Any, time: Any, velocity: Any) -> Any:
        """Move the boundary by displacements (k, d); return MOVED."""

    def commit(self) -> Any:
        """Commit the step; return COMMITTED."""


def replay(
    session_folder: Path,
    folder: Path,
    changes: Mapping[str, Any],
    *,
    until: int | None = None,
    endpoint: str | None = None,
    keys: Keys | None = None,
    every: int = 1,
    progress: Progress | None = None,
) -> Comparison:
    """Replay a stored session and compare the replay with it.

    Raises InvalidInput if there is nothing to replay, or a setting is wrong. Raises DataLoss if the folder is not a
    session folder, or does not verify. Raises MeshMotionError if no server is available.

    Parameters
    ----------
    session_folder : Path
        Folder of a stored session, or a copy of it.
    folder : Path
        Receives ``comparison.json`` and the results of a played case.
    changes : dict
        Settings that replace those of the session.
    until : int, optional
        The last step; by default the last step with a recorded boundary.
    endpoint, keys, every, progress
        The same as in :func:`~mesh_motion_server.cases.play.play`.
    """
    recorded = read_recorded(session_folder)
    last, settings = _last_step(recorded, until), _changed(recorded, changes)
    with run_folder(folder):
        view, metric = recorded.mesh, str(settings["quality_metric"])
        moving, series = nodes_with(view.patches, ("moving",)), VtuSeries(folder, SERIES)
        results = Results(view.points, view.cells, moving, metric, series=series, every=every, last=last)
        results.write_mesh(0)

        def seen(boundary: BoundaryStep, moved: Any, points: Floats) -> None:
            base = view.points if boundary.frame == "reference" else results.points
            gap = points[moving] - (base[moving] + boundary.rows)
            quality, error = results.judge(points), float(np.sqrt((gap**2).sum(axis=1)).max())
            driven = {"iterations": 1, "boundary_error": error, "seconds": moved.seconds["total"]}
            record = StepRecord.of(boundary.step, quality, moved, moved.seconds, **driven)
            results.warn(list(moved.warnings))
            results.take(record, points, quality)
            if progress is not None:
                progress(boundary.step, last, record)

        with _session(recorded, settings, endpoint, keys) as session:
            run = replay_steps(recorded, changes, session, last, seen)
        summary = {
            "replay_of": str(recorded.folder),
            "version": __version__,
            "method": settings,
            "changes": run.changes,
            "refusal": run.refusal,
            "warnings": results.warnings,
            "steps": [record.as_dict() for record in results.records],
        }
        results.write(folder, summary, run.name)
        write_points(folder, results.points)
        comparison = Comparison(recorded, last, run, elsewhere=endpoint is not None)
        write_comparison(folder, comparison)
    return comparison


def replay_steps(
    recorded: Recorded,
    changes: Mapping[str, Any],
    session: Runner,
    last: int,
    seen: Callable[[BoundaryStep, Any, Floats], None],
) -> Replayed:
    """Play the steps 1 … ``last``; stop at a refused step.

    Parameters
    ----------
    seen : callable
        Called for each step with the boundary motion, MOVED and the coordinates (n, d).
    """
    reference = points = recorded.mesh.points
    series, digests = Series(), {}
    levels = recorded.spec.time_levels if recorded.log.timed else ""
    stored: Floats | None = None
    velocity: Floats | None = None
    before = recorded.spec.time
    refusal = ""
    for step in range(1, last + 1):
        boundary = recorded.log.read(step)
        try:
            time = boundary.time if levels else None
            moved = session.move(boundary.rows, frame=boundary.frame, report="faces", time=time, velocity=levels)
        except MeshMotionError as error:
            if not error.code.startswith("FAILED_PRECONDITION"):
                raise
            refusal = f"step {step} refused: {error.code}: {error.message}"
            break
        committed = session.commit()
        event = {"quality": moved.quality, "correction": moved.correction, "seconds": moved.seconds, "iteration": 1}
        event["seconds_total"] = moved.seconds["total"]
        series.add({"event": "moved", "step": step} | event)
        done = {"event": "committed", "step": step, "at": 0.0, "quality": committed.quality}
        series.add(of_metric(done, "size-skew"))
        digests[step] = committed.digest
        last_points = points
        points = (reference if boundary.frame == "reference" else points) + moved.displacement
        if recorded.stored is not None and step == recorded.stored[0]:
            stored = points
            if time is not None:
                mean = difference_velocity(points, last_points, time - before)
                velocity = moved.velocity if levels == "bossak" else mean
        before = time if time is not None else before
        seen(boundary, moved, points)
    return Replayed(dict(changes), series.columns(), digests, refusal, stored, velocity)


def _session(
    recorded: Recorded, settings: Mapping[str, Any], endpoint: str | None, keys: Keys | None
) -> AbstractContextManager[Session]:
    """A session of the recorded mesh, on a running server or on a private one that ends with the block."""
    view = recorded.mesh
    patches = {name: Patch(patch.role, patch.nodes) for name, patch in view.patches.items()}
    mesh = Mesh(view.points, {block.type.name: block.nodes for block in view.cells}, patches)
    timed = recorded.log.timed and recorded.spec.time_levels
    levels: dict[str, Any] = {"time": recorded.spec.time, "time_levels": recorded.spec.time_levels} if timed else {}
    label = f"replay of {recorded.spec.label or recorded.spec.session}"[:200]
    return passing_session(mesh, settings, endpoint, keys, label=label, **levels)


def _last_step(recorded: Recorded, until: int | None) -> int:
    if until is not None and until > recorded.log.steps:
        raise InvalidInput(
            f"{recorded.folder}: the motion of the boundary is recorded up to step {recorded.log.steps}, not {until}"
        )
    return until or recorded.log.steps


def _changed(recorded: Recorded, changes: Mapping[str, Any]) -> dict[str, Any]:
    """The recorded settings with the changes, checked; settings that the server chooses are left out."""
    values = recorded.spec.settings.model_dump() | dict(changes)
    checked = MethodSettings.from_mapping(values).model_dump()
    return {key: value for key, value in checked.items() if value is not None}
