"""Arrays as VTK's formats take them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.numerics.mesh.cells import CellTable

__all__ = ["three_components", "topology"]


def three_components(values: NDArray[np.generic], *, vector: bool = False) -> NDArray[np.generic]:
    """Fill vectors up to three components; scalars and booleans become what VTK knows."""
    if values.dtype == np.bool_:
        values = values.astype(np.uint8)
    if values.ndim == 2 and (vector or values.shape[1] == 2):
        return np.pad(values, ((0, 0), (0, 3 - values.shape[1])))
    return values


def topology(cells: CellTable) -> dict[str, NDArray[np.generic]]:
    """VTK's connectivity, offsets (ends of the cells) and types."""
    ends = np.cumsum(np.concatenate([np.full(len(block), block.type.n_nodes, dtype=np.int64) for block in cells]))
    types = np.concatenate([np.full(len(block), block.type.vtk, dtype=np.uint8) for block in cells])
    return {"connectivity": np.concatenate([block.nodes.ravel() for block in cells]), "offsets": ends, "types": types}
