"""Bulk data of Nastran and OptiStruct, in small, large and free fields. Properties of shells (in 2D: bars) are patches.

Names of properties are taken from the comments of HyperMesh, ANSA and Femap. Files that are included are read from the
deck's folder. Nodes in local coordinate systems (CORD1R, CORD2C, …) get their places in the basic one. Cards that
do not describe the mesh are skipped.

MSC Nastran Quick Reference Guide, section 4, "Format of Bulk Data Entries"
"""

import re
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.mesh.cells import CELL_TYPES
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.files.format import Format
from mesh_motion_server.files.mesh_file import MeshFile, assemble_elements, by_name, named_groups
from mesh_motion_server.files.moved import edit
from mesh_motion_server.files.numbering import NumberedRows
from mesh_motion_server.files.text import integer, real, text_of

#: Our type, and the largest number of nodes; those between the corners may be left out.
_ELEMENTS = {
    "CTETRA": ("tetra", 10), "CPYRAM": ("pyramid", 13), "CPYRA": ("pyramid", 13), "CPENTA": ("wedge", 15),
    "CHEXA": ("hexahedron", 20), "CTRIA3": ("triangle", 3), "CTRIAR": ("triangle", 3), "CTRIA6": ("triangle", 6),
    "CQUAD4": ("quad", 4), "CQUADR": ("quad", 4), "CSHEAR": ("quad", 4), "CQUAD8": ("quad", 8), "CQUAD": ("quad", 9),
    "CQUAD9": ("quad", 9),  # Gmsh's name of CQUAD
    "CPLSTN3": ("triangle", 3), "CPLSTN6": ("triangle", 6), "CPLSTN4": ("quad", 4), "CPLSTN8": ("quad", 8),
    "CBAR": ("line", 2), "CBEAM": ("line", 2), "CROD": ("line", 2), "CTUBE": ("line", 2),
}  # fmt: skip
#: The number and the name of a property, in comments.
_NAMES = (
    re.compile(r'^\$HMNAME PROP\s+(\d+)"([^"\n]+)"', re.MULTILINE),
    re.compile(r"^\$ANSA_NAME_COMMENT;(\d+);P\w+;([^;\n]+);", re.MULTILINE),
    re.compile(r"^\$ Femap Property (\d+) : (.*\S)", re.MULTILINE),
)
_INCLUDE = re.compile(r"(?i)\s*INCLUDE\s+(.*)")
#: An exponent without its letter: 1.5-3.
_EXPONENT = re.compile(r"(?<=[\d.])(?=[-+])")


@dataclass(frozen=True, eq=False)
class _Axes:
    """A coordinate system: R, C or S (angles in degrees), and three points in another system, or three nodes.

    The points are the origin, one on the axis z, and one in the plane x-z.
    """

    kind: str
    system: int = 0
    points: Floats = field(default_factory=lambda: np.zeros((3, 3)))
    nodes: tuple[int, ...] = ()

    def cartesian(self, points: Floats) -> Floats:
        """(n, 3) x, y, z of its own coordinates."""
        if self.kind == "R":
            return points
        r, second, third = points[:, 0], np.radians(points[:, 1]), points[:, 2]
        if self.kind == "C":
            return np.column_stack([r * np.cos(second), r * np.sin(second), third])
        third = np.radians(third)
        return np.column_stack(
            [r * np.sin(second) * np.cos(third), r * np.sin(second) * np.sin(third), r * np.cos(second)]
        )


