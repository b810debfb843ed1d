"""The histories of both runs, and the meshes at the largest displacement."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from mok_benchmark.benchmark import POINTS, PUBLISHED
from mok_benchmark.execution import History

__all__ = ["write_picture"]

#: Control first: what is drawn later lies on top.
_STYLES: tuple[dict[str, Any], ...] = (
    {"color": "C1", "linewidth": 4.0, "alpha": 0.5},
    {"color": "C0", "linewidth": 1.2},
)
_DOTS = ("o", "s")


def write_picture(
    path: Path, runs: Mapping[str, History], triangles: NDArray[np.int64], found: Mapping[str, float], *, whole: bool
) -> None:
    """Draw the histories above, the meshes at the largest displacement below.

    Parameters
    ----------
    runs : mapping
        Mesh solver → its run, the control first.
    triangles : (m, 3) int array
    found : mapping
        The largest differences, by reference point.
    whole : bool
        Whether to show the published largest displacements.
    """
    figure = Figure(figsize=(11.0, 7.2))
    above = figure.add_subplot(2, 1, 1)
    for (name, run), style in zip(runs.items(), _STYLES, strict=True):
        for index in range(len(POINTS)):
            label = name if index == 0 else None
            above.plot(run.times, 100.0 * run.displacements[:, index, 0], label=label, **style)
    control = next(iter(runs.values()))
    for index, point in enumerate(POINTS):
        peak = int(control.displacements[:, index, 0].argmax())
        above.annotate(
            f"{point}: {found[point]:.2%} apart", (control.times[peak], 100.0 * control.displacements[peak, index, 0]),
            xytext=(0, 6), textcoords="offset points", ha="center",
        )  # fmt: skip
        if whole:
            for dot, (source, values) in zip(_DOTS, PUBLISHED.items(), strict=True):
                label = f"largest, {source}" if index == 0 else None
                above.plot(control.times[peak], 100.0 * values[point], dot, color="grey", label=label)
    above.set(
        xlabel="time [s]", ylabel="horizontal displacement [cm]", title="Mok benchmark in Kratos, two mesh solvers"
    )
    above.set_ylim(top=1.15 * above.get_ylim()[1])
    above.legend(loc="best")
    above.grid(alpha=0.3)
    step = int(control.displacements[:, 0, 0].argmax())
    for number, (name, run) in enumerate(runs.items(), 3):
        below = figure.add_subplot(2, 2, number)
        below.triplot(*run.points[step].T, triangles, color="k", linewidth=0.4)
        below.set(xlim=(0.38, 0.78), ylim=(0.0, 0.33), aspect="equal", title=f"{name}, t = {run.times[step]:.1f} s")
    figure.tight_layout()
    figure.savefig(path, dpi=120)
