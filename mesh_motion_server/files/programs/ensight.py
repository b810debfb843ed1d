"""EnSight Gold: a case, or its geometry in text or C binary. Parts of surface elements become patches.

Each part has its own nodes; nodes of two parts at one place are one node of the mesh. Binary files have coordinates of
single precision.

EnSight User Manual, chapter 9, "EnSight Gold Casefile Format"
"""

import math
import re
from collections import defaultdict
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.mesh.cells import CELL_TYPES
from mesh_motion_protocol.errors import InvalidInput
from numpy.typing import NDArray

from mesh_motion_server.files.format import Format
from mesh_motion_server.files.mesh_file import MeshFile, assemble_elements, by_name
from mesh_motion_server.files.moved import companions, edit
from mesh_motion_server.files.replace import replacing
from mesh_motion_server.files.text import integer, real, text_of
from mesh_motion_server.files.vtk.grid import KNOWN_TYPES, CellFaces, lattice, structured_cells
from mesh_motion_server.files.vtk.pieces import numbering
from mesh_motion_server.files.vtk.polyhedra import Numbered, simple_elements

_SHAPES = {"point": "", "bar": "line", "tria": "triangle", "quad": "quad", "tetra": "tetra", "pyramid": "pyramid",
           "penta": "wedge", "hexa": "hexahedron"}  # fmt: skip
_ELEMENTS = re.compile(r"(g_)?([a-z]+?)(\d*)")
_BLOCK = re.compile(r"block((?:\s+(?:curvilinear|rectilinear|uniform|iblanked|with_ghost|range))*)")
_MODEL = re.compile(rb"(?im)^(\s*model:(?:[ \t]+\d+){0,2}[ \t]+)(\"[^\"\n]+\"|[^\s\"]+)(.*)$")


class _Text:
    """The items of a file in text: lines, and rows of numbers."""

    def __init__(self, data: bytes) -> None:
        self.lines = data.decode("utf-8", errors="surrogateescape").splitlines(keepends=True)
        self.place = 0
        self._ends: dict[int, int] = {}  # of the rows of numbers, by their first line

    @property
    def where(self) -> str:
        return f"line {self.place}"

    def text(self, *, free: bool = False) -> str:
        """The next line, of ``free`` text or one that is neither blank nor a comment; "" after the last one."""
        while self.place < len(self.lines):
            line = self.lines[self.place].strip()
            self.place += 1
            if free or (line and not line.startswith("#")):
                return text_of(line.encode("utf-8", errors="surrogateescape"))
        return ""

    def numbers(self, count: int, kind: type = int) -> NDArray[np.generic]:
        found, begin = list[float](), self.place
        while len(found) < count:
            if self.place >= len(self.lines):
                raise ValueError(f"the file ends where {count - len(found)} more numbers are expected")
            found += map(integer if kind is int else real, self.text().split())
        if len(found) > count:
            raise ValueError(f"{len(found)} numbers, expected {count}")
        self._ends[begin] = self.place
        return np.array(found, dtype=kind)

    def changed(self, places: list[tuple[int, Floats]]) -> bytes:
        """The file with other numbers, one a line, from these lines on."""
        for place, values in sorted(places, key=lambda one: -one[0]):
            self.lines[place : self._ends[place]] = [f" {value!r}\n" for value in values.tolist()]
        return "".join(self.lines).encode("utf-8", errors="surrogateescape")


class _Binary:
    """The items of a binary file: texts of 80 bytes, and numbers of 4."""

    def __init__(self, data: bytes) -> None:
        self.data, self.place, self.order = data, 80, ""

    @property
    def where(self) -> str:
        return f"byte {self.place}"

    def _take(self, size: int) -> bytes:
        self.place += size
        if not 0 <= size <= self.place <= len(self.data):
            raise ValueError(f"the file ends where {size} bytes are expected")
        return self.data[self.place - size : self.place]

    def text(self, *, free: bool = False) -> str:
        """The next text; "" after the last one."""
        del free
        if self.place >= len(self.data):
            return ""
        return text_of(self._take(80).split(b"\0")[0]).strip()

    def numbers(self, count: int, kind: type = int) -> NDArray[np.generic]:
        found = self._take(4 * count)
        if kind is int and not self.order:  # the file does not say it; its first integer is small, the number of a part
            self.order = ">" if int.from_bytes(found, "big") < int.from_bytes(found, "little") else "<"
        return np.frombuffer(found, f"{self.order}{'f' if kind is float else 'i'}4").astype(kind)

    def changed(self, places: list[tuple[int, Floats]]) -> bytes:
        content = bytearray(self.data)
        for place, values in places:
            content[place : place + 4 * len(values)] = values.astype(f"{self.order}f4").tobytes()
        return bytes(content)


