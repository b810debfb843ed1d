"""Medit's ``.mesh`` in text and ``.meshb``, as FreeFEM, Mmg, TetGen and refine write them.

References of faces (in 2D: edges) are patches; reference 0 is not a patch. Sections of other things (corners, ridges,
normals) are not used.

Frey, "MEDIT: an interactive mesh visualization software", INRIA RT-0253 (2001); libMeshb's list of keywords
"""

import math
import re
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.mesh.cells import CELL_TYPES
from mesh_motion_protocol.errors import InvalidInput
from numpy.typing import NDArray

from mesh_motion_server.files.format import Format
from mesh_motion_server.files.mesh_file import MeshFile, assemble_elements, by_name, named_groups
from mesh_motion_server.files.moved import Place, edit, replaced
from mesh_motion_server.files.text import integer, number_array

#: Our type, and the number of nodes, by keyword. Elements of second order have their corners first.
_ELEMENTS = {
    "Edges": ("line", 2), "Triangles": ("triangle", 3), "Quadrilaterals": ("quad", 4), "Tetrahedra": ("tetra", 4),
    "Hexahedra": ("hexahedron", 8), "Hexaedra": ("hexahedron", 8), "Prisms": ("wedge", 6), "Pentahedra": ("wedge", 6),
    "Pyramids": ("pyramid", 5), "EdgesP2": ("line", 3), "TrianglesP2": ("triangle", 6),
    "QuadrilateralsQ2": ("quad", 9), "TetrahedraP2": ("tetra", 10), "HexahedraQ2": ("hexahedron", 27),
    "PrismsP2": ("wedge", 18), "PyramidsP2": ("pyramid", 14),
}  # fmt: skip
#: Numbers of nodes that elements of second order may have; Gmsh writes them with the keywords of first order.
_SECOND = {"triangle": (6,), "quad": (8, 9), "tetra": (10,), "hexahedron": (20, 27), "wedge": (15, 18),
           "pyramid": (13, 14), "line": (3,)}  # fmt: skip
_OF_OTHER_ORDER = re.compile(r"(Edges|Triangles|Quadrilaterals|Tetrahedra|Hexahedra|Prisms|Pyramids)[PQ]\d")
#: BAMG writes sizes as hVertices.
_KEYWORD = re.compile(rb"(?:^|(?<=\s))h?[A-Z][A-Za-z0-9]*(?=\s|$)")


#: Keywords by their numbers in binary files.
_NUMBERS = {
    3: "Dimension", 4: "Vertices", 5: "Edges", 6: "Triangles", 7: "Quadrilaterals", 8: "Tetrahedra", 9: "Prisms",
    10: "Hexahedra", 24: "TrianglesP2", 25: "EdgesP2", 27: "QuadrilateralsQ2", 30: "TetrahedraP2", 33: "HexahedraQ2",
    49: "Pyramids", 86: "PrismsP2", 87: "PyramidsP2", 88: "QuadrilateralsQ3", 89: "QuadrilateralsQ4",
    90: "TrianglesP3", 91: "TrianglesP4", 92: "EdgesP3", 93: "EdgesP4", 96: "TetrahedraP3", 97: "TetrahedraP4",
    98: "HexahedraQ3", 99: "HexahedraQ4", 100: "PyramidsP3", 101: "PyramidsP4", 102: "PrismsP3", 103: "PrismsP4",
}  # fmt: skip
_BINARY = re.compile(rb"\A(\x01\0\0\0[\x01-\x04]\0\0\0|\0\0\0\x01\0\0\0[\x01-\x04])")


