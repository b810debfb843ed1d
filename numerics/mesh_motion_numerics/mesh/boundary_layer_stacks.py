"""Columns of nodes above the nodes of a wall, where layers of quads, hexahedra or wedges are stacked on it.

From the wall's facets, every step goes through a cell from one facet to the opposite one. All nodes above one another
share the wall node at the foot of their column, even if the column leans over a neighbouring wall node or ends on the
bisector of a concave corner.

Where a layer ends at another wall, columns also start from that wall, through long sides of thin cells. A node that is
much nearer to the layer's wall does not belong to them.
"""

import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers, Marks, Shorts
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.points import marks_at

#: Largest distance of a node from the foot of its column, as a multiple of its distance from the wall.
_LEANING = 2.0

#: Opposite facets, local node numbers in the same order, by cell type; each pair is used in both directions.
_OPPOSITE: dict[str, tuple[tuple[tuple[int, ...], tuple[int, ...]], ...]] = {
    "quad": (((0, 1), (3, 2)), ((1, 2), (0, 3))),
    "wedge": (((0, 1, 2), (3, 4, 5)),),
    "hexahedron": (
        ((0, 1, 2, 3), (4, 5, 6, 7)),
        ((0, 1, 5, 4), (3, 2, 6, 7)),
        ((1, 2, 6, 5), (0, 3, 7, 4)),
    ),
}


def column_feet(points: Floats, cells: CellTable, wall: Integers, layer: Integers, away: Floats) -> Integers:
    """(n,) wall node at the foot of each node's column; −1 for nodes in no column, the node itself on the wall.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
        Reference coordinates.
    wall : (w,) int64 array
        Nodes of the wall.
    layer : (l,) int64 array
        Nodes that may belong to a column.
    away : (l,) array, mesh length unit
        Their distances from the wall.
    """
    n = len(points)
    feet, level = np.full(n, -1, dtype=np.int64), np.full(n, -1, dtype=np.int64)
    most = np.zeros(n)
    most[layer] = _LEANING * away
    feet[wall], level[wall] = wall, 0
    possible = marks_at(n, wall, layer)
    steps = _steps(cells, possible)
    height = 0
    while (level == height).any():
        for near, far in steps:
            onwards = np.flatnonzero((level[near] == height).all(axis=1) & (level[far] < 0).all(axis=1))
            ends, below = far[onwards], feet[near[onwards]]
            short = (np.linalg.norm(points[ends] - points[below], axis=2) <= most[ends]).all(axis=1)
            feet[ends[short]] = below[short]
        height += 1
        level[(level < 0) & (feet >= 0)] = height
    return feet


def _steps(cells: CellTable, possible: Marks) -> list[tuple[Shorts, Shorts]]:
    """Facets and opposite facets (c, k) of the cells whose nodes are all ``possible`` (n,)."""
    found = []
    for block in cells:
        own = block.nodes[possible[block.nodes].all(axis=1)]
        for one, other in _OPPOSITE.get(block.type.name, ()):
            a, b = own[:, one], own[:, other]
            found += [(a, b), (b, a)]
    return found
