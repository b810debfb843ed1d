"""Universal files (UNV) of I-DEAS, Salome and Gmsh. Groups of nodes and of elements of the boundary become patches.

https://www.ceas3.uc.edu/sdrluff/: datasets 15, 781, 2411 (nodes), 780, 2412 (elements), 2429 to 2477 (groups),
757 (nodes whose degrees of freedom are restrained, also taken as patches by OpenFOAM's ideasUnvToFoam).
"""

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
from mesh_motion_server.files.mesh_file import MeshFile, assemble_elements, by_name, concatenated
from mesh_motion_server.files.moved import edit_lines
from mesh_motion_server.files.numbering import NumberedRows
from mesh_motion_server.files.text import integer, real, text_of

#: Nodes of each dataset: number of lines per node.
_NODE_LINES = {15: 1, 781: 2, 2411: 2}
#: Elements: number of numbers in the first line.
_ELEMENT_WORDS = {780: 8, 2412: 6}
#: Groups: number of numbers for each entity; its type and its number come first.
_GROUP_WORDS = {2417: 2, 2429: 2, 2430: 2, 2432: 2, 2435: 4, 2452: 4, 2467: 4, 2477: 4}
_RESTRAINED = 757
_NODES, _ELEMENTS = 7, 8
#: A beam has an additional line before its nodes.
_BEAMS = (11, 21, 22, 23, 24)
#: Our type, and the places of the corners, by descriptor: a ring of second order is corner, middle, corner, middle, ….
_FLAT = {1: ("triangle", [0, 1, 2]), 2: ("triangle", [0, 2, 4]), 4: ("quad", [0, 1, 2, 3]), 5: ("quad", [0, 2, 4, 6])}
_SHAPES = {
    11: ("line", [0, 1]),
    21: ("line", [0, 1]),
    22: ("line", [0, 2]),
    24: ("line", [0, 2]),
    171: ("line", [0, 1]),  # of an axisymmetric shell; edges, as Cubit writes them
    172: ("line", [0, 2]),
    **{ten + kind: shape for ten in (40, 50, 60, 70, 80, 90) for kind, shape in _FLAT.items()},
    111: ("tetra", [0, 1, 2, 3]),
    118: ("tetra", [0, 2, 4, 9]),
    112: ("wedge", [0, 1, 2, 3, 4, 5]),
    113: ("wedge", [0, 2, 4, 9, 11, 13]),
    115: ("hexahedron", list(range(8))),
    116: ("hexahedron", [0, 2, 4, 6, 12, 14, 16, 18]),
}
_POINTS = (121, 122, 136, 137, 138, 139, 151, 152, 161)  # rigid elements, springs, gaps, masses
#: A dataset is between lines of -1; its first number is its type.
_FENCE = "-1"


@dataclass(eq=False)
class _Content:
    """``elements``: {descriptor: [[number, nodes…]]}; ``groups``: [(name, numbers of nodes, numbers of elements)]."""

    numbers: list[int] = field(default_factory=list)
    points: list[list[float]] = field(default_factory=list)
    elements: dict[tuple[int, int], list[list[int]]] = field(default_factory=lambda: defaultdict(list))
    groups: list[tuple[str, list[int], list[int]]] = field(default_factory=list)


def _read(path: Path) -> MeshFile:
    """Read a mesh from ``.unv``.

    Raises InvalidInput for unknown elements, missing numbers, and malformed datasets; names the dataset and the line.
    """
    try:
        return _mesh(path, _content(text_of(path.read_bytes()).splitlines()))
    except (ValueError, IndexError, OverflowError) as error:
        raise InvalidInput(f"{path}: malformed universal file: {error}") from None


def _datasets(lines: list[str]) -> Iterator[tuple[int, int, int]]:
    """Yield number, first line, and line after the last, of each dataset."""
    fences = [place for place, line in enumerate(lines) if line.strip() == _FENCE]
    if len(fences) % 2:
        raise ValueError(f"the dataset in line {fences[-1] + 1} does not end")
    for begin, end in zip(fences[::2], fences[1::2], strict=True):
        head = lines[begin + 1].split()[:1]
        if begin + 1 < end and head and head[0].isdecimal():
            yield integer(head[0]), begin + 2, end


def _content(lines: list[str]) -> _Content:
    found = _Content()
    for number, begin, end in _datasets(lines):
        place = begin
        try:
            while place < end:
                if number in _NODE_LINES:
                    place = _node(found, lines, place, _NODE_LINES[number])
                elif number in _ELEMENT_WORDS:
                    place = _element(found, lines, place, _ELEMENT_WORDS[number])
                elif number in _GROUP_WORDS:
                    place = _group(found, lines, place, _GROUP_WORDS[number])
                elif number == _RESTRAINED:
                    name = re.sub(r"\s*\(\s*\d+\s*\)$", "", lines[place + 1].strip()) or lines[place].strip()
                    found.groups.append((name, [integer(line.split()[0]) for line in lines[place + 2 : end]], []))
                    place = end
                else:
                    break
                if place > end:
                    raise ValueError("it goes beyond its dataset")
        except (ValueError, IndexError) as error:
            text = lines[min(place, end - 1)].strip()[:40]
            raise ValueError(f"dataset {number}, line {place + 1}, {text!r}: {error}") from None
    return found


def _node(found: _Content, lines: list[str], place: int, count: int) -> int:
    words = lines[place].split()
    xyz = words[4:7] if count == 1 else lines[place + 1].split()[:3]
    values = [real(word) for word in xyz]
    if len(values) != 3:
        raise ValueError(f"a node of {len(values)} coordinates, expected 3")
    found.numbers.append(integer(words[0]))
    found.points.append(values)
    return place + count


