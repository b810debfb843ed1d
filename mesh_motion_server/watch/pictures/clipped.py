"""A 3D mesh clipped by a plane, seen from the removed side: whole cells behind it, coloured by quality.

The cells whose centres lie behind the plane, near what moves, keep their shape (no cell is cut, so that a distorted one
looks distorted); before and after it are the same cells. Of these, the outer facets that face the viewer are projected
in parallel and drawn from far to near: the painter's algorithm, which is exact enough for facets of like size.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from mesh_motion_server.numerics.arrays import Floats, Integers, Marks
from mesh_motion_server.numerics.mesh.boundary_facets import LOCAL_FACETS
from mesh_motion_server.numerics.mesh.cells import CellTable
from mesh_motion_server.watch.pictures.mesh_axes import RASTER_ABOVE, Look
from mesh_motion_server.watch.pictures.palette import INVERTED_COLOUR, colour_scale
from mesh_motion_server.watch.pictures.snapshot import Plane, Snapshot

__all__ = ["Facets", "cells_behind", "draw_clipped", "visible_facets"]


#: The side of a plane across each axis from which the viewer looks: with z (or y) upwards, x (or y) then goes right.
_SIDES = (1.0, -1.0, 1.0)
#: Where the viewer stands, as shares of the plane's normal, the axis to the right and the axis upwards.
_NORMAL, _RIGHT, _UP = 1.0, 0.55, 0.45
#: How much darker a facet is if the light is parallel to it.
_SHADE = 0.22
_NO_NODE = -1
#: Colour of the moving boundary, seen from inside the mesh: it has no quality.
_BODY = "#b9bdc4"


@dataclass(frozen=True, eq=False)
class Facets:
    """Projected facets, far ones first.

    Attributes
    ----------
    corners : (f, 4, 2) array
        A triangle repeats its last one.
    cells : (f,) int64 array
        The cell of each facet.
    light : (f,) array
        0 … 1, how much a facet faces the light.
    body : (f,) bool array
        Whether it belongs to the moving boundary.
    """

    corners: Floats
    cells: Integers
    light: Floats
    body: Marks


def cells_behind(mesh: Snapshot, plane: Plane, box: Floats) -> Integers:
    """(s,) ascending numbers of the cells whose centres lie behind the plane and within the box (2, 3)."""
    centres = mesh.cells.centres(mesh.points, np.arange(len(mesh.cells)))
    margin = 1e-9 * (box[1] - box[0])
    kept = ((centres >= box[0] - margin) & (centres <= box[1] + margin)).all(axis=1)
    side = _SIDES[plane.axis]
    return np.flatnonzero(kept & (side * (centres[:, plane.axis] - plane.position) <= margin[plane.axis]))


def visible_facets(mesh: Snapshot, chosen: Integers, axis: int) -> Facets:
    """The visible facets of the chosen cells (s,) along an axis, from the side of :func:`cells_behind`."""
    facets, owners = _outer_facets(mesh.cells, chosen)
    towards, right, up = _view(axis)
    places = mesh.points[facets]  # (f, 4, 3); a triangle's last node is repeated
    normals = np.cross(places[:, 2] - places[:, 0], places[:, 3] - places[:, 1])
    degenerate = facets[:, 2] == facets[:, 3]
    edges = places[:, 1] - places[:, 0], places[:, 2] - places[:, 0]
    normals[degenerate] = np.cross(*edges)[degenerate]
    lengths = np.linalg.norm(normals, axis=1)
    normals /= np.where(lengths > 0, lengths, 1.0)[:, None]
    order = np.argsort((places @ towards).mean(axis=1), kind="stable")
    order = order[(normals @ towards)[order] > 0]
    flat = places @ np.stack([right, up], axis=1)
    light = np.clip(normals @ _unit(towards + 0.6 * up - 0.4 * right), 0.0, 1.0)
    moving = np.zeros(len(mesh.points), dtype=np.bool_)
    moving[mesh.moving] = True
    return Facets(flat[order], owners[order], light[order], np.all(moving[facets[order]], axis=1))


def draw_clipped(axes: Any, mesh: Snapshot, chosen: Integers, axis: int, look: Look) -> Any:
    """Draw the chosen cells (s,) into matplotlib axes; return the data for a colour bar."""
    from matplotlib.collections import PolyCollection  # noqa: PLC0415  (an extra)
    from matplotlib.colors import to_rgb  # noqa: PLC0415

    facets = visible_facets(mesh, chosen, axis)
    values = mesh.quality[facets.cells]
    scale = colour_scale(mesh.scale)
    colours = scale.to_rgba(values)[:, :3]
    colours[mesh.inverted[facets.cells]] = to_rgb(INVERTED_COLOUR)
    colours[facets.body] = to_rgb(_BODY)
    colours *= (1.0 - _SHADE + _SHADE * facets.light)[:, None]
    width = float(np.clip(25.0 / np.sqrt(max(len(values), 1)), 0.05, 0.5)) * look.ring_points / 16.0
    axes.add_collection(
        PolyCollection(
            facets.corners, facecolors=colours, edgecolors=look.theme.edge, linewidths=width,  # type: ignore[arg-type]
            rasterized=len(values) > RASTER_ABOVE,
        )
    )  # fmt: skip
    own = np.flatnonzero((facets.cells == mesh.worst) & ~facets.body)
    if len(own):
        place = facets.corners[own].mean(axis=(0, 1))
        axes.plot(*place, marker="o", markersize=look.ring_points, markerfacecolor="none",
                  markeredgecolor=INVERTED_COLOUR, markeredgewidth=look.ring_points / 8.0)  # fmt: skip
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.margins(0.01)
    axes.set_axis_off()
    return scale


def _view(axis: int) -> tuple[Floats, Floats, Floats]:
    """Unit vectors towards the viewer, to the right and upwards in the picture; x or y goes right, z or y up."""
    across, upwards = ((1, 2), (0, 2), (0, 1))[axis]
    towards, up = np.zeros(3), np.zeros(3)
    towards[[axis, across, upwards]] = _SIDES[axis] * _NORMAL, _RIGHT, _UP
    towards = _unit(towards)
    up[upwards] = 1.0
    right = _unit(np.cross(up, towards))
    return towards, right, np.cross(towards, right)


def _unit(vector: Floats) -> Floats:
    return np.asarray(vector / np.linalg.norm(vector))


def _outer_facets(cells: CellTable, chosen: Integers) -> tuple[Integers, Integers]:
    """Nodes (f, 4) and owners (f,) of facets that only one of the chosen cells (s,) has; a triangle repeats one."""
    nodes, owners = [np.empty((0, 4), dtype=np.int64)], [np.empty(0, dtype=np.int64)]
    for block, first in zip(cells, cells.offsets, strict=False):
        rows = chosen[(chosen >= first) & (chosen < first + len(block))] - first
        for local in LOCAL_FACETS[block.type.name]:
            nodes.append(block.nodes[rows][:, [*local, local[-1]][:4]])
            owners.append(rows + first)
    everything, whose = np.concatenate(nodes), np.concatenate(owners)
    keys = np.sort(everything, axis=1)
    keys[keys[:, 2] == keys[:, 3], 3] = _NO_NODE  # a triangle has one key, whichever node is repeated
    for column in (0, 1):
        repeated = (keys[:, column] == keys[:, column + 1]) & (keys[:, 3] != _NO_NODE)
        keys[repeated] = np.column_stack([np.delete(keys[repeated], column, axis=1), np.full(repeated.sum(), _NO_NODE)])
    _, index, count = np.unique(keys, axis=0, return_index=True, return_counts=True)
    alone = np.sort(index[count == 1])
    return everything[alone], whose[alone]
