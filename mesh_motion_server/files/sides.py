"""Sides of elements by their numbers, as finite-element programs number them; also for elements of higher order."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.mesh.cells import CELL_TYPES

__all__ = ["ABAQUS", "EXODUS", "PLANES", "SHELLS", "SOLIDS", "side_nodes"]

#: Our type of elements with this number of nodes, of first and second order.
SOLIDS = {4: "tetra", 10: "tetra", 8: "hexahedron", 20: "hexahedron", 27: "hexahedron", 6: "wedge", 15: "wedge",
          5: "pyramid", 13: "pyramid"}  # fmt: skip
PLANES = {3: "triangle", 6: "triangle", 4: "quad", 8: "quad", 9: "quad"}

Sides = dict[str, Sequence[Sequence[int]]]

_FLAT: Sides = {"triangle": ((1, 2), (2, 3), (3, 1)), "quad": ((1, 2), (2, 3), (3, 4), (4, 1))}
#: Sandia report SAND92-2137, figure 4: corners of each side of each type, counted from 1.
EXODUS: Sides = {
    **_FLAT,
    "tetra": ((1, 2, 4), (2, 3, 4), (1, 4, 3), (1, 3, 2)),
    "hexahedron": ((1, 2, 6, 5), (2, 3, 7, 6), (3, 4, 8, 7), (1, 5, 8, 4), (1, 4, 3, 2), (5, 6, 7, 8)),
    "wedge": ((1, 2, 5, 4), (2, 3, 6, 5), (1, 4, 6, 3), (1, 3, 2), (4, 5, 6)),
    "pyramid": ((1, 2, 5), (2, 3, 5), (3, 4, 5), (1, 5, 4), (1, 4, 3, 2)),
}
#: The same for shells: their two faces come before their edges.
SHELLS: Sides = {name: (faces := tuple(range(1, len(edges) + 1)), faces, *edges) for name, edges in _FLAT.items()}
#: CalculiX's manual, *SURFACE, the same as Abaqus'.
ABAQUS: Sides = {
    **_FLAT,
    "tetra": ((1, 2, 3), (1, 4, 2), (2, 4, 3), (3, 4, 1)),
    "hexahedron": ((1, 2, 3, 4), (5, 8, 7, 6), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 8, 4), (4, 8, 5, 1)),
    "wedge": ((1, 2, 3), (4, 5, 6), (1, 2, 5, 4), (2, 3, 6, 5), (3, 1, 4, 6)),
    "pyramid": ((1, 2, 3, 4), (1, 5, 2), (2, 5, 3), (3, 5, 4), (4, 5, 1)),
}


def side_nodes(points: Floats, name: str, nodes: Integers, sides: Integers, table: Sides) -> Integers:
    """Nodes of sides of elements, with repeats; also those between corners.

    Parameters
    ----------
    nodes : (m, k) array
        Nodes of the elements, the corners of type ``name`` first.
    sides : (m,) array
        The side of each element, counted from 1.

    Raises
    ------
    ValueError
        If an element has no such side.
    """
    known = table.get(name, ())
    wrong = np.flatnonzero((sides < 1) | (sides > len(known)))
    if len(wrong):
        raise ValueError(f"side {int(sides[wrong[0]])} of a {name}, which has {len(known)} sides")
    between = _between(points, name, nodes[:1])
    parts = [np.empty(0, dtype=np.int64)]
    for side, corners in enumerate(known, start=1):
        own = {corner - 1 for corner in corners}
        local = [*own, *(extra for extra, ends in between.items() if ends <= own)]
        parts.append(nodes[sides == side][:, local].ravel())
    return np.concatenate(parts)


def _between(points: Floats, name: str, first: Integers) -> dict[int, set[int]]:
    """For each local node beyond the corners: the corners of the edge, side or element in whose middle it is.

    Programs count these nodes in different orders, so the nearest middle in the first element decides.
    """
    count = CELL_TYPES[name].n_nodes
    if not len(first) or first.shape[1] == count:
        return {}
    groups = [set(group) for size in (2, 3, 4, count) for group in combinations(range(count), size)]
    middles = np.array([points[first[0, list(group)]].mean(axis=0) for group in groups])
    found = {}
    for local in range(count, first.shape[1]):
        found[local] = groups[int(np.argmin(np.linalg.norm(middles - points[first[0, local]], axis=1)))]
    return found
