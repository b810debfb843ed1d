"""quality.png: the mesh before and after its worst step, coloured by size-skew, the worst cell marked, and the history.

A 3D mesh is cut by a plane through its moving boundary, across the axis along which that boundary moves least.
matplotlib is an extra (``plot``); it is imported when something is drawn.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.cases.records import StepRecord
from mesh_motion_server.cases.slices import Polygons, cut, flat
from mesh_motion_server.numerics.cells import CellTable

__all__ = [
    "INK",
    "INVERTED_COLOUR",
    "Plane",
    "Snapshot",
    "choose_plane",
    "choose_window",
    "draw_mesh",
    "picture_is_possible",
    "write_picture",
]

FloatArray = NDArray[np.float64]

INVERTED_COLOUR, INK = "#e5007d", "#202020"
#: A picture shows only the surroundings of the moving nodes if they take less than this share of it.
_CROP_BELOW = 0.4
_MAP, _EDGE = "viridis", "#10101060"


@dataclass(frozen=True, eq=False)
class Snapshot:
    """A mesh at one time, as far as a picture needs it.

    Attributes
    ----------
    step : int
        0 at opening.
    points : (n, d) array
    cells : CellTable
    quality : (m,) array
        Size-skew of each cell.
    moving : (k,) int64 array
        The moving nodes.
    """

    step: int
    points: FloatArray
    cells: CellTable
    quality: FloatArray
    moving: NDArray[np.int64]

    @property
    def worst(self) -> int:
        """Number of the worst cell."""
        return int(np.argmin(self.quality))

    def centre(self, cell: int) -> FloatArray:
        """(d,) mean of a cell's nodes."""
        block, row = self.cells.locate(cell)
        return np.asarray(self.points[block.nodes[row]].mean(axis=0))


@dataclass(frozen=True)
class Plane:
    """Where a 3D mesh is cut: x[axis] = position. In 2D there is none."""

    axis: int
    position: float


def picture_is_possible() -> bool:
    """Whether matplotlib is installed."""
    return find_spec("matplotlib") is not None


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
        bar.set_label("size-skew of a cell (inverted: pink)")
    else:
        _draw_line(first, before, "at opening")
        _draw_line(second, after, last)
    _draw_history(below[0], before, steps, metric)
    _draw_distribution(below[1], (before, after), ("at opening", last))
    figure.savefig(path, metadata={"Software": None})


def choose_plane(before: Snapshot, after: Snapshot) -> Plane | None:
    """The plane that shows most of a 3D motion: across the axis of least motion, through the nodes that move most."""
    if before.points.shape[1] < 3:
        return None
    start, moved = before.points[before.moving], after.points[after.moving]
    motion = moved - start
    axis = int(np.argmin((motion**2).sum(axis=0)))
    weight = (motion**2).sum(axis=1)
    position = float(np.average(moved[:, axis], weights=weight) if weight.any() else moved[:, axis].mean())
    return Plane(axis, position)


def choose_window(before: Snapshot, after: Snapshot, plane: Plane | None) -> FloatArray:
    """(2, 2) lower and upper corner of the part of the picture where something moves, or of all of it."""
    dimension = before.points.shape[1]
    drawn = [axis for axis in range(dimension) if plane is None or axis != plane.axis]
    both = np.concatenate([before.points, after.points])[:, drawn]
    low, high = both.min(axis=0), both.max(axis=0)
    if dimension == 1:
        return np.array([[low[0], 0.0], [high[0], 1.0]])
    moving = np.concatenate([before.points[before.moving], after.points[after.moving]])
    if plane is not None:
        distance = np.abs(moving[:, plane.axis] - plane.position)
        moving = moving[distance <= max(0.1 * float(np.ptp(moving[:, plane.axis])), float(distance.min()))]
    moving = moving[:, drawn]
    margin = 0.5 * float(np.ptp(moving, axis=0).max())
    near_low, near_high = np.maximum(moving.min(axis=0) - margin, low), np.minimum(moving.max(axis=0) + margin, high)
    is_small = np.prod(near_high - near_low) < _CROP_BELOW * np.prod(high - low)
    return np.array([near_low, near_high] if is_small else [low, high])


