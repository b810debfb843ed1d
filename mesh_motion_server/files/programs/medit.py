"""Medit's ``.mesh`` in text, as FreeFEM, Mmg and TetGen write it. References of faces (in 2D: edges) are patches.

Reference 0 is no patch. Sections of other things (corners, ridges, normals) are not used.

Frey, "MEDIT: an interactive mesh visualization software", INRIA RT-0253 (2001); libMeshb's list of keywords
"""

import re
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.mesh.cells import CELL_TYPES
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.files.format import Format
from mesh_motion_server.files.mesh_file import MeshFile, assemble_elements, by_name, named_groups
from mesh_motion_server.files.moved import Place, edit, replaced
from mesh_motion_server.files.text import integer, number_array

__all__ = ["MEDIT"]

#: Our type, and the number of nodes, by keyword. Elements of second order have their corners first.
_ELEMENTS = {
    "Edges": ("line", 2), "Triangles": ("triangle", 3), "Quadrilaterals": ("quad", 4), "Tetrahedra": ("tetra", 4),
    "Hexahedra": ("hexahedron", 8), "Hexaedra": ("hexahedron", 8), "Prisms": ("wedge", 6), "Pentahedra": ("wedge", 6),
    "Pyramids": ("pyramid", 5), "EdgesP2": ("line", 3), "TrianglesP2": ("triangle", 6),
    "QuadrilateralsQ2": ("quad", 9), "TetrahedraP2": ("tetra", 10), "HexahedraQ2": ("hexahedron", 27),
    "PrismsP2": ("wedge", 18), "PyramidsP2": ("pyramid", 14),
}  # fmt: skip
_OF_OTHER_ORDER = re.compile(r"(Edges|Triangles|Quadrilaterals|Tetrahedra|Hexahedra|Prisms|Pyramids)[PQ]\d")
_KEYWORD = re.compile(rb"(?:^|(?<=\s))[A-Z][A-Za-z0-9]*(?=\s|$)")


@dataclass(frozen=True, eq=False)
class _Sections:
    """The file with blanks instead of comments and texts, and begin and end of what follows each keyword."""

    data: bytes
    places: dict[str, tuple[int, int]]

    @classmethod
    def of(cls, data: bytes) -> "_Sections":
        data = re.sub(rb'#[^\n]*|"[^"\n]*"', lambda other: b" " * len(other[0]), data)
        found = [*_KEYWORD.finditer(data)]
        ends = [match.start() for match in found[1:]] + [len(data)]
        return cls(data, {m[0].decode(): (m.end(), end) for m, end in zip(found, ends, strict=True)})

    @property
    def width(self) -> int:
        """Number of coordinates."""
        words = self._words("Dimension")
        if words[:1] not in ([b"2"], [b"3"]):
            raise ValueError(f"Dimension {b' '.join(words[:1]).decode()!r}, expected 2 or 3")
        return integer(words[0])

    def rows(self, keyword: str, width: int) -> Floats:
        """(m, width) the numbers of a section."""
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
        return _mesh(path, _Sections.of(path.read_bytes()))
    except (ValueError, OverflowError) as error:
        raise InvalidInput(f"{path}: malformed Medit mesh: {error}") from None


def _mesh(path: Path, file: _Sections) -> MeshFile:
    points = file.rows("Vertices", file.width + 1)[:, :-1]
    elements: list[tuple[str, Integers]] = []
    references: list[Integers] = []
    for keyword in file.places:
        if keyword in _ELEMENTS:
            name, count = _ELEMENTS[keyword]
            rows = file.rows(keyword, count + 1).astype(np.int64)
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
    """Write the file with other coordinates of the vertices, without comments between them."""

    def changed(data: bytes) -> bytes:
        file = _Sections.of(data)
        begin, end = file.places["Vertices"]
        place = Place(len(points), 1, file.width + 1, text=(0, end - begin))
        return data[:begin] + replaced(file.data[begin:end], [place], points) + data[end:]

    edit(source, target, changed)


MEDIT = Format("a Medit mesh", (".mesh",), re.compile(rb"\A(\s|#.*\n)*MeshVersionFormatted"), _read, move=_move)
