"""MFEM's meshes of versions 1.0, 1.2 and 1.3. Attributes of the boundary become patches, with names if they are in
sets.

Nodes of a curved mesh are its vertices, then the nodes on edges, on faces and inside. Edges and faces are in the order
in which the elements first name them.

https://mfem.org/mesh-format-v1.0, and mesh/mesh_readers.cpp, fem/geom.cpp (local edges and faces) of MFEM's sources.
"""

import re
from collections import defaultdict
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.mesh.cells import CELL_TYPES
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.files.format import Format
from mesh_motion_server.files.mesh_file import MeshFile, assemble_elements, by_corners, concatenated
from mesh_motion_server.files.moved import Place, edit, replaced
from mesh_motion_server.files.text import integer, number_array, text_of

_TYPES = {0: "", 1: "line", 2: "triangle", 3: "quad", 4: "tetra", 5: "hexahedron", 6: "wedge", 7: "pyramid"}
_EDGES: dict[str, list[tuple[int, ...]]] = {
    "line": [(0, 1)],
    "triangle": [(0, 1), (1, 2), (2, 0)],
    "quad": [(0, 1), (1, 2), (2, 3), (3, 0)],
    "tetra": [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)],
    "hexahedron": [(0, 1), (1, 2), (3, 2), (0, 3), (4, 5), (5, 6), (7, 6), (4, 7), (0, 4), (1, 5), (2, 6), (3, 7)],
    "wedge": [(0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)],
    "pyramid": [(0, 1), (1, 2), (3, 2), (0, 3), (0, 4), (1, 4), (2, 4), (3, 4)],
}
_FACES: dict[str, list[tuple[int, ...]]] = {
    "triangle": [(0, 1, 2)],
    "quad": [(0, 1, 2, 3)],
    "tetra": [(1, 2, 3), (0, 3, 2), (0, 1, 3), (0, 2, 1)],
    "hexahedron": [(3, 2, 1, 0), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7), (4, 5, 6, 7)],
    "wedge": [(0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)],
    "pyramid": [(3, 2, 1, 0), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)],
}
_COMMENT = re.compile(rb"(?m)^[ \t]*#.*$")
_WORD = re.compile(r'"((?:\\.|[^"\\])*)"|(\S+)')
_VERTICES = re.compile(rb"(?m)^[ \t]*vertices\s+(\d+)\s+(\S+)\s+")
_END = re.compile(rb"\s*mfem_mesh_end")
_NODES = re.compile(rb"\s*FiniteElementSpace\s+FiniteElementCollection:\s*(\S+)\s+VDim:\s*(\d+)\s+Ordering:\s*(\d+)\s+")
_ORDERS = {"Linear": 1, "Quadratic": 2, "Cubic": 3}

#: Our type, [[row in the section, attribute]] (m, 2) and nodes (m, k), for elements of one type.
_Block = tuple[str, Integers, Integers]


@dataclass(frozen=True, eq=False)
class _Coordinates:
    """The place of the numbers of ``count`` nodes in the file, and the order of the elements."""

    vertices: int
    count: int
    width: int
    by_axis: bool
    order: int
    text: tuple[int, int]
    values: Floats

    @property
    def points(self) -> Floats:
        """(n, width)."""
        return self.values.reshape(self.width, -1).T if self.by_axis else self.values.reshape(-1, self.width)


def _read(path: Path) -> MeshFile:
    """Read a mesh from ``.mesh``.

    Raises InvalidInput for nodes that are not continuous or are not points of the mesh (L2, NURBS), and for malformed
    sections.
    """
    try:
        return _mesh(path, path.read_bytes())
    except (ValueError, IndexError, OverflowError) as error:
        raise InvalidInput(f"{path}: malformed MFEM mesh: {error}") from None


