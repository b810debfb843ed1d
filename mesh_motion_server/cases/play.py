"""Play a case: drive a session as a coupling code would, step by step, and keep the replies.

Each step has several coupling iterations: Moves that start from the same committed state and approach the step's final
displacement, like a relaxed fixed-point iteration. The last one is committed.
"""

import resource
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from mesh_motion_client import Keys, Session
from mesh_motion_client.moved import Moved
from mesh_motion_client.session import Report
from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.mesh.roles import BoundaryRoles, Patch
from mesh_motion_protocol.errors import MeshMotionError, QualityRefused

from mesh_motion_server import __version__
from mesh_motion_server.cases.case import Case, read_case
from mesh_motion_server.cases.driver import open_session
from mesh_motion_server.cases.motion_program import MotionProgram
from mesh_motion_server.cases.outputs import SERIES, remove_results, run_folder, write_points
from mesh_motion_server.cases.prediction import Prediction, named
from mesh_motion_server.cases.records import StepRecord, add_seconds
from mesh_motion_server.cases.refused import write_refused
from mesh_motion_server.cases.results import Results
from mesh_motion_server.files import MeshFile, VtuSeries, patch_marks
from mesh_motion_server.watch.pictures.page import pictures_are_possible
from mesh_motion_server.watch.pictures.snapshot import Snapshot

Progress = Callable[[int, int, StepRecord | None], None]

#: Factor by which an iteration reduces the distance to the step's final displacement, like relaxation by 0.5.
_RELAXATION = 0.5


@dataclass(frozen=True, eq=False)
class Played:
    """A case that was played to its end."""

    mesh: MeshFile
    points: Floats  # (n, d). Final coordinates
    steps: list[StepRecord]
    warnings: list[str]  # warnings of the server and of the writers, each once, in the order of first appearance
    summary: dict[str, Any]  # the content of summary.json
    #: before, worst: the mesh at opening, and after the step that left the lowest minimum size-skew
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
) -> Played:
    """Play a case and write its results after each step.

    Raises InvalidInput if the case, its mesh or its tables do not fit. Raises MeshMotionError if the server refuses a
    step. The folder then has the results of the steps before it, ``accepted.npy`` instead of ``points.npy``, and the
    refused mesh in ``refused.vtu`` and ``quality.png``.

    Parameters
    ----------
    folder : path
        Receives the results; created if it is missing.
    endpoint : str, optional
        Endpoint of a running server; if omitted, a private server is started and stopped.
    every : int
        Write every ``every``-th step to the series; the last step always.
    progress : callable, optional
        Called with the steps done, the number of steps and the record of the step just done.
    keys : Keys, optional
        Keys for a server that requires them.
    """
    if folder.is_dir() and case_file.is_file():  # an error for a misspelt name must not remove earlier results
        remove_results(folder)
    case = read_case(case_file)
    mesh = case.read_mesh()
    program = MotionProgram.of(case, mesh)
    with run_folder(folder):
        with open_session(case, mesh, endpoint, keys=keys) as session:
            run = _Run(case, mesh, program, session, folder, every)
            try:
                for step in run.steps():
                    if progress is not None:
                        progress(step.step, program.count, step)
            except BaseException as error:
                run.keep(folder, error)
                raise
            played = run.result()
        write_points(folder, played.points)
        run.write(folder, played.summary)
    return played


