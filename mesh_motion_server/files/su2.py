"""SU2's native mesh format: ``KEY= value`` lines, each followed by its rows. Markers become patches by their names.

Read as SU2 itself and its older releases do: blanks anywhere, comments after ``%``, names of markers without blanks or
empty, rows with or without their number at the end, two counts of points, keys that say nothing about a mesh.

https://su2code.github.io/docs_v7/Mesh-File/
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import islice, takewhile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.files.mesh_file import IntArray, MeshFile, assemble, chosen_zone
from mesh_motion_server.numerics.cells import CELL_TYPES

__all__ = ["key_of", "read_su2"]

_TYPES = {cell_type.vtk: cell_type for cell_type in CELL_TYPES.values()}  # SU2 uses VTK's numbers
_VERTEX = 1
#: Markers of nodes that another processor or a period owns; old releases write them.
_HALO = "SEND_RECEIVE"
_UNNAMED = "unnamed"

_Rows = list[list[str]]


@dataclass(eq=False)
class _Zone:
    """What the sections of one zone gave so far.

    physical : number of points that are none of the halo
    markers : {name: {type: [(m, k) nodes]}}, vertices with the type ""
    """

    dimension: int = 0
    physical: int = 0
    points: _Rows = field(default_factory=list)
    cells: dict[str, IntArray] = field(default_factory=dict)
    markers: dict[str, dict[str, list[IntArray]]] = field(default_factory=dict)

    def add_marker(self, name: str, rows: _Rows) -> None:
        """Vertices and facets of a marker."""
        marker = self.markers.setdefault(name, defaultdict(list))
        marker[""].append(np.array([row[1:2] for row in rows if int(row[0]) == _VERTEX], dtype=np.int64).reshape(-1, 1))
        for kind, nodes in _elements([row for row in rows if int(row[0]) != _VERTEX]).items():
            marker[kind].append(nodes)

    def mesh(self, path: Path, zone: str) -> MeshFile:
        """The mesh without its halo and without markers that have no elements."""
        points = np.array([row[: self.dimension] for row in self.points], dtype=np.float64)
        markers = {
            name or _UNNAMED: {kind: np.concatenate(parts) for kind, parts in of.items()}
            for name, of in self.markers.items()
        }
        cells, markers, left = _without_halo(self.cells, markers, self.physical, len(points))
        nodes = {name: np.concatenate([part.ravel() for part in of.values()]) for name, of in markers.items()}
        notes = [f"marker {name!r} has no elements: it is no patch" for name in nodes if not len(nodes[name])]
        notes += [f"a marker without a name is the patch {_UNNAMED!r}"] if "" in self.markers else []
        notes += [f"cells of the halo ({_HALO}) that are left out: {left}"] if left else []
        patches = {name: of for name, of in nodes.items() if len(of)}
        facets = {name: {kind: part for kind, part in of.items() if kind} for name, of in markers.items()}
        mesh = assemble(path, points.reshape(len(points), self.dimension), cells, patches, facets)
        return replace(mesh, zone=zone, notes=tuple(notes))


_Markers = dict[str, dict[str, IntArray]]


def _without_halo(
    cells: dict[str, IntArray], markers: _Markers, physical: int, count: int
) -> tuple[dict[str, IntArray], _Markers, int]:
    """Cells and markers without those of the halo, and how many cells that are.

    The halo begins behind the ``physical`` ones of ``count`` nodes. Its cells have such a node that no marker has; a
    periodic marker has the nodes on its side.
    """
    halo = np.arange(count) >= physical
    for of in markers.values():
        for nodes in of.values():
            halo[nodes[(nodes >= 0) & (nodes < count)]] = False
    kept = {name: nodes[~_touching(nodes, halo)] for name, nodes in cells.items()}
    left = sum(len(cells[name]) - len(nodes) for name, nodes in kept.items())
    if not left:
        return cells, markers, 0
    beyond = np.arange(count) >= physical
    for nodes in kept.values():
        beyond[nodes] = False
    return (
        kept,
        {name: {kind: part[~_touching(part, beyond)] for kind, part in of.items()} for name, of in markers.items()},
        left,
    )


def _touching(nodes: IntArray, marked: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(m,) whether a row of nodes (m, k) has a marked one; numbers of no node are left to the mesh's own check."""
    known = (nodes >= 0) & (nodes < len(marked))
    return np.asarray((known & marked[np.where(known, nodes, 0)]).any(axis=1))


