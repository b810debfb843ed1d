"""The cells of a partition, judged in one pass that counts their values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mesh_motion_kernels as kernels
import numpy as np
from numpy.typing import NDArray

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.distributed.order_statistics import BINS, FEW, WHOLE, BinContent, Way, content
from mesh_motion_numerics.distributed.summaries import WORST, PartialSummary, Questions
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.metrics import CellsAtRest, judged
from mesh_motion_numerics.quality.quality_summary import reported_metrics, worst_cells


class CountedCells:
    """The cells of a partition, which are judged many times.

    The place of each value is kept in four bytes: its bin, and the part of the bin. So the counts of all bins are
    known. If the values themselves are needed, the few cells that have them are judged again.

    Parameters
    ----------
    cells : CellTable
        m cells.
    metric : str
        The metric that ranks the worst cells.
    """

    def __init__(self, cells: CellTable, at_rest: CellsAtRest, metric: str) -> None:
        self.metric, self._cells, self._at_rest = metric, cells, at_rest
        self._names = reported_metrics(metric)
        self._places = np.zeros((len(self._names), len(cells)), dtype=np.uint32)
        self._known: dict[tuple[str, Way], BinContent] = {}

    def judge(self, points: Floats) -> PartialSummary:
        """Judge the cells with nodes at points (n, d), which must not change until the next call."""
        self._points = points
        arrays = self._arguments(self.metric)
        extents, counts, worst, inverted = kernels.counted_cells(*arrays, WORST, BINS, self._places)
        by_name = dict(zip(self._names, extents.tolist(), strict=True))
        self._known = {
            (name, WHOLE): self._whole(name, own, least, most)
            for own, (name, (_, least, most)) in zip(counts, by_name.items(), strict=True)
        }
        values = kernels.values_of_cells(*arrays, worst)
        return PartialSummary(
            cells=len(self._cells),
            inverted=inverted,
            sums={name: total for name, (total, _, _) in by_name.items()},
            minima={name: least for name, (_, least, _) in by_name.items()},
            worst=worst_cells(worst, self._cells.centres(points, worst), values),
        )

    def contents(self, questions: Questions) -> tuple[BinContent, ...]:
        """Return the contents of bins, for the cells as judged last."""
        missing = [one for one in questions if one not in self._known]
        for name in dict.fromkeys(name for name, _ in missing):
            ways = [way for of, way in missing if of == name]
            for depth, find in ((1, self._find_counts), (2, self._find_values)):
                if some := [way for way in ways if min(len(way), 2) == depth]:
                    find(name, some)
        return tuple(self._known[one] for one in questions)

    def _find_counts(self, name: str, ways: Sequence[Way]) -> None:
        """Divide these bins of the first division again, and count the values in each part."""
        bins = np.array([way[0][2] for way in ways], dtype=np.uint32)
        counts = kernels.counts_in_parts(self._places_of(name), bins, BINS)
        for way, own in zip(ways, counts, strict=True):
            filled = np.flatnonzero(own)
            if own.sum() <= FEW or len(filled) == 1:  # the values may be needed
                self._known[name, way] = content(self._values(name, way[0][2] * BINS + filled), way)
            else:
                self._known[name, way] = BinContent(filled.astype(np.uint16), own[filled].astype(np.uint32), None, None)

    def _find_values(self, name: str, ways: Sequence[Way]) -> None:
        """Find the values in bins of further divisions."""
        values = self._values(name, np.array([way[0][2] * BINS + way[1][2] for way in ways]))
        self._known |= {(name, way): content(values, way) for way in ways}

    def _whole(self, name: str, counts: Integers, least: float, most: float) -> BinContent:
        """Return all values of a metric: their counts (BINS,), minimum and maximum."""
        if len(self._cells) <= FEW:
            return content(self._values(name, np.unique(self._places_of(name))), WHOLE)
        filled = np.flatnonzero(counts)
        alike = (np.array([least]), np.array([len(self._cells)])) if least == most else (None, None)
        return BinContent(filled.astype(np.uint16), counts[filled].astype(np.uint32), *alike)

    def _values(self, name: str, places: NDArray[Any]) -> Floats:
        """Return the values of a metric at given places."""
        found: Floats = kernels.values_at(*self._arguments(name), self._places_of(name), places.astype(np.uint32))
        return found

    def _places_of(self, name: str) -> NDArray[np.uint32]:
        """The places of the values (m,) of a metric."""
        places: NDArray[np.uint32] = self._places[self._names.index(name)]
        return places

    def _arguments(self, name: str) -> tuple[Any, ...]:
        """Of the compiled loops."""
        return judged(self._points, self._cells, self._at_rest, name)