def _mesh(path: Path, data: bytes) -> MeshFile:
    at = _coordinates(data)
    head = text_of(_COMMENT.sub(b"", data[: at.text[0]]))
    words = _Words([quoted or word for quoted, word in _WORD.findall(head)])
    elements, _ = words.section("elements")
    boundary, names = words.section("boundary")
    for what, blocks in (("elements", elements), ("boundary", boundary)):
        for _, rows, nodes in blocks:
            wrong = np.argwhere((nodes < 0) | (nodes >= at.vertices))
            if len(wrong):
                row, node = rows[wrong[0, 0], 0], nodes[tuple(wrong[0])]
                raise ValueError(f"row {row} of {what} names vertex {node}, but there are {at.vertices}")
    own = _boundary_nodes(elements, boundary, at)
    patches: dict[str, list[Integers]] = defaultdict(list)
    for (_, rows, _), nodes in zip(boundary, own, strict=True):
        for attribute in np.unique(rows[:, 1]).tolist():
            for name in names.get(attribute, [str(attribute)]):
                patches[name].append(nodes[rows[:, 1] == attribute].ravel())
    cells = [(name, nodes) for name, _, nodes in elements]
    mesh = assemble_elements(path, at.points, cells, concatenated(patches))
    return replace(mesh, notes=(*mesh.notes, *by_corners(mesh.n_cells * (at.order > 1))))


class _Words:
    """The words of a file before its coordinates."""

    def __init__(self, words: list[str]) -> None:
        self._words = words
        if self._words[3:4] != ["dimension"]:
            raise ValueError("it has no dimension after its first line")

    def section(self, title: str) -> tuple[list[_Block], dict[int, list[str]]]:
        """[(type, [[row, attribute]] (m, 2), nodes (m, k))] of a section, and {attribute: names of its sets}."""
        try:
            place = self._words.index(title) + 1
        except ValueError:
            raise ValueError(f"there is no {title}") from None
        found: dict[str, list[list[int]]] = defaultdict(list)
        count = integer(self._words[place])
        place += 1
        for row in range(count):
            attribute, code = (integer(word) for word in self._words[place : place + 2])
            if code not in _TYPES:
                raise ValueError(f"row {row} of {title} is of geometry {code}, expected 0 to 7")
            name = _TYPES[code]
            size = CELL_TYPES[name].n_nodes if name else 1
            nodes = [integer(word) for word in self._words[place + 2 : place + 2 + size]]
            if len(nodes) < size:
                raise ValueError(f"{title} end in row {row} of {count}")
            found[name].append([row, attribute, *nodes])
            place += 2 + size
        blocks = []
        for name, listed in found.items():
            rows = np.array(listed, dtype=np.int64)
            blocks.append((name, rows[:, :2], rows[:, 2:]))
        return blocks, self._sets(place)

    def _sets(self, place: int) -> dict[int, list[str]]:
        """{attribute: names of the sets that have it}, if the file continues with sets."""
        found: dict[int, list[str]] = defaultdict(list)
        if not self._words[place : place + 1] or not self._words[place].endswith("attribute_sets"):
            return found
        count, place = integer(self._words[place + 1]), place + 2
        for _ in range(count):
            name, size = self._words[place], integer(self._words[place + 1])
            for word in self._words[place + 2 : place + 2 + size]:
                found[integer(word)].append(name)
            place += 2 + size
        return found


def _coordinates(data: bytes) -> _Coordinates:
    """The place and the kind of the coordinates."""
    begin = _VERTICES.search(data)
    if begin is None:
        raise ValueError("there are no vertices")
    vertices, order, by_axis, start = int(begin[1]), 1, False, begin.end()
    if begin[2] == b"nodes":
        space = _NODES.match(data, start)
        if space is None:
            raise ValueError("its nodes are no FiniteElementSpace")
        name, width, by_axis, start = space[1].decode(), int(space[2]), space[3] == b"0", space.end()
        known = re.fullmatch(r"H1_\dD_P(\d+)", name)
        order = int(known[1]) if known else _ORDERS.get(name, 0)
        if not order:
            raise ValueError(f"its nodes are of {name}; only continuous ones are read: H1, Linear, Quadratic, Cubic")
    else:
        width = int(begin[2])
    end = _END.search(data, start)
    text = (start, end.start() if end else len(data))
    values = number_array(data[slice(*text)].split(), np.float64)
    count = len(values) // max(width, 1)
    if width not in (1, 2, 3) or count * width != len(values) or (order == 1 and count != vertices):
        expected = f"{vertices * width}" if order == 1 else f"a multiple of {width}"
        raise ValueError(f"{vertices} vertices with {width} coordinates: {len(values)} numbers, expected {expected}")
    return _Coordinates(vertices, count, width, by_axis, order, text, values)


def _boundary_nodes(elements: list[_Block], boundary: list[_Block], at: _Coordinates) -> list[Integers]:
    """(m, k) nodes of each block of the boundary: its vertices and the nodes between them."""
    found = [[nodes] for _, _, nodes in boundary]
    if at.order > 1:
        first = at.vertices
        for sides, sizes in ((_EDGES, {2: 1}), (_FACES, {3: at.order - 2, 4: 2 * (at.order - 1)})):
            # (order - 1) nodes on an edge, (order - 1) (order - 2) / 2 in a triangle, (order - 1)² in a quadrilateral
            counts = {size: (at.order - 1) * factor // (1 + (size > 2)) for size, factor in sizes.items()}
            blocks = [*elements, *boundary]
            if sides is _FACES and max(CELL_TYPES[name].dimension for name, _, _ in elements if name) < 3:
                break
            numbers, total = _numbered(sides, counts, blocks, len(elements))
            for own, starts in zip(found, numbers[len(elements) :], strict=True):
                own += [
                    first + start[:, None] + np.arange(count) for column in starts for start, count in [column] if count
                ]
            first += total
        if first > at.count:
            raise ValueError(f"{at.count} nodes, expected at least {first} of order {at.order}")
    return [np.concatenate(own, axis=1) for own in found]


def _numbered(
    sides: dict[str, list[tuple[int, ...]]], counts: dict[int, int], blocks: list[_Block], n_elements: int
) -> tuple[list[list[tuple[Integers, int]]], int]:
    """For each block and local side: the first node (m,) on it and their number; and the number of nodes on all sides.

    Sides are numbered in the order in which the elements first name them; the blocks after ``n_elements`` are those of
    the boundary.
    """
    keys, places, sizes = [], [], []
    for number, (name, rows, nodes) in enumerate(blocks):
        for local, corners in enumerate(sides.get(name, ())):
            key = np.full((len(nodes), 4), -1, dtype=np.int64)
            key[:, : len(corners)] = np.sort(nodes[:, corners], axis=1)
            keys.append(key)
            places.append(
                np.column_stack([np.full(len(nodes), number >= n_elements), rows[:, 0], 0 * rows[:, 0] + local])
            )
            sizes.append(np.full(len(nodes), counts[len(corners)]))
    if not keys:
        return [[] for _ in blocks], 0
    place = np.concatenate(places)
    order = np.lexsort(place.T[::-1])
    _, first, inverse = np.unique(np.concatenate(keys)[order], axis=0, return_index=True, return_inverse=True)
    if place[order][first, 0].any():
        row = place[order][first[place[order][first, 0] == 1][0], 1]
        raise ValueError(f"row {row} of boundary is on no element")
    size = np.concatenate(sizes)[order][first]
    by_first = np.argsort(first)
    start = np.empty(len(first), dtype=np.int64)
    start[by_first] = np.cumsum([0, *size[by_first]])[:-1]
    starts = np.empty(len(place), dtype=np.int64)
    starts[order] = start[inverse.ravel()]
    found, done = [], 0
    for name, _, nodes in blocks:
        own = []
        for corners in sides.get(name, ()):
            own.append((starts[done : done + len(nodes)], counts[len(corners)]))
            done += len(nodes)
        found.append(own)
    return found, int(size.sum())


def _move(source: Path, target: Path, points: Floats) -> None:
    """Write the file with other coordinates of the nodes."""

    def changed(data: bytes) -> bytes:
        at = _coordinates(data)
        if not at.by_axis:
            return replaced(data, [Place(at.count, 0, at.width, text=at.text)], points)
        axes = [Place(at.count, axis * at.count, 1, text=at.text) for axis in range(points.shape[1])]
        return replaced(data, axes, points.T.reshape(-1, 1))

    edit(source, target, changed)


MFEM = Format("an MFEM mesh", (".mesh", ".mfem"), re.compile(rb"\AMFEM mesh v1\.[023]\s"), _read, move=_move)
