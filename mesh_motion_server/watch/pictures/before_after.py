"""A mesh before and after a motion, coloured by quality: both meshes, a close-up of the worst cell, the distribution.

A 2D mesh is drawn as it is; a 3D mesh is cut by a plane through the moving nodes, and for the close-up through its
worst cell. For a 1D mesh only the distribution is drawn.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from mesh_motion_numerics.arrays import Floats

from mesh_motion_server.watch.pictures.history import draw_quality
from mesh_motion_server.watch.pictures.mesh_axes import draw_closeup, draw_mesh
from mesh_motion_server.watch.pictures.page import Page, blank
from mesh_motion_server.watch.pictures.palette import INVERTED_COLOUR
from mesh_motion_server.watch.pictures.runs import Run
from mesh_motion_server.watch.pictures.snapshot import Plane, Snapshot, choose_plane, choose_window

#: From this width on, mm, the close-up is next to both meshes.
_WIDE_PAGE = 130.0
#: A picture lower than this share of its width takes the page's whole width.
_LONG = 0.4
#: In the picture of one mesh: the mesh's share of the width, and the heights of title and colour bar.
_LEFT, _HEAD_MM, _FOOT_MM = 0.6, 7.0, 14.0
#: Least height of a long mesh, mm.
_LEAST = 4.0
#: Height of the history, as a share of the page's width.
_HISTORY = 0.22


@dataclass(frozen=True, eq=False)
class MeshPair:
    """A mesh at two times."""

    label: str
    metric: str  # the quality metric of the snapshots
    before: Snapshot
    after: Snapshot
    titles: tuple[str, str]  # the titles of the two meshes
    #: (k, d). Places where enrichment functions were added in the step of ``after``; empty if unknown.
    enrichment_points: Floats = field(default_factory=lambda: np.empty((0, 1)))


def draw_before_after(pair: MeshPair, page: Page, *, title: str | None = None, run: Run | None = None) -> Any:
    """A matplotlib figure of both meshes; make and save it within :func:`~.page.styled`.

    Parameters
    ----------
    title : str, optional
        None: the label; "": none.
    run : Run, optional
        Its history is drawn below.
    """
    before, after = pair.before, pair.after
    plane = choose_plane(before, after)
    window = choose_window(before, after, plane)
    rows, widths, heights, around = _arrangement(before.points.shape[1], window, page)
    if run is not None:
        rows, heights = [*rows, "h" * len(rows[0])], [*heights, _HISTORY * page.width]
    figure = blank(page, sum(heights) + around, fixed_aspect=True)
    axes = figure.subplot_mosaic([list(row) for row in rows], width_ratios=widths, height_ratios=heights)
    if "a" in axes:
        _draw_meshes(figure, axes, pair, plane, window, page)
    if "d" in axes:
        _draw_distribution(axes["d"], pair, page)
    if run is not None:
        draw_quality(axes["h"], [run], page)
        axes["h"].grid(visible=True, axis="y")
        axes["h"].set_xlabel("step")
        axes["h"].xaxis.get_major_locator().set_params(integer=True)
    title = pair.label if title is None else title
    if title:
        figure.suptitle(title)
    return figure


def draw_after(pair: MeshPair, page: Page) -> Any:
    """A matplotlib figure of the mesh after, and its worst cell: made in a second, because it needs no layout."""
    mesh, plane = pair.after, choose_plane(pair.before, pair.after)
    window = choose_window(pair.before, mesh, plane)
    wide, high = window[1] - window[0]
    meshes = float(np.clip(_LEFT * high / wide, 1 - _LEFT, 1.0)) * page.width
    height = meshes + _HEAD_MM + _FOOT_MM
    figure = blank(page, height)
    figure.set_layout_engine("none")
    low, share = _FOOT_MM / height, meshes / height
    whole = figure.add_axes((0.0, low, _LEFT - 0.01, share))
    near = figure.add_axes((_LEFT + 0.01, low, 0.99 - _LEFT, share))
    below = figure.add_axes((0.25, 0.7 * low, 0.5, 0.15 * low))
    colours = draw_mesh(whole, mesh, plane, f"{pair.titles[1]}, {mesh.extreme}", window, page)
    draw_closeup(near, mesh, plane, page)
    whole.set_axis_off()
    near.set_axis_off()
    figure.colorbar(colours, cax=below, orientation="horizontal", label=_bar_label(pair)).outline.set_linewidth(0.5)
    return figure


def _draw_meshes(figure: Any, axes: Any, pair: MeshPair, plane: Plane | None, window: Floats, page: Page) -> None:
    """Draw both meshes, the close-up, and the colour bar; the bar has a pink end only if a cell is inverted."""
    for name, mesh, what in zip("ab", (pair.before, pair.after), pair.titles, strict=True):
        colours = draw_mesh(axes[name], mesh, plane, f"{what}, {mesh.extreme}".replace(", m", "\nm"), window, page)
    _mark_enrichment(axes["b"], pair, plane, page)
    near = draw_closeup(axes["c"], pair.after, plane, page)
    middle = near.mean(axis=0)
    if plane is None and ((middle >= window[0]) & (middle <= window[1])).all():  # a frame without its cell misleads
        low, high = np.maximum(near[0], window[0]), np.minimum(near[1], window[1])
        axes["b"].indicate_inset((*low, *(high - low)), edgecolor=page.theme.ink, linewidth=0.6, alpha=0.9)
    meshes = [axes[name] for name in "abc"]
    for each in meshes:
        each.spines[["top", "right"]].set_visible(True)
    inverted = any(bool(mesh.inverted.any()) for mesh in (pair.before, pair.after))
    end = "min" if inverted else "neither"
    bar = figure.colorbar(colours, ax=meshes, location="bottom", shrink=0.6, pad=0.02, aspect=45, extend=end)
    bar.set_label(_bar_label(pair))
    bar.outline.set_linewidth(0.5)
    if inverted:
        bar.cmap = bar.cmap.with_extremes(under=INVERTED_COLOUR)
        colours.set_cmap(bar.cmap)


def _bar_label(pair: MeshPair) -> str:
    inverted = any(bool(mesh.inverted.any()) for mesh in (pair.before, pair.after))
    return f"{pair.metric} of a cell" + (" (pink: inverted)" if inverted else "")


def _arrangement(dimension: int, window: Floats, page: Page) -> tuple[list[str], list[float], list[float], float]:
    """Rows of panels (a, b the meshes, c close-up, d distribution), shares of columns, heights of rows, and the height
    of the rows above and below, mm.
    """
    ratio = float((window[1, 1] - window[0, 1]) / (window[1, 0] - window[0, 0]))
    head, text = 26.0, 11.0
    if dimension == 1:
        return ["d"], [1.0], [0.4 * page.width], text
    if ratio < _LONG:  # one below the other
        flat = max(ratio * (page.width - text), _LEAST)
        return ["aa", "bb", "cd"], [1.0, 1.0], [flat, flat, 0.4 * page.width], 3 * text + head
    if page.width >= _WIDE_PAGE:
        unit = (page.width - 3 * text) / (2.0 / ratio + 1.0)
        return ["abc"], [1.0 / ratio, 1.0 / ratio, 1.0], [unit], text + head
    side = (page.width - 2 * text) / 2.0
    return ["ab", "cd"], [1.0, 1.0], [ratio * side, side], 2 * text + head


def _mark_enrichment(axes: Any, pair: MeshPair, plane: Plane | None, page: Page) -> None:
    """Draw crosses where enrichment functions were added, in 2D; in 3D they are inside: only their number is shown."""
    places = pair.enrichment_points
    if not len(places):
        return
    if plane is not None:
        axes.annotate(f"{len(places)} enrichment points", (0.02, 0.02), xycoords="axes fraction")
        return
    axes.plot(
        *places.T, linestyle="", marker="P", markersize=0.6 * page.points, color=page.theme.enriched,
        markeredgecolor="white", markeredgewidth=0.5, label="enrichment points", zorder=5,
    )  # fmt: skip
    axes.legend(loc="lower left", frameon=True, framealpha=0.9, edgecolor="none", handlelength=1.0)


def _draw_distribution(axes: Any, pair: MeshPair, page: Page) -> None:
    """Draw the number of cells that are worse than a value."""
    theme, falls = page.theme, pair.after.scale[1] < pair.after.scale[0]
    for mesh, colour, dash, label in zip(
        (pair.before, pair.after), (theme.faint, theme.runs[0]), theme.dashes[1::-1], pair.titles, strict=True
    ):
        values = np.sort(mesh.badness)
        shown = np.unique(np.linspace(0, len(values) - 1, min(len(values), 2000)).astype(np.int64))
        shown = np.union1d(np.arange(min(len(values), 200)), shown)  # each of the worst cells
        share = 100.0 * (shown + 1) / len(values)
        axes.step(np.abs(values[shown]) if falls else values[shown], share, color=colour, linestyle=dash,
                  where="post", label=label)  # fmt: skip
    if not falls:
        axes.axvline(0.0, color=INVERTED_COLOUR, linewidth=0.6)
        axes.set_xlim(right=1.0)
    axes.set(title=f"cells {'above' if falls else 'below'}, %", xlabel=pair.metric, yscale="log")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.legend(loc="best", borderaxespad=0.2)
    axes.grid(visible=True)
    if pair.after.points.shape[1] > 1:
        axes.set_box_aspect(1.0)
