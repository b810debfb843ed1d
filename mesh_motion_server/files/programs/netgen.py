"""Netgen's ``.vol`` in text. Boundary conditions become patches, by their names.

https://github.com/NGSolve/netgen/blob/master/libsrc/meshing/meshclass.cpp, Mesh::Load
"""

import re
from collections import defaultdict
from pathlib import Path

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.files.format import Format
from mesh_motion_server.files.mesh_file import MeshFile, assemble_elements, concatenated
from mesh_motion_server.files.moved import edit_lines, move_rows
from mesh_motion_server.files.sides import PLANES, SOLIDS
from mesh_motion_server.files.text import integer, real, text_of

#: The sections that are used.
_SECTIONS = {
    "surfaceelements", "surfaceelementsgi", "surfaceelementsuv", "volumeelements", "edgesegmentsgi2",
    "edgesegmentsgi3", "edgedescriptors", "points", "bcnames",
}  # fmt: skip
#: The nodes of a plane element of second order after its corners are in the middles of these edges.
_MIDDLES = {6: ((1, 2), (0, 2), (0, 1)), 8: ((0, 1), (2, 3), (0, 3), (1, 2))}


def _sections(lines: list[str]) -> dict[str, tuple[int, list[str]]]:
    """The rows of each section, and the line of the first one; a section is a keyword, a count and its rows."""
    found, place = {}, 0
    while place < len(lines) and lines[place].strip() != "endmesh":
        word = lines[place].strip()
        place += 1
        if word not in _SECTIONS:
            continue
        count, first = integer(lines[place]), place + 1
        rows: list[str] = []
        place += 1
        while len(rows) < count:
            if place >= len(lines):
                raise ValueError(f"{count} {word}, but {len(rows)} rows follow")
            if lines[place].strip():
                rows.append(lines[place])
            place += 1
        found[word] = (first, rows)
    return found


def _read(path: Path) -> MeshFile:
    """Read a mesh from ``.vol``.

    Raises InvalidInput for malformed sections, unknown elements, and nodes that do not exist.
    """
    try:
        return _mesh(path, {key: rows for key, (_, rows) in _sections(_lines(path.read_bytes())).items()})
    except (ValueError, IndexError, OverflowError) as error:
        raise InvalidInput(f"{path}: malformed Netgen mesh: {error}") from None


def _lines(data: bytes) -> list[str]:
    return ["" if line.startswith(b"#") else text_of(line) for line in data.splitlines()]


def _mesh(path: Path, sections: dict[str, list[str]]) -> MeshFile:
    points = np.array([list(map(real, line.split())) for line in sections.get("points", [])], dtype=np.float64).reshape(
        -1, 3
    )
    names = {integer(line.split()[0]): " ".join(line.split()[1:]) for line in sections.get("bcnames", [])}
    surface = [row for key, rows in sections.items() if key.startswith("surfaceelements") for row in rows]
    faces = _elements(surface, 4, len(points))
    solids = _elements(sections.get("volumeelements", []), 1, len(points))
    edges = {} if solids else _segments(sections, len(points))
    patches: dict[str, list[Integers]] = defaultdict(list)
    for conditions, nodes in (faces if solids else edges).values():
        for number in np.unique(conditions).tolist():
            own = nodes[conditions == number].ravel()
            patches[names.get(number) or str(number)] += [own] if solids else [own, _between(own, faces)]
    elements = [(PLANES[size], nodes) for size, (_, nodes) in faces.items()]
    for size, (_, nodes) in solids.items():
        if SOLIDS[size] == "tetra":  # Netgen's are left-handed
            nodes[:, [1, 2]] = nodes[:, [2, 1]]
        elements.append((SOLIDS[size], nodes))
    return assemble_elements(path, points, elements, concatenated(patches))


def _elements(rows: list[str], before: int, n_points: int) -> dict[int, tuple[Integers, Integers]]:
    """{number of nodes: (conditions (m,), nodes (m, k))}; ``before`` numbers come before that number."""
    found: dict[int, list[list[int]]] = defaultdict(list)
    for place, line in enumerate(rows, start=1):
        words = line.split()
        size = integer(words[before])
        if size not in (SOLIDS if before == 1 else PLANES) or len(words) < before + 1 + size:
            what = "volumeelements" if before == 1 else "surfaceelements"
            raise ValueError(f"row {place} of {what} has {size} nodes, but {len(words) - before - 1} numbers follow")
        found[size].append([integer(word) for word in words[: before + 1 + size]])
    parts = {}
    for size, listed in found.items():
        values = np.array(listed, dtype=np.int64)
        parts[size] = (values[:, int(before > 1)], _rows(values[:, before + 1 :], n_points))
    return parts


def _segments(sections: dict[str, list[str]], n_points: int) -> dict[int, tuple[Integers, Integers]]:
    """The same of the edges in the plane; newer files have the number of a descriptor, from 0, in each row."""
    if "edgesegmentsgi3" in sections:
        rows = np.array(
            [list(map(real, line.split())) for line in sections["edgesegmentsgi3"]], dtype=np.float64
        ).reshape(-1, 7)
        descriptors = [integer(line.split()[0]) for line in sections["edgedescriptors"]]
        conditions = np.array(descriptors, dtype=np.int64)[rows[:, 6].astype(np.int64)]
        nodes = rows[:, :2]
    else:
        rows = np.array(
            [list(map(real, line.split()[:4])) for line in sections.get("edgesegmentsgi2", [])], dtype=np.float64
        )
        conditions, nodes = rows[:, 0].astype(np.int64), rows[:, 2:]
    return {2: (conditions, _rows(nodes.astype(np.int64), n_points))}


def _between(edges: Integers, faces: dict[int, tuple[Integers, Integers]]) -> Integers:
    """The nodes in the middles of edges (2 e,) in the plane, which are listed with the cells only."""
    known: dict[tuple[int, ...], int] = {}
    for size, (_, nodes) in faces.items():
        for column, ends in enumerate(_MIDDLES.get(size, ()), start=size // 2):
            pairs = map(tuple, np.sort(nodes[:, ends], axis=1).tolist())
            known |= dict(zip(pairs, nodes[:, column].tolist(), strict=True))
    pairs = map(tuple, np.sort(edges.reshape(-1, 2), axis=1).tolist())
    return np.array([known[pair] for pair in pairs if pair in known], dtype=np.int64)


def _rows(numbers: Integers, n_points: int) -> Integers:
    """The nodes from 0."""
    wrong = numbers[(numbers < 1) | (numbers > n_points)]
    if len(wrong):
        raise ValueError(f"node {int(wrong[0])} is named, but there are 1 to {n_points}")
    return numbers - 1


def _move(source: Path, target: Path, points: Floats) -> None:
    """Write the file with other coordinates of the nodes."""

    def change(lines: list[bytes]) -> None:
        first, _ = _sections(_lines(b"".join(lines)))["points"]
        move_rows(lines, first, points)

    edit_lines(source, target, change)


NETGEN = Format("a Netgen mesh", (".vol",), re.compile(rb"\A(\s|#.*\n)*mesh3d\b"), _read, move=_move)
