"""SU2's native mesh format: ``KEY= value`` lines, each followed by its rows. Markers become patches by their names.

The reader accepts the same files as SU2 and its older releases: blanks anywhere, comments after ``%``, marker names
without blanks or empty, rows with or without their number at the end, two counts of points, keys unrelated to the mesh.

https://su2code.github.io/docs_v7/Mesh-File/
"""

import re
import warnings
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.mesh.cells import CELL_TYPES
from mesh_motion_protocol.errors import InvalidInput
from numpy.typing import NDArray

from mesh_motion_server.files.format import Format
from mesh_motion_server.files.mesh_file import MeshFile, assemble, chosen_zone
from mesh_motion_server.files.moved import edit_lines, move_rows
from mesh_motion_server.files.text import integer, text_of

#: Name and number of nodes of each SU2 type number (the same as in VTK); a marker may also have vertices.
_CELLS = {cell_type.vtk: (cell_type.name, cell_type.n_nodes) for cell_type in CELL_TYPES.values()}
_FACETS = {1: ("", 1), **_CELLS}
#: A marker of releases before 7: nodes of another processor's part, or images beyond a periodic side.
_HALO = "SEND_RECEIVE"
_UNNAMED = "unnamed"

_Rows = list[str]


@dataclass(eq=False)
class _Zone:
    """The content of the sections of one zone read so far.

    markers_left : the markers that NMARK announces and that have not been read
    marker : the one that is read
    markers : {name: {type: [(m, k) nodes]}}, vertices with the type ""
    """

    dimension: int = 0
    markers_left: int = 0
    marker: str = ""
    points: _Rows = field(default_factory=list)
    cells: dict[str, Integers] = field(default_factory=dict)
    markers: dict[str, dict[str, list[Integers]]] = field(default_factory=dict)

    def take(self, key: str, value: str, rows: _Rows) -> None:
        """Add a section; keys that do not describe the mesh (FFD_NBOX, …) are skipped."""
        if key in ("NPOIN", "NELEM") and (self.points if key == "NPOIN" else self.cells):
            raise ValueError(f"{key}= appears twice in one zone")
        match key:
            case "NDIME":
                self.dimension = integer(value)
                if not 1 <= self.dimension <= 3:
                    raise ValueError(f"NDIME= {value}, expected 2 or 3")
            case "NPOIN":
                self.points = _counted(rows, integer(value.split(maxsplit=1)[0]), key)
            case "NELEM":
                self.cells = _elements(_counted(rows, integer(value.split(maxsplit=1)[0]), key), _CELLS)
            case "NMARK":
                self.markers_left += integer(value)
            case "MARKERTAG":
                self.marker = value
                self.markers_left -= 1
            case "MARKERELEMS":
                elements = _counted(rows, integer(value.split(maxsplit=1)[0]), key)
                if self.marker != _HALO:
                    self.add_marker(self.marker, elements)

    def add_marker(self, name: str, rows: _Rows) -> None:
        """Add the vertices and facets of a marker."""
        marker = self.markers.setdefault(name, defaultdict(list))
        for kind, nodes in _elements(rows, _FACETS).items():
            marker[kind].append(nodes)

    def mesh(self, path: Path, zone: str) -> MeshFile:
        """The mesh, without markers that have no elements."""
        points = _columns(self.points, range(self.dimension), np.float64)
        markers = {
            name or _UNNAMED: {kind: np.concatenate(parts) for kind, parts in of.items()}
            for name, of in self.markers.items()
        }
        none = np.empty(0, dtype=np.int64)
        nodes = {name: np.concatenate([none, *(part.ravel() for part in of.values())]) for name, of in markers.items()}
        notes = [f"marker {name!r} has no elements: it is not a patch" for name in nodes if not len(nodes[name])]
        notes += [f"a marker without a name becomes the patch {_UNNAMED!r}"] if "" in self.markers else []
        patches = {name: of for name, of in nodes.items() if len(of)}
        return replace(assemble(path, points, self.cells, patches), zone=zone, notes=tuple(notes))


def read_su2(path: Path, zone: str = "") -> MeshFile:
    """Read a mesh from ``.su2``.

    Raises InvalidInput without the zone, for unknown element types, missing or malformed sections.

    Parameters
    ----------
    zone : str
        The number after ``IZONE=``; required if there are several.
    """
    try:
        zones = _read_zones(text_of(path.read_bytes()).removeprefix("\ufeff"))
        chosen = chosen_zone(path, list(zones), zone)
        return zones[chosen].mesh(path, chosen)
    except (ValueError, IndexError) as error:
        raise InvalidInput(f"{path}: malformed SU2 mesh: {error}") from None


