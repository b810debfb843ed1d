"""VTK's legacy files, ``# vtk DataFile``: all grids, in text and binary, of versions 1 to 5.1.

https://docs.vtk.org/en/latest/design_documents/VTKFileFormats.html#legacy-file-format
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from numpy.typing import NDArray

from mesh_motion_server.files.moved import Place
from mesh_motion_server.files.text import integer, number_array, real, text_of
from mesh_motion_server.files.vtk.grid import POLYHEDRON, CellFaces, VtkGrid, lattice, structured_cells

_TYPES = {
    "bit": "u1", "unsigned_char": "u1", "char": "i1", "unsigned_short": "u2", "short": "i2", "unsigned_int": "u4",
    "int": "i4", "unsigned_long": "u8", "long": "i8", "float": "f4", "double": "f8", "vtkidtype": "i4",
    "signed_char": "i1",
    "int1": "i4",  # earlier FreeFEM: the type and the number of components without a blank
    **{f"vtktypeint{8 * size}": f"i{size}" for size in (1, 2, 4, 8)},
    **{f"vtktypeuint{8 * size}": f"u{size}" for size in (1, 2, 4, 8)},
    "vtktypefloat32": "f4", "vtktypefloat64": "f8",
}  # fmt: skip
_KINDS = ("UNSTRUCTURED_GRID", "STRUCTURED_GRID", "RECTILINEAR_GRID", "STRUCTURED_POINTS")
_WIDTHS = {"VECTORS": 3, "NORMALS": 3, "TENSORS": 9, "TENSORS6": 6, "GLOBAL_IDS": 1, "PEDIGREE_IDS": 1, "EDGE_FLAGS": 1}


@dataclass(eq=False)
class Legacy:
    """The content read so far; ``places`` of the points, if the file lists the points."""

    kind: str = ""
    counts: list[int] = field(default_factory=list)
    points: Floats = field(default_factory=lambda: np.empty((0, 3)))
    places: list[Place] = field(default_factory=list)
    axes: dict[str, Floats] = field(default_factory=dict)
    spacing: list[float] = field(default_factory=lambda: [1.0] * 3)
    origin: list[float] = field(default_factory=lambda: [0.0] * 3)
    cells: tuple[Integers, Integers] | None = None
    types: Integers = field(default_factory=lambda: np.empty(0, np.int64))
    arrays: dict[str, dict[str, NDArray[np.generic]]] = field(
        default_factory=lambda: {"POINT_DATA": {}, "CELL_DATA": {}}
    )

    def grid(self) -> VtkGrid:
        """The grid."""
        points, types, cells = self.points, self.types, self.cells
        if self.kind != "UNSTRUCTURED_GRID":
            if self.kind == "RECTILINEAR_GRID":
                points = lattice([self.axes.get(f"{axis}_COORDINATES", np.zeros(1)) for axis in "XYZ"])
            elif self.kind == "STRUCTURED_POINTS":
                ranges = zip(self.origin, self.spacing, self.counts, strict=True)
                points = lattice(
                    [(start + step * np.arange(count)).astype(np.float64) for start, step, count in ranges]
                )
            if len(points) != np.prod(self.counts, dtype=np.int64):
                raise ValueError(f"{len(points)} points, but DIMENSIONS {self.counts}")
            code, nodes = structured_cells(self.counts)
            types = np.full(len(nodes), code)
            cells = nodes.shape[1] * np.arange(len(nodes) + 1), nodes.ravel()
        if cells is None:
            raise ValueError("it has no CELLS")
        rows = np.flatnonzero(types == POLYHEDRON)
        faces = CellFaces.of_streams(cells[1], cells[0][:-1][rows], rows) if len(rows) else None
        return VtkGrid(points, types, *cells, self.arrays["POINT_DATA"], self.arrays["CELL_DATA"], faces)


def read_legacy(data: bytes) -> Legacy:
    """Read a file. Raises ValueError for surfaces (POLYDATA), unknown keywords, and values that do not fit."""
    file = _Cursor(data)
    if not file.line().startswith("# vtk DataFile"):
        raise ValueError("it does not begin with '# vtk DataFile'")
    file.line(blank=True)
    form = file.line()
    if form.upper() not in ("ASCII", "BINARY"):
        raise ValueError(f"its third line is {form[:30]!r}, expected ASCII or BINARY")
    file.binary = form.upper() == "BINARY"
    content, owner, rows = Legacy(), "", 0
    while line := file.line():
        words = line.split()
        key = words[0].upper()
        if key in ("POINT_DATA", "CELL_DATA"):
            owner, rows = key, integer(words[1])
        elif key == "METADATA":
            file.skip_metadata()
        elif owner or key == "FIELD":
            _read_array(file, content.arrays.get(owner, {}), key, words, rows)
        else:
            _read_structure(file, content, key, words)
    return content


def _read_structure(file: "_Cursor", content: Legacy, key: str, words: list[str]) -> None:
    """A section before the data."""
    match key:
        case "DATASET":
            content.kind = words[1].upper()
            if content.kind not in _KINDS:
                surface = "a surface (POLYDATA)" if content.kind == "POLYDATA" else f"a grid of type {content.kind}"
                raise ValueError(f"{surface}, expected {', '.join(_KINDS)}")
        case "DIMENSIONS":
            content.counts = [integer(word) for word in words[1:4]]
        case "SPACING" | "ASPECT_RATIO":
            content.spacing = [real(word) for word in words[1:4]]
        case "ORIGIN":
            content.origin = [real(word) for word in words[1:4]]
        case "POINTS":
            content.places = [file.place(integer(words[1]), words[2])]
            content.points = file.values(3 * integer(words[1]), words[2]).astype(np.float64).reshape(-1, 3)
            if not file.binary:
                content.places = [Place(integer(words[1]), 0, 3, text=(content.places[0].text[0], file.position))]
        case "X_COORDINATES" | "Y_COORDINATES" | "Z_COORDINATES":
            content.axes[key] = file.values(integer(words[1]), words[2]).astype(np.float64)
        case "CELLS":
            content.cells = _read_cells(file, integer(words[1]), integer(words[2]))
        case "CELL_TYPES":
            content.types = file.values(integer(words[1]), "int").astype(np.int64)
        case _:
            raise ValueError(f"the keyword {words[0][:30]!r} is not known")


def _read_cells(file: "_Cursor", count: int, size: int) -> tuple[Integers, Integers]:
    """The start of each cell's nodes, and the nodes."""
    begin = file.position
    words = file.line().split()
    if words[:1] == ["OFFSETS"]:
        offsets = file.values(count, words[1]).astype(np.int64)
        words = file.line().split()
        return offsets, file.values(size, words[1]).astype(np.int64)
    file.position = begin
    listed = file.values(size, "int").astype(np.int64)
    starts, place, numbers = np.empty(count + 1, np.int64), 0, listed.tolist()
    for cell in range(count):
        starts[cell] = place - cell
        if place >= size or not 0 < numbers[place] < size - place:
            raise ValueError(f"cell {cell} has no number of nodes, or fewer nodes than it says")
        place += 1 + numbers[place]
    starts[count] = place - count
    return starts, np.delete(listed, starts[:-1] + np.arange(count))


