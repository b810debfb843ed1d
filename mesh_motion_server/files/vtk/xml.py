"""VTK's XML files: unstructured and structured grids, with values as text, in base64, or appended, compressed or not.

https://docs.vtk.org/en/latest/design_documents/VTKFileFormats.html
"""

import base64
import lzma
import math
import re
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_protocol.errors import InvalidInput
from numpy.typing import NDArray

from mesh_motion_server.files.packages import check_unpacked, most_unpacked
from mesh_motion_server.files.text import integer, number_array
from mesh_motion_server.files.vtk.grid import POLYHEDRON, CellFaces, VtkGrid, structured_cells

_APPENDED = re.compile(rb"<AppendedData\s[^>]*encoding\s*=\s*[\"'](raw|base64)[\"'][^>]*>\s*_")
_END = b"</AppendedData>"
_POINTS = re.compile(rb"(<Points\b[^>]*>\s*)<DataArray\b([^>]*?)(?:/>|>.*?</DataArray\s*>)", re.DOTALL)
_ASCII = re.compile(rb"format\s*=\s*[\"']ascii")
#: How a compressor unpacks in steps, and packs.
_COMPRESSORS: dict[str, tuple[Callable[[], Any], Callable[[bytes], bytes]]] = {
    "vtkZLibDataCompressor": (zlib.decompressobj, zlib.compress),
    "vtkLZMADataCompressor": (lzma.LZMADecompressor, lzma.compress),
}
_OF_FILES = "give one of the files that it names"
_ANY = -1  # a list of any length
_BY_PARAVIEW = "convert it with ParaView's filter Append Datasets, and save the result as .vtu"
_WAYS_IN = {
    **dict.fromkeys(("Collection", "vtkMultiBlockDataSet"), _OF_FILES),
    **dict.fromkeys(("vtkPartitionedDataSet", "vtkPartitionedDataSetCollection"), _OF_FILES),
    **dict.fromkeys(("ImageData", "RectilinearGrid"), _BY_PARAVIEW),
    **dict.fromkeys(("PImageData", "PRectilinearGrid", "PStructuredGrid"), _BY_PARAVIEW),
    **dict.fromkeys(("PolyData", "PPolyData"), "a surface has no cells of a volume: mesh the space around it"),
}
_TYPES = {
    **{f"Float{bits}": f"f{bits // 8}" for bits in (32, 64)},
    **{f"{sign}Int{bits}": f"{kind}{bits // 8}" for sign, kind in (("", "i"), ("U", "u")) for bits in (8, 16, 32, 64)},
}


def read_xml(path: Path) -> list[VtkGrid]:
    """The pieces of a ``.vtu`` or ``.vts`` file.

    Raises InvalidInput for other kinds of files. Raises ValueError for damaged files; errors of XML, zlib and lzma are
    passed on.
    """
    raw = path.read_bytes()
    values = _Values(path, raw)
    kind = values.root.get("type")
    if kind not in ("UnstructuredGrid", "StructuredGrid"):
        message = f"{path}: a VTK file of type {kind}, expected UnstructuredGrid or StructuredGrid"
        raise InvalidInput(message, hint=_WAYS_IN.get(str(kind), ""))
    read = _unstructured if kind == "UnstructuredGrid" else _structured
    pieces = [piece for grid in values.root.iter(kind) for piece in grid.findall("Piece")]
    if not pieces:
        raise ValueError("it has no Piece")
    return [read(values, piece) for piece in pieces]


def with_points(path: Path, raw: bytes, points: list[Floats]) -> bytes:
    """The file with other points (n, 3) of each piece, in double precision; everything else is the same.

    They are written between the tags of their array, as text or in base64, because the data of other arrays would move
    otherwise.
    """
    values, new = _Values(path, raw), iter(points)
    appended = _APPENDED.search(raw)
    end = appended.start() if appended else len(raw)

    def changed(found: re.Match[bytes]) -> bytes:
        form, text = values.written(next(new), as_text=_ASCII.search(found[2]) is not None)
        head = b'<DataArray type="Float64" Name="Points" NumberOfComponents="3" format="%s">' % form
        return b"%s%s\n%s\n</DataArray>" % (found[1], head, text)

    return _POINTS.sub(changed, raw[:end]) + raw[end:]


