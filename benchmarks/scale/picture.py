"""The growth as a plot: seconds of a step against nodes, both logarithmic, with the slope between sizes."""

from __future__ import annotations

import math
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.scale.cases import CASES, MESHES
from benchmarks.scale.results import Results, growth

__all__ = ["write_picture"]

_DIMENSIONS = {"T1": "2D", "T3": "3D"}
_STYLES = {"steady": ("C0", "-"), "large": ("C3", "--")}


def write_picture(results: Results, path: Path) -> None:
    """One panel a dimension; hollow markers: over the wire (wall time)."""
    figure = Figure(figsize=(9, 4))
    for axis, (motion, dimension) in zip(figure.subplots(1, 2, sharey=True), _DIMENSIONS.items(), strict=True):
        for kind in _STYLES:
            _draw(axis, results, motion, kind)
        axis.set(xscale="log", yscale="log", xlabel="nodes", title=dimension)
        axis.grid(alpha=0.3, which="both")
        axis.set_xlim(_decades(results, motion))
        axis.margins(y=0.15)
    figure.axes[0].set_ylabel("seconds of a step")
    handles = dict(zip(*reversed(figure.axes[1].get_legend_handles_labels()), strict=True))
    figure.legend(handles.values(), handles.keys(), loc="lower center", ncols=4, fontsize=9)
    figure.tight_layout(rect=(0, 0.08, 1, 1))
    figure.savefig(path, dpi=110)


def _decades(results: Results, motion: str) -> tuple[float, float]:
    """Whole decades around the sizes that were measured with a motion."""
    sizes = [f.nodes for name, f in results.library.items() if MESHES.get(CASES[name].mesh) == motion] or [1000]
    return 0.8 * 10 ** math.floor(math.log10(min(sizes))), 1.25 * 10 ** math.ceil(math.log10(max(sizes)))


def _draw(axis: Axes, results: Results, motion: str, kind: str) -> None:
    """The sizes of one dimension with one motion."""
    colour, line = _STYLES[kind]
    names = [f"{mesh}-{kind}" for mesh, own in MESHES.items() if own == motion]
    names = [name for name in names if name in results.library]
    nodes = [results.library[name].nodes for name in names]
    cpu = [results.library[name].step.cpu for name in names]
    axis.plot(nodes, cpu, marker="o", color=colour, linestyle=line, label=f"{kind}, processor time")
    carried = [name for name in names if name in results.wire]
    axis.plot(
        [results.library[name].nodes for name in carried],
        [results.wire[name].step.wall for name in carried],
        marker="s",
        markersize=9,
        markerfacecolor="none",
        linestyle="none",
        color=colour,
        label=f"{kind}, over the wire (wall)",
    )
    if names and kind == "steady" and (slope := growth(results, names[-1])) is not None:
        middle = (nodes[-1] * nodes[-2]) ** 0.5, (cpu[-1] * cpu[-2]) ** 0.5
        label = f"{CASES[names[-2]].mesh}–{CASES[names[-1]].mesh}: slope {slope:.2f}"
        axis.annotate(label, middle, xytext=(8, -14), textcoords="offset points", ha="left", fontsize=9)
