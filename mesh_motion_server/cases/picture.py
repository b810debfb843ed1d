"""quality.png: the mesh before and after its worst step, coloured by size-skew, the worst cell marked, and the history.

A 3D mesh is cut by a plane through its moving boundary, across the axis along which that boundary moves least.
matplotlib is an extra (``plot``); it is imported when something is drawn.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mesh_motion_server.cases.records import StepRecord, drawn
from mesh_motion_server.watch.pictures.mesh_axes import draw_mesh
from mesh_motion_server.watch.pictures.palette import INK, INVERTED_COLOUR, LIGHT
from mesh_motion_server.watch.pictures.snapshot import Snapshot, choose_plane, choose_window

__all__ = ["write_picture"]

#: Inches: the figure, its margins, the space for ticks and titles between two panels, and the height of a chart. The
#: positions are fixed: matplotlib's layout engines measure every text and take as long as the drawing.
_WIDTH, _LEFT, _RIGHT, _TOP, _GAP, _CHART = 13.5, 0.8, 1.3, 0.9, 0.75, 3.2
#: Largest height of a mesh if the two are side by side, and if stacked; the smallest height is a third of the latter.
_TALL, _LOW = 5.4, 3.2

_MINIMUM, _MEAN, _BEFORE = LIGHT.runs[0], LIGHT.runs[2], LIGHT.faint


def write_picture(
    path: Path,
    title: str,
    before: Snapshot,
    after: Snapshot,
    steps: Sequence[StepRecord],
    metric: str = "size-skew",
    last: str = "",
) -> None:
    """Draw both meshes and the history into one PNG.

    Parameters
    ----------
    before, after : Snapshot
        The mesh at opening and after its worst step.
    metric : str
        The quality metric of the steps' predictions.
    last : str
        What ``after`` shows, if it is not a committed step.
    """
    plane = choose_plane(before, after)
    window = choose_window(before, after, plane)
    figure, (first, second), bar, below = _panels(*(window[1] - window[0]))
    figure.suptitle(title, y=1.0 - 0.2 / figure.get_figheight(), va="top", fontsize=15, fontweight="bold", color=INK)
    last = last or f"after step {after.step} of {len(steps)}" + (", the worst" if len(steps) > 1 else "")
    if before.points.shape[1] > 1:
        draw_mesh(first, before, plane, "at opening", window)
        colours = draw_mesh(second, after, plane, last, window)
        figure.colorbar(colours, cax=bar, extend="min").set_label(f"{drawn(metric)} of a cell (inverted: pink)")
    else:
        bar.remove()
        _draw_line(first, before, "at opening", drawn(metric))
        _draw_line(second, after, last, drawn(metric))
    _draw_history(below[0], before, steps, metric)
    _draw_distribution(below[1], (before, after), ("at opening", last), drawn(metric))
    figure.savefig(path, metadata={"Software": None}, pil_kwargs={"compress_level": 3})


def _panels(width: float, height: float) -> tuple[Any, list[Any], Any, list[Any]]:
    """A figure, the axes of both meshes of this extent, of their colour bar, and of two charts below."""
    from matplotlib.figure import Figure  # noqa: PLC0415  (an extra)

    wide = width > 2.0 * height
    across = _WIDTH - _LEFT - _RIGHT
    half = (across - _GAP) / 2.0
    mesh_width, largest = (across, _LOW) if wide else (half, _TALL)
    mesh_height = min(max(mesh_width * height / width, _LOW / 3.0), largest)
    meshes = mesh_height + wide * (_GAP + mesh_height)
    total = _TOP + meshes + _GAP + _CHART + _GAP
    figure = Figure(figsize=(_WIDTH, total), dpi=110)

    def panel(left: float, bottom: float, wide: float, high: float) -> Any:
        return figure.add_axes((left / _WIDTH, bottom / total, wide / _WIDTH, high / total))

    upper, right, base = total - _TOP - mesh_height, _LEFT + half + _GAP, _CHART + 2.0 * _GAP
    second = (_LEFT, base) if wide else (right, base)
    return (
        figure,
        [panel(_LEFT, upper, mesh_width, mesh_height), panel(*second, mesh_width, mesh_height)],
        panel(_LEFT + across + 0.25, base + 0.05 * meshes, 0.22, 0.9 * meshes),
        [panel(_LEFT, _GAP, half, _CHART), panel(right, _GAP, half, _CHART)],
    )


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
    axes.set(title=f"{drawn(metric)} over the steps", xlabel="step", xlim=(0, max(1, *number)))
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