@dataclass(eq=False)
class _Part:
    """Nodes (n, 3), the places of their x, y and z in the file, and elements: our type, and nodes (m, k)."""

    name: str
    points: Floats
    places: list[int]
    elements: list[tuple[str, Integers]] = field(default_factory=list)
    polygons: list[CellFaces] = field(default_factory=list)
    polyhedra: list[CellFaces] = field(default_factory=list)

    @property
    def dimension(self) -> int:
        """Of its elements; -1 without any."""
        simple = [_dimension(name) for name, nodes in self.elements if len(nodes)]
        return max([*simple, *(2 for _ in self.polygons), *(3 for _ in self.polyhedra)], default=-1)


def _dimension(name: str) -> int:
    return CELL_TYPES[name].dimension if name else 0


def _parts(path: Path) -> tuple[_Text | _Binary, list[_Part]]:
    data = path.read_bytes()
    if data[4:18].lower() == b"fortran binary":
        raise InvalidInput(f"{path}: EnSight's Fortran binary", hint="ParaView saves it with the ending .vtu")
    file = _Binary(data) if data[:8].lower() == b"c binary" else _Text(data)
    try:
        return file, _content(file)
    except (ValueError, OverflowError) as error:
        raise InvalidInput(f"{path}: malformed EnSight geometry: {file.where}: {error}") from None


def _content(file: _Text | _Binary) -> list[_Part]:
    if file.text(free=True).upper() == "BEGIN TIME STEP":
        file.text(free=True)
    file.text(free=True)
    nodes_given, elements_given = (_given(kind, file.text()) for kind in ("node", "element"))
    parts: list[_Part] = []
    line = file.text()
    if line.lower() == "extents":
        file.numbers(6, float)
        line = file.text()
    while line and line.upper() != "END TIME STEP":
        if line.lower() == "part":
            number = int(file.numbers(1)[0])
            name, kind = file.text(free=True) or f"part_{number}", file.text()
            if block := _BLOCK.fullmatch(kind.lower()):
                parts.append(_block(file, name, block[1].split()))
                line = file.text()
                continue
            if kind.lower() != "coordinates":
                raise ValueError(f"{kind[:40]!r} in the part {name!r}, expected its 'coordinates' or a block")
            count = int(file.numbers(1)[0])
            if nodes_given:
                file.numbers(count)
            parts.append(_coordinates(file, name, count))
        elif (match := _ELEMENTS.fullmatch(line.lower())) and parts:
            _read_elements(file, match, parts[-1], elements_given)
        else:
            of_six = ": it is EnSight 6's, of which ParaView makes .vtu" if line.lower() == "coordinates" else ""
            raise ValueError(f"{line[:40]!r}, expected a part or a type of elements{of_six}")
        line = file.text()
    return parts


def _coordinates(file: _Text | _Binary, name: str, count: int) -> _Part:
    """A part with the nodes that follow: all x, all y, all z."""
    axes = [(file.place, file.numbers(count, float).astype(np.float64)) for _ in range(3)]
    return _Part(name, np.column_stack([of for _, of in axes]), [place for place, _ in axes])


def _block(file: _Text | _Binary, name: str, flags: list[str]) -> _Part:
    """A structured part, the first direction fastest, without cells that have a blanked node or are ghosts."""
    counts = file.numbers(3).astype(np.int64).tolist()
    if "range" in flags:
        low, high = file.numbers(6).astype(np.int64).reshape(3, 2).T
        counts = (high - low + 1).tolist()
    if min(counts) < 1:
        raise ValueError(f"the part {name!r} has a block of {counts} nodes")
    if "rectilinear" in flags or "uniform" in flags:
        part = _Part(name, lattice(_axes(file, counts, "uniform" in flags)), [])
    else:
        part = _coordinates(file, name, math.prod(counts))
    code, nodes = structured_cells(counts)
    kept = np.ones(len(nodes), dtype=bool)
    if "iblanked" in flags:
        kept &= (file.numbers(len(part.points))[nodes] != 0).all(axis=1)
    if "with_ghost" in flags:
        file.text()  # ghost_flags
        kept &= file.numbers(len(nodes)) == 0
    for what, count in (("node_ids", len(part.points)), ("element_ids", len(nodes))):
        place = file.place
        if file.text().lower() == what:
            file.numbers(count)
        else:  # EnSight itself leaves them out
            file.place = place
    part.elements.append((KNOWN_TYPES.get(code, ""), nodes[kept]))
    return part


