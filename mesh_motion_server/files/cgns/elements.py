"""The element sections of a CGNS zone: fixed types, MIXED, and polyhedra by NGON_n and NFACE_n.

Element numbers continue through all sections. Before version 4 (in fact 3.4) MIXED and NGON_n sections had no
``ElementStartOffset``: a type or a count before each element's nodes then gives the start of the next element.

https://cgns.github.io/CGNS_docs_current/sids/conv.html#unstructgrid
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from mesh_motion_numerics.arrays import Integers
from mesh_motion_numerics.mesh.cells import CELL_TYPES

from mesh_motion_server.files.cgns.tree import Node

NODE, MIXED, NGON, NFACE = 2, 20, 22, 23
#: Our type for each CGNS type number that is read; for other numbers the CGNS name.
TYPES = {3: "line", 5: "triangle", 7: "quad", 10: "tetra", 12: "pyramid", 14: "wedge", 17: "hexahedron"}
#: Second order: the corners come first; total number of nodes.
_SECOND = {4: ("line", 3), 6: ("triangle", 6), 8: ("quad", 8), 9: ("quad", 9), 11: ("tetra", 10), 13: ("pyramid", 14),
           15: ("wedge", 15), 16: ("wedge", 18), 18: ("hexahedron", 20), 19: ("hexahedron", 27),
           21: ("pyramid", 13)}  # fmt: skip
#: Single nodes are also elements: boundary conditions may list them.
VERTEX = "vertex"
_NAMES = TYPES | {kind: name for kind, (name, _) in _SECOND.items()} | {NODE: VERTEX}
_WIDTHS = {kind: CELL_TYPES[name].n_nodes for kind, name in TYPES.items()}
_WIDTHS |= {kind: width for kind, (_, width) in _SECOND.items()} | {NODE: 1}


@dataclass(frozen=True, eq=False)
class Elements:
    """Elements of one type: nodes (m, k) counted from 0, corners first, and element numbers (m,) in the zone.

    ``parents`` (m, 2): the cell and the side of it that each element is, if the section has zeros instead of nodes.
    """

    name: str
    nodes: Integers
    numbers: Integers
    section: str
    parents: Integers | None = None


@dataclass(frozen=True, eq=False)
class ListedElements:
    """Elements of variable length, NGON_n or NFACE_n: (m + 1,) start of each element, and the entries as in the file.

    ``parents`` (m, 2): the cells on both sides of each face, if the section has them.
    """

    kind: int
    section: str
    starts: Integers
    entries: Integers
    first: int
    parents: Integers | None

    @property
    def numbers(self) -> Integers:
        """(m,) numbers of the elements in the zone."""
        return self.first + np.arange(len(self.starts) - 1)


def _since_3_1(kind: int) -> int:
    """The number that a type of version 3.0 has since version 3.1, which moved PYRA_13 from 13 to 21."""
    return {13: 21}.get(kind, kind - 1) if 13 <= kind <= 21 else kind


def read_elements(section: Node, version: float = 4.0) -> list[Elements | ListedElements]:
    """Read the elements of one section; ``version`` is that of the file.

    Raises InvalidInput for types of third and higher order, and for wrong counts.
    """
    numbered = _since_3_1 if 3.0 <= version < 3.1 else int
    kind = numbered(int(_first(section, section.integers(), 2)[0]))
    low, high = (int(v) for v in _first(section, _array(section, "ElementRange"), 2))
    connectivity = _array(section, "ElementConnectivity")
    count = high - low + 1
    if low < 1 or not 0 < count <= len(connectivity):
        raise section.refused(f"elements {low} to {high}, but a connectivity of {len(connectivity)} entries")
    if kind in (NGON, NFACE):
        starts, entries = _listed(section, connectivity, count)
        return [ListedElements(kind, section.name, starts, entries, low, _parents(section, count))]
    if kind == MIXED:
        return _mixed(section, connectivity, low, count, numbered)
    if kind not in _NAMES:
        raise section.refused(
            f"elements of CGNS' type {kind}; known are {', '.join(TYPES.values())} of first and second "
            "order, MIXED, NGON_n and NFACE_n",
            "save the mesh with first-order elements",
        )
    width = _WIDTHS[kind]
    if len(connectivity) != count * width:
        raise section.refused(f"{count} elements of {width} nodes, but a connectivity of {len(connectivity)} entries")
    nodes, numbers = connectivity.reshape(count, width) - 1, np.arange(low, high + 1)
    parents = None if connectivity.any() else _cell_and_side(section, count)
    return [Elements(_NAMES[kind], nodes, numbers, section.name, parents)]


def _array(section: Node, name: str) -> Integers:
    """Read an array that the section must have."""
    found = section.child(name)
    if found is None:
        raise section.refused(f"it has no {name}")
    return found.integers()


def _first(section: Node, values: Integers, count: int) -> Integers:
    """The first ``count`` values of an array; refuse a shorter array."""
    if len(values) < count:
        raise section.refused(f"an array of {len(values)} values, expected {count}")
    return values[:count]


def _offsets(section: Node, size: int, count: int) -> Integers | None:
    """(count + 1,) ``ElementStartOffset``, if the section has it."""
    if section.child("ElementStartOffset") is None:
        return None
    starts = _array(section, "ElementStartOffset")
    if len(starts) != count + 1 or starts[0] != 0 or starts[-1] != size or (np.diff(starts) < 1).any():
        raise section.refused(f"its ElementStartOffset does not increase from 0 to {size} for {count} elements")
    return starts


def _listed(section: Node, connectivity: Integers, count: int) -> tuple[Integers, Integers]:
    """Starts and entries of elements of variable length."""
    starts = _offsets(section, len(connectivity), count)
    if starts is not None:
        return starts, connectivity
    starts = np.empty(count + 1, dtype=np.int64)
    place, values = 0, connectivity.tolist()
    for element in range(count):
        starts[element] = place - element
        if place >= len(values) or not 0 < values[place] < len(values) - place:
            raise section.refused(f"element {element} of the section has no count, or fewer entries than its count")
        place += 1 + values[place]
    starts[count] = place - count
    if place != len(values):
        raise section.refused(f"{len(values) - place} entries follow the last element")
    return starts, np.delete(connectivity, starts[:-1] + np.arange(count))


def _mixed(
    section: Node, connectivity: Integers, low: int, count: int, numbered: Callable[[int], int]
) -> list[Elements | ListedElements]:
    """Elements of a MIXED section: the type precedes the nodes."""
    starts = _offsets(section, len(connectivity), count)
    if starts is None:
        starts = _walked(section, connectivity, count, numbered)
    kinds = np.array([numbered(kind) for kind in connectivity[starts[:-1]].tolist()])
    found: list[Elements | ListedElements] = []
    for kind in np.unique(kinds):
        rows = np.flatnonzero(kinds == kind)
        if int(kind) not in _NAMES:
            raise section.refused(
                f"element {low + int(rows[0])} of CGNS' type {int(kind)}; cells of first and second order are read"
            )
        width = _WIDTHS[int(kind)]
        if (np.diff(starts)[rows] != width + 1).any():
            raise section.refused(f"a {_NAMES[int(kind)]} with a number of nodes other than {width}")
        nodes = connectivity[starts[rows, None] + 1 + np.arange(width)] - 1
        found.append(Elements(_NAMES[int(kind)], nodes, low + rows, section.name))
    return found


def _walked(section: Node, connectivity: Integers, count: int, numbered: Callable[[int], int]) -> Integers:
    """(count + 1,) start of each element of a MIXED section, found from the types before the nodes."""
    starts = np.empty(count + 1, dtype=np.int64)
    place, values = 0, connectivity.tolist()
    for element in range(count):
        starts[element] = place
        kind = numbered(values[place]) if place < len(values) else 0
        if kind not in _WIDTHS:
            raise section.refused(
                f"element {element} of the section is of CGNS' type {kind}; cells of first and second order are read"
            )
        place += 1 + _WIDTHS[kind]
    starts[count] = place
    if place != len(values):
        raise section.refused(f"{count} elements have {place} entries, but the connectivity {len(values)}")
    return starts


def _parents(section: Node, count: int) -> Integers | None:
    """(count, 2) the cells on both sides of each face; HDF5 has the arrays of CGNS transposed."""
    return _pairs(section, "ParentElements", count)


def _cell_and_side(section: Node, count: int) -> Integers | None:
    """(count, 2) the cell of each face, and which of its sides the face is."""
    cells, sides = (_pairs(section, f"ParentElements{what}", count) for what in ("", "Position"))
    return None if cells is None or sides is None else np.column_stack([cells[:, 0], sides[:, 0]])


def _pairs(section: Node, name: str, count: int) -> Integers | None:
    """(count, 2) an array about both sides of each face, if the section has it."""
    node = section.child(name)
    if node is None:
        return None
    values = node.integers()
    if len(values) != 2 * count:
        raise section.refused(f"{count} faces, but {len(values)} values in {name}")
    return values.reshape(2, count).T