def _unstructured(values: "_Values", piece: ElementTree.Element) -> VtkGrid:
    if not integer(piece.get("NumberOfCells", "0")):
        return _grid(values, piece, _points(values, piece), *(np.zeros(size, dtype=np.int64) for size in (0, 1, 0)))
    cells = values.arrays(piece, "Cells", ("offsets", "types"))
    offsets = np.concatenate([[0], cells["offsets"].astype(np.int64)])
    nodes = values.arrays(piece, "Cells", ("connectivity",), rows=int(offsets[-1]))["connectivity"]
    types = cells["types"].astype(np.int64)
    grid = _grid(values, piece, _points(values, piece), types, offsets, nodes.astype(np.int64))
    return replace(grid, faces=_faces(values, piece, types)) if (types == POLYHEDRON).any() else grid


def _faces(values: "_Values", piece: ElementTree.Element, types: Integers) -> CellFaces:
    """The faces of the polyhedra: in files before version 2.3 a list of all faces of each cell."""

    def listed(name: str, rows: int | None = None) -> Integers:
        return values.arrays(piece, "Cells", (name,), rows)[name].astype(np.int64)

    if values.has(piece, "Cells", "faces"):
        rows = np.flatnonzero(types == POLYHEDRON)
        ends = listed("faceoffsets")[rows]
        return CellFaces.of_streams(listed("faces", int(ends[-1])), np.concatenate([[0], ends[:-1]]), rows)
    face_ends, cell_ends = listed("face_offsets", _ANY), listed("polyhedron_offsets")
    nodes, faces = listed("face_connectivity", int(face_ends[-1])), listed("polyhedron_to_faces", int(cell_ends[-1]))
    return CellFaces.of_lists(nodes, face_ends, faces, cell_ends)


def _structured(values: "_Values", piece: ElementTree.Element) -> VtkGrid:
    extent = [integer(word) for word in piece.get("Extent", "").split()]
    if len(extent) != 6:
        raise ValueError(f"a piece of the extent {piece.get('Extent')!r}, expected six numbers")
    counts = [high - low + 1 for low, high in zip(extent[::2], extent[1::2], strict=True)]
    points = _points(values, piece)
    if len(points) != math.prod(counts):  # check before cells are made from announced counts
        raise ValueError(f"{len(points)} points, but a piece of the extent {piece.get('Extent')!r}")
    code, nodes = structured_cells(counts)
    offsets = nodes.shape[1] * np.arange(len(nodes) + 1)
    return _grid(values, piece, points, np.full(len(nodes), code), offsets, nodes.ravel())


def _points(values: "_Values", piece: ElementTree.Element) -> Floats:
    points = values.arrays(piece, "Points")
    if len(points) != 1:
        raise ValueError(f"{len(points)} arrays of points, expected one")
    (xyz,) = points.values()
    return xyz.reshape(-1, 3).astype(np.float64)


def _grid(values: "_Values", piece: ElementTree.Element, points: Floats, *cells: Integers) -> VtkGrid:
    types, offsets, nodes = cells
    data = values.arrays(piece, "PointData"), values.arrays(piece, "CellData")
    return VtkGrid(points, types, offsets, nodes, *data)


