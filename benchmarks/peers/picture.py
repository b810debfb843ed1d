"""The result as a plot: quality against time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from benchmarks.peers.comparison import Outcome, name_in_words
from benchmarks.peers.systems import SYSTEMS

__all__ = ["write_picture"]


def write_picture(outcomes: Sequence[Outcome], path: Path) -> None:
    """Quality against time, one panel for each case: slow is right, good is up, hollow markers mean inverted cells."""
    cases = list(dict.fromkeys(outcome.case for outcome in outcomes))
    names = list(dict.fromkeys(outcome.system for outcome in outcomes))
    columns = 2 if len(cases) > 1 else 1
    rows = -(-len(cases) // columns)
    legend = 0.3 + 0.25 * -(-len(names) // 2)  # inches
    figure = Figure(figsize=(6.2 * columns, 3.2 * rows + legend))
    axes = figure.subplots(rows, columns, squeeze=False)
    styles: dict[str, dict[str, Any]] = {
        name: {"marker": "*PposD^vXh<>"[i % 12], "color": f"C{i % 10}"} for i, name in enumerate(SYSTEMS)
    }
    for axis, case in zip(axes.flat, cases, strict=False):
        for outcome in outcomes:
            if outcome.case == case and outcome.measurement and outcome.verdict:
                style = styles[outcome.system] | {"fillstyle": "none" if outcome.verdict.most_inverted else "full"}
                axis.plot(outcome.measurement.step, outcome.verdict.min_size_skew, markersize=10, **style)
        axis.set(xscale="log", xlabel="seconds a step", ylabel="min size-skew")
        axis.set_title(name_in_words(case).replace(": ", "\n", 1), fontsize=9)
        axis.axhline(0, color="grey", linewidth=0.8)
        axis.grid(alpha=0.3)
    for axis in list(axes.flat)[len(cases) :]:
        axis.axis("off")
    handles = [
        Line2D([], [], linestyle="none", label=SYSTEMS[name].label.replace("*", ""), **styles[name]) for name in names
    ]
    figure.legend(handles=handles, loc="lower center", ncols=2, fontsize=9)
    figure.suptitle("Quality after the motion against time (up is better; hollow: cells were inverted)", fontsize=11)
    figure.tight_layout(rect=(0, legend / (3.2 * rows + legend), 1, 0.99))
    figure.savefig(path, dpi=130)
