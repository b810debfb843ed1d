"""The results of a run so far: a record of each step, the mesh series, the worst mesh."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.metrics import CellQuality, cell_quality
from mesh_motion_numerics.quality.orientation import oriented_at_rest

from mesh_motion_server.cases.outputs import write_steps, write_summary
from mesh_motion_server.cases.records import VTU_METRICS, StepRecord, drawn
from mesh_motion_server.files import VtuSeries
from mesh_motion_server.files.vtk.vtu import Data
from mesh_motion_server.watch.pictures.before_after import MeshPair, draw_before_after
from mesh_motion_server.watch.pictures.page import Page, pictures_are_possible, save, styled
from mesh_motion_server.watch.pictures.runs import read_played
from mesh_motion_server.watch.pictures.snapshot import Snapshot

#: The page of quality.png, which is made for screens.
_PAGE = Page(width=300.0, points=9.0, dpi=120)


class Results:
    """The results of a run so far.

    Parameters
    ----------
    reference : (n, d) array, mesh length unit
    moving : (k,) int64 array
        The moving nodes.
    metric : str
        The quality metric of the run.
    series : VtuSeries
        Receives every ``every``-th mesh and that of the step ``last``, with the point arrays ``marks``.

    Attributes
    ----------
    points : (n, d) array, mesh length unit
        Coordinates after the last step.
    before, worst : Snapshot
        The mesh at opening, and after the step that left the lowest minimum.
    warnings : list of str
        The warnings, each once, in the order of first appearance.
    """

    def __init__(
        self,
        reference: Floats,
        cells: CellTable,
        moving: Integers,
        metric: str,
        *,
        series: VtuSeries,
        every: int,
        last: int,
        marks: Data | None = None,
    ) -> None:
        self.cells, self.sizes = oriented_at_rest(reference, cells)
        self.metric = metric
        self.records: list[StepRecord] = []
        self.warnings: list[str] = []
        self._moving, self._marks = moving, marks or {}
        self._series, self._every, self._last = series, every, last
        self._reference = self.points = reference
        self._quality = self.judge(reference)
        self.before = self.worst = self.snapshot(0, reference)

    def judge(self, points: Floats) -> CellQuality:
        """Quality of the cells with the nodes at ``points`` (n, d)."""
        return cell_quality(points, self.cells, self.sizes)

    def snapshot(self, step: int, points: Floats) -> Snapshot:
        """The mesh with its nodes at ``points`` (n, d), for a picture."""
        return Snapshot(step, points, self.cells, self.judge(points).metric(drawn(self.metric)), self._moving)

    def warn(self, warnings: list[str]) -> None:
        """Add the warnings that are new."""
        self.warnings += [warning for warning in warnings if warning not in self.warnings]

    def take(self, record: StepRecord, points: Floats, quality: CellQuality) -> bool:
        """Add a step with the coordinates ``points`` (n, d); return whether it is the worst so far."""
        self.points, self._quality = points, quality
        self.records.append(record)
        is_worst = record.step == 1 or record.shown(self.metric)[0] < float(self.worst.quality.min())
        if is_worst:
            self.worst = self.snapshot(record.step, points)
        self.write_mesh(record.step)
        return is_worst

    @property
    def worst_step(self) -> int:
        """The step with the lowest minimum; 0 without a step."""
        worst = min(self.records, key=lambda record: record.shown(self.metric)[0], default=None)
        return worst.step if worst else 0

    def write_mesh(self, step: int) -> None:
        """Add the current mesh to the series, if this step is to be written."""
        if step % self._every and step != self._last:
            return
        quality = {name.replace("-", "_"): self._quality.metric(name) for name in VTU_METRICS}
        nodes: Data = {"displacement": self.points - self._reference, **self._marks}
        self._series.write(float(step), self.points, self.cells, point_data=nodes, cell_data=quality)

    def write(self, folder: Path, summary: Mapping[str, Any], title: str, last: str = "") -> None:
        """Write summary.json, steps.csv and quality.png; ``last``: the picture's mesh if it is not a committed step."""
        write_summary(folder, dict(summary))
        write_steps(folder, self.records)
        if not pictures_are_possible():
            return
        count, metric = len(self.records), drawn(self.metric)
        last = last or f"after step {self.worst.step} of {count}" + (", the worst" if count > 1 else "")
        pair = MeshPair(title, metric, self.before, self.worst, ("at opening", last))
        run = read_played(folder, metric) if self.records else None
        with styled(_PAGE):
            save(draw_before_after(pair, _PAGE, run=run), folder / "quality.png", _PAGE)