def _read_array(file: "_Cursor", arrays: dict[str, Any], key: str, words: list[str], rows: int) -> None:
    """An array of point or cell data; ``rows`` values or vectors."""
    if key == "SCALARS":
        width = integer(words[3]) if len(words) > 3 else 1
        begin = file.position
        if not file.line().startswith("LOOKUP_TABLE"):
            file.position = begin
        arrays[words[1]] = file.values(rows * width, words[2]).reshape(rows, width)
    elif key == "FIELD":
        for _ in range(integer(words[2])):
            while (head := file.line().split())[:1] == ["METADATA"]:
                file.skip_metadata()
            if head[3].lower() == "string":
                file.skip_texts(integer(head[1]) * integer(head[2]))
                continue
            arrays[head[0]] = file.values(integer(head[1]) * integer(head[2]), head[3]).reshape(
                integer(head[2]), integer(head[1])
            )
    elif key == "LOOKUP_TABLE":
        file.values(4 * integer(words[2]), "unsigned_char" if file.binary else "float")
    elif key == "COLOR_SCALARS":
        width = integer(words[2])
        values = file.values(rows * width, "unsigned_char" if file.binary else "float").reshape(rows, width)
        arrays[words[1]] = (
            values if file.binary else np.rint(255 * values).astype(np.int64)
        )  # bytes; text has parts of 255
    elif key in _WIDTHS or key == "TEXTURE_COORDINATES":
        width = integer(words[2]) if key == "TEXTURE_COORDINATES" else _WIDTHS[key]
        arrays[words[1]] = file.values(rows * width, words[-1]).reshape(rows, width)
    else:
        raise ValueError(f"the keyword {words[0][:30]!r} is not known")