@dataclass(eq=False)
class _Content:
    """The cards.

    elements : {(our type, largest number of nodes): [[property, nodes…]]}, 0 for a node that is left out
    systems : the coordinate system of each node, -1 for the ``usual`` one
    """

    numbers: list[int] = field(default_factory=list)
    systems: list[int] = field(default_factory=list)
    usual: int = 0
    points: list[list[float]] = field(default_factory=list)
    elements: dict[tuple[str, int], list[list[int]]] = field(default_factory=lambda: defaultdict(list))
    axes: dict[int, _Axes] = field(default_factory=dict)

    def take(self, name: str, fields: list[str]) -> None:
        """Add a card; cards that do not describe the mesh are skipped."""
        if name == "GRID":
            self.numbers.append(integer(fields[0]))
            self.systems.append(integer(fields[1] or "-1"))
            self.points.append([_real(word) for word in fields[2:5]])
        elif name in _ELEMENTS:
            kind, most = _ELEMENTS[name]
            count = CELL_TYPES[kind].n_nodes
            nodes = [integer(word or "0") for word in fields[2 : 2 + most]]
            if len(nodes) < count or min(nodes[:count]) < 1:
                raise ValueError(f"nodes {nodes}, expected {count} numbers from 1")
            self.elements[kind, most].append([integer(fields[1] or fields[0]), *nodes, *[0] * (most - len(nodes))])
        elif name == "GRDSET":
            self.usual = integer(fields[1] or "0")
        elif name in ("CORD2R", "CORD2C", "CORD2S"):
            points = np.array([_real(word) for word in fields[2:11]]).reshape(3, 3)
            self.axes[integer(fields[0])] = _Axes(name[-1], integer(fields[1] or "0"), points)
        elif name in ("CORD1R", "CORD1C", "CORD1S"):
            for number, *of in (fields[:4], fields[4:8]):  # a card has one or two systems
                if number:
                    self.axes[integer(number)] = _Axes(name[-1], nodes=tuple(integer(word) for word in of))

    def places(self) -> Floats:
        """(n, 3) the nodes in the basic coordinate system.

        Raises ValueError for a system that is not there, or that refers to itself.
        """
        points, systems = np.array(self.points), np.array(self.systems)
        systems[systems < 0] = self.usual
        for system in np.unique(systems[systems != 0]).tolist():
            own = systems == system
            points[own] = self._basic(system, points[own], ())
        return points

    def _basic(self, system: int, points: Floats, seen: tuple[int, ...]) -> Floats:
        if system == 0:
            return points
        if system not in self.axes or system in seen:
            raise ValueError(f"nodes in the coordinate system {system}, which no CORD1 or CORD2 (R, C, S) defines")
        axes, within = self.axes[system], (*seen, system)
        if axes.nodes:
            rows = NumberedRows.of(np.array(self.numbers))(np.array(axes.nodes), f"coordinate system {system}: node")
            own = [(self.systems[row], np.array([self.points[row]])) for row in rows]
            parts = [self._basic(self.usual if of < 0 else of, point, within) for of, point in own]
            origin, above, beyond = np.concatenate(parts)
        else:
            origin, above, beyond = self._basic(axes.system, axes.points, within)
        z = above - origin
        y = np.cross(z, beyond - origin)
        x = np.cross(y, z)
        if not (np.any(y) and np.any(z)):
            raise ValueError(f"the three points of the coordinate system {system} are on a line")
        turned = axes.cartesian(points) @ np.array([v / np.linalg.norm(v) for v in (x, y, z)])
        basic: Floats = origin + turned
        return basic


def _read(path: Path) -> MeshFile:
    """Read a mesh from bulk data.

    Raises InvalidInput for coordinate systems and included files that are not there, and malformed cards; names the
    card and line.
    """
    try:
        return _mesh(path, _lines(path, path.resolve().parent, ()))
    except (ValueError, IndexError, OverflowError) as error:
        raise InvalidInput(f"{path}: malformed Nastran deck: {error}") from None


def _lines(path: Path, folder: Path, within: tuple[Path, ...]) -> list[bytes]:
    """The lines of a file with their ends, with those of the files that it includes."""
    found: list[bytes] = []
    lines = iter(path.read_bytes().splitlines(keepends=True))
    for line in lines:
        if match := _INCLUDE.match(text_of(line)):
            name = match[1]
            while name.count("'") == 1:  # it goes on in the next line
                name = name.strip() + text_of(next(lines, b"'")).strip()
            name = name.split("'")[1] if "'" in name else name.partition("$")[0].strip().strip('"')
            other = (folder / name).resolve()
            if not other.is_relative_to(folder) or not other.is_file() or other in within:
                known = other.is_relative_to(folder) and other.is_file()
                reason = "includes itself" if known else "is not a file in the deck's folder"
                raise ValueError(f"INCLUDE of {name!r}, which {reason}")
            found += _lines(other, folder, (*within, other))
        else:
            found.append(line if line.endswith((b"\n", b"\r")) else line + b"\n")
    return found


def _cards(lines: list[bytes]) -> Iterator[tuple[list[int], str, list[str]]]:
    """Yield the lines, the name, and the fields after the name, of each card of the bulk data."""
    begin = next((place for place, line in enumerate(lines, start=1) if re.match(rb"(?i)\s*BEGIN\s+BULK", line)), 0)
    places, name, fields = list[int](), "", list[str]()
    for place in range(begin, len(lines)):
        line = text_of(lines[place]).partition("$")[0].rstrip()
        if not line:
            continue
        head, found = _fields(line)
        if head.startswith("="):
            raise ValueError(f"line {place + 1}: {line[:20]!r} repeats a card; write each card in full")
        if head[:1].isalpha():
            if name:
                yield places, name, fields
            if head.upper() == "ENDDATA":
                return
            places, name, fields = [], head.upper(), []
        places.append(place)
        fields += found
    if name:
        yield places, name, fields


