"""A mesh in matplotlib axes: its cells, or the cut of its cells, coloured by quality, and a mark on the worst one."""

from typing import Any

import numpy as np
from mesh_motion_numerics.arrays import Floats

from mesh_motion_server.watch.pictures.page import Page
from mesh_motion_server.watch.pictures.palette import INVERTED_COLOUR, colour_scale
from mesh_motion_server.watch.pictures.slices import Polygons, cut, flat
from mesh_motion_server.watch.pictures.snapshot import Plane, Snapshot

#: Above this number of polygons, the cells become pixels inside SVG and PDF: a polygon takes about 150 bytes there.
RASTER_ABOVE = 3000
#: Distance that a close-up shows to each side of the worst cell, in sizes of that cell.
_AROUND = 3.5


def draw_mesh(axes: Any, mesh: Snapshot, plane: Plane | None, title: str, window: Floats, page: Page) -> Any:
    """Draw a mesh (or its cut) into matplotlib axes and mark the worst cell; return the data for a colour bar.

    Parameters
    ----------
    plane : Plane or None
        The cut of a 3D mesh.
    window : (2, 2) array
        Lower and upper corner of the shown part.
    """
    polygons = _within(_polygons(mesh, plane), window)
    colours = draw_polygons(axes, polygons, mesh, page)
    _show(axes, window - [[0.02], [-0.02]] * (window[1] - window[0]))
    _mark_worst(axes, mesh, polygons, window, page)
    where = "" if plane is None else f", cut at {'xyz'[plane.axis]} = {plane.position:.3g}"
    if "\n" in title:  # its line has no room for more
        where = where.replace(", ", "\n")
    axes.set_title(f"{title}{where}")
    return colours


def draw_closeup(axes: Any, mesh: Snapshot, plane: Plane | None, page: Page) -> Floats:
    """Draw the surroundings of the worst cell, outline it, and return the (2, 2) window that is shown.

    A 3D mesh is cut through that cell, across the axis of ``plane``.
    """
    from matplotlib.collections import PolyCollection  # noqa: PLC0415

    centre = mesh.centre(mesh.worst)
    block, row = mesh.cells.locate(mesh.worst)
    half = _AROUND * float(np.ptp(mesh.points[block.nodes[row]], axis=0).max())
    if plane is not None:
        plane = Plane(plane.axis, float(centre[plane.axis]))
        centre = np.delete(centre, plane.axis)
    window = np.array([centre - half, centre + half])
    polygons = _within(_polygons(mesh, plane), window)
    draw_polygons(axes, polygons, mesh, page)
    own = polygons.corners[polygons.cells == mesh.worst]
    axes.add_collection(
        PolyCollection(own, facecolors="none", edgecolors=INVERTED_COLOUR, linewidths=page.points / 9.0, zorder=4)
    )
    _show(axes, window)
    where = (
        f"\nat {centre[0]:.3g}, {centre[1]:.3g}" if plane is None else f", {'xyz'[plane.axis]} = {plane.position:.3g}"
    )
    axes.set_title(f"its worst cell{where}")
    return window


def draw_polygons(axes: Any, polygons: Polygons, mesh: Snapshot, page: Page) -> Any:
    """Draw polygons of a mesh in the colours of their cells' quality, inverted ones apart; return the bar's data."""
    from matplotlib.collections import PolyCollection  # noqa: PLC0415

    values = mesh.quality[polygons.cells]
    width = float(np.clip(40.0 / np.sqrt(max(len(values), 1)), 0.1, 0.7)) * page.points / 16.0
    in_pixels, scale = len(values) > RASTER_ABOVE, colour_scale(mesh.scale)
    colours = PolyCollection(
        polygons.corners,  # type: ignore[arg-type]
        array=np.clip(values, min(mesh.scale), max(mesh.scale)),
        cmap=scale.cmap,
        norm=scale.norm,
        edgecolors=page.theme.edge,
        linewidths=width,
        rasterized=in_pixels,
    )
    axes.add_collection(colours, autolim=False)  # the window is already set, and computing the extents is slow
    folded = mesh.inverted[polygons.cells]
    if folded.any():
        axes.add_collection(
            PolyCollection(
                polygons.corners[folded],  # type: ignore[arg-type]
                facecolors=INVERTED_COLOUR,
                edgecolors="white",
                linewidths=width,
                rasterized=in_pixels,
            ),
            autolim=False,
        )
    return colours


def _polygons(mesh: Snapshot, plane: Plane | None) -> Polygons:
    if plane is None:
        return flat(mesh.points, mesh.cells)
    return cut(mesh.points, mesh.cells, plane.axis, plane.position)


def _within(polygons: Polygons, window: Floats) -> Polygons:
    """The polygons that are at least partly in the window, or nearly."""
    margin = 0.05 * (window[1] - window[0])
    low, high = window[0] - margin, window[1] + margin
    corners = polygons.corners
    kept = ((corners.max(axis=1) >= low) & (corners.min(axis=1) <= high)).all(axis=1)
    return Polygons(corners[kept], polygons.cells[kept])


def _show(axes: Any, window: Floats) -> None:
    axes.set_aspect("equal")
    axes.set(xlim=window[:, 0], ylim=window[:, 1])


def _mark_worst(axes: Any, mesh: Snapshot, polygons: Polygons, window: Floats, page: Page) -> None:
    """Draw a ring around the worst cell, which titles name and the close-up shows; no other cell has a ring."""
    for corners in polygons.corners[polygons.cells == mesh.worst][:1]:
        place = np.unique(corners, axis=0).mean(axis=0)
        if ((place >= window[0]) & (place <= window[1])).all():
            axes.plot(
                *place, marker="o", markersize=page.points, markerfacecolor="none", markeredgecolor=INVERTED_COLOUR,
                markeredgewidth=page.points / 8.0,
            )  # fmt: skip