def _axes(file: _Text | _Binary, counts: list[int], uniform: bool) -> list[Floats]:
    """The coordinates along x, y and z of a block without a list of points."""
    if not uniform:
        return [file.numbers(count, float).astype(np.float64) for count in counts]
    origin, step = (file.numbers(3, float).astype(np.float64) for _ in range(2))
    return [begin + by * np.arange(count) for begin, by, count in zip(origin, step, counts, strict=True)]


def _given(kind: str, line: str) -> bool:
    """Whether the file has the numbers of its nodes or elements."""
    if (found := re.fullmatch(rf"(?i){kind} id (given|ignore|off|assign)", line)) is None:
        raise ValueError(f"{line[:40]!r}, expected '{kind} id' with one of: off, given, assign, ignore")
    return found[1].lower() in ("given", "ignore")


def _read_elements(file: _Text | _Binary, kind: re.Match[str], part: _Part, given: bool) -> None:
    """Add the next elements of a part to it; none of ghosts, which another part has."""
    ghost, name, digits = kind.groups()
    count = int(file.numbers(1)[0])
    if count < 0 or (name not in _SHAPES and name not in ("nsided", "nfaced")):
        raise ValueError(f"{count} elements {kind[0]!r}; known are {', '.join(_SHAPES)}, nsided, nfaced")
    if given:
        file.numbers(count)
    if name in _SHAPES:
        shape, width = _SHAPES[name], int(digits or 1)
        if shape and width < CELL_TYPES[shape].n_nodes:
            raise ValueError(f"elements {kind[0]!r} have too few nodes")
        found = _nodes(file, kind[0], part, count * width).reshape(-1, width)
        if not ghost:
            part.elements.append((shape, found))
        return
    counts = file.numbers(count).astype(np.int64)
    sizes = file.numbers(int(counts.sum())).astype(np.int64) if name == "nfaced" else counts
    if name == "nsided":
        counts = np.ones(count, np.int64)
    faces = CellFaces.of_counts(_nodes(file, kind[0], part, int(sizes.sum())), sizes, counts)
    if count and not ghost:
        (part.polyhedra if name == "nfaced" else part.polygons).append(faces)


def _nodes(file: _Text | _Binary, kind: str, part: _Part, count: int) -> Integers:
    """(count,) the nodes of elements, counted from 0."""
    found = file.numbers(count).astype(np.int64)
    wrong = np.flatnonzero((found < 1) | (found > len(part.points)))
    if len(wrong):
        node = int(found[wrong[0]])
        raise ValueError(f"part {part.name!r}, {kind}: node {node}, but its nodes are 1 to {len(part.points)}")
    return found - 1


def _geometry(case: Path, content: bytes) -> tuple[Path, str]:
    """The geometry of a case, and a note if it is the first of several."""
    if (found := _MODEL.search(content)) is None:
        raise InvalidInput(f"{case}: no 'model: FILE' in its section GEOMETRY")
    name = text_of(found[2]).strip('"')
    pattern = re.compile(re.sub(r"(\\\*)+", r"\\d+", re.escape(Path(name).name)))
    folder = (case.parent / name).parent
    files = sorted(file for file in folder.glob("*") if pattern.fullmatch(file.name)) if folder.is_dir() else []
    if not files:
        raise InvalidInput(f"{case}: its geometry {name!r} is missing", hint="keep the files of a case together")
    return files[0], f"{files[0].name} is read, the first of {len(files)} steps" if len(files) > 1 else ""


def _read_case(path: Path) -> MeshFile:
    """Read the mesh of a ``.case``; of a series its first step."""
    geometry, note = _geometry(path, path.read_bytes())
    mesh = _read(geometry)
    return replace(mesh, path=path, notes=(*mesh.notes, note) if note else mesh.notes)


