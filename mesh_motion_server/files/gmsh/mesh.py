"""Gmsh's MSH format, versions 2.2 and 4.1, ASCII and binary. Physical groups of lower dimension become patches.

The binary and the ASCII form of a section have the same values in the same order, so both are read through
:class:`Values`. An element may belong to several physical groups; a group without a name becomes the patch ``"<tag>"``,
or ``"curve_<tag>"`` if a surface has the same number: curves and surfaces are numbered separately.

http://gmsh.info/doc/texinfo/gmsh.html#MSH-file-format
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.mesh.cells import CELL_TYPES
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.files.format import Format
from mesh_motion_server.files.gmsh.values import AsciiValues, BinaryValues, Values, end_of
from mesh_motion_server.files.mesh_file import MeshFile, assemble, by_corners, by_name, group_names
from mesh_motion_server.files.moved import Place, edit, replaced
from mesh_motion_server.files.numbering import NumberedRows
from mesh_motion_server.files.text import integer, text_of

#: Gmsh's number of the element with one node, which is not a cell.
_VERTEX = 15
_TYPES = {1: "line", 2: "triangle", 3: "quad", 4: "tetra", 5: "hexahedron", 6: "wedge", 7: "pyramid"}
#: Second order: the corners come first; total number of nodes.
_SECOND = {8: ("line", 3), 9: ("triangle", 6), 10: ("quad", 9), 11: ("tetra", 10), 12: ("hexahedron", 27),
           13: ("wedge", 18), 14: ("pyramid", 14), 16: ("quad", 8), 17: ("hexahedron", 20), 18: ("wedge", 15),
           19: ("pyramid", 13)}  # fmt: skip
_HEADER = re.compile(rb"(?m)^[ \t]*\$MeshFormat\s+(\S+)\s+([01])\s+(\d+)[^\n]*\n")
#: Lines between two sections are not read, as in Gmsh.
_SECTION = re.compile(rb"\n[ \t]*\$(\w+)[ \t\r]*\n")
_VERSIONS = (2.0, 2.1, 2.2, 4.1)
_NAME = re.compile(r'^\s*(\d+)\s+(\d+)\s+"(.*)"\s*$')


@dataclass(frozen=True, eq=False)
class _Block:
    """Elements of one type in the same physical groups: the type's name ("" for vertices), node tags (m, k).

    ``entity`` is the number of the surface, curve or point; 0 if the elements have groups in version 2.2.
    """

    dimension: int
    name: str
    nodes: Integers
    groups: tuple[int, ...]
    entity: int

    @property
    def corners(self) -> Integers:
        """(m, c) the corners of the cells, without the middle nodes of cells of higher order."""
        return self.nodes[:, : CELL_TYPES[self.name].n_nodes] if self.name else self.nodes


@dataclass(eq=False)
class _Content:
    """The content of the sections read so far."""

    names: dict[tuple[int, int], str] = field(default_factory=dict)  # (dimension, tag) of a physical group
    groups: dict[tuple[int, int], tuple[int, ...]] = field(default_factory=dict)  # physical tags of an entity (4.1)
    tags: Integers = field(default_factory=lambda: np.empty(0, dtype=np.int64))  # (n,) node tags
    points: Floats = field(default_factory=lambda: np.empty((0, 3)))
    places: list[Place] = field(default_factory=list)  # of the points
    blocks: list[_Block] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def read_gmsh(path: Path) -> MeshFile:
    """Read a mesh from ``.msh``.

    Raises InvalidInput for other versions, partitioned meshes, cells of third order and more, and malformed sections.
    """
    try:
        content = _read_sections(path.read_bytes())
        rows = NumberedRows.of(content.tags, missing="an element names node {number}, which is not in $Nodes")
        cells, patches = _cells(content, rows), _patches(content, rows)
    except (ValueError, IndexError, OverflowError) as error:
        raise InvalidInput(f"{path}: malformed or unsupported Gmsh file: {error}") from None
    mesh = assemble(path, content.points, cells, patches)
    higher = (block for block in content.blocks if block.name and block.nodes.shape[1] > block.corners.shape[1])
    content.notes += by_corners(sum(len(block.nodes) for block in higher if block.dimension == mesh.dimension))
    return replace(mesh, notes=(*mesh.notes, *content.notes))


def _read_sections(data: bytes) -> _Content:
    """Read all sections of the file."""
    header = _HEADER.search(data)
    if header is None:
        raise ValueError("it does not begin with $MeshFormat")
    version, binary, word = header[1].decode(), header[2] == b"1", int(header[3])
    if float(version) not in _VERSIONS:  # Netgen writes 2.000000
        raise ValueError(f"version {version}; versions 2.2 and 4.1 are read (gmsh -save -format msh41)")
    order = "<"
    if binary:
        order = "<" if int.from_bytes(data[header.end() : header.end() + 4], "little") == 1 else ">"
    readers = _READERS_41 if float(version) > 4 else _READERS_22
    content, position = _Content(), header.end()
    position = end_of(data, b"MeshFormat", position) + len(b"$EndMeshFormat")
    while section := _SECTION.search(data, position):
        name, start = section[1], section.end()
        if name == b"PartitionedEntities":
            raise ValueError("a partitioned mesh; save it with Mesh.PartitionSplitMeshFiles = 0 and one partition")
        if name == b"PhysicalNames":
            end = end_of(data, name, start)
            _read_names(content, text_of(data[start:end]))
        elif name in readers:
            values: Values = BinaryValues(data, start, order, word) if binary else AsciiValues(data, start, name)
            readers[name](content, values)
            if name != b"Entities":
                values.require_end(name.decode())
            end = values.end
        else:
            if name not in _OTHER_SECTIONS:
                content.notes.append(f"its section ${name.decode()} is not read")
            end = end_of(data, name, start)
        position = end_of(data, name, end) + len(b"$End" + name)
    return content


def _read_names(content: _Content, text: str) -> None:
    """$PhysicalNames: a count, then ``dimension tag "name"``."""
    for line in text.splitlines()[1:]:
        if match := _NAME.match(line):
            content.names[integer(match[1]), integer(match[2])] = match[3]


# --- 4.1 -------------------------------------------------------------------------------------------------------------


def _read_entities_41(content: _Content, values: Values) -> None:
    """$Entities: for each dimension tag, bounding box, physical tags and bounding entities of each entity."""
    counts = values.sizes(4)
    for dimension, count in enumerate(counts):
        for _ in range(count):
            (tag,) = values.ints(1)
            values.doubles(3 if dimension == 0 else 6)
            groups = values.ints(int(values.sizes(1)[0]))
            content.groups[dimension, int(tag)] = tuple(abs(int(g)) for g in groups)
            if dimension:
                values.ints(int(values.sizes(1)[0]))


def _read_nodes_41(content: _Content, values: Values) -> None:
    """$Nodes: entity blocks, each with its tags first, then its coordinates (and parameters, which are dropped)."""
    n_blocks, announced, _, _ = values.sizes(4)
    tags, points = [content.tags], [content.points]
    for _ in range(n_blocks):
        dimension, _, parametric = values.ints(3)
        count = int(values.sizes(1)[0])
        columns = 3 + (int(dimension) if parametric else 0)
        tags.append(values.sizes(count))
        content.places.append(values.place(count, columns))
        points.append(values.doubles(count * columns).reshape(count, columns)[:, :3])
    content.tags, content.points = np.concatenate(tags), np.concatenate(points)
    _require_count("nodes", announced, len(content.tags))


def _read_elements_41(content: _Content, values: Values) -> None:
    """$Elements: entity blocks of one type each; a row is the element's tag and its nodes' tags."""
    n_blocks, announced, _, _ = values.sizes(4)
    for _ in range(n_blocks):
        dimension, entity, code = (int(v) for v in values.ints(3))
        count = int(values.sizes(1)[0])
        name, n_nodes = _element_type(code)
        nodes = values.sizes(count * (1 + n_nodes)).reshape(count, 1 + n_nodes)[:, 1:]
        content.blocks.append(_Block(dimension, name, nodes, content.groups.get((dimension, entity), ()), entity))
    _require_count("elements", announced, sum(len(block.nodes) for block in content.blocks))


def _require_count(what: str, announced: int, read: int) -> None:
    """Refuse a section whose number of items differs from the announced number."""
    if announced != read:
        raise ValueError(f"it announces {announced} {what}, but has {read}")


# --- 2.2 -------------------------------------------------------------------------------------------------------------


def _read_nodes_22(content: _Content, values: Values) -> None:
    """$Nodes: a count, then tag and coordinates of each node."""
    count = values.text_count()
    content.places.append(values.place(count, 3, tags=1))
    content.tags, content.points = values.numbered_points(count)


def _read_parametric_nodes_22(content: _Content, values: Values) -> None:
    """$ParametricNodes instead of $Nodes: the entity of each node, and its parameters, come after the coordinates."""
    count = values.text_count()
    content.tags, content.points = np.empty(count, dtype=np.int64), np.empty((count, 3))
    for row in range(count):
        content.tags[row] = values.ints(1)[0]
        content.places.append(values.place(1, 3))
        content.points[row] = values.doubles(3)
        dimension, _ = values.ints(2)
        values.doubles(int(dimension) if dimension in (1, 2) else 0)


def _read_elements_22(content: _Content, values: Values) -> None:
    """$Elements: tag, type, number of tags, tags (the first is the physical group), nodes of each element."""
    rows: dict[tuple[int, int], list[Integers]] = defaultdict(list)
    for code, group, nodes in _runs_22(values, values.text_count()):
        rows[code, group].append(nodes)
    for (code, group), parts in rows.items():
        name, _ = _element_type(code)
        dimension = CELL_TYPES[name].dimension if name else 0
        groups = (group,) if group > 0 else ()
        content.blocks.append(_Block(dimension, name, np.concatenate(parts), groups, max(-group, 0)))


def _runs_22(values: Values, count: int) -> Iterator[tuple[int, int, Integers]]:
    """Type, group and (m, k) node tags of each run of consecutive elements: a physical group, or minus an entity."""
    done = 0
    while done < count:
        code, n_tags, rows = values.element_run(lambda code: _element_type(code)[1])
        groups = np.abs(rows[:, 0]) if n_tags else np.zeros(len(rows), dtype=np.int64)
        if n_tags > 1:
            groups = np.where(groups == 0, -np.abs(rows[:, 1]), groups)
        for group in np.unique(groups):
            yield code, int(group), rows[groups == group, n_tags:]
        done += len(rows)
    _require_count("elements", count, done)


_READERS_41 = {b"Entities": _read_entities_41, b"Nodes": _read_nodes_41, b"Elements": _read_elements_41}
_READERS_22 = {b"Nodes": _read_nodes_22, b"ParametricNodes": _read_parametric_nodes_22, b"Elements": _read_elements_22}
#: Sections without nodes, cells and groups.
_OTHER_SECTIONS = {
    b"Comments",
    b"ElementData",
    b"ElementNodeData",
    b"GhostElements",
    b"InterpolationScheme",
    b"NodeData",
    b"Parametrizations",
    b"Periodic",
}


# --- both ------------------------------------------------------------------------------------------------------------


def _element_type(code: int) -> tuple[str, int]:
    """Our name ("" for a vertex) and the number of nodes of Gmsh's element type."""
    if code == _VERTEX:
        return "", 1
    if code in _SECOND:
        return _SECOND[code]
    if code not in _TYPES:
        raise ValueError(f"elements of Gmsh's type {code}; first and second order are read (Mesh.ElementOrder = 1)")
    return _TYPES[code], CELL_TYPES[_TYPES[code]].n_nodes


