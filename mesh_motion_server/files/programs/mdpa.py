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
from mesh_motion_server.files.moved import edit_lines, move_rows
from mesh_motion_server.files.numbering import NumberedRows
from mesh_motion_server.files.sides import PLANES, SOLIDS
from mesh_motion_server.files.text import integer, real, text_of

_SIZE = re.compile(r"(\d)D(\d+)(N|$)")
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
        return _mesh(path, _content(text_of(path.read_bytes())))
    except (ValueError, IndexError, OverflowError) as error:
        raise InvalidInput(f"{path}: malformed Kratos mesh: {error}") from None


def _blocks(text: str) -> Iterator[tuple[int, list[str], list[str], list[list[str]]]]:
    """Yield line number, names of the enclosing parts, words of the head, and rows of each block."""
    open_blocks: list[tuple[int, list[str], list[list[str]]]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.partition("//")[0].split()
        if words[:1] == ["Begin"]:
            open_blocks.append((number, words[1:], []))
        elif words[:1] == ["End"]:
            if not open_blocks or words[1:2] != open_blocks[-1][1][:1]:
                raise ValueError(f"line {number}: {line.strip()[:40]!r} ends a block that is not open")
            start, head, rows = open_blocks.pop()
            yield start, [outer[1] for _, outer, _ in open_blocks if outer[0] == "SubModelPart"], head, rows
        elif words and open_blocks:
            open_blocks[-1][2].append(words)
    if open_blocks:
        raise ValueError(f"the block {' '.join(open_blocks[-1][1])!r} in line {open_blocks[-1][0]} does not end")


def _content(text: str) -> _Content:
    """Read all blocks that describe the mesh."""
    found = _Content()
    for number, outer, head, rows in _blocks(text):
        part = found.parts.setdefault(".".join(outer), _Part()) if outer else _Part()
        try:
            match head[0]:
                case "Nodes":
                    found.numbers.append(np.array([integer(row[0]) for row in rows], dtype=np.int64))
                    xyz = [[real(value) for value in row[1:4]] for row in rows]
                    found.points.append(np.array(xyz, dtype=np.float64).reshape(-1, 3))
                case "Elements" if rows:
                    found.elements.append(_rows(head, rows))
                case "Geometries" if rows:
                    found.geometries.append(_rows(head, rows))
                case "Conditions" if rows:
                    found.conditions.append(_rows(head, rows))
                case "SubModelPartNodes":
                    part.nodes += [integer(word) for row in rows for word in row]
                case "SubModelPartConditions":
                    part.conditions += [integer(word) for row in rows for word in row]
                case "SubModelPartGeometries":
                    part.geometries += [integer(word) for row in rows for word in row]
                case "SubModelPartElements":
                    part.has_elements |= bool(rows)
        except (ValueError, IndexError) as error:
            raise ValueError(f"block {' '.join(head)!r} in line {number}: {error}") from None
    return found


def _rows(head: list[str], rows: list[list[str]]) -> tuple[str, Integers, Integers]:
    """Our type, numbers and nodes of the rows. A row is a number, a property (not for geometries), and the nodes."""
    before = 1 if head[0] == "Geometries" else 2
    size = len(rows[0]) - before
    name = head[1] if len(head) > 1 else ""
    named = _SIZE.search(name)
    usual = _PLANES if named is not None and (named[1] == "2" or head[0] == "Conditions") else _SOLIDS
    types = next((types for form, types in _NAMED if form.search(name)), usual)
    if size == 1:
        return "", np.array([integer(row[0]) for row in rows]), np.array([[integer(row[-1])] for row in rows])
    if size not in types:
        raise ValueError(f"{size} nodes, expected one of {', '.join(map(str, types))}")
    wrong = next((row for row in rows if len(row) != size + before), None)
    if wrong is not None:
        raise ValueError(f"{' '.join(wrong)!r} has {len(wrong) - before} nodes, expected {size}")
    values = np.array(rows, dtype=np.int64)
    return types[size], values[:, 0], values[:, before:]


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

    def change(lines: list[bytes]) -> None:
        done = 0
        for place, line in enumerate(lines):
            if line.split(b"//")[0].split() == [b"Begin", b"Nodes"]:
                end = next(k for k in range(place, len(lines)) if lines[k].split()[:1] == [b"End"])
                rows = sum(bool(row.split(b"//")[0].strip()) for row in lines[place + 1 : end])
                move_rows(lines, place + 1, points[done : done + rows], column=1, comment=b"//")
                done += rows

    edit_lines(source, target, change)


KRATOS = Format(
    "a Kratos mesh",
    (".mdpa",),
    re.compile(rb"(?m)^[ \t]*Begin\s+(ModelPartData|Properties|Nodes|Table)\b"),
    _read,
    move=_move,
)
