"""SU2's native mesh format: ``KEY= value`` lines, each followed by its rows. Markers become patches by their names.

https://su2code.github.io/docs_v7/Mesh-File/
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.files.mesh_file import IntArray, MeshFile, assemble
from mesh_motion_server.numerics.cells import CELL_TYPES

__all__ = ["read_su2"]

_TYPES = {cell_type.vtk: cell_type for cell_type in CELL_TYPES.values()}  # SU2 uses VTK's numbers
_VERTEX = 1

_Rows = list[list[str]]


def read_su2(path: Path) -> MeshFile:
    """Read a mesh of one zone from ``.su2``.

    Raises
    ------
    InvalidInput
        On several zones, unknown element types, missing or malformed sections.
    """
    text = path.read_text(encoding="utf-8", errors="replace")
    lines = (bare for line in text.splitlines() if (bare := line.partition("%")[0].strip()))
    try:
        return _read_sections(path, lines)
    except (ValueError, IndexError) as error:
        raise InvalidInput(f"{path}: malformed SU2 mesh: {error}") from None


def _read_sections(path: Path, lines: Iterator[str]) -> MeshFile:
    """Go through the sections in whatever order they come."""
    dimension, points, cells, marker = 0, np.empty((0, 0)), dict[str, IntArray](), ""
    patches: dict[str, list[IntArray]] = defaultdict(list)
    facets: dict[str, dict[str, IntArray]] = {}
    for line in lines:
        key, _, value = (part.strip() for part in line.partition("="))
        match key:
            case "NZONE" if int(value) > 1:
                raise InvalidInput(f"{path}: {value} zones in one file", hint="write one file for each zone")
            case "NDIME":
                dimension = int(value)
            case "NPOIN":
                rows = _rows(lines, int(value.split()[0]), key)
                points = np.array([row[:dimension] for row in rows], dtype=np.float64).reshape(len(rows), dimension)
            case "NELEM":
                cells = _elements(_rows(lines, int(value), key))
            case "MARKER_TAG":
                marker = value
            case "MARKER_ELEMS":
                vertices, facets[marker] = _marker(_rows(lines, int(value), key))
                patches[marker] += [vertices, *(nodes.ravel() for nodes in facets[marker].values())]
            case _:
                continue  # counts that the rows repeat (NMARK), and keys without a meaning for a mesh (SEND_RECV, …)
    return assemble(path, points, cells, {name: np.concatenate(nodes) for name, nodes in patches.items()}, facets)


def _rows(lines: Iterator[str], count: int, key: str) -> _Rows:
    """The next ``count`` lines, split."""
    rows = [line.split() for line in islice(lines, count)]
    if len(rows) != count:
        raise ValueError(f"{key}= {count}, but only {len(rows)} rows follow")
    return rows


def _elements(rows: _Rows) -> dict[str, IntArray]:
    """{type: (m, k)} node ids; a row is the VTK type, the nodes, and perhaps the element's number."""
    found: dict[str, list[list[str]]] = defaultdict(list)
    for row in rows:
        cell_type = _TYPES.get(int(row[0]))
        if cell_type is None:
            raise ValueError(f"element type {row[0]} is not one of {', '.join(map(str, _TYPES))}")
        nodes = row[1 : 1 + cell_type.n_nodes]
        if len(nodes) < cell_type.n_nodes:
            raise ValueError(f"a {cell_type.name} with {len(nodes)} nodes")
        found[cell_type.name].append(nodes)
    return {name: np.array(nodes, dtype=np.int64) for name, nodes in found.items()}


def _marker(rows: _Rows) -> tuple[NDArray[np.int64], dict[str, IntArray]]:
    """(p,) a marker's vertices, and {type: (m, k)} its facets."""
    vertices = [int(row[1]) for row in rows if int(row[0]) == _VERTEX]
    return np.array(vertices, dtype=np.int64), _elements([row for row in rows if int(row[0]) != _VERTEX])