def _cells(content: _Content, rows: NumberedRows) -> dict[str, Integers]:
    """{type: (m, k)} cells of all dimensions; 2.2 lists an element of several groups several times."""
    found: dict[str, list[_Block]] = defaultdict(list)
    for block in content.blocks:
        if block.name:
            found[block.name].append(block)
    return {name: rows(_merge(blocks)) for name, blocks in found.items()}


def _merge(blocks: list[_Block]) -> Integers:
    """(m, k) the nodes of all blocks; an element that is listed once for each of its groups appears once."""
    nodes = np.concatenate([block.corners for block in blocks])
    if len({block.groups for block in blocks}) == 1:
        return nodes
    _, first = np.unique(nodes, axis=0, return_index=True)
    return nodes[np.sort(first)]


def _patches(content: _Content, rows: NumberedRows) -> dict[str, Integers]:
    """{name: (p,) node rows, with repeats} of the groups of lower dimension than the mesh."""
    top = max((block.dimension for block in content.blocks), default=0)
    lower, of_groups = [block for block in content.blocks if block.dimension < top], content.names
    if not any(block.groups for block in lower) and top > 1:
        lower = [
            replace(block, groups=(block.entity,)) for block in lower if block.entity and block.dimension == top - 1
        ]
        if lower:
            what, of_groups = "surfaces" if top == 3 else "curves", {}
            lost = [name for (dimension, _), name in content.names.items() if dimension == top - 1]
            why = f"no element is in its group {lost[0]!r} (Mesh.SaveAll?)" if lost else "it has no physical groups"
            content.notes.append(f"{why}: the {what} of its geometry are the patches, by their numbers")
    names = group_names([(block.dimension, group) for block in lower for group in block.groups], of_groups)
    found: dict[str, list[tuple[int, Integers]]] = defaultdict(list)
    for block in lower:
        for group in block.groups:
            found[names[block.dimension, group]].append((block.dimension, rows(block.nodes.ravel())))
    patches, notes = by_name(found)
    content.notes += notes
    return patches


def _move(source: Path, target: Path, points: Floats) -> None:
    """Write the file with other coordinates of the nodes."""
    edit(source, target, lambda data: replaced(data, _read_sections(data).places, points))


GMSH = Format("a Gmsh mesh", (".msh",), re.compile(rb"(?m)^[ \t]*\$MeshFormat\b"), read_gmsh, move=_move)
