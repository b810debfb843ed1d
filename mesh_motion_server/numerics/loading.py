"""The kernels that a session calls beside those of a motion loaded, or compiled where that was not done yet."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.numerics.cell_order import sorted_cells
from mesh_motion_server.numerics.cells import CellTable
from mesh_motion_server.numerics.exact_displacements import differences_of, settle

__all__ = ["load_session_kernels"]


def load_session_kernels(points: NDArray[np.float64], cells: CellTable) -> None:
    """Order the first block's cells and answer a Move that moves none of the points (n, d)."""
    sorted_cells([(np.arange(len(points)), cells.blocks[0].nodes)], len(points))
    settle(points.copy(), points, np.arange(1), np.zeros_like(points[:1]))
    differences_of(points, points, np.arange(1))
