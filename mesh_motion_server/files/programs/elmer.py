"""Elmer's mesh folders: mesh.nodes, mesh.elements, mesh.boundary and mesh.names. Boundaries become patches.

A folder ``partitioning.N`` in it has the files of N parts, ``part.1.nodes``, …, whose nodes have their numbers in the
whole mesh.

https://www.nic.funet.fi/pub/sci/physics/elmer/doc/ElmerGridManual.pdf, appendix "Format of ElmerSolver meshes"
"""

import re
import shutil
from collections import defaultdict
from pathlib import Path

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.files.format import Format
from mesh_motion_server.files.mesh_file import MeshFile, assemble_elements, concatenated
from mesh_motion_server.files.moved import edit_lines, move_rows
from mesh_motion_server.files.numbering import NumberedRows
from mesh_motion_server.files.text import integer, real, text_of

#: Shape by the hundreds of a type; its other digits are the number of nodes: 504 is a tetrahedron, 510 one of second
#: order.
_SHAPES = {1: "", 2: "line", 3: "triangle", 4: "quad", 5: "tetra", 6: "pyramid", 7: "wedge", 8: "hexahedron"}
_NAME = re.compile(r"^\s*\$\s*(\S.*?)\s*=\s*(\d+)", re.MULTILINE)
_PART = re.compile(r"part\.(\d+)\.nodes")
#: ElmerGrid's heading before the names of boundaries; Netgen writes these names only.
_HEADING = re.compile(r"names\s+for\s+boundaries")


def _read(path: Path) -> MeshFile:
    """Read a mesh from a folder.

    Raises InvalidInput for a missing file, unknown elements and malformed rows; names the file and the row.
    """
    try:
        stems = _stems(path)
        nodes = [_nodes(path, stem) for stem in stems]
        numbers, points = (np.concatenate(parts) for parts in zip(*nodes, strict=True))
        _, first = np.unique(numbers, return_index=True)  # several parts have a node at their interface
        first.sort()
        rows = NumberedRows.of(numbers[first])
        elements: list[tuple[str, Integers]] = []
        patches: dict[str, list[Integers]] = defaultdict(list)
        names = _boundary_names(path)
        for stem in stems:
            elements += [(name, own) for name, _, own in _elements(path / f"{stem}.elements", rows, 2)]
            for _, tags, own in _elements(path / f"{stem}.boundary", rows, 4):
                for tag in np.unique(tags).tolist():
                    patches[names.get(tag, str(tag))].append(own[tags == tag].ravel())
    except (ValueError, IndexError, OverflowError) as error:
        raise InvalidInput(f"{path}: malformed Elmer mesh: {error}") from None
    return assemble_elements(path, points[first], elements, concatenated(patches))


def _stems(path: Path) -> list[str]:
    """The beginnings of the names of the files: ``mesh``, or ``part.1``, … in the order of their numbers."""
    found = [match for file in path.iterdir() if (match := _PART.fullmatch(file.name))]
    return [f"part.{number}" for number in sorted(int(part[1]) for part in found)] or ["mesh"]


def _nodes(path: Path, stem: str) -> tuple[Integers, Floats]:
    """Numbers (n,) and coordinates (n, 3) of the nodes of a part."""
    listed = [line.split() for line in _lines(path / f"{stem}.nodes")]
    numbers = np.array([integer(row[0]) for row in listed], dtype=np.int64)
    NumberedRows.of(numbers)  # each once
    points = np.array([[real(value) for value in row[2:5]] for row in listed], dtype=np.float64)
    return numbers, points.reshape(-1, 3)


def _lines(path: Path) -> list[str]:
    if not path.is_file():
        raise ValueError(f"there is no {path.name}")
    return [line for line in text_of(path.read_bytes()).splitlines() if line.strip()]


def _elements(path: Path, node_rows: NumberedRows, before: int) -> list[tuple[str, Integers, Integers]]:
    """Our type, second numbers (m,) and nodes (m, k) of each type's rows; ``before`` numbers come before the type."""
    found: dict[int, list[list[int]]] = defaultdict(list)
    for place, line in enumerate(_lines(path), start=1):
        words = line.split()
        if "/" in words[0]:  # a copy of another part's element
            continue
        row = [integer(word) for word in words]
        kind = row[before]
        if kind // 100 not in _SHAPES or len(row) != before + 1 + kind % 100:
            raise ValueError(f"row {place} of {path.name} is of type {kind}, but has {len(row) - before - 1} nodes")
        found[kind].append(row)
    parts = []
    for kind, listed in found.items():
        rows = np.array(listed, dtype=np.int64)
        nodes = node_rows(rows[:, before + 1 :], f"{path.name}: node")
        parts.append((_SHAPES[kind // 100], rows[:, 1], nodes))
    return parts


def _boundary_names(path: Path) -> dict[int, str]:
    """{number: name} of the boundaries, the last names in mesh.names; this file may be missing."""
    file = _names_of(path)
    text = text_of(file.read_bytes()) if file.is_file() else ""
    return {integer(number): name for name, number in _NAME.findall(_HEADING.split(text)[-1])}


def _names_of(path: Path) -> Path:
    """The place of mesh.names: of parts, it is in the folder of the whole mesh."""
    own = path / "mesh.names"
    return own if own.is_file() else path.parent / "mesh.names"


def _move(source: Path, target: Path, points: Floats) -> None:
    """Write the folder with other coordinates of the nodes."""
    of_part = {stem: _nodes(source, stem)[0] for stem in _stems(source)}
    numbers = np.concatenate(list(of_part.values()))
    unique, first = np.unique(numbers, return_index=True)
    rows = np.argsort(np.argsort(first))  # of each number among the nodes, which are in the order of the files
    shutil.copytree(source, target)
    if (names := _names_of(source)).is_file():
        shutil.copy(names, target / "mesh.names")
    for stem, own in of_part.items():
        moved = points[rows[np.searchsorted(unique, own)]]

        def change(lines: list[bytes], moved: Floats = moved) -> None:
            move_rows(lines, 0, moved, column=2)

        edit_lines(source / f"{stem}.nodes", target / f"{stem}.nodes", change)


ELMER = Format("an Elmer folder", (), re.compile(rb"(?m)^(mesh|part\.1)\.header$"), _read, move=_move, folder=True)
