"""Play a case: drive a session as a coupling code would, step by step, and keep the replies.

Each step has several coupling iterations: Moves that start from the same committed state and approach the step's final
displacement, as a relaxed fixed-point iteration does. The last one is committed.
"""

import resource
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from mesh_motion_client import Keys
from mesh_motion_client import MeshMotionError as ClientError
from mesh_motion_client.session import Report

from mesh_motion_server import __version__
from mesh_motion_server.cases.case import Case, read_case
from mesh_motion_server.cases.driver import Driver, Reply, open_session
from mesh_motion_server.cases.faces import faces_numbers
from mesh_motion_server.cases.kept import Kept
from mesh_motion_server.cases.motion_program import MotionProgram
from mesh_motion_server.cases.outputs import (
    SERIES,
    remove_ended,
    remove_results,
    run_folder,
    write_points,
    write_steps,
    write_summary,
)
from mesh_motion_server.cases.picture import write_picture
from mesh_motion_server.cases.prediction import Prediction, named
from mesh_motion_server.cases.records import VTU_METRICS, StepRecord, add_seconds, drawn, quality_numbers
from mesh_motion_server.cases.refused import write_refused
from mesh_motion_server.errors import InvalidInput, MeshMotionError, NumericalError
from mesh_motion_server.files import MeshFile, VtuSeries, patch_marks
from mesh_motion_server.files.vtu import Data
from mesh_motion_server.numerics.arrays import Floats
from mesh_motion_server.numerics.mesh.roles import BoundaryRoles, Patch
from mesh_motion_server.numerics.quality.metrics import cell_quality
from mesh_motion_server.numerics.quality.orientation import oriented_at_rest
from mesh_motion_server.watch.pictures.page import pictures_are_possible
from mesh_motion_server.watch.pictures.snapshot import Snapshot

__all__ = ["Played", "play"]

Progress = Callable[[int, int, StepRecord | None], None]

#: An iteration halves the distance to the step's final displacement, as relaxation by 0.5 does.
_RELAXATION = 0.5
#: As a share of the mesh's extent: motions that differ by less than this are the same.
_AGREEMENT = 1e-9


@dataclass(frozen=True, eq=False)
class Played:
    """A case that was played to its end.

    Attributes
    ----------
    points : (n, d) array
        Final coordinates.
    warnings : list of str
        What the server and the writers warned about, each once, in the order of first appearance.
    summary : dict
        The content of summary.json.
    before, worst : Snapshot
        The mesh at opening, and after the step that left the lowest minimum size-skew.
    """

    mesh: MeshFile
    points: Floats
    steps: list[StepRecord]
    warnings: list[str]
    summary: dict[str, Any]
    before: Snapshot
    worst: Snapshot


def play(
    case_file: Path,
    folder: Path,
    *,
    endpoint: str | None = None,
    every: int = 1,
    progress: Progress | None = None,
    keys: Keys | None = None,
    resume: bool = False,
) -> Played:
    """Play a case and write its results after each step.

    Parameters
    ----------
    folder : path
        Receives the results; created if it is missing.
    endpoint : str, optional
        A running server; if omitted, a private server is started and stopped.
    every : int
        Write every ``every``-th step to the series; the last step always.
    progress : callable, optional
        Called with the steps done, the number of steps and the record of the step just done.
    keys : Keys, optional
        Keys for a server that requires them.
    resume : bool
        Continue after the last committed step of the run that ended early in this folder, for any reason.

    Raises
    ------
    InvalidInput
        If the case, its mesh or its tables do not fit.
    MeshMotionError
        If the server refuses a step. The folder then has the results of the steps before it, ``accepted.npy`` instead
        of ``points.npy``, and the refused mesh in ``refused.vtu`` and ``quality.png``.
    """
    if folder.is_dir() and case_file.is_file() and not resume:  # after a misspelt name the earlier results stay
        remove_results(folder)
    case = read_case(case_file)
    mesh = case.read_mesh()
    program = MotionProgram.of(case, mesh)
    with run_folder(folder, resumed=resume) as kept:
        opening = open_session(case, mesh, endpoint, kept, resumed=resume, keys=keys)
        with opening as driver:
            written = [0, *range(every, driver.step, every)] if driver.step else []
            series = VtuSeries(folder, SERIES, list(map(float, written)))
            run = _Run(case, mesh, program, driver, series, every, kept)
            try:
                for step in run.steps():
                    if progress is not None:
                        progress(step.step, program.count, step)
            except BaseException as error:
                run.keep(folder, error)
                raise
            played = run.result()
        remove_ended(folder)
        write_points(folder, played.points)
        _write(folder, case, played)
    return played


def _write(folder: Path, case: Case, played: Played, refused: str = "") -> None:
    """Write all results except coordinates and series."""
    write_summary(folder, played.summary)
    write_steps(folder, played.steps)
    if pictures_are_possible():
        metric = case.content.method.quality_metric
        write_picture(folder / "quality.png", case.name, played.before, played.worst, played.steps, metric, refused)