def _read_zones(text: str) -> dict[str, _Zone]:
    """Read the sections, in any order."""
    zone, announced = _Zone(), 1
    zones: dict[str, _Zone] = {}
    for key, value, rows in _sections(text):
        if key == "NZONE":
            announced = integer(value)
        elif key == "IZONE":
            zone = zones[value] = _Zone()
        else:
            zone.take(key, value, rows)
    zones = zones or {"1": zone}
    if len(zones) < announced:
        raise ValueError(f"NZONE= {announced}, but only {len(zones)} follow")
    for name, one in zones.items():
        if one.markers_left > 0:
            raise ValueError(f"zone {name}: {one.markers_left} markers less than its NMARK announces")
    return zones


def _sections(text: str) -> Iterator[tuple[str, str, _Rows]]:
    """Key, value and the lines of numbers that follow; the key SEND_TO of halo markers is skipped."""
    lines = text.splitlines()
    if "%" in text:
        lines = [line.partition("%")[0] for line in lines]
    lines = [line for line in lines if line and not line.isspace()]
    keys = [(place, *_key_of(line)) for place, line in enumerate(lines) if "=" in line]
    keys = [(place, key, value) for place, key, value in keys if not key.startswith("SEND")]
    for (place, key, value), (end, _, _) in pairwise([*keys, (len(lines), "", "")]):
        rows = lines[place + 1 : end]
        yield key, value, [row for row in rows if "=" not in row] if key == "MARKERELEMS" else rows


def _key_of(line: str) -> tuple[str, str]:
    """The key of a line, without underscores, and its value; a line of numbers has no key."""
    key, equals, value = line.partition("=")
    return (key.strip().replace("_", "").upper(), value.strip()) if equals else ("", "")


def _counted(rows: _Rows, count: int, key: str) -> _Rows:
    """The lines, which must be ``count`` lines."""
    if count != len(rows):
        raise ValueError(f"{key}= {count}, but {'only ' if len(rows) < count else ''}{len(rows)} rows follow")
    return rows


def _elements(rows: _Rows, types: Mapping[int, tuple[str, int]]) -> dict[str, Integers]:
    """{type: (m, k)} node ids; a row is the VTK type, the nodes, and optionally the element's number."""
    codes = _columns(rows, range(1), np.int64)[:, 0]
    known, first = np.unique(codes, return_index=True)
    found = {}
    for code in known[np.argsort(first)].tolist():
        if code not in types:
            listed = ", ".join(str(code) for code in types)
            raise ValueError(
                f"element type {code} is not one of {listed}; SU2 has first-order cells only "
                "(Gmsh: Mesh.ElementOrder = 1)"
            )
        name, count = types[code]
        own = rows if len(known) == 1 else [rows[i] for i in np.flatnonzero(codes == code).tolist()]
        found[name] = _columns(own, range(1, 1 + count), np.int64)
    return found


def _columns(rows: _Rows, columns: Sequence[int], dtype: type[np.generic]) -> NDArray[Any]:
    """(m, k) some columns of lines of numbers."""
    if not rows or not columns:  # loadtxt warns in both cases
        return np.empty((len(rows), len(columns)), dtype=dtype)
    try:
        with warnings.catch_warnings(action="error", category=DeprecationWarning):  # NumPy < 2.3 accepts 1.5
            return np.loadtxt(rows, dtype=dtype, comments=None, usecols=columns, ndmin=2)
    except (ValueError, DeprecationWarning) as error:
        for row in rows if len(rows) > 1 else ():  # find the wrong row
            _columns([row], columns, dtype)
        given, needed = len(rows[0].split()), max(columns) + 1
        reason = f"{given} numbers, expected {needed}" if given < needed else str(error).partition(" at row")[0]
        raise ValueError(f"{rows[0].strip()!r}: {reason}") from None


def _move(source: Path, target: Path, points: Floats, zone: str) -> None:
    """Write the file with other coordinates of one zone's nodes."""
    chosen = read_su2(source, zone).zone

    def change(lines: list[bytes]) -> None:
        current = ""
        for place, line in enumerate(lines):
            key, value = _key_of(text_of(line).partition("%")[0])
            if key == "IZONE":
                current = value
            if key == "NPOIN" and current in ("", chosen):
                move_rows(lines, place + 1, points, comment=b"%")

    edit_lines(source, target, change)


SU2 = Format(
    "a SU2 mesh", (".su2",), re.compile(rb"(?im)^[ \t]*(NDIME|NZONE|IZONE|NELEM|NPOIN)\s*="), read_su2, True, _move
)