class _Cursor:
    """Lines and values of a file, one after the other."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self.position = 0
        self.binary = False

    def line(self, *, blank: bool = False) -> str:
        """The next line that is not blank, or just the next one; "" at the end of the file."""
        while self.position < len(self._data):
            end = self._data.find(b"\n", self.position)
            end = len(self._data) if end < 0 else end
            text = text_of(self._data[self.position : end]).strip()
            self.position = end + 1
            if text or blank:
                return text
        return ""

    def skip_metadata(self) -> None:
        """Skip the lines to the next blank one."""
        while self.line(blank=True):
            pass

    def skip_texts(self, count: int) -> None:
        """Skip texts: lines; in binary after their length, whose first two bits say how many bytes it has."""
        for _ in range(count):
            if not self.binary:
                self.line(blank=True)
            elif self.position < len(self._data):
                width = 8 >> (self._data[self.position] >> 6)
                head = int.from_bytes(self._data[self.position : self.position + width], "big")
                self.position += width + head % (1 << (8 * width - 2))

    def place(self, count: int, kind: str) -> Place:
        """The place of ``count`` points that follow; for text, its begin."""
        if self.binary:
            dtype = np.dtype(">" + _TYPES[kind.lower()])
            return Place(count, self.position, 3 * dtype.itemsize, dtype=dtype.str)
        return Place(count, 0, 3, text=(self.position, self.position))

    def values(self, count: int, kind: str) -> NDArray[Any]:
        """The next ``count`` values of a type."""
        if kind.lower() not in _TYPES or count < 0:
            raise ValueError(f"{count} values of type {kind[:20]!r}")
        dtype = np.dtype(">" + _TYPES[kind.lower()])
        if not self.binary:
            return number_array(self._words(count), np.float64 if dtype.kind == "f" else np.int64)
        size = -(-count // 8) if kind.lower() == "bit" else count * dtype.itemsize
        found = self._data[self.position : self.position + size]
        if len(found) < size:
            raise ValueError(f"{count} values of type {kind} go beyond the file")
        self.position += size
        return (
            np.unpackbits(np.frombuffer(found, np.uint8))[:count]
            if kind.lower() == "bit"
            else np.frombuffer(found, dtype)
        )

    def _words(self, count: int) -> list[bytes]:
        """The next words; a word and its blank have at least two bytes. NGSolve ends no line before a keyword."""
        words: list[bytes] = []
        while len(words) < count and self.position < len(self._data):
            end = self._data.find(b"\n", self.position + 2 * (count - len(words)) - 2)
            end = len(self._data) if end < 0 else end
            line = self._data[self.position : end]
            words += line.split()
            surplus = len(words) - count
            if surplus > 0 and words[count][:1].isalpha():
                end = self.position + len(line.rsplit(None, surplus)[0])
                del words[count:]
            self.position = end + 1
        if len(words) != count:
            raise ValueError(
                f"{count} values are expected, but {'only ' if len(words) < count else ''}{len(words)} are found"
            )
        return words
