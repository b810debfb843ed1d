"""Fluent's meshes: ``.msh`` and ``.cas``, ASCII and binary, and ``.msh.h5`` and ``.cas.h5``, its form in HDF5.

The mesh is a list of faces with the cell on either side. Zones of faces become patches with their names, except zones
of inner faces. In text, ``(index header body)`` is a section; numbers of headers and faces are hexadecimal.

Fluent User's Guide, appendix "Mesh File Format"; https://github.com/Kitware/VTK/tree/master/IO/FLUENTCFF for HDF5.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.files.format import Format
from mesh_motion_server.files.hdf5 import array_of, opened_hdf5, whole_of
from mesh_motion_server.files.mesh_file import MeshFile, assemble
from mesh_motion_server.files.moved import Place, copied_hdf5, edit, replaced
from mesh_motion_server.files.polyhedra.cells import find_cells
from mesh_motion_server.files.polyhedra.face_mesh import from_sides
from mesh_motion_server.files.polyhedra.pieces import divide
from mesh_motion_server.files.polyhedra.polygons import polygons
from mesh_motion_server.files.text import integer, number_array, text_of

_INTERIOR = 2
_ROLES = {7: "symmetry", 37: "symmetry", 8: "periodic", 12: "periodic"}
_KINDS = {3: "wall", 4: "pressure-inlet", 5: "pressure-outlet", 7: "symmetry", 8: "periodic-shadow",
          9: "pressure-far-field", 10: "velocity-inlet", 12: "periodic", 14: "fan", 20: "mass-flow-inlet",
          24: "interface", 31: "parent", 36: "outflow", 37: "axis"}  # fmt: skip
#: Number of nodes of faces with a fixed number; with 0 and 5 the number is given before each face.
_OF_ANY_SIZE = (0, 5)
_SECTION = re.compile(rb"\s*\((\d+)\s*")
_HEADER = re.compile(rb"\(([^()]*)\)\s*")
_NAME = re.compile(rb"\s*\(\s*(\d+)\s+(\S+)\s+([^\s()]+)")
_BRACKET = re.compile(rb'[()]|"(?:[^"\\]|\\.)*"')
_NODES, _FACES = {10: "", 2010: "f4", 3010: "f8"}, {13: "", 2013: "i4", 3013: "i8"}
_BODY_END = re.compile(rb"\s*\)(?:\s*End of Binary Section\s+\d+)?\s*\)")
#: Sections from this number on are binary.
_BINARY = 2000
_NAMES, _TREES = (39, 45), (58, 59)


@dataclass(frozen=True)
class _Zone:
    """Faces ``first`` … ``last``, counted from 1."""

    number: int
    first: int
    last: int
    kind: int


@dataclass(eq=False)
class _Content:
    """The content of the file, in the order of the file.

    nodes : [(first, (m, d) coordinates)]; places : where these stand
    faces : [(first, (m,) numbers of nodes, (k,) nodes counted from 1, (m, 2) cells c0 and c1 counted from 1)]
    """

    dimension: int = 3
    nodes: list[tuple[int, Floats]] = field(default_factory=list)
    places: list[Place] = field(default_factory=list)
    faces: list[tuple[int, Integers, Integers, Integers]] = field(default_factory=list)
    zones: list[_Zone] = field(default_factory=list)
    names: dict[int, str] = field(default_factory=dict)


def _read_text(path: Path) -> MeshFile:
    """Read ``.msh`` or ``.cas``. Raises InvalidInput for hanging nodes and inconsistent data; names the section."""
    data = path.read_bytes()
    if data.startswith(b'(1 "meshio '):
        raise InvalidInput(
            f"{path}: cells without faces, written by meshio as 'ansys'; Fluent's meshes are lists of faces",
            hint="let meshio write another format, for example .vtu",
        )
    try:
        return _mesh(path, _read_sections(data))
    except (ValueError, IndexError, OverflowError) as error:
        raise InvalidInput(f"{path}: malformed Fluent mesh: {error}") from None


def _read_sections(data: bytes) -> _Content:
    """Read all sections; those that do not describe the mesh are skipped."""
    content, position = _Content(), 0
    while section := _SECTION.match(data, position):
        index = int(section[1])
        header = _HEADER.match(data, section.end())
        has_body = header is not None and data[header.end() : header.end() + 1] == b"("
        words = header[1].split() if header and has_body and index in (*_NODES, *_FACES) else []
        if header and words and integer(words[0], 16):
            read = _read_nodes if index in _NODES else _read_faces
            numbers = [integer(word, 16) for word in words]
            position = _behind(data, read(content, data, header.end() + 1, numbers, (_NODES | _FACES)[index]))
            continue
        if index % 1000 in _TREES:
            raise ValueError("an adapted mesh with hanging nodes; save it without adaption")
        if index > _BINARY and has_body:  # brackets in its numbers do not count
            last = re.compile(rb"\)\s*End of Binary Section\s+%d\s*\)" % index).search(data, section.end())
            if last is None:
                raise ValueError(f"the section at byte {section.start()} does not end")
            position = last.end()
            continue
        position = _end(data, section.start() + data[section.start() : section.end()].index(b"("))
        if index == 2:
            content.dimension = int(data[section.end() : position - 1])
            if content.dimension not in (2, 3):
                raise ValueError(f"{content.dimension} dimensions, expected 2 or 3")
        elif index in _NAMES and (name := _NAME.match(data, section.end())):
            content.names[int(name[1])] = text_of(name[3])
    if data[position:].strip():
        raise ValueError(f"no section begins after byte {position}: {data[position : position + 30]!r}")
    return content


def _end(data: bytes, start: int) -> int:
    """The place after the bracket that closes the one at ``start``; brackets in strings do not count."""
    depth = 0
    for bracket in _BRACKET.finditer(data, start):
        depth += {b"(": 1, b")": -1}.get(bracket[0], 0)
        if depth == 0:
            return bracket.end()
    raise ValueError(f"the section at byte {start} does not end")


def _behind(data: bytes, end: int) -> int:
    """The place after a section whose body ends at ``end``."""
    found = _BODY_END.match(data, end)
    if found is None:
        raise ValueError(f"the section before byte {end} does not have the length that its header states")
    return found.end()


def _read_nodes(content: _Content, data: bytes, start: int, header: list[int], kind: str) -> int:
    """Read a section of nodes: zone, first and last node, type, and the number of coordinates; return its end."""
    _, first, last, *more = header
    width = more[1] if len(more) > 1 else content.dimension
    count = (last - first + 1) * width
    values, end = _values(data, start, count, kind, lambda words: number_array(words, np.float64))
    if kind:
        size = np.dtype(kind).itemsize
        content.places.append(Place(last - first + 1, start, width * size, dtype=f"<{kind}"))
    else:
        content.places.append(Place(last - first + 1, 0, width, text=(start, end)))
    if len(values) != count:
        raise ValueError(f"nodes {first} to {last} are {count} coordinates, but {len(values)} follow")
    content.nodes.append((first, values.reshape(-1, width)))
    return end


def _read_faces(content: _Content, data: bytes, start: int, header: list[int], kind: str) -> int:
    """Read a section of faces: zone, first and last face, type of zone, nodes of each face; return its end."""
    zone, first, last, zone_type, face_type = header[:5]
    count = last - first + 1
    most, of_each = count * (2 + face_type) if face_type not in _OF_ANY_SIZE else -1, []
    if kind and most < 0:
        size = np.dtype(kind).itemsize
        rest = np.frombuffer(data, f"<{kind}", (len(data) - start) // size, start)
        of_each = _sizes(rest, first, last)
        most = sum(of_each) + 3 * count
    values, end = _values(
        data, start, most, kind, lambda words: np.array([integer(word, 16) for word in words], np.int64)
    )
    if face_type in _OF_ANY_SIZE:
        sizes = np.array(of_each or _sizes(values.tolist(), first, last), dtype=np.int64)
        if (more := len(values) - int(sizes.sum()) - 3 * count) > 0:
            raise ValueError(f"{more} numbers follow face {last}")
        starts = np.cumsum([0, *(sizes + 3)[:-1]])
        cells = np.stack([values[starts + sizes + 1], values[starts + sizes + 2]], axis=1)
        nodes = np.delete(values, np.concatenate([starts, starts + sizes + 1, starts + sizes + 2]))
    elif len(values) != most:
        raise ValueError(f"faces {first} to {last} are {most} numbers, but {len(values)} follow")
    else:
        rows = values.reshape(count, face_type + 2)
        sizes, nodes, cells = np.full(count, face_type), rows[:, :face_type].ravel(), rows[:, face_type:]
    content.zones.append(_Zone(zone, first, last, zone_type))
    content.faces.append((first, sizes, nodes, cells))
    return end


def _sizes(numbers: list[int] | Integers, first: int, last: int) -> list[int]:
    """The number of nodes that stands before each face."""
    found, place, count = [], 0, len(numbers)
    for face in range(first, last + 1):
        if place >= count or not 2 <= numbers[place] <= count - place - 3:
            raise ValueError(f"face {face} has no number of nodes, or fewer nodes than it says")
        found.append(int(numbers[place]))
        place += found[-1] + 3
    return found


def _values(data: bytes, start: int, count: int, kind: str, of_words: Callable[[list[bytes]], Any]) -> tuple[Any, int]:
    """The numbers of a body, and its end."""
    if not kind:
        end = data.index(b")", start)
        return of_words(data[start:end].split()), end
    dtype = np.dtype(f"<{kind}")
    if start + count * dtype.itemsize > len(data):
        raise ValueError(f"the section at byte {start} ends before all of its values")
    values = np.frombuffer(data, dtype, count, start)
    return values.astype(np.float64 if kind[0] == "f" else np.int64), start + values.nbytes


def _read_hdf5(path: Path) -> MeshFile:
    """Read ``.msh.h5`` or ``.cas.h5``. Raises InvalidInput without h5py, and for inconsistent data."""
    with opened_hdf5(path, "Fluent mesh") as file:
        if "meshes" not in file:
            raise InvalidInput(
                f"{path}: an HDF5 file without Fluent's group 'meshes'",
                hint="give the .xdmf that it belongs to; files of other programs end with .cgns, .med, .exo, .vtkhdf",
            )
        faces = file["meshes/1/faces"]
        content = _Content(int(np.ravel(file["meshes/1"].attrs["dimension"])[0]))
        for part in _parts(file["meshes/1/nodes/coords"]):
            content.nodes.append((_first(part), array_of(path, part, "f")))
        cells = [
            {_first(part): array_of(path, part, "iu") for part in _parts(faces[side])} if side in faces else {}
            for side in ("c0", "c1")
        ]
        last = int(np.max(whole_of(path, faces["zoneTopology/maxId"])))
        held = sum(len(part["nnodes"]) for part in _parts(faces["nodes"]))
        if last > held:
            raise InvalidInput(f"{path}: zones of {last} faces, but the file has {held}")
        both = np.zeros((last, 2), dtype=np.int64)
        for side, parts in enumerate(cells):
            for first, values in parts.items():
                both[first - 1 : first - 1 + len(values), side] = values
        for part in _parts(faces["nodes"]):
            sizes, nodes = array_of(path, part["nnodes"], "iu"), array_of(path, part["nodes"], "iu")
            first = _first(part)
            content.faces.append((first, sizes, nodes, both[first - 1 : first - 1 + len(sizes)]))
        topology = faces["zoneTopology"]
        numbers, names = whole_of(path, topology["id"]).tolist(), np.ravel(whole_of(path, topology["name"]))[0]
        listed = (text_of(names) if isinstance(names, bytes) else str(names)).split(";")
        content.names = dict(zip(numbers, listed, strict=False))
        columns = (whole_of(path, topology[key]).tolist() for key in ("minId", "maxId", "zoneType"))
        content.zones = [_Zone(*row) for row in zip(numbers, *columns, strict=True)]
        return _mesh(path, content)


def _parts(group: Any) -> Iterator[Any]:
    """The numbered parts of a group of HDF5."""
    yield from (group[name] for name in sorted((name for name in group if name.isdigit()), key=int))


def _first(part: Any) -> int:
    return int(np.ravel(part.attrs["minId"])[0])


def _mesh(path: Path, content: _Content) -> MeshFile:
    """The mesh of the content, with the nodes in the order of their numbers."""
    content.nodes.sort(key=lambda one: one[0])
    content.faces.sort(key=lambda one: one[0])
    for what, found in (("node", [(a, len(of)) for a, of in content.nodes]),
                        ("face", [(one[0], len(one[1])) for one in content.faces])):  # fmt: skip
        expected = 1
        for first, count in found:
            if first != expected:
                raise ValueError(f"{what} {expected} is expected, but {what} {first} follows")
            expected += count
        if expected == 1:
            raise ValueError(f"no {what}s")
    points = np.concatenate([of for _, of in content.nodes])
    sizes, nodes, cells = (np.concatenate([one[k] for one in content.faces]) for k in (1, 2, 3))
    nodes = nodes - 1
    wrong = np.flatnonzero((nodes < 0) | (nodes >= len(points)))
    if len(wrong):
        face = int(np.searchsorted(np.cumsum(sizes), wrong[0], side="right")) + 1
        raise ValueError(
            f"face {face} names node {int(nodes[wrong[0]]) + 1}, but there are the nodes 1 to {len(points)}"
        )
    of_zone = {zone.number: np.arange(zone.first - 1, zone.last) for zone in content.zones if zone.kind != _INTERIOR}
    if content.dimension == 2:
        points, simple, facets = _plane(points[:, :2], nodes, sizes, cells)
    else:
        points, simple, facets = _volume(path, points, nodes, sizes, cells)
    kinds = {zone.number: zone.kind for zone in content.zones}
    names = {number: content.names.get(number, f"{_KINDS.get(kinds[number], 'zone')}-{number}") for number in of_zone}
    patches = {names[number]: facets(faces) for number, faces in of_zone.items() if len(faces)}
    marked = {names[number]: _ROLES[kinds[number]] for number in of_zone if kinds[number] in _ROLES}
    return replace(assemble(path, points, simple, patches), marked=marked)


_Facets = Callable[[Integers], Integers]


def _plane(
    points: Floats, nodes: Integers, sizes: Integers, cells: Integers
) -> tuple[Floats, dict[str, Integers], _Facets]:
    """Points, cells, and the nodes of faces, which are edges."""
    if (sizes != 2).any():
        raise ValueError(f"face {int(np.argmax(sizes != 2)) + 1} of a 2D mesh has {int(sizes[sizes != 2][0])} nodes")
    edges = nodes.reshape(-1, 2)
    owners = np.concatenate([cells[:, 0], cells[:, 1]]) - 1
    directed = np.concatenate([edges, edges[:, ::-1]])[owners >= 0]
    points, simple = polygons(points, directed, owners[owners >= 0])
    return points, simple, lambda faces: edges[faces].ravel()


def _volume(
    path: Path, points: Floats, nodes: Integers, sizes: Integers, cells: Integers
) -> tuple[Floats, dict[str, Integers], _Facets]:
    """Points, cells, and the nodes of faces; a face's normal points into its cell c0."""
    if (sizes < 3).any():
        raise ValueError(f"face {int(np.argmax(sizes < 3)) + 1} of a 3D mesh has {int(sizes.min())} nodes")
    mesh, order = from_sides(path, points, nodes, sizes, cells[:, ::-1] - 1)
    pieces, row = divide(mesh, find_cells(mesh)), np.empty(len(order), dtype=np.int64)
    row[order] = np.arange(len(order))

    def facets(faces: Integers) -> Integers:
        return np.concatenate([part.ravel() for part in pieces.facets(mesh, row[faces]).values()])

    return pieces.points, pieces.cells, facets


def _move(source: Path, target: Path, points: Floats) -> None:
    """Write the file with other coordinates of the nodes."""

    def changed(data: bytes) -> bytes:
        content = _read_sections(data)
        order = sorted(range(len(content.places)), key=lambda k: content.nodes[k][0])
        return replaced(data, [content.places[k] for k in order], points)

    edit(source, target, changed)


def _move_hdf5(source: Path, target: Path, points: Floats) -> None:
    """Write the file with other coordinates of the nodes."""
    with copied_hdf5(source, target) as file:
        for part in _parts(file["meshes/1/nodes/coords"]):
            part[...] = points[_first(part) - 1 :][: len(part), : part.shape[1]]


FLUENT = Format("a Fluent mesh", (".msh", ".cas"), re.compile(rb"\A\s*\(\s*\d+\s"), _read_text, move=_move)
FLUENT_HDF5 = Format("a Fluent mesh in HDF5", (".h5",), re.compile(rb"\A\x89HDF"), _read_hdf5, move=_move_hdf5)
