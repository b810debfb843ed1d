"""A mesh before and after a motion, coloured by quality: both meshes, a close-up of the worst cell, the distribution.

A 2D mesh is drawn as it is, a 3D mesh clipped by a plane through its worst cell (:mod:`.clipped`); the close-up of a 3D
mesh is a cut through that cell.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from mesh_motion_server.numerics.arrays import Floats
from mesh_motion_server.watch.pictures.clipped import cells_behind, draw_clipped
from mesh_motion_server.watch.pictures.mesh_axes import Look, draw_closeup, draw_mesh
from mesh_motion_server.watch.pictures.page import Page, blank
from mesh_motion_server.watch.pictures.palette import INVERTED_COLOUR, Theme
from mesh_motion_server.watch.pictures.snapshot import Plane, Snapshot, choose_box, choose_plane, choose_window

__all__ = ["MeshPair", "draw_before_after"]


#: From this width on, mm, the close-up stands beside both meshes.
_WIDE_PAGE = 130.0
#: A picture lower than this share of its width takes the page's whole width.
_LONG = 0.4


@dataclass(frozen=True, eq=False)
class MeshPair:
    """A mesh at two times.

    Attributes
    ----------
    metric : str
        The quality metric of the snapshots.
    enrichment_points : (k, d) array
        Where enrichment functions were added in the step of ``after``; empty if unknown.
    note : str
        A remark on the step of ``after``, such as "the worst".
    """

    label: str
    metric: str
    before: Snapshot
    after: Snapshot
    enrichment_points: Floats
    note: str = ""


def draw_before_after(pair: MeshPair, page: Page, *, title: str | None = None) -> Any:
    """A matplotlib figure of both meshes; make and save it within :func:`~.page.styled`.

    Parameters
    ----------
    pair : MeshPair
        Of a mesh in 2D or 3D.
    title : str, optional
        None: the label; "": none.
    """
    before, after = pair.before, pair.after
    plane = choose_plane(before, after)
    window = choose_window(before, after, plane)
    rows, widths, height = _arrangement(window, page, is_3d=plane is not None)
    figure = blank(page, height, fixed_aspect=True)
    axes = figure.subplot_mosaic([list(row) for row in rows], width_ratios=widths)
    look = Look(page.theme, page.points, page.points - 1.0, page.points, notes=False)
    colours = _draw_meshes(axes, pair, plane, window, look)
    _mark_enrichment(axes["b"], pair, plane, look)
    near = draw_closeup(axes["c"], after, plane, look)
    if plane is None:
        box = (*near[0], *(near[1] - near[0]))
        axes["b"].indicate_inset(box, edgecolor=page.theme.ink, linewidth=0.6, alpha=0.9)
    if "d" in axes:
        _draw_distribution(axes["d"], pair, page.theme)
        axes["d"].set_box_aspect(1.0)
    for name in set(axes) - {"d"}:
        axes[name].spines[["top", "right"]].set_visible(True)
    _add_bar(figure, list(axes.values()), colours, pair)
    title = pair.label if title is None else title
    if title:
        figure.suptitle(title)
    return figure


def _draw_meshes(axes: Any, pair: MeshPair, plane: Plane | None, window: Floats, look: Look) -> Any:
    """Draw both meshes; return the data for a colour bar."""
    titles = _titles(pair)
    box = choose_box(pair.before, pair.after)
    shown = None if plane is None else cells_behind(pair.before, _through_worst(plane, pair), box)
    for name, mesh in (("a", pair.before), ("b", pair.after)):
        if plane is None or shown is None:
            colours = draw_mesh(axes[name], mesh, None, titles[name], window, look)
        else:
            colours = draw_clipped(axes[name], mesh, shown, plane.axis, look)
            axes[name].set_title(titles[name].replace(", m", "\nm"))
    return colours


def _through_worst(plane: Plane, pair: MeshPair) -> Plane:
    """The plane across the same axis through the worst cell in the mesh before, so that this cell is visible."""
    return Plane(plane.axis, float(pair.before.centre(pair.after.worst)[plane.axis]))


def _add_bar(figure: Any, axes: list[Any], colours: Any, pair: MeshPair) -> None:
    """The colour bar below everything; it has a pink end only where a cell is inverted."""
    inverted = any(bool(mesh.inverted.any()) for mesh in (pair.before, pair.after))
    end = "min" if inverted else "neither"
    bar = figure.colorbar(
        colours,
        ax=axes,
        location="bottom",
        shrink=0.6,
        pad=0.02,
        aspect=45,
        extend=end,
    )
    bar.set_label(f"{pair.metric} of a cell" + (" (pink: inverted)" if inverted else ""))
    bar.outline.set_linewidth(0.5)
    if inverted:
        bar.cmap = bar.cmap.with_extremes(under=INVERTED_COLOUR)
        colours.set_cmap(bar.cmap)


def _titles(pair: MeshPair) -> dict[str, str]:
    """Titles of the two meshes."""
    note = f" ({pair.note})" if pair.note else ""
    before = "at opening" if pair.before.step == 0 else f"after step {pair.before.step}"
    return {
        "a": f"{before}, {pair.before.extreme}",
        "b": f"after step {pair.after.step}{note}, {pair.after.extreme}",
    }


def _arrangement(window: Floats, page: Page, *, is_3d: bool) -> tuple[list[str], list[float], float]:
    """Rows of panels (a, b the meshes, c close-up, d distribution), shares of columns, the suitable height, mm."""
    ratio = 0.85 if is_3d else float((window[1, 1] - window[0, 1]) / (window[1, 0] - window[0, 0]))
    head, text = 34.0 if is_3d else 22.0, 11.0
    if ratio < _LONG:  # one below the other
        return ["aa", "bb", "cd"], [1.0, 1.0], 2 * (ratio * page.width + text) + 0.4 * page.width + text + head
    if page.width >= _WIDE_PAGE:
        unit = (page.width - 3 * text) / (2.0 / ratio + 1.0)
        return ["abc"], [1.0 / ratio, 1.0 / ratio, 1.0], unit + text + head
    return ["ab", "cd"], [1.0, 1.0], (1.0 + ratio) * (page.width - 2 * text) / 2.0 + 2 * text + head


def _mark_enrichment(axes: Any, pair: MeshPair, plane: Plane | None, look: Look) -> None:
    """Crosses where enrichment functions were added, in 2D; in 3D they lie inside, and only their number is shown."""
    places = pair.enrichment_points
    if not len(places):
        return
    if plane is not None:
        axes.annotate(
            f"{len(places)} enrichment points", (0.02, 0.02), xycoords="axes fraction", fontsize=look.note_points
        )
        return
    axes.plot(
        *places.T, linestyle="", marker="P", markersize=0.6 * look.ring_points, color=look.theme.enriched,
        markeredgecolor="white", markeredgewidth=0.5, label="enrichment points", zorder=5,
    )  # fmt: skip
    axes.legend(loc="lower left", frameon=True, framealpha=0.9, edgecolor="none", handlelength=1.0)


def _draw_distribution(axes: Any, pair: MeshPair, theme: Theme) -> None:
    """How many cells are worse than a value."""
    falls = pair.after.scale[1] < pair.after.scale[0]
    for mesh, colour, dash, label in (
        (pair.before, theme.faint, theme.dashes[1], "before"),
        (pair.after, theme.runs[0], theme.dashes[0], "after"),
    ):
        values = np.sort(mesh.badness)
        shown = np.unique(np.linspace(0, len(values) - 1, min(len(values), 2000)).astype(np.int64))
        shown = np.union1d(np.arange(min(len(values), 200)), shown)  # every one of the worst
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
