"""Kratos' ``.mdpa``: blocks between ``Begin`` and ``End``. Sub-model parts without elements become patches.

Cells are the elements, or the geometries of a file without elements.

https://kratosmultiphysics.github.io/Kratos/pages/Kratos/For_Users/Crash_course/Data_Management/Input_data.html
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.mesh.cells import CELL_TYPES
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.files.format import Format
from mesh_motion_server.files.mesh_file import MeshFile, all_outside, assemble_elements
from mesh_motion_server.files.moved import edit
from mesh_motion_server.files.numbering import NumberedRows
from mesh_motion_server.files.sides import PLANES, SOLIDS
from mesh_motion_server.files.text import integer, number_array, real, text_of

_SIZE = re.compile(r"(\d)D(\d+)(N|$)")
_COMMENT = re.compile(rb"//[^\n]*|/\*.*?\*/", re.DOTALL)
_NODES = re.compile(rb"(?ms)^[ \t]*Begin[ \t]+Nodes\b[^\n]*\n(.*?)^[ \t]*End\b")
_WORD = re.compile(rb"\S+")
_SOLIDS, _PLANES = SOLIDS | {3: "triangle", 2: "line"}, PLANES | {2: "line"}
#: Names of geometries, and of elements that are not volumes although their nodes are in space.
_NAMED = (
    (re.compile(r"Line"), {2: "line", 3: "line"}),
    (re.compile(r"Triangle|Quadrilateral|Shell|Membrane"), _PLANES),
)


@dataclass(eq=False)
class _Part:
    """A sub-model part: its nodes, conditions, geometries, and whether it has elements; numbers of the file."""

    nodes: list[int] = field(default_factory=list)
    conditions: list[int] = field(default_factory=list)
    geometries: list[int] = field(default_factory=list)
    has_elements: bool = False


@dataclass(eq=False)
class _Content:
    """``elements``, ``geometries`` and ``conditions``: [(our type, numbers (m,), nodes (m, k))]."""

    numbers: list[Integers] = field(default_factory=list)
    points: list[Floats] = field(default_factory=list)
    elements: list[tuple[str, Integers, Integers]] = field(default_factory=list)
    geometries: list[tuple[str, Integers, Integers]] = field(default_factory=list)
    conditions: list[tuple[str, Integers, Integers]] = field(default_factory=list)
    parts: dict[str, _Part] = field(default_factory=dict)


def _read(path: Path) -> MeshFile:
    """Read a mesh from ``.mdpa``.

    Raises InvalidInput for unknown elements, missing numbers, and malformed blocks; names the block and its line.
    """
    try:
        return _mesh(path, _content(text_of(_plain(path.read_bytes()))))
    except (ValueError, IndexError, OverflowError) as error:
        raise InvalidInput(f"{path}: malformed Kratos mesh: {error}") from None


def _plain(data: bytes) -> bytes:
    """The file with blanks for comments; all else stays in its place."""
    return _COMMENT.sub(lambda comment: re.sub(rb"[^\n]", b" ", comment[0]), data)


def _blocks(text: str) -> Iterator[tuple[int, list[str], list[str], list[str], int]]:
    """Yield line number, names of the enclosing parts, words of the head, and the words of each block.

    The last result is the number of words in the block's first line: words may be in any lines.
    """
    open_blocks: list[tuple[int, list[str], list[list[str]]]] = []
    for number, line in enumerate(text.split("\n"), start=1):
        words = line.split()
        if words[:1] == ["Begin"]:
            open_blocks.append((number, words[1:], []))
        elif words[:1] == ["End"]:
            if not open_blocks or words[1:2] != open_blocks[-1][1][:1]:
                raise ValueError(f"line {number}: {line.strip()[:40]!r} ends a block that is not open")
            start, head, rows = open_blocks.pop()
            outer = [outer[1] for _, outer, _ in open_blocks if outer[0] == "SubModelPart"]
            yield start, outer, head, [word for row in rows for word in row], len(rows[0]) if rows else 0
        elif words and open_blocks:
            open_blocks[-1][2].append(words)
    if open_blocks:
        raise ValueError(f"the block {' '.join(open_blocks[-1][1])!r} in line {open_blocks[-1][0]} does not end")


def _content(text: str) -> _Content:
    """Read all blocks that describe the mesh."""
    found = _Content()
    for number, outer, head, words, width in _blocks(text):
        part = found.parts.setdefault(".".join(outer), _Part()) if outer else _Part()
        try:
            match head[0]:
                case "Nodes":
                    if len(words) % 4:
                        raise ValueError(f"{len(words)} numbers, expected four for each node")
                    found.numbers.append(np.array([integer(word) for word in words[::4]], dtype=np.int64))
                    xyz = [[real(word) for word in words[axis::4]] for axis in (1, 2, 3)]
                    found.points.append(np.array(xyz, dtype=np.float64).T)
                case "Elements" if words:
                    found.elements.append(_rows(head, words, width))
                case "Geometries" if words:
                    found.geometries.append(_rows(head, words, width))
                case "Conditions" if words:
                    found.conditions.append(_rows(head, words, width))
                case "SubModelPartNodes":
                    part.nodes += [integer(word) for word in words]
                case "SubModelPartConditions":
                    part.conditions += [integer(word) for word in words]
                case "SubModelPartGeometries":
                    part.geometries += [integer(word) for word in words]
                case "SubModelPartElements":
                    part.has_elements |= bool(words)
        except (ValueError, IndexError) as error:
            raise ValueError(f"block {' '.join(head)!r} in line {number}: {error}") from None
    return found


def _rows(head: list[str], words: list[str], width: int) -> tuple[str, Integers, Integers]:
    """Our type, numbers and nodes of the rows. A row is a number, a property (not for geometries), and the nodes.

    The name of the type ends with the number of nodes, as in Element2D4N; else the first line is a row.
    """
    before = 1 if head[0] == "Geometries" else 2
    name = head[1] if len(head) > 1 else ""
    named = _SIZE.search(name)
    size = integer(named[2]) if named is not None else width - before
    usual = _PLANES if named is not None and (named[1] == "2" or head[0] == "Conditions") else _SOLIDS
    types = next((types for form, types in _NAMED if form.search(name)), usual)
    if size != 1 and size not in types:
        raise ValueError(f"{size} nodes, expected one of {', '.join(map(str, types))}")
    if len(words) % (size + before):
        raise ValueError(f"{len(words)} numbers, expected {size + before} for each row: {' '.join(words[:8])} …")
    values = number_array(words, np.int64).reshape(-1, size + before)
    return types[size] if size > 1 else "", values[:, 0], values[:, before:]


def _mesh(path: Path, found: _Content) -> MeshFile:
    if not found.points:
        raise ValueError("it has no nodes")
    rows = NumberedRows.of(np.concatenate(found.numbers))
    points = np.concatenate(found.points)
    elements = [(name, rows(nodes)) for name, _, nodes in found.elements or found.geometries if name]
    dimension = max((CELL_TYPES[name].dimension for name, _ in elements), default=0)
    conditions, geometries = _by_number(found.conditions), _by_number(found.geometries)
    patches, with_cells = {}, set()
    for name, part in found.parts.items():
        of_part = [np.array(part.nodes, dtype=np.int64)]
        for what, numbers, listed in (("condition", part.conditions, conditions),
                                      ("geometry", part.geometries, geometries)):  # fmt: skip
            unknown = next((number for number in numbers if number not in listed), None)
            if unknown is not None:
                raise ValueError(f"sub-model part {name!r} names {what} {unknown}, which is not there")
            of_part += [listed[number][1] for number in numbers]
        if part.has_elements or any(geometries[number][0] == dimension for number in part.geometries):
            with_cells.add(name)
        nodes = np.unique(np.concatenate(of_part))
        # a part of all nodes gives them a condition or a material, except both sides of one layer of elements
        whole = len(nodes) == len(points) and not all_outside(elements, len(points))
        if len(nodes) and not whole:
            patches[name] = rows(nodes, f"sub-model part {name!r}: node")
    for name in list(patches):  # a part has what its own parts have
        if any(f"{other}.".startswith(f"{name}.") for other in with_cells):
            del patches[name]
    return assemble_elements(path, points, elements, patches)


def _by_number(found: list[tuple[str, Integers, Integers]]) -> dict[int, tuple[int, Integers]]:
    """Dimension and nodes of conditions or geometries."""
    return {
        number: (CELL_TYPES[name].dimension if name else 0, nodes)
        for name, numbers, listed in found
        for number, nodes in zip(numbers.tolist(), listed, strict=True)
    }


def _move(source: Path, target: Path, points: Floats) -> None:
    """Write the file with other coordinates of the nodes."""

    def changed(data: bytes) -> bytes:
        plain, parts, end, values = _plain(data), list[bytes](), 0, iter(points.tolist())
        for block in _NODES.finditer(plain):
            words = list(_WORD.finditer(plain, *block.span(1)))
            for node in range(0, len(words), 4):
                for word, value in zip(words[node + 1 : node + 4], next(values), strict=False):
                    parts += [data[end : word.start()], repr(value).encode()]
                    end = word.end()
        return b"".join([*parts, data[end:]])

    edit(source, target, changed)


KRATOS = Format(
    "a Kratos mesh",
    (".mdpa",),
    re.compile(rb"(?m)^[ \t]*Begin\s+(ModelPartData|Properties|Nodes|Table)\b"),
    _read,
    move=_move,
)