@dataclass(frozen=True, eq=False)
class _Binary:
    """A binary file, and where the number of rows of each keyword stands."""

    data: bytes
    places: dict[str, int]
    integer: np.dtype[np.signedinteger]  # of counts, nodes and references
    real: np.dtype[np.floating]

    @classmethod
    def of(cls, data: bytes) -> "_Binary":
        order = "<" if data[0] else ">"
        version = _number(data, 4, np.dtype(f"{order}i4"))
        position = np.dtype(f"{order}i{4 if version < 3 else 8}")
        places, place = {}, 8
        while place:
            keyword, after = _number(data, place, np.dtype(f"{order}i4")), _number(data, place + 4, position)
            if keyword in _NUMBERS:
                places[_NUMBERS[keyword]] = place + 4 + position.itemsize
            if after and not place < after < len(data):
                raise ValueError(f"keyword {keyword} at byte {place} says that the next one is at byte {after}")
            place = after
        integer, real = np.dtype(f"{order}i{4 if version < 4 else 8}"), np.dtype(f"{order}f{4 if version < 2 else 8}")
        return cls(data, places, integer, real)

    @property
    def width(self) -> int:
        """Number of coordinates."""
        width = _number(self.data, self._place("Dimension"), np.dtype(f"{self.integer.byteorder}i4"))
        if width not in (2, 3):
            raise ValueError(f"Dimension {width}, expected 2 or 3")
        return width

    def points(self) -> Floats:
        """(n, d) the vertices."""
        row = np.dtype([("x", self.real, (self.width,)), ("reference", self.integer)])
        return self._rows("Vertices", row)["x"].astype(np.float64)

    def rows(self, keyword: str, width: int, wider: tuple[int, ...] = ()) -> Integers:
        """(m, width) the numbers of a section."""
        del wider  # in a binary file each keyword has one width
        return self._rows(keyword, np.dtype((self.integer, (width,)))).astype(np.int64)

    def moved(self, points: Floats) -> bytes:
        """The file with other coordinates of the vertices."""
        first = self._place("Vertices") + self.integer.itemsize
        stride = self.width * self.real.itemsize + self.integer.itemsize
        return replaced(self.data, [Place(len(points), first, stride, dtype=self.real.str)], points)

    def _rows(self, keyword: str, row: np.dtype[Any]) -> NDArray[Any]:
        place = self._place(keyword)
        count, first = _number(self.data, place, self.integer), place + self.integer.itemsize
        if not 0 <= count <= (len(self.data) - first) // max(row.itemsize, 1):
            raise ValueError(f"{count} {keyword} go beyond the end of the file")
        return np.frombuffer(self.data, row.base, count * math.prod(row.shape), first).reshape(count, *row.shape)

    def _place(self, keyword: str) -> int:
        if keyword not in self.places:
            raise ValueError(f"there is no {keyword}")
        return self.places[keyword]


def _number(data: bytes, place: int, dtype: np.dtype[Any]) -> int:
    """The whole number at a place."""
    if place + dtype.itemsize > len(data):
        raise ValueError(f"it ends after {len(data)} bytes")
    return int(np.frombuffer(data, dtype, 1, place)[0])


