"""Sides of elements by their numbers, as finite-element programs number them; also for elements of higher order."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from mesh_motion_numerics.arrays import Integers
from mesh_motion_numerics.mesh.cells import CELL_TYPES

#: Our type of elements with this number of nodes, of first and second order.
SOLIDS = {4: "tetra", 10: "tetra", 8: "hexahedron", 20: "hexahedron", 27: "hexahedron", 6: "wedge", 15: "wedge",
          5: "pyramid", 13: "pyramid"}  # fmt: skip
PLANES = {3: "triangle", 6: "triangle", 4: "quad", 8: "quad", 9: "quad"}


@dataclass(frozen=True, eq=False)
class Sides:
    """How a program numbers the sides of elements and the nodes between their corners."""

    corners: Mapping[str, Sequence[Sequence[int]]]  # {type: corners of each side}. Counted from 1
    #: {type: pairs of corners}. In elements of second order, the corners are followed by the nodes in the middles of
    #: these edges, in this order.
    edges: Mapping[str, str]
    #: {(type, number of nodes): node in the centre of each side}. Counted from 1, 0 for none.
    centres: Mapping[tuple[str, int], Sequence[int]] = field(default_factory=dict)

    def local(self, name: str, width: int) -> list[list[int]]:
        """The nodes of each side of an element with ``width`` nodes, counted from 0; also those between corners.

        Raises ValueError for elements of third and higher order.
        """
        if name not in self.corners:
            return []
        sides, count, edges = self.corners[name], CELL_TYPES[name].n_nodes, self.edges[name].split()
        if width < count + len(edges):
            edges = []
        centres = self.centres.get((name, width), [0] * len(sides))
        if (name, width) not in self.centres and width - count - len(edges) not in (0, 1):
            raise ValueError(f"sides of a {name} of {width} nodes; those of first and second order are read")
        middles = [(count + k, {int(end) for end in edge}) for k, edge in enumerate(edges)]
        return [
            [*(c - 1 for c in own), *(node for node, ends in middles if ends <= {*own}), *([centre - 1] * (centre > 0))]
            for own, centre in zip(sides, centres, strict=True)
        ]


_FLAT = {"triangle": ((1, 2), (2, 3), (3, 1)), "quad": ((1, 2), (2, 3), (3, 4), (4, 1))}
_FLAT_EDGES = {"line": "12", "triangle": "12 23 31", "quad": "12 23 34 41"}
_EDGES = {
    **_FLAT_EDGES,
    "tetra": "12 23 31 14 24 34",
    "hexahedron": "12 23 34 41 15 26 37 48 56 67 78 85",
    "wedge": "12 23 31 14 25 36 45 56 64",
    "pyramid": "12 23 34 41 15 25 35 45",
}
#: Sandia report SAND92-2137, figure 4, and libexodus, ex_get_side_set_node_list.
EXODUS = Sides(
    {
        "line": ((1,), (2,)),
        **_FLAT,
        "tetra": ((1, 2, 4), (2, 3, 4), (1, 4, 3), (1, 3, 2)),
        "hexahedron": ((1, 2, 6, 5), (2, 3, 7, 6), (3, 4, 8, 7), (1, 5, 8, 4), (1, 4, 3, 2), (5, 6, 7, 8)),
        "wedge": ((1, 2, 5, 4), (2, 3, 6, 5), (1, 4, 6, 3), (1, 3, 2), (4, 5, 6)),
        "pyramid": ((1, 2, 5), (2, 3, 5), (3, 4, 5), (1, 5, 4), (1, 4, 3, 2)),
    },
    _EDGES,
    {
        ("line", 4): (0, 0),
        ("tetra", 8): (5, 6, 7, 8),
        ("tetra", 14): (14, 12, 13, 11),
        ("tetra", 15): (14, 12, 13, 11),
        ("hexahedron", 27): (26, 25, 27, 24, 22, 23),
        ("wedge", 18): (16, 17, 18, 0, 0),
        ("wedge", 20): (20, 18, 19, 16, 17),
        ("wedge", 21): (21, 19, 20, 17, 18),
        ("pyramid", 14): (0, 0, 0, 0, 14),
        ("pyramid", 18): (15, 16, 17, 18, 14),
        ("pyramid", 19): (15, 16, 17, 18, 14),
    },
)
#: The same for beams: libexodus takes the whole beam for each of its sides.
BEAMS = replace(EXODUS, corners={"line": ((1, 2), (2, 1))}, centres={("line", 4): (4, 4)})
#: SIDS, 3.3: the faces of CGNS' elements.
CGNS = Sides(
    {
        **_FLAT,
        "tetra": ((1, 3, 2), (1, 2, 4), (2, 3, 4), (3, 1, 4)),
        "hexahedron": ((1, 4, 3, 2), (1, 2, 6, 5), (2, 3, 7, 6), (3, 4, 8, 7), (1, 5, 8, 4), (5, 6, 7, 8)),
        "wedge": ((1, 2, 5, 4), (2, 3, 6, 5), (3, 1, 4, 6), (1, 3, 2), (4, 5, 6)),
        "pyramid": ((1, 4, 3, 2), (1, 2, 5), (2, 3, 5), (3, 4, 5), (4, 1, 5)),
    },
    _EDGES,
    {
        ("hexahedron", 27): (21, 22, 23, 24, 25, 26),
        ("wedge", 18): (16, 17, 18, 0, 0),
        ("pyramid", 14): (14, 0, 0, 0, 0),
    },
)
#: The sides of shells are their two faces, then their edges.
SHELLS = Sides(
    {name: (faces := tuple(range(1, len(edges) + 1)), faces, *edges) for name, edges in _FLAT.items()},
    _FLAT_EDGES,
    {("triangle", 7): (7, 7, 0, 0, 0), ("quad", 9): (9, 9, 0, 0, 0, 0)},
)
#: CalculiX's manual, *SURFACE, the same as Abaqus'.
ABAQUS = Sides(
    {
        **_FLAT,
        "tetra": ((1, 2, 3), (1, 4, 2), (2, 4, 3), (3, 4, 1)),
        "hexahedron": ((1, 2, 3, 4), (5, 8, 7, 6), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 8, 4), (4, 8, 5, 1)),
        "wedge": ((1, 2, 3), (4, 5, 6), (1, 2, 5, 4), (2, 3, 6, 5), (3, 1, 4, 6)),
        "pyramid": ((1, 2, 3, 4), (1, 5, 2), (2, 5, 3), (3, 5, 4), (4, 5, 1)),
    },
    _EDGES | {"hexahedron": "12 23 34 41 56 67 78 85 15 26 37 48", "wedge": "12 23 31 45 56 64 14 25 36"},
    {("hexahedron", 27): (22, 23, 24, 25, 26, 27)},
)


def side_nodes(name: str, nodes: Integers, sides: Integers, table: Sides) -> Integers:
    """Nodes of sides of elements, with repeats; also those between corners.

    Raises ValueError if an element has no such side, and as :meth:`Sides.local` does.

    Parameters
    ----------
    nodes : (m, k) array
        Nodes of the elements, the corners of type ``name`` first.
    sides : (m,) array
        The side of each element, counted from 1.
    """
    known = table.local(name, nodes.shape[1])
    wrong = np.flatnonzero((sides < 1) | (sides > len(known)))
    if len(wrong):
        raise ValueError(f"side {int(sides[wrong[0]])} of a {name}, which has {len(known)} sides")
    parts = [np.empty(0, dtype=np.int64)]
    return np.concatenate(parts + [nodes[sides == side][:, own].ravel() for side, own in enumerate(known, start=1)])