def _element(found: _Content, lines: list[str], place: int, n_words: int) -> int:
    words = [integer(word) for word in lines[place].split()[:n_words]]
    if len(words) < n_words:
        raise ValueError(f"an element of {len(words)} numbers, expected {n_words}")
    number, code, count = words[0], words[1], words[-1]
    if code not in _SHAPES and code not in _POINTS:
        raise ValueError(f"elements of type {code}; known are {', '.join(map(str, _SHAPES))}")
    place += 2 if code in _BEAMS else 1
    nodes: list[int] = []
    while len(nodes) < count:
        row = [integer(word) for word in lines[place].split()]
        if not row:
            raise ValueError(f"element {number} has {len(nodes)} nodes, expected {count}")
        nodes += row
        place += 1
    if code in _SHAPES and (len(nodes) != count or count <= max(_SHAPES[code][1])):
        raise ValueError(f"element {number} of type {code} has {len(nodes)} nodes of {count}")
    found.elements[code, count].append([number, *nodes])
    return place


def _group(found: _Content, lines: list[str], place: int, n_words: int) -> int:
    head = [integer(word) for word in lines[place].split()]
    count, name = head[-1], lines[place + 1].strip() or str(head[0])
    values: list[int] = []
    place += 2
    while len(values) < n_words * count:
        row = [integer(word) for word in lines[place].split()]
        if not row:
            raise ValueError(f"group {name!r} has {len(values) // n_words} entities, expected {count}")
        values += row
        place += 1
    entities = np.array(values, dtype=np.int64).reshape(-1, n_words)
    kinds = (entities[entities[:, 0] == kind, 1].tolist() for kind in (_NODES, _ELEMENTS))
    found.groups.append((name, *kinds))
    return place


def _mesh(path: Path, found: _Content) -> MeshFile:
    if not found.points:
        raise ValueError("it has no nodes")
    rows = NumberedRows.of(np.array(found.numbers, dtype=np.int64))
    elements: list[tuple[str, Integers]] = []
    facets: dict[int, tuple[int, Integers]] = {}  # dimension and nodes of each element, by its number
    for (code, count), listed in found.elements.items():
        values = np.array(listed, dtype=np.int64)
        own = rows(values[:, 1:], f"element {listed[0][0]} and others of its type: node")
        name, corners = _SHAPES.get(code, ("", [0]))
        elements.append((name, own[:, [*corners, *(k for k in range(count) if k not in corners)]]))
        dimension = CELL_TYPES[name].dimension if name else 0
        facets |= {number: (dimension, nodes) for number, nodes in zip(values[:, 0].tolist(), own, strict=True)}
    dimension = max((of for of, _ in facets.values()), default=0)
    groups: dict[str, list[tuple[int, Integers]]] = defaultdict(list)
    cells_of = _cells_of(found, facets, dimension)
    notes = []
    for name, nodes, members in found.groups:
        unknown = next((number for number in members if number not in facets), None)
        if unknown is not None and not nodes and facets.keys().isdisjoint(members):
            # Gmsh writes groups of points, but not their elements
            notes.append(f"a group {name!r} names no element that is there: it is not a patch")
            continue
        if unknown is not None:
            raise ValueError(f"group {name!r} names element {unknown}, which is not there")
        sides = [(of, own) for of, own in (facets[number] for number in members) if of < dimension]
        own = rows(np.array(nodes, dtype=np.int64), f"group {name!r}: node")
        if len(cells_of.get(name, ())) and np.isin(cells_of[name], own).all():
            own = own[:0]  # the nodes of a volume
        parts = [(0, own), *sides]
        groups[name] += [part for part in parts if len(part[1])]
    patches, of_names = by_name({name: parts for name, parts in groups.items() if parts})
    notes += of_names
    mesh = assemble_elements(path, np.array(found.points), elements, patches)
    return replace(mesh, notes=(*mesh.notes, *notes))


def _cells_of(found: _Content, facets: dict[int, tuple[int, Integers]], dimension: int) -> dict[str, Integers]:
    """{group: (p,) nodes of its cells}; several groups may have one name."""
    cells: dict[str, list[Integers]] = defaultdict(lambda: [np.empty(0, np.int64)])
    for name, _, members in found.groups:
        cells[name] += [facets[number][1] for number in members if facets.get(number, (0,))[0] == dimension]
    return concatenated(cells)


def _move(source: Path, target: Path, points: Floats) -> None:
    """Write the file with other coordinates of the nodes; short ones in double precision, as dataset 2411."""

    def change(lines: list[bytes]) -> None:
        text = [text_of(line) for line in lines]
        done = 0
        for number, begin, end in _datasets(text):
            count = _NODE_LINES.get(number)
            if count is None:
                continue
            if count == 1:
                lines[begin - 1] = lines[begin - 1].replace(b"15", b"2411", 1)
            for place in range(begin, end, count):
                row = text[place].split()
                words = row[4:7] if count == 1 else text[place + 1].split()
                words[: points.shape[1]] = [f"{value:.16E}".replace("E", "D") for value in points[done].tolist()]
                ending = lines[place][len(lines[place].rstrip(b"\r\n")) :]
                moved = "".join(f"{word:>25}" for word in words).encode() + ending
                if count == 1:
                    head = "".join(f"{word:>10}" for word in row[:4]).encode() + ending
                    lines[place] = head + moved
                else:
                    lines[place + 1] = moved
                done += 1

    edit_lines(source, target, change)


UNV = Format(
    "a universal file (UNV)",
    (".unv",),
    re.compile(rb"\A\s*-1\s+(15|151|164|780|781|2411|2412|2420)\s"),
    _read,
    move=_move,
)
