"""The bad cells of a partition and the cells around them, as plain values and arrays: the content of CORRECT.

A rank sends the cells whose quality is below a bound, and all cells within some rings around them or around given
nodes. For each node it says whether all of the rank's cells at this node are sent.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.correction.free_region import cells_of_nodes, grow, nodes_of_cells
from mesh_motion_numerics.distributed.judging import reading, require
from mesh_motion_numerics.mesh.cells import CELL_TYPES, CellTable
from mesh_motion_numerics.mesh.points import rows_among
from mesh_motion_numerics.quality.metrics import CellQuality

#: A bound above every quality: all cells are below it.
ALL = 2.0


@dataclass(frozen=True)
class Extent:
    """The choice of the cells that are sent."""

    metric: str
    below: float  # cells with a lower quality are sent; :data:`ALL`: all cells
    rings: int  # number of rings of cells around these cells, or around given nodes, that are sent too

    @classmethod
    def of(cls, plain: Mapping[str, Any]) -> Self:
        """Read the map ``region`` of a message."""
        return cls(str(plain["metric"]), float(plain["below"]), int(plain["rings"]))

    def as_plain(self) -> dict[str, Any]:
        """Return the map ``region`` of a message."""
        return {"metric": self.metric, "below": self.below, "rings": self.rings}


@dataclass(frozen=True, eq=False)
class Region:
    """The data that one rank sent."""

    extent: Extent
    ids: Integers  # (r,). Global ids of the nodes
    whole: Marks  # (r,) bool. Whether all cells of the rank at the node are sent
    #: points, positions: (r, d), mesh length unit. Coordinates in the reference mesh, and after the field's
    #: displacement
    points: Floats
    positions: Floats
    cells: Mapping[str, Integers]  # type → (m, k) rows of nodes
    interior: int  # number of nodes of the rank that the server does not have
    #: (float, float). Smallest relative skew and size of the cells that are not sent; 1 without such cells.
    extremes: tuple[float, float]

    @classmethod
    def read(cls, fields: Mapping[str, Any], *, partition: int) -> Self:
        """Read the fields of a CORRECT. Raises InvalidInput if the fields do not fit together."""
        with reading("CORRECT", partition):
            return cls._read(fields)

    @classmethod
    def _read(cls, fields: Mapping[str, Any]) -> Self:
        part, nodes, corners = fields["part"], fields["nodes"], fields["corners"].reshape(-1)
        points, positions = (np.asarray(fields[name], dtype=np.float64) for name in ("points", "positions"))
        require(nodes.ndim == 2 and nodes.shape[1] == 2, "nodes: expected two columns")
        require(len(points) == len(nodes) == len(positions), "expected as many points and positions as nodes")
        require(points.shape == positions.shape, "expected points and positions of one dimension")
        require(bool(np.isfinite(points).all() and np.isfinite(positions).all()), "expected finite coordinates")
        require(not len(corners) or (corners.min() >= 0 and corners.max() < len(nodes)), "corners: no such node")
        cells, taken = {}, 0
        for name, count in part["cells"].items():
            entries = CELL_TYPES[name].n_nodes * int(count)
            require(entries > 0, f"cells: expected a positive number of {name}")
            cells[str(name)] = corners[taken : taken + entries].reshape(int(count), -1)
            taken += entries
        require(taken == len(corners), f"corners: expected {taken}, got {len(corners)}")
        skew, size = (float(value) for value in part["least"])
        whole = nodes[:, 1].astype(bool)
        interior = int(part["interior"])
        require(interior >= 0, "interior: expected a number of nodes")
        return cls(Extent.of(part), nodes[:, 0], whole, points, positions, cells, interior, (skew, size))

    def fields(self) -> dict[str, Any]:
        """Return the fields of a CORRECT."""
        corners = [rows.reshape(-1) for rows in self.cells.values()]
        return {
            "part": self.extent.as_plain()
            | {"interior": self.interior, "least": list(self.extremes)}
            | {"cells": {name: len(rows) for name, rows in self.cells.items()}},
            "nodes": np.column_stack([self.ids, self.whole]).astype(np.int64),
            "points": self.points,
            "positions": self.positions,
            "corners": np.concatenate([np.empty(0, dtype=np.int32), *corners]).astype(np.int32)[:, None],
        }


def region_fields(
    points: Floats,
    positions: Floats,
    cells: CellTable,
    quality: CellQuality,
    values: Floats,
    extent: Extent,
    around: Integers,
    *,
    interior: int,
) -> Region:
    """Return the cells of a rank that are sent; ids are the rank's own indices.

    Parameters
    ----------
    points, positions : (n, d) arrays, mesh length unit
        Coordinates of all its nodes.
    quality, values : CellQuality, (m,) array
        Quality of all its cells at the positions, and the metric of the extent.
    around : (k,) int64 array
        Further nodes whose cells belong to the region.
    interior : int
        As in :class:`Region`.
    """
    bad = values < extent.below
    marked = nodes_of_cells(cells, bad, len(points))
    marked[around] = True
    marked = grow(cells, marked, extent.rings)
    chosen = bad | cells_of_nodes(cells, marked)
    here = nodes_of_cells(cells, chosen, len(points))
    nodes = np.flatnonzero(here)
    local = rows_among(len(points), nodes)
    rows = {block.type.name: local[block.nodes[chosen[span]]] for block, span in cells.numbered}
    return Region(
        extent,
        nodes,
        marked[nodes],
        points[nodes],
        positions[nodes],
        {name: cells for name, cells in rows.items() if len(cells)},
        interior,
        _extremes(quality, ~chosen, extent.metric),
    )


def _extremes(quality: CellQuality, chosen: Marks, metric: str) -> tuple[float, float]:
    """The smallest relative skew, if the metric uses it, and the smallest size of the chosen (m,) cells."""
    size = float(np.min(quality.size, where=chosen, initial=1.0))
    if metric != "relative-size-skew":
        return 1.0, size
    relative = np.where(quality.inverted, 0.0, quality.relative_shape)
    return float(np.min(relative, where=chosen, initial=1.0)), size
