"""Writing Gmsh's MSH format: a new file (2.2, ASCII, which most programs read), or one with other coordinates.

A new file has its cells in a physical group ``volume`` and each patch in a group by its name. Of an existing file only
the numbers in ``$Nodes`` are replaced, in the file's own version and form.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.files.mesh_file import FloatArray, IntArray, MeshFile
from mesh_motion_server.files.patch_facets import facets_of_patches
from mesh_motion_server.files.replace import replacing
from mesh_motion_server.files.text_rows import integer_rows, real_rows

__all__ = ["check_gmsh", "move_gmsh", "write_gmsh"]

_CODES = {"vertex": 15, "line": 1, "triangle": 2, "quad": 3, "tetra": 4, "hexahedron": 5, "wedge": 6, "pyramid": 7}
_DIMENSIONS = {"vertex": 0, "line": 1, "triangle": 2, "quad": 2}
_VOLUME = "volume"


def check_gmsh(path: Path, mesh: MeshFile) -> None:
    """Refuse patches whose names no group can have."""
    for name in mesh.patches:
        if '"' in name or "\n" in name:
            raise InvalidInput(f"{path}: patch {name!r} is no name for a group of Gmsh", hint="rename the patch")


def write_gmsh(path: Path, mesh: MeshFile) -> None:
    """Write a mesh; each patch is a physical group, its facets elements of it."""
    check_gmsh(path, mesh)
    names, blocks = [(mesh.dimension, 1, _VOLUME)], [(name, nodes, 1) for name, nodes in mesh.cells.items()]
    for tag, (name, patch) in enumerate(facets_of_patches(mesh).items(), start=2):
        parts = patch.facets | ({"vertex": patch.loose[:, None]} if len(patch.loose) else {})
        names += sorted({(_DIMENSIONS[kind], tag, name) for kind in parts})
        blocks += [(kind, nodes, tag) for kind, nodes in parts.items()]
    count = sum(len(nodes) for _, nodes, _ in blocks)
    points = np.pad(mesh.points, ((0, 0), (0, 3 - mesh.dimension)))
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", str(len(names))]
    lines += [f'{dimension} {tag} "{name}"' for dimension, tag, name in names]
    lines += ["$EndPhysicalNames", "$Nodes", str(len(points))]
    lines += [f"{number} {row}" for number, row in enumerate(real_rows(points), start=1)]
    lines += ["$EndNodes", "$Elements", str(count)]
    first = 1
    for kind, nodes, tag in blocks:
        lines += [f"{n} {row}" for n, row in enumerate(integer_rows(nodes + 1, [_CODES[kind], 2, tag, tag]), first)]
        first += len(nodes)
    with replacing(path) as file:
        file.write(("\n".join([*lines, "$EndElements"]) + "\n").encode())


def move_gmsh(path: Path, mesh: MeshFile, points: FloatArray) -> None:
    """Write the file again with other coordinates (n, d); what d leaves of x, y, z and all else stays."""
    data = bytearray(mesh.path.read_bytes())
    head = re.match(rb"\s*\$MeshFormat\s+(\S+)\s+([01])\s+(\d+)[^\n]*\n", data)
    start = re.search(rb"\$Nodes[ \t\r]*\n", data)
    if head is None or start is None:
        raise InvalidInput(f"{mesh.path}: no $Nodes found again: the file has changed meanwhile")
    version, binary, word = head[1].decode(), head[2] == b"1", int(head[3])
    order = "<"
    if binary:
        order = "<" if int.from_bytes(data[head.end() : head.end() + 4], "little") == 1 else ">"
        places = _places_41(data, start.end(), order, word) if version == "4.1" else _places_22(data, start.end())
        for axis in range(points.shape[1]):
            _put(data, places + 8 * axis, points[:, axis], order)
    else:
        end = data.index(b"$EndNodes", start.end())
        text = data[start.end() : end].decode("ascii")
        try:
            data[start.end() : end] = (_lines_41 if version == "4.1" else _lines_22)(text, points).encode()
        except (ValueError, IndexError, StopIteration):
            raise InvalidInput(f"{mesh.path}: its nodes are not one a line, as Gmsh writes them") from None
    with replacing(path) as file:
        file.write(data)


def _put(data: bytearray, places: IntArray, values: FloatArray, order: str) -> None:
    """Set the doubles that begin at these bytes."""
    view = np.frombuffer(data, np.uint8)
    view[places[:, None] + np.arange(8)] = values.astype(f"{order}f8").view(np.uint8).reshape(-1, 8)


def _places_22(data: bytearray, start: int) -> IntArray:
    """(n,) where the x of each node lies: behind the count each has a tag and three doubles."""
    stop = data.index(b"\n", start)
    return stop + 1 + 4 + 28 * np.arange(int(data[start:stop]))


def _places_41(data: bytearray, start: int, order: str, word: int) -> IntArray:
    """(n,) where the x of each node lies, block by block."""
    size = np.dtype(f"{order}u{word}")
    n_blocks = int(np.frombuffer(data, size, 1, start)[0])
    place, found = start + 4 * word, [np.empty(0, dtype=np.int64)]
    for _ in range(n_blocks):
        dimension, _, parametric = np.frombuffer(data, f"{order}i4", 3, place).tolist()
        count = int(np.frombuffer(data, size, 1, place + 12)[0])
        first = place + 12 + word + count * word
        width = 8 * (3 + (dimension if parametric else 0))
        found.append(first + width * np.arange(count))
        place = first + width * count
    return np.concatenate(found)


def _lines_22(text: str, points: FloatArray) -> str:
    """``tag x y z`` behind a line with the count."""
    count, *rows = text.strip().splitlines()
    moved = []
    for row, new in zip(rows, real_rows(points), strict=True):
        words = row.split()
        moved.append(" ".join([words[0], new, *words[1 + points.shape[1] :]]))
    return "\n".join([count, *moved]) + "\n"


def _lines_41(text: str, points: FloatArray) -> str:
    """Blocks: a line that ends with their count, tags, coordinates with perhaps parameters."""
    lines = text.strip().splitlines()
    rows = iter(real_rows(points))
    moved, place = lines[:1], 1
    while place < len(lines):
        count = int(lines[place].split()[3])
        moved += lines[place : place + 1 + count]
        for line in lines[place + 1 + count : place + 1 + 2 * count]:
            moved.append(" ".join([next(rows), *line.split()[points.shape[1] :]]))
        place += 1 + 2 * count
    return "\n".join(moved) + "\n"