class _Values:
    """The arrays of one file."""

    def __init__(self, path: Path, raw: bytes) -> None:
        begin = _APPENDED.search(raw)
        self._path, self._packed, self._unpacked = path, len(raw), 0
        self._data, self._encoding = b"", ""
        if begin is not None:
            end = raw.rfind(_END)
            line = raw.rfind(b"\n", 0, end)  # the last line is not data
            self._data, self._encoding = raw[begin.end() : line if raw[line:end].isspace() else end], begin[1].decode()
            raw = raw[: begin.start()] + raw[end + len(_END) :]
        self.root = ElementTree.fromstring(raw)
        order = ">" if self.root.get("byte_order") == "BigEndian" else "<"
        self._order = order
        self._integer = np.dtype(order + ("u8" if self.root.get("header_type") == "UInt64" else "u4"))
        self._compressor = self.root.get("compressor")

    def arrays(
        self, piece: ElementTree.Element, section: str, names: tuple[str, ...] = (), rows: int | None = None
    ) -> dict[str, NDArray[np.generic]]:
        """The arrays of a section of a piece, all or those with these names; arrays of text are left out.

        ``rows`` is their length, unless it is that of the piece; -1 for any.
        """
        found = piece.find(section)
        arrays = found.findall("DataArray") if found is not None else []
        named = {array.get("Name", section): array for array in arrays if array.get("type") in _TYPES}
        if missing := sorted({*names} - named.keys()):
            raise ValueError(f"its {section} have no {missing[0]}")
        count = piece.get("NumberOfPoints" if section.startswith("Point") else "NumberOfCells")
        rows = integer(count) if rows is None and count is not None else rows
        return {name: self._array(name, named[name], rows) for name in names or named}

    def has(self, piece: ElementTree.Element, section: str, name: str) -> bool:
        """Whether a section of a piece has an array with this name."""
        return any(array.get("Name") == name for array in piece.iterfind(f"{section}/DataArray"))

    def written(self, values: Floats, *, as_text: bool) -> tuple[bytes, bytes]:
        """The format and the text of an array, as :meth:`arrays` reads it."""
        if as_text:
            return b"ascii", "\n".join(" ".join(map(repr, row)) for row in values.tolist()).encode()
        data = values.astype(self._order + "f8").tobytes()
        if not self._compressor:
            return b"binary", base64.b64encode(np.array([len(data)], self._integer).tobytes() + data)
        packed = _COMPRESSORS[self._compressor][1](data)
        head = np.array([1, len(data), 0, len(packed)], self._integer)  # one block, which is not a part of one
        return b"binary", base64.b64encode(head.tobytes()) + base64.b64encode(packed)

    def _array(self, name: str, array: ElementTree.Element, rows: int | None) -> NDArray[np.generic]:
        dtype = np.dtype(self._order + _TYPES[array.get("type", "")])
        text = (array.text or "").strip()
        width = integer(array.get("NumberOfComponents", "1"))
        try:
            if array.get("format") == "ascii":
                values = number_array(text.split(), dtype)
            else:
                most = most_unpacked(self._packed) if rows in (None, _ANY) else rows * max(width, 1) * dtype.itemsize
                values = np.frombuffer(self._bytes(array, text, most), dtype)
            if rows and rows != _ANY and values.size != rows * max(width, 1):  # half of a mesh is not a mesh
                raise ValueError(f"{values.size} values, but {rows * max(width, 1)} are expected")
            return values.reshape(-1, width) if width > 1 else values
        except ValueError as error:
            raise ValueError(f"array {name!r}: {error}") from None

    def _bytes(self, array: ElementTree.Element, text: str, most: int) -> bytes:
        if array.get("format") != "appended":
            return self._unpack(text.encode(), most, coded=True) if text else b""
        return self._unpack(self._data[integer(array.get("offset", "0")) :], most, coded=self._encoding == "base64")

    def _unpack(self, data: bytes, most: int, *, coded: bool) -> bytes:
        """Unpack the values after their header: the number of bytes, or the number of blocks and of the bytes of each.

        At most ``most`` bytes are unpacked.
        """
        size = self._integer.itemsize
        count = int(np.frombuffer(_taken(data, 0, size, coded=coded), self._integer)[0])
        if not self._compressor:
            begin, pad = 4 * -(-size // 3), b"=" * (-size % 3)
            if coded and data[:begin].endswith(pad):  # DUNE and hpGEM encode the length by itself, as VTK reads it, too
                return _taken(data, begin, count, coded=True)
            if size + count > len(data):  # MEDCoupling writes four other bytes instead of the length
                count = min(count, most)
            return _taken(data, 0, size + count, coded=coded)[size:]
        if self._compressor not in _COMPRESSORS:  # a text names one, too, but does not use it
            raise InvalidInput(
                f"{self._path}: compressed by {self._compressor}; known are {', '.join(_COMPRESSORS)}",
                hint="save it with the compressor ZLib: an option of ParaView, SetCompressorTypeToZLib in VTK",
            )
        if not count:
            return b""
        head = size * (3 + count)
        sizes = np.frombuffer(_taken(data, 0, head, coded=coded), self._integer)[3:].tolist()
        blocks = _taken(data, 4 * -(-head // 3) if coded else head, sum(sizes), coded=coded)
        unpacked, begin, left = [], 0, most
        for length in sizes:
            room = min(left, most_unpacked(self._packed) - self._unpacked) + 1
            unpacked.append(_COMPRESSORS[self._compressor][0]().decompress(blocks[begin : begin + length], room))
            begin, left, self._unpacked = begin + length, left - len(unpacked[-1]), self._unpacked + len(unpacked[-1])
            check_unpacked(self._path, self._packed, self._unpacked)
            if left < 0:
                raise ValueError(f"it holds more than the {most} bytes that are expected")
        return b"".join(unpacked)


def _taken(data: bytes, place: int, count: int, *, coded: bool) -> bytes:
    """``count`` bytes from ``place`` on; in base64 if ``coded``."""
    found = base64.b64decode(data[place : place + 4 * -(-count // 3)])[:count] if coded else data[place : place + count]
    if len(found) < count:
        raise ValueError(f"{count} bytes go beyond the data")
    return found