class _Run:
    """The state of a case being played."""

    def __init__(
        self, case: Case, mesh: MeshFile, program: MotionProgram, session: Session, folder: Path, every: int
    ) -> None:
        self._case, self._mesh, self._program, self._session = case, mesh, program, session
        patches = {name: Patch(role, mesh.patches[name]) for name, role in case.roles.items()}
        self._fixed = BoundaryRoles.from_patches(patches).fixed
        self._results = Results(
            mesh.points,
            mesh.cell_table,
            program.nodes,
            case.content.method.quality_metric,
            series=VtuSeries(folder, SERIES),
            every=every,
            last=program.count,
            marks=patch_marks(mesh),
        )
        size_skew = self._results.judge(mesh.points).metric("size-skew")
        self._at_opening = {"min_size_skew": float(size_skew.min()), "mean_size_skew": float(size_skew.mean())}
        self._results.warn(
            [f"patch {name!r} is moving, but no motion is given for it: it stays in place" for name in program.still]
        )
        self._results.warn([*mesh.notes, *session.mesh_report.get("warnings", ())])
        self._begin = time.perf_counter()
        self._results.write_mesh(0)

    def steps(self) -> Iterator[StepRecord]:
        """Play all steps."""
        for step in range(1, self._program.count + 1):
            yield self._step(step)

    def _step(self, step: int) -> StepRecord:
        """Iterate one step and commit it."""
        before, target = self._program.displacement(step - 1), self._program.displacement(step)
        iterations = self._case.content.steps.iterations
        begin = time.perf_counter()
        phases: dict[str, float] = {}
        for iteration in range(1, iterations + 1):
            fraction = 1.0 if iteration == iterations else 1.0 - (1.0 - _RELAXATION) ** iteration
            wanted = target if fraction == 1.0 else before + fraction * (target - before)
            moved = self._move(step, wanted, "faces" if iteration == iterations else "")
            phases = add_seconds(phases, moved.seconds)
        elapsed = time.perf_counter() - begin
        self._results.warn(list(moved.warnings))
        points = self._mesh.points + moved.displacement
        quality, error = self._results.judge(points), self._boundary_error(points, target)
        driven = {"iterations": iterations, "boundary_error": error, "seconds": elapsed}
        record = StepRecord.of(step, quality, moved, phases, **driven)
        begin = time.perf_counter()
        self._session.commit(final_step=self._program.count)
        record = replace(record, seconds=elapsed + time.perf_counter() - begin)
        self._results.take(record, points, quality)
        return record

    def _move(self, step: int, displacement: Floats, report: Report) -> Moved:
        """One coupling iteration; an error names the step."""
        try:
            return self._session.move(displacement, report=report)
        except MeshMotionError as error:
            error.message = f"step {step} of {self._program.count}: {error.message}"
            raise

    def _boundary_error(self, points: Floats, target: Floats) -> float:
        """Largest distance of a moving or fixed node of ``points`` (n, d) from its prescribed position."""
        moving = points[self._program.nodes] - (self._mesh.points[self._program.nodes] + target)
        fixed = points[self._fixed] - self._mesh.points[self._fixed]
        return float(np.sqrt((np.concatenate([moving, fixed]) ** 2).sum(axis=1)).max())

    def write(self, folder: Path, summary: dict[str, Any], refused: str = "") -> None:
        """Write all results except coordinates and series."""
        self._results.write(folder, summary, self._case.name, refused)

    def keep(self, folder: Path, error: BaseException) -> None:
        """Write the results after an error: the steps before it, and a refused mesh with its worst cells."""
        refused = isinstance(error, MeshMotionError) and error.code == QualityRefused.default_code
        done = len(self._results.records)
        if not (refused or done):
            return
        step, title = done + 1, ""
        refusal: dict[str, Any] = {"step": step, "message": str(error) or type(error).__name__}
        if refused:
            refusal |= self._refused(folder, step, error)
            title = f"the refused step {step}"
        if done:
            write_points(folder, self._results.points, "accepted.npy")
            error.add_note(f"{done} of {self._program.count} steps are kept in {folder}")
        self.write(folder, self.result().summary | {"ended_early": refusal}, title)

    def _refused(self, folder: Path, step: int, error: Any) -> dict[str, Any]:
        """Write refused.vtu, name its worst cell in the error, and return a summary of the mesh."""
        results, prediction = self._results, Prediction.of(self._case, self._mesh, self._program)
        path = folder / "refused.vtu"
        points, worst = write_refused(path, prediction, results.points, step, results.cells, results.sizes)
        if points is not None and worst:
            results.worst = results.snapshot(step, points)
            error.message += f"; {named(worst[0])}"
        details = getattr(error, "details", {})
        refusal = {name: getattr(error, name, details.get(name)) for name in ("best", "fraction")}
        return {"code": error.code, **refusal, "worst": worst}

    def result(self) -> Played:
        """The result of the case."""
        results, records = self._results, self._results.records
        if not pictures_are_possible():
            results.warn(["no quality.png without matplotlib: pip install 'mesh-motion-server[plot]'"])
        summary = {
            "case": str(self._case.path),
            "version": __version__,
            "method": self._session.settings,
            "mesh": {
                "nodes": len(self._mesh.points),
                "dimension": self._mesh.dimension,
                "cells": {block.type.name: len(block) for block in results.cells},
                "patches": {name: len(nodes) for name, nodes in self._mesh.patches.items()},
                "moving_nodes": len(self._program.nodes),
                "reference": self._at_opening,
            },
            "worst_step": results.worst_step,
            "min_size_skew": min((record.min_size_skew for record in records), default=None),
            "min_relative_size_skew": min((record.min_relative_size_skew for record in records), default=None),
            "inverted_cells": max((record.inverted_cells for record in records), default=0),
            "boundary_error": max((record.boundary_error for record in records), default=0.0),
            "peak_memory_bytes": _own_peak_memory() + self._peak_memory_of_the_server(),
            "seconds": time.perf_counter() - self._begin,
            "warnings": results.warnings,
            "steps": [record.as_dict() for record in records],
        }
        return Played(self._mesh, results.points, records, results.warnings, summary, results.before, results.worst)

    def _peak_memory_of_the_server(self) -> int:
        """Peak memory in bytes; 0 if the server has ended."""
        try:
            return int(self._session.status().report.get("peak_memory_bytes", 0))
        except MeshMotionError:
            return 0


def _own_peak_memory() -> int:
    """Largest resident size of this process so far, bytes; Linux counts in KiB, macOS in bytes."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak
