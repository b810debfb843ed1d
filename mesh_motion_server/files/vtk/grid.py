"""The content of a VTK file: points, cells of all types in one list, and named arrays on both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers, Marks
from numpy.typing import NDArray

Arrays = dict[str, NDArray[np.generic]]

#: Our type, and the places of the corners, for VTK's type numbers. Cells of higher order have their corners first.
_CORNERS = {"line": 2, "triangle": 3, "quad": 4, "tetra": 4, "hexahedron": 8, "wedge": 6, "pyramid": 5}
_FIRST = {3: "line", 5: "triangle", 9: "quad", 10: "tetra", 12: "hexahedron", 13: "wedge", 14: "pyramid"}
_HIGHER = {
    21: "line", 22: "triangle", 23: "quad", 24: "tetra", 25: "hexahedron", 26: "wedge", 27: "pyramid", 28: "quad",
    29: "hexahedron", 30: "quad", 31: "wedge", 32: "wedge", 33: "hexahedron", 34: "triangle", 35: "line", 37: "pyramid",
    68: "line", 69: "triangle", 70: "quad", 71: "tetra", 72: "hexahedron", 73: "wedge", 74: "pyramid",
}  # fmt: skip
#: Our type for VTK's type numbers whose corners come first.
KNOWN_TYPES = _FIRST | _HIGHER
_ALIGNED = {8: ("quad", [0, 1, 3, 2]), 11: ("hexahedron", [0, 1, 3, 2, 4, 5, 7, 6])}  # pixel, voxel
_BOX = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
_VERTICES = (0, 1, 2)  # no cell, a vertex, several vertices
POLYGON, POLYHEDRON = 7, 42
#: Polylines and triangle strips: each node from the second or the third one on ends a line or a triangle.
_CHAINS = {4: "line", 6: "triangle"}
_OTHERS = {POLYGON: "polygons", 41: "polygons", POLYHEDRON: "polyhedra"}


def _ranges(first: Integers, sizes: Integers) -> Integers:
    """The numbers from ``first`` on, ``sizes`` of them, one range after the other."""
    return np.repeat(first - np.cumsum(sizes) + sizes, sizes) + np.arange(int(sizes.sum()))


@dataclass(frozen=True, eq=False)
class CellFaces:
    """Faces of cells. A face of two cells is given twice."""

    nodes: Integers  # (k,)
    #: first, sizes: (f,) each. The place of each face's first node in ``nodes``, and the number of its nodes
    first: Integers
    sizes: Integers
    cells: Integers  # (f,). The cell of each face

    @classmethod
    def of_cells(cls, nodes: Integers, offsets: Integers, rows: Integers) -> CellFaces:
        """Cells that are faces themselves: their nodes begin at their offsets."""
        return cls(nodes, offsets[rows], np.diff(offsets)[rows], rows).of_rows(np.arange(len(rows)))

    @classmethod
    def of_counts(cls, nodes: Integers, sizes: Integers, counts: Integers) -> CellFaces:
        """Faces of ``sizes`` nodes each, one after the other; each cell has the next ``counts`` faces.

        Raises ValueError if a cell has no face, a face has fewer than three nodes, or the sums do not fit.
        """
        if (few := np.flatnonzero(counts < 1)).size or (short := np.flatnonzero(sizes < 3)).size:
            what = f"polyhedron {few[0] + 1} has no faces" if few.size else f"face {short[0] + 1} has too few nodes"
            raise ValueError(what)
        if counts.sum() != len(sizes) or sizes.sum() != len(nodes):
            raise ValueError("the faces of the polyhedra do not fit their list")
        return cls(nodes, np.cumsum(sizes) - sizes, sizes, np.repeat(np.arange(len(counts)), counts))

    @classmethod
    def of_streams(cls, numbers: Integers, first: Integers, rows: Integers) -> CellFaces:
        """Faces of the cells ``rows``, which begin at ``first``: the number of faces, for each its size and nodes.

        Raises ValueError if a cell goes beyond the numbers.
        """

        def at(places: Integers) -> Integers:
            if (places >= len(numbers)).any():
                raise ValueError("the faces of a polyhedron go beyond their list")
            found: Integers = numbers[places]
            return found

        left, place, parts = at(first), first + 1, [np.empty((3, 0), np.int64)]
        while len(place := place[left > 0]):
            rows, left, sizes = rows[left > 0], left[left > 0] - 1, at(place)
            if (sizes < 3).any():
                raise ValueError(f"cell {int(rows[np.argmin(sizes)])} has a face of {int(sizes.min())} nodes")
            parts.append(np.stack([place + 1, sizes, rows]))
            place = place + 1 + sizes
        begin, sizes, cells = np.concatenate(parts, axis=1)
        at(begin + sizes - 1)
        return cls(numbers, begin, sizes, cells).of_rows(np.arange(len(sizes)))

    @classmethod
    def of_lists(cls, nodes: Integers, face_ends: Integers, faces: Integers, cell_ends: Integers) -> CellFaces:
        """Faces in one list, the faces of all cells in a second one; where each face and each cell ends."""
        first = np.concatenate([[0], face_ends])
        sizes = np.diff(np.concatenate([[0], cell_ends]))
        if sizes.min(initial=0) < 0 or len(faces) != sizes.sum() or (faces >= len(face_ends)).any():
            raise ValueError("the faces of the polyhedra do not fit their list")
        return cls(nodes, first[faces], np.diff(first)[faces], np.repeat(np.arange(len(sizes)), sizes))

    @classmethod
    def joined(cls, parts: Sequence[CellFaces]) -> CellFaces:
        """The faces of all parts."""
        starts = np.cumsum([0, *(len(part.nodes) for part in parts)])
        first = [part.first + start for part, start in zip(parts, starts, strict=False)]
        nodes, sizes, cells = ([getattr(part, name) for part in parts] for name in ("nodes", "sizes", "cells"))
        return cls(*(np.concatenate(each) for each in (nodes, first, sizes, cells)))

    def of_rows(self, rows: Integers) -> CellFaces:
        """Some of the faces; their nodes follow each other."""
        sizes = self.sizes[rows]
        nodes = self.nodes[_ranges(self.first[rows], sizes)]
        return CellFaces(nodes, np.cumsum(sizes) - sizes, sizes, self.cells[rows])

    def edges(self) -> tuple[Integers, Integers]:
        """(e, 2) the edges of all faces, in their direction, and (e,) the face of each."""
        rows = np.repeat(np.arange(len(self.sizes)), self.sizes)
        ahead = np.where(np.diff(rows, append=-1) != 0, 1 - self.sizes[rows], 1)
        places = _ranges(self.first, self.sizes)
        return np.column_stack([self.nodes[places], self.nodes[places + ahead]]), rows


@dataclass(frozen=True, eq=False)
class VtkGrid:
    """A grid, or one piece of it.

    Raises ValueError if the arrays do not fit together.
    """

    points: Floats  # (n, 3)
    types: Integers  # (m,). VTK's type number of each cell
    #: offsets, connectivity: (m + 1,), (k,). Start of each cell's nodes, and the nodes
    offsets: Integers
    connectivity: Integers
    #: point_arrays, cell_arrays: (n,) | (n, c), (m,) | (m, c)
    point_arrays: Arrays
    cell_arrays: Arrays
    faces: CellFaces | None = None  # of the polyhedra

    def __post_init__(self) -> None:
        sizes = np.diff(self.offsets)
        if len(self.offsets) != len(self.types) + 1 or (len(sizes) and (sizes.min() < 0 or self.offsets[0] != 0)):
            raise ValueError(
                f"{len(self.types)} cells, but their offsets do not increase from 0, or have another length"
            )
        if len(self.offsets) and self.offsets[-1] != len(self.connectivity):
            raise ValueError(f"cells of {int(self.offsets[-1])} nodes, but a connectivity of {len(self.connectivity)}")
        for arrays, count, what in (
            (self.point_arrays, len(self.points), "points"),
            (self.cell_arrays, len(sizes), "cells"),
        ):
            for name, values in arrays.items():
                if len(values) != count:
                    raise ValueError(f"array {name!r} has {len(values)} rows, but there are {count} {what}")

    def cells(self) -> list[tuple[str, Integers, Integers]]:
        """Yield our type's name, rows (m,) among all cells, and corner nodes (m, k), of each type of cell.

        Polylines and triangle strips have several rows with the same number.

        Raises ValueError for polygons, polyhedra and unknown types; for a cell with fewer nodes than its type has.
        """
        found, types = [], self.types.copy()
        for size, code in ((3, 5), (4, 9)):  # polygons that are triangles or quadrilaterals
            types[(types == POLYGON) & (np.diff(self.offsets) == size)] = code
        for code in np.unique(types).tolist():
            if code in _VERTICES:
                continue
            if code in _CHAINS:
                found.append(self._links(code))
                continue
            name, order = _ALIGNED.get(code, (_FIRST.get(code) or _HIGHER.get(code, ""), None))
            if not name:
                raise ValueError(f"cells of VTK's type {code} ({_OTHERS.get(code, 'of another shape')})")
            rows = np.flatnonzero(types == code)
            few = np.diff(self.offsets)[rows] < _CORNERS[name]
            if few.any():
                raise ValueError(f"cell {int(rows[few][0])} is of type {name}, but has fewer nodes")
            local = np.arange(_CORNERS[name]) if order is None else np.array(order)
            found.append((name, rows, self.connectivity[self.offsets[rows, None] + local]))
        return found

    def _links(self, code: int) -> tuple[str, Integers, Integers]:
        """The same for the parts of chains."""
        name, rows = _CHAINS[code], np.flatnonzero(self.types == code)
        counts = np.maximum(np.diff(self.offsets)[rows] - _CORNERS[name] + 1, 0)
        first = _ranges(self.offsets[rows], counts)
        nodes = self.connectivity[first[:, None] + np.arange(_CORNERS[name])]
        turned = (first - np.repeat(self.offsets[rows], counts)) % 2 == 1  # in a strip, every second triangle
        if name == "triangle":
            nodes[turned] = nodes[turned][:, [0, 2, 1]]
        return name, np.repeat(rows, counts), nodes

    def of_rows(self, rows: Integers) -> VtkGrid:
        """The grid with some of its cells."""
        sizes = np.diff(self.offsets)[rows]
        faces, number = self.faces, np.full(len(self.types), -1)
        number[rows] = np.arange(len(rows))
        if faces is not None:
            faces = faces.of_rows(np.flatnonzero(number[faces.cells] >= 0))
            faces = replace(faces, cells=number[faces.cells])
        return VtkGrid(
            self.points, self.types[rows], np.concatenate([[0], np.cumsum(sizes)]),
            self.connectivity[_ranges(self.offsets[rows], sizes)], self.point_arrays,
            {name: values[rows] for name, values in self.cell_arrays.items()}, faces,
        )  # fmt: skip

    @property
    def is_higher(self) -> Marks:
        """(m,) whether each cell has nodes between its corners."""
        return np.isin(self.types, list(_HIGHER))


def structured_cells(counts: Sequence[int]) -> tuple[int, Integers]:
    """VTK's type and nodes (m, k) of the cells in a block of ``counts`` nodes per direction, the first fastest."""
    sides = [count for count in counts if count > 1]
    number = np.arange(int(np.prod(sides, dtype=np.int64))).reshape(sides[::-1]).T
    parts = [
        number[tuple(slice(step, size - 1 + step) for step, size in zip(corner, sides, strict=False))]
        for corner in _BOX[: 2 ** len(sides)]
    ]
    nodes = np.stack([part.T.ravel() for part in parts], axis=1)
    return {1: 1, 2: 3, 4: 9, 8: 12}[len(parts)], nodes


def lattice(axes: Sequence[Floats]) -> Floats:
    """(n, 3) all points of one to three axes, the first fastest; zero on further axes."""
    columns = [of.ravel() for of in np.meshgrid(*axes[::-1], indexing="ij")][::-1]
    return np.pad(np.column_stack(columns), ((0, 0), (0, 3 - len(columns))))