def _fields(line: str) -> tuple[str, list[str]]:
    """The first field of a line, without its star, and the four large or eight small ones after it."""
    if "," in line:
        head, *found = (word.strip() for word in line.split(","))
        count = 4 if "*" in head else 8
        found = [*found, *[""] * count][:count]
    else:
        line = line.expandtabs(8)
        head = line[:8].strip()
        width, count = (16, 4) if "*" in head else (8, 8)
        found = [line[place : place + width].strip() for place in range(8, 8 + width * count, width)]
    return head.rstrip("*"), found


def _real(word: str) -> float:
    """A number: 1.5, .5, 1.5D-3, 1.5-3; blank is zero."""
    try:
        return real(word or "0")
    except ValueError:
        return real(word if {*"dDeE"} & {*word} else _EXPONENT.sub("E", word))


def _content(lines: list[bytes]) -> _Content:
    found = _Content()
    for places, name, fields in _cards(lines):
        try:
            found.take(name, fields)
        except (ValueError, IndexError) as error:
            raise ValueError(f"{name} in line {places[0] + 1}: {error}") from None
    if not found.numbers:
        raise ValueError("it has no GRID")
    return found


def _mesh(path: Path, lines: list[bytes]) -> MeshFile:
    found = _content(lines)
    rows = NumberedRows.of(np.array(found.numbers, dtype=np.int64))
    names = {integer(number): name for form in _NAMES for number, name in form.findall(text_of(b"".join(lines)))}
    dimension = max((CELL_TYPES[kind].dimension for kind, _ in found.elements), default=0)
    elements: list[tuple[str, Integers]] = []
    groups: dict[tuple[int, int | str], list[Integers]] = defaultdict(list)
    for (kind, _), listed in found.elements.items():
        values = np.array(listed, dtype=np.int64)
        given = values[:, 1:] > 0
        nodes = rows(np.where(given, values[:, 1:], values[:, 1:2]), f"{kind}: node")  # the first for one left out
        count = CELL_TYPES[kind].n_nodes
        first_order = given.sum(axis=1) == count
        elements += [(kind, nodes[~first_order]), (kind, nodes[first_order, :count])]
        if CELL_TYPES[kind].dimension == dimension - 1:
            for number in np.unique(values[:, 0]).tolist():
                groups[dimension - 1, names.get(number, number)].append(nodes[values[:, 0] == number].ravel())
    patches, _ = by_name(named_groups({key: np.concatenate(parts) for key, parts in groups.items()}))
    return assemble_elements(path, found.places(), elements, patches)


def _move(source: Path, target: Path, points: Floats) -> None:
    """Write the deck with other coordinates of the nodes, in large fields of 16 characters.

    The included files become part of it, if nodes are in these.
    """

    def changed(data: bytes) -> bytes:
        lines, whole = data.splitlines(keepends=True), _lines(source, source.resolve().parent, ())
        if sum(name == "GRID" for _, name, _ in _cards(lines)) < len(points):
            lines = whole
        cards = [card for card in _cards(lines) if card[1] == "GRID"]
        places = _content(whole).places()
        places[:, : points.shape[1]] = points
        for (rows, _, fields), values in zip(cards, places.tolist(), strict=True):
            rest = [*fields[5:8], *[""] * 3][:3]
            words = [f"{word:<16}" for word in (fields[0], "0", *map(_large, values), *rest)]
            ending = lines[rows[0]][len(lines[rows[0]].rstrip(b"\r\n")) :] or b"\n"
            card = (f"GRID*   {''.join(words[:4])}", f"*       {''.join(words[4:])}")
            for row in rows:
                lines[row] = b""
            lines[rows[0]] = b"".join(line.rstrip().encode() + ending for line in card)
        return b"".join(lines)

    edit(source, target, changed)


def _large(value: float) -> str:
    """The number in at most 16 characters, with as many digits as fit."""
    for digits in range(17, 0, -1):
        mantissa, _, exponent = f"{value:.{digits}g}".partition("e")
        mantissa = re.sub(r"^(-?)0\.(?=\d)", r"\1.", mantissa if "." in mantissa else f"{mantissa}.")
        text = f"{mantissa}{int(exponent):+d}" if exponent else mantissa
        if len(text) <= 16 or digits == 1:
            break
    return text


_HEAD = re.compile(rb"(?m)^((GRID|CTETRA|CHEXA|CPENTA|CTRIA3|CQUAD4)\*?[ \t,]|BEGIN BULK|CEND\b)")
NASTRAN = Format("a Nastran deck", (".bdf", ".nas", ".fem"), _HEAD, _read, move=_move)
