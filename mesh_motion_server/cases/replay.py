"""Replay a stored session: its boundary motion from its reference mesh, with its own or other settings.

For each step, the replay makes the committed Move again, in its own frame, and commits it. Earlier coupling iterations,
trials that were rolled back and restarts do not affect the committed state: with the same settings and the same version
on the same machine, the state digests are equal, bit for bit.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from mesh_motion_client import Keys, Mesh, Patch, connect
from mesh_motion_client import MeshMotionError as ClientError

from mesh_motion_server import __version__
from mesh_motion_server.cases.comparison import Comparison, Replayed, write_comparison
from mesh_motion_server.cases.faces import faces_numbers
from mesh_motion_server.cases.outputs import (
    SERIES,
    remove_results,
    result_folder,
    write_points,
    write_steps,
    write_summary,
)
from mesh_motion_server.cases.picture import write_picture
from mesh_motion_server.cases.recorded import Recorded, StepFigures, read_recorded
from mesh_motion_server.cases.records import VTU_METRICS, StepRecord, drawn, quality_numbers
from mesh_motion_server.errors import InvalidInput, MeshMotionError
from mesh_motion_server.files import VtuSeries
from mesh_motion_server.numerics.arrays import Floats
from mesh_motion_server.numerics.mesh.roles import nodes_with
from mesh_motion_server.numerics.quality.metrics import cell_quality
from mesh_motion_server.numerics.quality.orientation import oriented_at_rest
from mesh_motion_server.session.history.boundary import BoundaryStep
from mesh_motion_server.settings import MethodSettings
from mesh_motion_server.watch.pictures.page import pictures_are_possible
from mesh_motion_server.watch.pictures.snapshot import Snapshot

__all__ = ["Opener", "Runner", "Variant", "over_the_wire", "replay", "replay_variant", "variant_of"]

Progress = Callable[[int, int, StepRecord], None]


class Runner(Protocol):
    """An open session, as a client has it."""

    def move(self, displacements: Any, *, frame: Any, report: Any) -> Any:
        """Move the boundary by displacements (k, d); return MOVED."""

    def commit(self) -> Any:
        """Commit the step; return COMMITTED."""


#: Opens a session of the recorded mesh with the given settings.
Opener = Callable[[Mapping[str, Any]], AbstractContextManager[Runner]]


@dataclass(frozen=True)
class Variant:
    """A replay's name, and its settings that differ from the recorded session."""

    name: str
    changes: Mapping[str, Any]


def variant_of(changes: Mapping[str, Any]) -> Variant:
    """A variant whose name lists its changes."""
    return Variant(", ".join(f"{key} = {value}" for key, value in changes.items()) or "replayed", changes)


@contextmanager
def over_the_wire(recorded: Recorded, endpoint: str | None, keys: Keys | None = None) -> Iterator[Opener]:
    """Open sessions on a running server, or on a private one that ends with the block."""
    view = recorded.mesh
    mesh = Mesh(
        view.points,
        {block.type.name: block.nodes for block in view.cells},
        {name: Patch(patch.role, patch.nodes) for name, patch in view.patches.items()},
    )
    with connect(endpoint, keys=keys) as server:

        @contextmanager
        def opened(settings: Mapping[str, Any]) -> Iterator[Runner]:
            label = f"replay of {recorded.spec.label or recorded.spec.session}"[:200]
            with server.open(mesh, settings, label=label) as session:
                try:
                    yield session
                finally:
                    with suppress(ClientError):  # the results do not depend on it
                        session.close("discard")

        yield opened


def replay(
    session_folder: Path,
    folder: Path,
    variants: Sequence[Variant],
    *,
    until: int | None = None,
    endpoint: str | None = None,
    keys: Keys | None = None,
    every: int = 1,
    progress: Progress | None = None,
) -> Comparison:
    """Replay a stored session with each variant and compare the replays with the recorded session.

    Parameters
    ----------
    session_folder : Path
        Folder of a stored session, or a copy of it.
    folder : Path
        Receives ``comparison.json``, ``comparison.csv`` and the results of a played case; several variants have their
        results in ``variant-1``, ….
    until : int, optional
        The last step; by default the last step with a recorded boundary.
    endpoint, keys, every, progress
        As for :func:`~mesh_motion_server.cases.play.play`.

    Raises
    ------
    InvalidInput
        If there is nothing to replay, or a setting is wrong.
    JournalError
        If the folder is not a session folder, or does not verify.
    MeshMotionError
        If no server is available.
    """
    recorded = read_recorded(session_folder)
    last = _last_step(recorded, until)
    settings = [_changed(recorded, variant) for variant in variants]
    runs = []
    _clear(folder)
    with over_the_wire(recorded, endpoint, keys) as opener:
        for number, (variant, values) in enumerate(zip(variants, settings, strict=True), start=1):
            target = folder if len(variants) == 1 else folder / f"variant-{number}"
            with result_folder(target) as work:
                with opener(values) as runner:
                    output = _Output(
                        recorded, VtuSeries(work, SERIES), every, last, progress, str(values["quality_metric"])
                    )
                    runs.append(replay_variant(recorded, variant, runner, last, output.take))
                output.write(work, runs[-1], values)
    comparison = Comparison(recorded, last, runs, elsewhere=endpoint is not None)
    write_comparison(folder, comparison)
    return comparison


