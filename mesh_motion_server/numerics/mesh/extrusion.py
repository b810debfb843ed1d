"""A plane mesh as one layer of cells in space, as a finite-volume code treats it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.numerics.mesh.cells import CELL_TYPES, CellBlock, CellTable

__all__ = ["extruded_cells", "extruded_points"]

_EXTRUDED = {"triangle": "wedge", "quad": "hexahedron"}


def extruded_cells(cells: CellTable, count: int) -> CellTable:
    """Triangles and quads as wedges and hexahedra, in the same order; node i of ``count`` is i + ``count`` above."""
    return CellTable(
        tuple(
            CellBlock(CELL_TYPES[_EXTRUDED[block.type.name]], np.hstack([block.nodes, block.nodes + count]))
            for block in cells
        )
    )


def extruded_points(points: NDArray[np.floating]) -> NDArray[np.float64]:
    """(2 n, 3) nodes of one layer about as high as a cell is wide, from positions (n, 2), mesh length unit."""
    n = len(points)
    height = float(np.sqrt(np.prod(np.ptp(points, axis=0)) / max(n, 1))) or 1.0
    return np.concatenate([np.column_stack([points, np.full(n, z)]) for z in (0.0, height)])