class _Run:
    """The state of a case being played."""

    def __init__(
        self,
        case: Case,
        mesh: MeshFile,
        program: MotionProgram,
        driver: Driver,
        series: VtuSeries,
        every: int,
        kept: Kept,
    ) -> None:
        self._case, self._mesh, self._program, self._driver = case, mesh, program, driver
        self._series, self._every, self._kept = series, every, kept
        self._cells, self._sizes = oriented_at_rest(mesh.points, mesh.cell_table)
        roles = BoundaryRoles.from_patches(
            {name: Patch(role, mesh.patches[name]) for name, role in case.content.patches.items()}
        )
        self._fixed = roles.fixed
        self._points = mesh.points
        self._quality = cell_quality(mesh.points, self._cells, self._sizes)
        self._drawn = drawn(case.content.method.quality_metric)
        self._reference = self._worst = self._snapshot(0)
        self._at_opening = _plain(self._quality.metric("size-skew"))
        self._records: list[StepRecord] = []
        self._warnings = [f"patch {name!r} is moving but has no motion: it stays" for name in program.still]
        self._warnings += [*mesh.notes, *driver.mesh_warnings]
        self._begin = time.perf_counter()
        if driver.step:
            self._go_on(driver.step)
        else:
            self._write(0)

    def _go_on(self, step: int) -> None:
        """Continue from the kept steps.

        Raises
        ------
        InvalidInput
            If the motion up to this step has changed.
        """
        self._records, self._warnings = self._kept.steps(step)
        self._begin -= sum(record.seconds for record in self._records)
        lowest = min(self._records, key=lambda record: record.shown(self._drawn)[0]).step
        for at, points in ((lowest, self._kept.worst(lowest)), (step, self._driver.points())):
            if points is not None:
                self._points = points
                self._quality = cell_quality(points, self._cells, self._sizes)
            self._worst = self._snapshot(at) if at == lowest else self._worst
        target = self._program.displacement(min(step, self._program.count))
        extent = float(np.ptp(self._mesh.points, axis=0).max())
        if not self._boundary_error(target) <= self._records[-1].boundary_error + _AGREEMENT * extent:
            raise InvalidInput(
                f"{self._case.path}: the motion up to step {step} is another than the one that was played",
                hint="put it back, or play from the beginning without --resume",
            )
        if step % self._every == 0 or step == self._program.count:
            self._write(step)  # again: the process may have been killed between the commit and the file

    def _snapshot(self, step: int) -> Snapshot:
        """The current mesh."""
        return Snapshot(step, self._points, self._cells, self._quality.metric(self._drawn), self._program.nodes)

    def steps(self) -> Iterator[StepRecord]:
        """Play all steps."""
        for step in range(len(self._records) + 1, self._program.count + 1):
            self._records.append(self._step(step))
            if step == 1 or self._records[-1].shown(self._drawn)[0] < float(self._worst.quality.min()):
                self._worst = self._snapshot(step)
                self._kept.keep_worst(step, self._points)
            if step % self._every == 0 or step == self._program.count:
                self._write(step)
            yield self._records[-1]

    def _step(self, step: int) -> StepRecord:
        """Iterate one step and commit it."""
        before, target = self._program.displacement(step - 1), self._program.displacement(step)
        iterations = self._case.content.steps.iterations
        begin = time.perf_counter()
        seconds: dict[str, float] = {}
        for iteration in range(1, iterations + 1):
            fraction = 1.0 if iteration == iterations else 1.0 - (1.0 - _RELAXATION) ** iteration
            wanted = target if fraction == 1.0 else before + fraction * (target - before)
            moved = self._move(step, wanted, "faces" if iteration == iterations else "")
            seconds = add_seconds(seconds, moved.seconds)
        elapsed = time.perf_counter() - begin
        self._warnings += [w for w in moved.warnings if w not in self._warnings]
        accepted = self._points, self._quality
        self._points = self._mesh.points + moved.displacement
        self._quality = cell_quality(self._points, self._cells, self._sizes)
        record = StepRecord(
            step=step,
            **quality_numbers(self._quality),
            predicted_min=moved.predicted,
            predicted_standard=moved.predicted_standard,
            enrichment_points=moved.enrichment_points,
            freed_nodes=moved.freed_nodes,
            iterations=iterations,
            boundary_error=self._boundary_error(target),
            seconds=elapsed,
            seconds_solve=seconds["solve"],
            seconds_predict=seconds["predict"],
            seconds_correct=seconds["correct"],
            seconds_displace=seconds["displace"],
            sub_steps=moved.sub_steps,
            faces=faces_numbers(moved.faces),
        )
        self._kept.add(record, self._warnings)  # before the commit, so that every committed step is known
        begin = time.perf_counter()
        try:
            self._driver.commit(self._program.count)
        except BaseException:
            self._points, self._quality = accepted
            raise
        return replace(record, seconds=elapsed + time.perf_counter() - begin)

    def _move(self, step: int, displacement: Floats, report: Report) -> Reply:
        """One coupling iteration; an error names the step."""
        try:
            return self._driver.move(displacement, report=report)
        except (MeshMotionError, ClientError) as error:
            error.message = f"step {step} of {self._program.count}: {error.message}"
            raise

    def _boundary_error(self, target: Floats) -> float:
        """Largest distance of a moving or fixed node from its prescribed position."""
        moving = self._points[self._program.nodes] - (self._mesh.points[self._program.nodes] + target)
        fixed = self._points[self._fixed] - self._mesh.points[self._fixed]
        return float(np.sqrt((np.concatenate([moving, fixed]) ** 2).sum(axis=1)).max())

    def _write(self, step: int) -> None:
        """Add the current mesh to the series."""
        quality = {name.replace("-", "_"): self._quality.metric(name) for name in VTU_METRICS}
        nodes: Data = {"displacement": self._points - self._mesh.points, **patch_marks(self._mesh)}
        self._series.write(float(step), self._points, self._cells, point_data=nodes, cell_data=quality)

    def keep(self, folder: Path, error: BaseException) -> None:
        """Write the results after an error: the steps before it, and a refused mesh with its worst cells."""
        refused = isinstance(error, MeshMotionError | ClientError) and error.code == NumericalError.default_code
        if not (refused or self._records):
            return
        step = len(self._records) + 1
        told: dict[str, Any] = {"step": step, "message": str(error) or type(error).__name__}
        remove_ended(folder)
        title = ""
        if refused:
            told |= self._refused(folder, step, error)
            title = f"the refused step {step}"
        if self._records:
            write_points(folder, self._points, "accepted.npy")
            error.add_note(f"{step - 1} of {self._program.count} steps are kept in {folder}: play --resume goes on")
        played = self.result()
        _write(folder, self._case, replace(played, summary=played.summary | {"ended_early": told}), title)

    def _refused(self, folder: Path, step: int, error: Any) -> dict[str, Any]:
        """Write refused.vtu, name its worst cell in the error, and return the summary of it."""
        prediction = Prediction.of(self._case, self._mesh, self._program)
        path = folder / "refused.vtu"
        points, worst = write_refused(path, prediction, self._points, step, self._cells, self._sizes)
        if points is not None and worst:
            quality = cell_quality(points, self._cells, self._sizes).metric(self._drawn)
            self._worst = Snapshot(step, points, self._cells, quality, self._program.nodes)
            error.message += f"; {named(worst[0])}"
        details = getattr(error, "details", {})
        told = {name: getattr(error, name, details.get(name)) for name in ("best", "fraction")}
        return {"code": error.code, **told, "worst": worst}

    def result(self) -> Played:
        """The result of the case."""
        if not pictures_are_possible():
            self._warnings.append("no quality.png without matplotlib: pip install 'mesh-motion-server[plot]'")
        records = self._records
        worst = min(records, key=lambda record: record.shown(self._drawn)[0], default=None)
        summary = {
            "case": str(self._case.path),
            "version": __version__,
            "method": self._driver.settings,
            "mesh": {
                "nodes": len(self._mesh.points),
                "dimension": self._mesh.dimension,
                "cells": {block.type.name: len(block) for block in self._cells},
                "patches": {name: len(nodes) for name, nodes in self._mesh.patches.items()},
                "moving_nodes": len(self._program.nodes),
                "reference": self._at_opening,
            },
            "worst_step": worst.step if worst else 0,
            "min_size_skew": min((record.min_size_skew for record in records), default=None),
            "min_relative_size_skew": min((record.min_relative_size_skew for record in records), default=None),
            "inverted_cells": max((record.inverted_cells for record in records), default=0),
            "boundary_error": max((record.boundary_error for record in records), default=0.0),
            "peak_memory_bytes": _own_peak_memory() + self._peak_memory_of_the_server(),
            "seconds": time.perf_counter() - self._begin,
            "warnings": self._warnings,
            "steps": [record.as_dict() for record in records],
        }
        return Played(self._mesh, self._points, records, self._warnings, summary, self._reference, self._worst)

    def _peak_memory_of_the_server(self) -> int:
        """Peak memory in bytes; 0 if the server has ended."""
        try:
            return self._driver.peak_memory_bytes()
        except ClientError:
            return 0


def _plain(quality: Floats) -> dict[str, float]:
    """Minimum and mean size-skew."""
    return {"min_size_skew": float(quality.min()), "mean_size_skew": float(quality.mean())}


def _own_peak_memory() -> int:
    """Largest resident size of this process so far, bytes; Linux counts in KiB, macOS in bytes."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak
