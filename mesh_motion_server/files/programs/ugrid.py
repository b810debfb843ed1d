"""UGRID of AFLR3, FUN3D, Pointwise and others: text, C binary or Fortran's, of either byte order and precision.

Surface numbers become patches. Names and symmetry planes are taken from FUN3D's ``.mapbc`` file.

https://www.simcenter.msstate.edu/software/documentation/ug_io/3d_grid_file_type_ugrid.html
"""

import re
import shutil
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.files.format import Format
from mesh_motion_server.files.mesh_file import MeshFile, assemble, concatenated
from mesh_motion_server.files.moved import Place, edit, replaced
from mesh_motion_server.files.text import integer, number_array, text_of

#: Faces, then cells, in the order of the file: our type and the order of its corners.
_FACES = (("triangle", [0, 1, 2]), ("quad", [0, 1, 2, 3]))
_CELLS = (
    ("tetra", [0, 1, 2, 3]),
    ("pyramid", [1, 0, 3, 4, 2]),
    ("wedge", [0, 1, 2, 3, 4, 5]),
    ("hexahedron", list(range(8))),
)
#: FUN3D's conditions: symmetry in x, y, z, or in any plane.
_SYMMETRY = range(6660, 6664)
#: The letters for byte order and precision, and the ending.
_ENDING = re.compile(r"(\.l?[bru][48])?\.ugrid$")


@dataclass(frozen=True, eq=False)
class _Content:
    """The counts (7,), the place of the coordinates, the coordinates (n, 3), and the integers that follow."""

    counts: tuple[int, ...]
    place: Place
    points: Floats
    integers: Integers


def _size(counts: tuple[int, ...]) -> int:
    """Number of the integers that describe faces and cells."""
    widths = [len(corners) for _, corners in (*_FACES, *_CELLS)]
    return sum(count * width for count, width in zip(counts[1:], widths, strict=True)) + counts[1] + counts[2]


def _content(data: bytes) -> _Content:
    if re.match(rb"\s*\d+(\s+\d+){6}\s", data):
        return _text(data)
    # optional records may follow, so the file may be longer
    for order, start, width, counts in _layouts(data):
        kind = f"{order}f{width}"
        end = start + 3 * width * counts[0]
        if end + 4 * _size(counts) <= len(data):
            integers = np.frombuffer(data, f"{order}i4", _size(counts), end).astype(np.int64)
            if ((integers[:3] >= 1) & (integers[:3] <= counts[0])).all():
                points = np.frombuffer(data, kind, 3 * counts[0], start).reshape(-1, 3).astype(np.float64)
                return _Content(counts, Place(counts[0], start, 3 * width, kind), points, integers)
    raise ValueError("no byte order and precision fits its size: it is not such a file, or cut off")


def _layouts(data: bytes) -> Iterator[tuple[str, int, int, tuple[int, ...]]]:
    """Byte order, place and size of the coordinates, and the counts, for each layout with sensible counts."""
    for order, (mark, width) in product("<>", product((0, 4), (8, 4))):  # Fortran has a mark around each record
        if not mark or data[:4] == np.array(28, f"{order}i4").tobytes():
            counts = tuple(np.frombuffer(data[mark : mark + 28], f"{order}i4").tolist())
            if len(counts) == 7 and counts[0] > 0 and min(counts) >= 0:
                yield order, 28 + 3 * mark, width, counts


def _text(data: bytes) -> _Content:
    words = data.split()
    counts = tuple(integer(word) for word in words[:7])
    end = 7 + 3 * counts[0]
    size = _size(counts)
    if len(words) < end + size:
        raise ValueError(f"{end + size} numbers by its first line, but {len(words)}")
    points = number_array(words[7:end], np.float64).reshape(-1, 3)
    integers = number_array(words[end : end + size], np.int64)
    return _Content(counts, Place(counts[0], 7, 3, text=(0, len(data))), points, integers)


def _read(path: Path) -> MeshFile:
    """Read a mesh from ``.ugrid``.

    Raises InvalidInput for a file without cells, a size that fits no layout, and nodes that do not exist.
    """
    try:
        return _mesh(path, _content(path.read_bytes()))
    except (ValueError, OverflowError) as error:
        raise InvalidInput(f"{path}: malformed UGRID mesh: {error}") from None


def _mesh(path: Path, found: _Content) -> MeshFile:
    _, *n_faces = found.counts[:3]
    if not any(found.counts[3:]):
        raise ValueError("it is a surface: mesh the space around it, and save the volume")
    begin = 0

    def taken(count: int, order: list[int]) -> Integers:
        nonlocal begin
        part = found.integers[begin : begin + count * len(order)].reshape(count, len(order))
        begin += part.size
        wrong = part[(part < 1) | (part > found.counts[0])]
        if len(wrong):
            raise ValueError(f"node {int(wrong[0])} is named, but there are 1 to {found.counts[0]}")
        return part[:, order] - 1

    faces = [taken(count, order) for count, (_, order) in zip(n_faces, _FACES, strict=True)]
    tags = np.split(found.integers[begin : begin + sum(n_faces)], n_faces[:1])
    begin += sum(n_faces)
    cells = {name: taken(count, order) for count, (name, order) in zip(found.counts[3:], _CELLS, strict=True)}
    names, symmetric = _names(path)
    patches: dict[str, list[Integers]] = defaultdict(list)
    for nodes, of in zip(faces, tags, strict=True):
        for tag in np.unique(of).tolist():
            patches[names.get(tag, str(tag))].append(nodes[of == tag].ravel())
    marked = {name: "symmetry" for name in patches if name in symmetric}
    return replace(assemble(path, found.points, cells, concatenated(patches)), marked=marked)


def _names(path: Path) -> tuple[dict[int, str], set[str]]:
    """{number: name} of the surfaces of the ``.mapbc`` file, and the names of symmetry planes."""
    conditions = _mapbc(path)
    if not conditions.is_file():
        return {}, set()
    names, symmetric = {}, set()
    for line in text_of(conditions.read_bytes()).splitlines()[1:]:  # the first line counts them
        number, kind, *name = line.partition("!")[0].split(maxsplit=2) or ["", ""]
        if number:
            names[integer(number)] = " ".join(name).strip() or number
            if integer(kind) in _SYMMETRY:
                symmetric.add(names[integer(number)])
    return names, symmetric


def _mapbc(path: Path) -> Path:
    """The file of the conditions: ``wing.mapbc`` of ``wing.lb8.ugrid``."""
    return path.with_name(_ENDING.sub("", path.name) + ".mapbc")


def _move(source: Path, target: Path, points: Floats) -> None:
    """Write the file with other coordinates of the nodes, and a copy of the names with it.

    Raises InvalidInput if the target's ending stands for another byte order or precision: programs read it by that.
    """
    endings = [found[0] if (found := _ENDING.search(path.name)) else "" for path in (source, target)]
    if endings[1] not in (".ugrid", endings[0]):
        raise InvalidInput(f"{target}: a copy of {source} ends in {endings[0]}, too", hint="rename it")
    edit(source, target, lambda data: replaced(data, [_content(data).place], points))
    if _mapbc(source).is_file() and _mapbc(source) != _mapbc(target):
        shutil.copyfile(_mapbc(source), _mapbc(target))


UGRID = Format("a UGRID mesh", (".ugrid",), re.compile(rb"(?!)"), _read, move=_move)