@dataclass(frozen=True, eq=False)
class _Sections:
    """The file with blanks instead of comments and texts, and the begin and end of the text after each keyword."""

    whole: bytes
    data: bytes  # the same with blanks
    places: dict[str, tuple[int, int]]

    @classmethod
    def of(cls, whole: bytes) -> "_Sections":
        data = re.sub(rb'#[^\n]*|"[^"\n]*"', lambda other: b" " * len(other[0]), whole)
        found = [*_KEYWORD.finditer(data)]
        ends = [match.start() for match in found[1:]] + [len(data)]
        return cls(whole, data, {m[0].decode(): (m.end(), end) for m, end in zip(found, ends, strict=True)})

    @property
    def width(self) -> int:
        """Number of coordinates."""
        words = self._words("Dimension")
        if words[:1] not in ([b"2"], [b"3"]):
            raise ValueError(f"Dimension {b' '.join(words[:1]).decode()!r}, expected 2 or 3")
        return integer(words[0])

    def points(self) -> Floats:
        """(n, d) the vertices."""
        return self._numbers("Vertices", self.width + 1)[:, :-1]

    def rows(self, keyword: str, width: int, wider: tuple[int, ...] = ()) -> Integers:
        """(m, width) the numbers of a section; of another width of ``wider`` if it has as many."""
        words = self._words(keyword)
        count, given = integer(words[0]) if words else 0, len(words) - 1
        width = next((other for other in wider if given == count * other > 0), width)
        return self._numbers(keyword, width).astype(np.int64)

    def moved(self, points: Floats) -> bytes:
        """The file with other coordinates of the vertices, without comments between them."""
        begin, end = self.places["Vertices"]
        place = Place(len(points), 1, self.width + 1, text=(0, end - begin))
        return self.whole[:begin] + replaced(self.data[begin:end], [place], points) + self.whole[end:]

    def _numbers(self, keyword: str, width: int) -> Floats:
        words = self._words(keyword)
        count = integer(words[0]) if words else 0
        if len(words) - 1 != count * width:
            raise ValueError(f"{count} {keyword} of {width} numbers, but {max(len(words) - 1, 0)} numbers")
        return number_array(words[1:], np.float64).reshape(count, width)

    def _words(self, keyword: str) -> list[bytes]:
        if keyword not in self.places:
            raise ValueError(f"there is no {keyword}")
        return self.data[slice(*self.places[keyword])].split()


def _read(path: Path) -> MeshFile:
    """Read a mesh. Raises InvalidInput for elements of third and higher order, and for malformed sections."""
    try:
        return _mesh(path, _content(path.read_bytes()))
    except (ValueError, OverflowError) as error:
        raise InvalidInput(f"{path}: malformed Medit mesh: {error}") from None


def _content(data: bytes) -> _Binary | _Sections:
    return _Binary.of(data) if _BINARY.match(data) else _Sections.of(data)


def _mesh(path: Path, file: _Binary | _Sections) -> MeshFile:
    points = file.points()
    elements: list[tuple[str, Integers]] = []
    references: list[Integers] = []
    for keyword in file.places:
        if keyword in _ELEMENTS:
            name, count = _ELEMENTS[keyword]
            rows = file.rows(keyword, count + 1, tuple(wider + 1 for wider in _SECOND[name]))
            wrong = np.argwhere((rows[:, :-1] < 1) | (rows[:, :-1] > len(points)))
            if len(wrong):
                row, node = int(wrong[0, 0]), int(rows[tuple(wrong[0])])
                raise ValueError(f"row {row + 1} of {keyword} names vertex {node}, but there are 1 to {len(points)}")
            elements.append((name, rows[:, :-1] - 1))
            references.append(rows[:, -1])
        elif _OF_OTHER_ORDER.fullmatch(keyword):
            raise ValueError(f"elements {keyword}; known are {', '.join(_ELEMENTS)}")
    dimension = max((CELL_TYPES[name].dimension for name, nodes in elements if len(nodes)), default=0)
    found: dict[tuple[int, int | str], list[Integers]] = defaultdict(list)
    for (name, nodes), of in zip(elements, references, strict=True):
        if CELL_TYPES[name].dimension == dimension - 1:
            for reference in np.unique(of[of != 0]).tolist():
                found[dimension - 1, reference].append(nodes[of == reference].ravel())
    named = named_groups({key: np.concatenate(some) for key, some in found.items()})
    return assemble_elements(path, points, elements, by_name(named)[0])


def _move(source: Path, target: Path, points: Floats) -> None:
    """Write the file with other coordinates of the vertices."""
    edit(source, target, lambda data: _content(data).moved(points))


MEDIT = Format(
    "a Medit mesh",
    (".mesh", ".meshb"),
    re.compile(rb"\A((\s|#.*\n)*MeshVersionFormatted|" + _BINARY.pattern.removeprefix(rb"\A") + rb")"),
    _read,
    move=_move,
)