def draw_mesh(axes: Any, mesh: Snapshot, plane: Plane | None, title: str, window: FloatArray) -> Any:
    """Draw a mesh (or its cut) into matplotlib axes and mark the worst cell; return what a colour bar needs."""
    from matplotlib.collections import PolyCollection  # noqa: PLC0415
    from matplotlib.colors import Normalize  # noqa: PLC0415

    polygons = (
        flat(mesh.points, mesh.cells) if plane is None else cut(mesh.points, mesh.cells, plane.axis, plane.position)
    )
    values = mesh.quality[polygons.cells]
    width = float(np.clip(40.0 / np.sqrt(max(len(values), 1)), 0.1, 0.7))
    colours = PolyCollection(
        polygons.corners,
        array=np.clip(values, 0.0, 1.0),
        cmap=_MAP,
        norm=Normalize(0.0, 1.0),
        edgecolors=_EDGE,
        linewidths=width,
    )
    axes.add_collection(colours)
    if (values <= 0).any():
        inverted = [polygons.corners[i] for i in np.flatnonzero(values <= 0)]
        axes.add_collection(PolyCollection(inverted, facecolors=INVERTED_COLOUR, edgecolors="white", linewidths=width))
    axes.set_aspect("equal")
    low, high = window - [[0.02], [-0.02]] * (window[1] - window[0])
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    _mark_worst(axes, mesh, polygons, window)
    where = "" if plane is None else f", cut at {'xyz'[plane.axis]} = {plane.position:.3g}"
    axes.set_title(f"{title}{where}", fontsize=11, color=INK)
    axes.tick_params(labelsize=8)
    return colours


def _mark_worst(axes: Any, mesh: Snapshot, polygons: Polygons, window: FloatArray) -> None:
    """A ring around the worst of the cells that are drawn, with its value and, if another one is worse, that one's."""
    for drawn in np.argsort(mesh.quality[polygons.cells], kind="stable"):
        place = polygons.corners[drawn].mean(axis=0)
        if ((place >= window[0]) & (place <= window[1])).all():
            break
    else:
        return
    cell = int(polygons.cells[drawn])
    text = f"worst cell: {mesh.quality[cell]:.3f}"
    if mesh.quality[cell] > mesh.quality[mesh.worst] + 1e-3:
        centre = ", ".join(f"{c:.3g}" for c in mesh.centre(mesh.worst))
        text = f"worst here: {mesh.quality[cell]:.3f}\nworst of all: {mesh.quality[mesh.worst]:.3f} at ({centre})"
    axes.plot(
        *place, marker="o", markersize=16, markerfacecolor="none", markeredgecolor=INVERTED_COLOUR, markeredgewidth=2
    )
    box = {"boxstyle": "round,pad=0.3", "facecolor": "white", "edgecolor": INVERTED_COLOUR, "alpha": 0.9}
    right, upper = (bool(side) for side in place > window.mean(axis=0))
    corner = {"x": 0.015, "ha": "left"} if right or not upper else {"x": 0.985, "ha": "right"}  # away from the ring
    axes.text(y=0.975, s=text, transform=axes.transAxes, va="top", fontsize=9, color=INK, bbox=box, **corner)


def _draw_line(axes: Any, mesh: Snapshot, title: str) -> None:
    """A 1D mesh: the size-skew over each cell."""
    for block in mesh.cells:
        for nodes, value in zip(block.nodes, mesh.quality, strict=True):
            axes.plot(mesh.points[nodes, 0], [value, value], color=INK if value > 0 else INVERTED_COLOUR, linewidth=2)
    axes.set(title=title, xlabel="x", ylabel="size-skew")


def _draw_history(axes: Any, before: Snapshot, steps: Sequence[StepRecord], metric: str) -> None:
    """Minimum and mean over the steps, and the minimum predicted for the motion without its correction."""
    number = [0, *(s.step for s in steps)]
    marker = "o" if len(steps) <= 25 else ""
    axes.axhline(0.0, color=INVERTED_COLOUR, linewidth=0.8)
    axes.plot(number, [before.quality.mean(), *(s.mean_size_skew for s in steps)], "--", color="#5ec962", label="mean")
    axes.plot(
        number, [before.quality.min(), *(s.min_size_skew for s in steps)], "-", marker=marker, color="#3b528b",
        markersize=4, label="minimum",
    )  # fmt: skip
    if metric == "size-skew" and any(s.predicted_standard < s.predicted_min for s in steps):
        standard = [s.predicted_standard for s in steps]
        axes.plot(number[1:], standard, ":", marker=marker, color="#9a9a9a", markersize=3, label="without correction")
    axes.set(title="size-skew over the steps", xlabel="step", xlim=(0, max(number)))
    axes.set_ylim(top=1.0)
    axes.legend(loc="best", frameon=False, fontsize=9)
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.grid(alpha=0.25)


def _draw_distribution(axes: Any, meshes: tuple[Snapshot, Snapshot], labels: tuple[str, str]) -> None:
    """How many cells are worse than a value."""
    for mesh, colour, label in zip(meshes, ("#9a9a9a", "#3b528b"), labels, strict=True):
        values = np.sort(mesh.quality)
        axes.step(values, 100.0 * np.arange(1, len(values) + 1) / len(values), color=colour, where="post", label=label)
    axes.axvline(0.0, color=INVERTED_COLOUR, linewidth=0.8)
    axes.set(title="share of cells below a size-skew", xlabel="size-skew", ylabel="%", yscale="log", xlim=(None, 1.0))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.legend(loc="best", frameon=False, fontsize=9)
    axes.grid(alpha=0.25)
