"""The growth as a plot: seconds of a step against nodes, both logarithmic, with the slope, and other systems."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.peers.comparison import Outcome
from benchmarks.scale.cases import CASES, MESHES
from benchmarks.scale.figures import of_threads
from benchmarks.scale.results import Results, exponent

__all__ = ["write_picture"]

_DIMENSIONS = {"T1": "2D", "T3": "3D"}
_STYLES = {"steady": ("C0", "-"), "large": ("C3", "--")}
#: Other systems' one large step: name, marker, colour.
_OTHERS = {
    "dense-rbf": ("dense RBF in numpy", "D", "C7"),
    "scipy-rbf": ("scipy, 50 neighbours", "P", "C8"),
    "openfoam-converged": ("OpenFOAM Laplacian", "^", "C2"),
    "kratos-laplacian": ("Kratos Laplacian", "v", "C1"),
    "kratos-similarity": ("Kratos similarity", "X", "C4"),
}


def write_picture(results: Results, path: Path, outcomes: Sequence[Outcome] = ()) -> None:
    """One panel for each dimension; hollow markers: over the network; other systems, if they ran."""
    figure = Figure(figsize=(10, 5))
    for axis, (motion, dimension) in zip(figure.subplots(1, 2, sharey=True), _DIMENSIONS.items(), strict=True):
        for kind in _STYLES:
            _draw(axis, results, motion, kind)
        _draw_others(axis, results, motion, outcomes)
        axis.set(xscale="log", yscale="log", xlabel="nodes", title=dimension)
        axis.grid(alpha=0.3, which="major")
        axis.set_xlim(_decades(results, motion))
        axis.margins(y=0.12)
    clock = "processor seconds" if results.threads == 1 else "seconds"
    figure.axes[0].set_ylabel(f"{clock} of a step")
    handles = {
        label: handle for axis in figure.axes for handle, label in zip(*axis.get_legend_handles_labels(), strict=True)
    }
    figure.legend(handles.values(), handles.keys(), loc="lower center", ncols=4, fontsize=9)
    figure.tight_layout(rect=(0, 0.02 + 0.045 * math.ceil(len(handles) / 4), 1, 1))
    figure.savefig(path, dpi=100)


def _names(results: Results, motion: str, kind: str) -> list[str]:
    """Measured cases of one dimension, smallest mesh first."""
    names = [f"{mesh}-{kind}" for mesh, own in MESHES.items() if own == motion]
    return [name for name in names if name in results.library]


def _decades(results: Results, motion: str) -> tuple[float, float]:
    """Whole decades around the sizes that were measured with a motion."""
    sizes = [f.nodes for name, f in results.library.items() if MESHES.get(CASES[name].mesh) == motion] or [1000]
    return 0.8 * 10 ** math.floor(math.log10(min(sizes))), 1.25 * 10 ** math.ceil(math.log10(max(sizes)))


def _draw(axis: Axes, results: Results, motion: str, kind: str) -> None:
    """Our steps of one dimension with one motion."""
    colour, line = _STYLES[kind]
    names = _names(results, motion, kind)
    nodes = [results.library[name].nodes for name in names]
    seconds = [of_threads(results.library[name].step, results.threads) for name in names]
    axis.plot(nodes, seconds, marker="o", color=colour, linestyle=line, label=f"ours, {kind}")
    if kind == "steady" and len(names) > 1:
        _annotate_slope(axis, results, names)
    carried = [name for name in names if name in results.wire]
    if not carried:
        return
    axis.plot(
        [results.library[name].nodes for name in carried],
        [of_threads(results.wire[name].step, results.threads) for name in carried],
        marker="s",
        markersize=9,
        markerfacecolor="none",
        linestyle="none",
        color=colour,
        label=f"ours, {kind}, over the wire",
    )


def _annotate_slope(axis: Axes, results: Results, names: list[str]) -> None:
    """Write the exponent of the steady step over the last two decades into the corner."""
    largest = results.library[names[-1]].nodes
    first = next(name for name in names if results.library[name].nodes > 0.005 * largest)
    slope = exponent(results, first, names[-1])
    if slope is None or first == names[-1]:
        return
    label = f"{CASES[first].mesh}–{CASES[names[-1]].mesh}: slope {slope:.2f}"
    axis.text(0.97, 0.05, label, transform=axis.transAxes, ha="right", color=_STYLES["steady"][0])


def _draw_others(axis: Axes, results: Results, motion: str, outcomes: Sequence[Outcome]) -> None:
    """One large step of each other system."""
    for system, (label, marker, colour) in _OTHERS.items():
        places = []
        for outcome in outcomes:
            mesh, own, steps = outcome.case.split("-")
            figures = results.library.get(f"{mesh}-large")
            if (outcome.system, own, steps) == (system, motion, "1") and outcome.measurement and figures:
                cost = outcome.measurement
                places.append((figures.nodes, cost.step_cpu if results.threads == 1 else cost.step))
        places.sort()
        if places:
            axis.plot(*zip(*places, strict=True), marker=marker, color=colour, linestyle=":", label=label)
