"""2D cells that are given by their edges: triangles, quadrilaterals, and fans of triangles for others."""

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers


def polygons(points: Floats, edges: Integers, cells: Integers) -> tuple[Floats, dict[str, Integers]]:
    """Points and cells (triangles and quadrilaterals) of a 2D mesh.

    A cell of more than four edges becomes triangles around a node in its middle, which is added after the points.
    Raises ValueError if the edges of a cell are not one loop.

    Parameters
    ----------
    edges : (e, 2) array
        Edges of all cells, each in the direction of its cell's circulation.
    cells : (e,) array
        The cell of each edge.
    """
    order = np.argsort(cells, kind="stable")
    edges, cells = edges[order], cells[order]
    key = cells * len(points)
    by_start = np.argsort(key + edges[:, 0], kind="stable")
    starts = (key + edges[:, 0])[by_start]
    after = by_start[np.minimum(np.searchsorted(starts, key + edges[:, 1]), len(starts) - 1)]  # (e,) the next edge
    open_ends = (edges[after, 0] != edges[:, 1]) | (cells[after] != cells)
    if open_ends.any():
        raise ValueError(f"the edges of cell {int(cells[np.argmax(open_ends)]) + 1} are not a loop")
    _, first, counts = np.unique(cells, return_index=True, return_counts=True)
    found: dict[str, Integers] = {}
    fans: list[Integers] = []
    middles: list[Floats] = []
    for size in np.unique(counts).tolist():
        edge, loop = first[counts == size], []
        for _ in range(size):
            loop.append(edges[edge, 0])
            edge = after[edge]
        if (edge != first[counts == size]).any() or size < 3:
            raise ValueError(
                f"the edges of cell {int(cells[first[counts == size][0]]) + 1} are not a loop of 3 or more"
            )
        nodes = np.stack(loop, axis=1)
        if size <= 4:
            found["triangle" if size == 3 else "quad"] = nodes
            continue
        centre = len(points) + sum(len(of) for of in middles) + np.arange(len(nodes))
        middles.append(points[nodes].mean(axis=1))
        fans += [np.stack([nodes[:, k], nodes[:, (k + 1) % size], centre], axis=1) for k in range(size)]
    if fans:
        found["triangle"] = np.concatenate([found.get("triangle", np.empty((0, 3), np.int64)), *fans])
    return np.concatenate([points, *middles]), found