def _clear(folder: Path) -> None:
    """Remove the results of earlier replays, for any number of variants, and nothing else."""
    remove_results(folder)
    for target in folder.glob("variant-[0-9]*"):
        remove_results(target)
        with suppress(OSError):  # the folder has other files
            target.rmdir()


def replay_variant(
    recorded: Recorded,
    variant: Variant,
    runner: Runner,
    last: int,
    seen: Callable[[BoundaryStep, Any, StepFigures, Floats], None],
) -> Replayed:
    """Play the steps 1 … ``last``; stop at a refused step.

    Parameters
    ----------
    seen : callable
        Called for each step with the boundary motion, MOVED, the figures and the coordinates (n, d).
    """
    reference = points = recorded.mesh.points
    figures: list[StepFigures] = []
    stored: Floats | None = None
    refusal = ""
    for step in range(1, last + 1):
        boundary, found = recorded.log.read(step), StepFigures(step)
        try:
            moved = runner.move(boundary.rows, frame=boundary.frame, report="faces")
        except (MeshMotionError, ClientError) as error:
            if not error.code.startswith("FAILED_PRECONDITION"):
                raise
            refusal = f"step {step} refused: {error.code}: {error.message}"
            break
        committed = runner.commit()
        found.take_motion(moved.quality, moved.correction, moved.seconds)
        found.take_commit(committed.quality, committed.digest)
        points = (reference if boundary.frame == "reference" else points) + moved.displacement
        figures.append(found)
        if recorded.stored is not None and step == recorded.stored[0]:
            stored = points
        seen(boundary, moved, found, points)
    return Replayed(variant.name, dict(variant.changes), figures, refusal, stored)


def _last_step(recorded: Recorded, until: int | None) -> int:
    if until is not None and until > recorded.log.steps:
        raise InvalidInput(
            f"{recorded.folder}: what the boundary did is recorded up to step {recorded.log.steps}, not {until}"
        )
    return until or recorded.log.steps


def _changed(recorded: Recorded, variant: Variant) -> dict[str, Any]:
    """The recorded settings with the variant's changes, checked; settings that the server chooses are omitted."""
    values = recorded.spec.settings.model_dump() | dict(variant.changes)
    checked = MethodSettings.from_mapping(values).model_dump()
    return {key: value for key, value in checked.items() if value is not None}


class _Output:
    """Writes the results of a replay like those of a played case."""

    def __init__(
        self, recorded: Recorded, series: VtuSeries, every: int, last: int, progress: Progress | None, metric: str
    ) -> None:
        self._recorded, self._series, self._every, self._last = recorded, series, every, last
        self._progress, self._metric = progress, metric
        view = recorded.mesh
        self._reference, self._points = view.points, view.points
        self._cells, self._sizes = oriented_at_rest(view.points, view.cells)
        self._moving = nodes_with(view.patches, ("moving",))
        self._quality = cell_quality(view.points, self._cells, self._sizes)
        self._before = self._worst = self._snapshot(0)
        self._records: list[StepRecord] = []
        self._warnings: list[str] = []
        self._write(0)

    def take(self, boundary: BoundaryStep, moved: Any, found: StepFigures, points: Floats) -> None:
        """Add a step."""
        base = self._reference if boundary.frame == "reference" else self._points
        target = base[self._moving] + boundary.rows
        self._points = points
        self._quality = cell_quality(points, self._cells, self._sizes)
        self._warnings += [warning for warning in moved.warnings if warning not in self._warnings]
        record = StepRecord(
            step=found.step,
            **quality_numbers(self._quality),
            predicted_min=found.predicted_min,
            predicted_standard=found.standard_min,
            enrichment_points=found.enrichment_points,
            freed_nodes=found.freed_nodes,
            iterations=1,
            boundary_error=float(np.sqrt(((points[self._moving] - target) ** 2).sum(axis=1)).max()),
            seconds=found.seconds_total,
            seconds_solve=found.seconds["solve"],
            seconds_predict=found.seconds["predict"],
            seconds_correct=found.seconds["correct"],
            seconds_displace=found.seconds["displace"],
            sub_steps=int(moved.correction.get("sub_steps", 1)),
            faces=faces_numbers(moved.faces),
        )
        self._records.append(record)
        if found.step == 1 or record.shown(self._metric)[0] < float(self._worst.quality.min()):
            self._worst = self._snapshot(found.step)
        if found.step % self._every == 0 or found.step == self._last:
            self._write(found.step)
        if self._progress is not None:
            self._progress(found.step, self._last, record)

    def write(self, work: Path, run: Replayed, settings: Mapping[str, Any]) -> None:
        """Write all results except the series."""
        summary = {
            "replay_of": str(self._recorded.folder),
            "version": __version__,
            "method": dict(settings),
            "changes": run.changes,
            "refusal": run.refusal,
            "warnings": self._warnings,
            "steps": [record.as_dict() for record in self._records],
        }
        write_summary(work, summary)
        write_steps(work, self._records)
        write_points(work, self._points)
        if self._records and pictures_are_possible():
            picture = work / "quality.png"
            write_picture(picture, run.name, self._before, self._worst, self._records, self._metric)

    def _snapshot(self, step: int) -> Snapshot:
        return Snapshot(step, self._points, self._cells, self._quality.metric(drawn(self._metric)), self._moving)

    def _write(self, step: int) -> None:
        quality = {name.replace("-", "_"): self._quality.metric(name) for name in VTU_METRICS}
        displacement = {"displacement": self._points - self._reference}
        self._series.write(float(step), self._points, self._cells, point_data=displacement, cell_data=quality)