def _numbered(path: Path, parts: list[_Part]) -> tuple[list[_Part], list[Integers], Floats]:
    """The parts, those with cells first; the mesh's node for each of their nodes; and the nodes of the cells (n, 3)."""
    dimension = max((part.dimension for part in parts), default=-1)
    parts = sorted((part for part in parts if part.dimension >= 0), key=lambda part: part.dimension < dimension)
    if not parts:
        raise InvalidInput(f"{path}: the mesh has no cells", hint="was the mesh saved before it was generated?")
    first = np.cumsum([0, *(len(part.points) for part in parts)])
    points = np.concatenate([part.points for part in parts])
    rows, kept = numbering(path, points, first) if len(parts) > 1 else (np.arange(len(points)), np.arange(len(points)))
    solid = int(first[sum(part.dimension == dimension for part in parts)])
    return parts, np.split(rows, first[1:-1]), points[kept[: int(rows[:solid].max()) + 1]]


def _read(path: Path) -> MeshFile:
    """Read a mesh from the geometry of a case.

    Raises InvalidInput for unknown elements and malformed files, and for polyhedra that cannot be divided.
    """
    parts, numbers, points = _numbered(path, _parts(path)[1])
    dimension, notes = parts[0].dimension, []
    elements: list[Numbered] = []
    polygons: list[CellFaces] = []
    polyhedra: list[CellFaces] = []
    for number, (part, rows) in enumerate(zip(parts, numbers, strict=True)):
        if (outside := _outside(part, rows, len(points))) > 0:
            notes.append(f"the part {part.name!r} has nodes that no cell has ({outside} elements): it is not a patch")
            continue
        elements += [(name, rows[nodes], np.full(len(nodes), number)) for name, nodes in part.elements]
        polygons += [replace(of, nodes=rows[of.nodes], cells=np.full_like(of.cells, number)) for of in part.polygons]
        polyhedra += [replace(of, nodes=rows[of.nodes]) for of in part.polyhedra]
    points, elements, _ = simple_elements(path, points, elements, polygons=polygons, polyhedra=polyhedra, groups={})
    found: dict[str, list[tuple[int, Integers]]] = defaultdict(list)
    for number, part in enumerate(parts):
        for name, nodes, own in elements:
            if _dimension(name) < dimension and (own == number).any():
                found[part.name].append((_dimension(name), nodes[own == number].ravel()))
    patches, of_names = by_name(found)
    mesh = assemble_elements(path, points, [(name, nodes) for name, nodes, _ in elements], patches)
    return replace(mesh, notes=(*mesh.notes, *notes, *of_names))


def _outside(part: _Part, rows: Integers, count: int) -> int:
    """The number of its elements that have nodes beyond the ``count`` nodes of the cells."""
    simple = [(rows[nodes] >= count).any(axis=1) for _, nodes in part.elements]
    faces = [np.add.reduceat(rows[of.nodes] >= count, of.first) > 0 for of in part.polygons]
    return sum(int(one.sum()) for one in (*simple, *faces))


def _move(source: Path, target: Path, points: Floats) -> None:
    """Write the geometry with other coordinates of the nodes."""
    file, parts = _parts(source)
    parts, numbers, own_points = _numbered(source, parts)
    places: list[tuple[int, Floats]] = []
    for part, rows in zip(parts, numbers, strict=True):
        own, moved = rows < len(own_points), part.points.copy()
        moved[own, : points.shape[1]] = points[rows[own]]
        if not part.places:
            raise InvalidInput(f"{source}: the block {part.name!r} has no list of points", hint="take .vtu")
        places += zip(part.places, moved.T, strict=True)
    edit(source, target, lambda _: file.changed(places))


def _move_case(source: Path, target: Path, points: Floats) -> None:
    """Write the case with the moved geometry in a file of the same name, without results."""
    content = source.read_bytes()
    geometry, name = _geometry(source, content)[0], f"{companions(target)}.geo"
    if (target.parent / name).resolve() == geometry.resolve() and source.resolve() != target.resolve():
        raise InvalidInput(f"{target}: {name} would replace the geometry of {source}", hint="take another name")
    _move(geometry, target.parent / name, points)
    quoted = f'"{name}"' if " " in name else name
    with replacing(target) as file:
        file.write(f"FORMAT\ntype: ensight gold\n\nGEOMETRY\nmodel: {quoted}\n".encode())


ENSIGHT = Format(
    "an EnSight case",
    (".case", ".encas"),
    re.compile(rb"(?i)\A(\s|#.*\n)*FORMAT\s+type:\s*ensight"),
    _read_case,
    move=_move_case,
)
ENSIGHT_GEOMETRY = Format(
    "EnSight's geometry",
    (".geo",),
    re.compile(rb"(?i)\A(C Binary|[\s\S]{4}Fortran Binary|(BEGIN TIME STEP.*\n)?.*\n.*\n\s*node id )"),
    _read,
    move=_move,
)
