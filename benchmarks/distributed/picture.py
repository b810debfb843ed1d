"""The cost model as a plot: seconds of a step against workers, both logarithmic, with what was measured."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.distributed.figures import Results
from benchmarks.distributed.model import CostModel

__all__ = ["write_picture"]

_TERMS = {"solve": "C3", "messages": "C1", "wire": "C2", "volume": "C0"}
_BILLION = (1e9, 3e6)


def write_picture(results: Results, path: Path) -> None:
    """Left: the largest mesh that was measured; right: 1e9 nodes."""
    model = CostModel.of(results)
    rows = [row for row in results.rows if row.way == "partitions" and "×" not in row.case]
    largest = max(rows, key=lambda row: row.nodes)
    figure = Figure(figsize=(9, 4))
    left, right = figure.subplots(1, 2)
    _draw(left, model, largest.nodes, largest.boundary, np.geomspace(1, 256, 60))
    measured = [row for row in rows if row.case == largest.case]
    volume = [row.longest for row in measured]
    workers = [row.workers for row in measured]
    left.plot(workers, volume, "o", color=_TERMS["volume"], label="busiest worker, measured")
    left.plot(workers, [row.solve for row in measured], "s", color=_TERMS["solve"], label="solve, measured")
    left.set_title(f"{largest.case}: {largest.nodes:,} nodes, {largest.boundary:,} on the boundary", fontsize=10)
    _draw(right, model, *_BILLION, np.geomspace(10, 20_000, 80))
    right.set_title("10⁹ nodes, 3·10⁶ on the boundary: predicted", fontsize=10)
    left.set_ylabel("seconds of a step")
    handles = dict(zip(*reversed(left.get_legend_handles_labels()), strict=True))
    figure.legend(handles.values(), handles.keys(), loc="lower center", ncols=4, fontsize=9)
    figure.tight_layout(rect=(0, 0.13, 1, 1))
    figure.savefig(path, dpi=110)


def _draw(axis: Axes, model: CostModel, nodes: float, boundary: float, workers: np.ndarray) -> None:
    """Each term and their sum."""
    terms = [model.terms(nodes, boundary, float(count)) for count in workers]
    for name, colour in _TERMS.items():
        axis.plot(workers, [getattr(term, name) for term in terms], color=colour, label=name)
    axis.plot(workers, [term.total for term in terms], color="black", linewidth=2, label="step")
    axis.set(xscale="log", yscale="log", xlabel="workers of one thread")
    axis.grid(alpha=0.3, which="both")