def read_su2(path: Path, zone: str = "") -> MeshFile:
    """Read a mesh from ``.su2``.

    Parameters
    ----------
    path : path
    zone : str
        The number after ``IZONE=``; needed where there are several.

    Raises
    ------
    InvalidInput
        Without the zone, for unknown element types, missing or malformed sections.
    """
    text = path.read_text(encoding="utf-8", errors="replace")
    lines = (bare for line in text.splitlines() if (bare := line.partition("%")[0].strip()))
    try:
        zones = _read_zones(lines)
        chosen = chosen_zone(path, list(zones), zone)
        return zones[chosen].mesh(path, chosen)
    except (ValueError, IndexError) as error:
        raise InvalidInput(f"{path}: malformed SU2 mesh: {error}") from None


def _read_zones(lines: Iterator[str]) -> dict[str, _Zone]:
    """Go through the sections in whatever order they come."""
    zone, marker = _Zone(), ""
    zones: dict[str, _Zone] = {}
    for line in lines:
        key, value = key_of(line)
        match key:
            case "IZONE":
                zone = zones[value] = _Zone()
            case "NDIME":
                zone.dimension = int(value)
            case "NPOIN":
                counts = [int(word) for word in value.split()]
                zone.points, zone.physical = _rows(lines, counts[0], key), counts[-1]
            case "NELEM":
                zone.cells = _elements(_rows(lines, int(value.split()[0]), key))
            case "MARKERTAG":
                marker = value
            case "MARKERELEMS":
                rows = _rows(lines, int(value.split()[0]), key)
                if marker != _HALO:
                    zone.add_marker(marker, rows)
            case _:
                continue  # counts that the rows repeat (NMARK), and keys that say nothing about a mesh (FFD_NBOX, …)
    return zones or {"1": zone}


def key_of(line: str) -> tuple[str, str]:
    """The key of a line, without underscores, and its value; a line of numbers has no key."""
    key, equals, value = line.partition("=")
    return (key.strip().replace("_", "").upper(), value.strip()) if equals else ("", "")


def _rows(lines: Iterator[str], count: int, key: str) -> _Rows:
    """The next ``count`` lines of numbers, split; what a halo's marker says before them (SEND_TO) is passed over."""
    numbers = (line for line in lines if not key_of(line)[0].startswith("SEND"))
    rows = [line.split() for line in islice(takewhile(lambda line: "=" not in line, numbers), count)]
    if len(rows) != count:
        raise ValueError(f"{key}= {count}, but only {len(rows)} rows follow")
    return rows


def _elements(rows: _Rows) -> dict[str, IntArray]:
    """{type: (m, k)} node ids; a row is the VTK type, the nodes, and perhaps the element's number."""
    found: dict[str, list[list[str]]] = defaultdict(list)
    for row in rows:
        cell_type = _TYPES.get(int(row[0]))
        if cell_type is None:
            known = ", ".join(map(str, _TYPES))
            raise ValueError(f"element type {row[0]} is not one of {known}; only first-order cells are read")
        nodes = row[1 : 1 + cell_type.n_nodes]
        if len(nodes) < cell_type.n_nodes:
            raise ValueError(f"a {cell_type.name} with {len(nodes)} nodes")
        found[cell_type.name].append(nodes)
    return {name: np.array(nodes, dtype=np.int64) for name, nodes in found.items()}
