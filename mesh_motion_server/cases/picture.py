"""quality.png: the mesh before and after its worst step, coloured by size-skew, the worst cell marked, and the history.

A 3D mesh is cut by a plane through its moving boundary, across the axis along which that boundary moves least.
matplotlib is an extra (``plot``); it is imported when something is drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mesh_motion_server.cases.records import StepRecord, drawn
from mesh_motion_server.pictures.mesh_axes import draw_mesh
from mesh_motion_server.pictures.palette import INK, INVERTED_COLOUR, LIGHT
from mesh_motion_server.pictures.snapshot import Snapshot, choose_plane, choose_window

__all__ = ["write_picture"]

_MINIMUM, _MEAN, _BEFORE = LIGHT.runs[0], LIGHT.runs[2], LIGHT.faint


def write_picture(
    path: Path, title: str, before: Snapshot, after: Snapshot, steps: Sequence[StepRecord], metric: str = "size-skew"
) -> None:
    """Draw both meshes and the history into one PNG.

    Parameters
    ----------
    path : path
    title : str
    before, after : Snapshot
        The mesh at opening and after its worst step.
    steps : sequence of StepRecord
    metric : str
        The quality metric that the steps' predictions are of.
    """
    from matplotlib.figure import Figure  # noqa: PLC0415  (an extra)

    figure = Figure(figsize=(13.5, 10.0), dpi=110, layout="constrained")
    figure.suptitle(title, fontsize=15, fontweight="bold", color=INK)
    plane = choose_plane(before, after)
    window = choose_window(before, after, plane)
    wide = window[1, 0] - window[0, 0] > 2.0 * (window[1, 1] - window[0, 1])
    rows = [["a", "a"], ["b", "b"], ["c", "d"]] if wide else [["a", "b"], ["c", "d"]]
    heights = [1.0, 1.0, 1.0] if wide else [1.7, 1.0]
    first, second, *below = figure.subplot_mosaic(rows, height_ratios=heights).values()  # type: ignore[arg-type]
    last = f"after step {after.step} of {len(steps)}" + (", the worst" if len(steps) > 1 else "")
    if before.points.shape[1] > 1:
        draw_mesh(first, before, plane, "at opening", window)
        colours = draw_mesh(second, after, plane, last, window)
        bar = figure.colorbar(colours, ax=[first, second], shrink=0.75, pad=0.01, extend="min")
        bar.set_label(f"{drawn(metric)} of a cell (inverted: pink)")
    else:
        _draw_line(first, before, "at opening", drawn(metric))
        _draw_line(second, after, last, drawn(metric))
    _draw_history(below[0], before, steps, metric)
    _draw_distribution(below[1], (before, after), ("at opening", last), drawn(metric))
    figure.savefig(path, metadata={"Software": None})


def _draw_line(axes: Any, mesh: Snapshot, title: str, name: str) -> None:
    """A 1D mesh: the quality over each cell."""
    for block in mesh.cells:
        for nodes, value in zip(block.nodes, mesh.quality, strict=True):
            axes.plot(mesh.points[nodes, 0], [value, value], color=INK if value > 0 else INVERTED_COLOUR, linewidth=2)
    axes.set(title=title, xlabel="x", ylabel=name)


def _draw_history(axes: Any, before: Snapshot, steps: Sequence[StepRecord], metric: str) -> None:
    """Minimum and mean over the steps, and the minimum predicted for the motion without its correction."""
    number = [0, *(s.step for s in steps)]
    marker = "o" if len(steps) <= 25 else ""
    axes.axhline(0.0, color=INVERTED_COLOUR, linewidth=0.8)
    axes.plot(number, [before.quality.mean(), *(s.shown(metric)[1] for s in steps)], "--", color=_MEAN, label="mean")
    axes.plot(
        number, [before.quality.min(), *(s.shown(metric)[0] for s in steps)], "-", marker=marker, color=_MINIMUM,
        markersize=4, label="minimum",
    )  # fmt: skip
    if metric == drawn(metric) and any(s.predicted_standard < s.predicted_min for s in steps):
        standard = [before.quality.min(), *(s.predicted_standard for s in steps)]
        axes.plot(number, standard, ":", marker=marker, color=_BEFORE, markersize=3, label="without correction")
    axes.set(title=f"{drawn(metric)} over the steps", xlabel="step", xlim=(0, max(number)))
    axes.set_ylim(top=1.0)
    axes.legend(loc="best", frameon=False, fontsize=9)
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.grid(alpha=0.25)


def _draw_distribution(axes: Any, meshes: tuple[Snapshot, Snapshot], labels: tuple[str, str], name: str) -> None:
    """How many cells are worse than a value."""
    for mesh, colour, label in zip(meshes, (_BEFORE, _MINIMUM), labels, strict=True):
        values = np.sort(mesh.quality)
        axes.step(values, 100.0 * np.arange(1, len(values) + 1) / len(values), color=colour, where="post", label=label)
    axes.axvline(0.0, color=INVERTED_COLOUR, linewidth=0.8)
    axes.set(title=f"share of cells below a {name}", xlabel=name, ylabel="%", yscale="log", xlim=(None, 1.0))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.legend(loc="best", frameon=False, fontsize=9)
    axes.grid(alpha=0.25)
