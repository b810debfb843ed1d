"""Plot3D grids of one or several blocks: text, C binary or Fortran's records, of either byte order and precision.

Cells on both sides of faces with the same four corners become neighbours: blocks that touch, the cut of an O-grid, the
wake of a C-grid. The other faces of the blocks become patches, one for each side: ``imin``, of several blocks
``block2_imin``. A face without area, at an axis, is on no patch; its corners at one place become one node.

https://www.grc.nasa.gov/www/wind/valid/plot3d.html
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.files.format import Format
from mesh_motion_server.files.mesh_file import MeshFile, assemble
from mesh_motion_server.files.moved import edit
from mesh_motion_server.files.packages import check_unpacked
from mesh_motion_server.files.text import number_array
from mesh_motion_server.files.vtk.grid import structured_cells
from mesh_motion_server.files.vtk.pieces import PatchKey, VtkPiece, renumbered

_NAMES = {3: "line", 9: "quad", 12: "hexahedron"}
#: Files with more blocks are another kind of file, read as numbers.
_MOST_BLOCKS = 100_000


@dataclass(frozen=True, eq=False)
class _Grid:
    """A file that was read.

    counts : nodes in each direction of each block
    content : the file's bytes, to be changed, or the numbers (k,) of a text
    blocks : (c, n) coordinates of each block, views of ``content``
    blanked : number of nodes that are marked as holes
    """

    counts: list[tuple[int, ...]]
    content: bytearray | Floats
    blocks: list[Floats]
    blanked: int


@dataclass(frozen=True)
class _Layout:
    """``kinds``: types of an integer and of a coordinate; ``mark``: bytes around each record."""

    kinds: tuple[str, str]
    mark: int
    several: bool
    axes: int
    blanks: bool

    def grid(self, content: bytearray | Floats) -> _Grid | None:
        """The grid, if the content has this layout."""
        buffer: Any = content if isinstance(content, bytearray) else content.data
        size = len(content) if isinstance(content, bytearray) else content.nbytes
        number, coordinate = map(np.dtype, self.kinds)

        def integers(start: int, count: int) -> list[int]:
            enough = start + count * number.itemsize <= size
            values = np.ndarray(count, number, buffer, start).tolist() if enough else [0] * count
            return [int(value) if value == value // 1 else 0 for value in values]

        start, n_blocks = self.mark, 1
        if self.mark and integers(0, 1) != [number.itemsize * (1 if self.several else self.axes)]:
            return None
        if self.several:
            (n_blocks,) = integers(start, 1)
            start += number.itemsize + 2 * self.mark
        if not 1 <= n_blocks <= _MOST_BLOCKS:
            return None
        sizes = integers(start, self.axes * n_blocks)
        if min(sizes) < 1:
            return None
        counts = [tuple(sizes[k : k + self.axes]) for k in range(0, len(sizes), self.axes)]
        start += len(sizes) * number.itemsize + 2 * self.mark
        blocks, blanked = [], 0
        for of in counts:
            n = int(np.prod(of, dtype=np.float64)) if np.prod(of, dtype=np.float64) < size else size
            after = start + self.axes * n * coordinate.itemsize
            end = after + self.blanks * n * number.itemsize
            if end + self.mark > size:
                return None
            blocks.append(np.ndarray((self.axes, n), coordinate, buffer, start))
            if self.blanks:
                blanked += int((np.ndarray(n, number, buffer, after) == 0).sum())
            start = end + 2 * self.mark
        return _Grid(counts, content, blocks, blanked) if start - self.mark == size else None


def _layouts(*, text: bool) -> Iterator[_Layout]:
    kinds = [("f8", "f8")] if text else [(f"{order}i4", f"{order}f{width}") for order in "<>" for width in (8, 4)]
    for mark, kind, several, axes, blanks in product(
        (0,) if text else (4, 0), kinds, (True, False), (3, 2), (False, True)
    ):
        yield _Layout(kind, mark, several, axes, blanks)


def _grid(path: Path, data: bytes) -> _Grid:
    content = _numbers(path, data)
    for layout in _layouts(text=not isinstance(content, bytearray)):
        found = layout.grid(content)
        if found is not None and all(np.isfinite(block).all() for block in found.blocks):
            return found
    raise ValueError("no numbers of blocks and nodes fit its size; only whole coordinates (x, then y, then z) are read")


def _numbers(path: Path, data: bytes) -> bytearray | Floats:
    """The numbers of a text, of which Fortran may repeat some (``3*0.0``), or the bytes of a binary file."""
    if re.search(rb"[^\s\d.,*eEdD+-]", data[:4096]):
        return bytearray(data)
    check_unpacked(path, len(data), sum(int(count) * 8 for count in re.findall(rb"(\d+)\*", data)))
    text = re.sub(rb"(\d+)\*(\S+)", lambda found: (found[2] + b" ") * int(found[1]), data.replace(b",", b" "))
    return number_array(text.split(), np.float64)


def _read(path: Path) -> MeshFile:
    """Read a grid. Raises InvalidInput if no layout fits the file."""
    try:
        grid = _grid(path, path.read_bytes())
        number, free = _joined(grid)
    except (ValueError, OverflowError) as error:
        raise InvalidInput(f"{path}: not readable as a Plot3D grid: {error}") from None
    pieces = []
    for place, (counts, block) in enumerate(zip(grid.counts, grid.blocks, strict=True)):
        code, nodes = structured_cells(counts)
        sides: dict[PatchKey, Integers] = {
            (0, name): faces[own].ravel() for name, faces, own in free[place] if own.any()
        }
        pieces.append(VtkPiece(block.T, {_NAMES[code]: nodes} if code in _NAMES else {}, sides))
    points = np.empty((int(number.max()) + 1, len(grid.blocks[0])))
    points[number[::-1]] = np.concatenate([block.T for block in grid.blocks])[::-1]  # of several nodes the first one
    whole = renumbered(pieces, number, points)
    mesh = assemble(path, points, whole.cells, {str(name): nodes for (_, name), nodes in whole.patches.items()})
    joined = len(number) - len(points)
    notes = [f"{joined} nodes on common faces of its blocks were joined"] * bool(joined)
    notes += [f"{grid.blanked} nodes are marked as holes; they are moved with the others"] * bool(grid.blanked)
    return replace(mesh, notes=(*mesh.notes, *notes))


#: Of each block, its sides: the name, the nodes (f, 4) or (f, 2) of its faces, and which of them are free.
_Sides = list[list[tuple[str, Integers, Marks]]]


def _joined(grid: _Grid) -> tuple[Integers, _Sides]:
    """The new number (n,) of each node of all blocks, and the sides of each block."""
    from mesh_motion_numerics.mesh.coincidence import first_at_place  # noqa: PLC0415 - needs scipy

    points = np.concatenate([block.T for block in grid.blocks]).astype(np.float64)
    first = np.cumsum([0, *(block.shape[1] for block in grid.blocks)])
    place = first_at_place(points, float(np.ptp(points, axis=0).max()))
    named: list[tuple[int, str, Integers]] = []
    for block, counts in enumerate(grid.counts):
        prefix = f"block{block + 1}_" if len(grid.counts) > 1 else ""
        named += [(block, prefix + name, faces) for name, faces in _block_sides(counts)]
    corners = np.concatenate([first[block] + faces for block, _, faces in named])
    keys = np.sort(place[corners], axis=1)
    again = np.diff(keys, axis=1, prepend=-1) == 0
    keys = np.sort(np.where(again, -1, keys), axis=1)
    flat = (~again).sum(axis=1) < min(corners.shape[1], 3)
    _, kind, times = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    twice = (times[kind.ravel()] > 1) | flat
    number = np.arange(len(points))
    inner = np.unique(corners[twice | again.any(axis=1)])
    _, index, row = np.unique(place[inner], return_index=True, return_inverse=True)
    number[inner] = inner[index][row]
    _, number = np.unique(number, return_inverse=True)
    free: _Sides = [[] for _ in grid.counts]
    begin = 0
    for block, name, faces in named:
        free[block].append((name, faces, ~twice[begin : begin + len(faces)]))
        begin += len(faces)
    return number, free


def _block_sides(counts: tuple[int, ...]) -> Iterator[tuple[str, Integers]]:
    """Name, and nodes of the faces, of each side of a block."""
    number = np.arange(int(np.prod(counts))).reshape(counts[::-1]).T
    for axis, end in product(range(len(counts)), (0, -1)):
        if counts[axis] > 1:
            side = number.take(end, axis=axis)
            _, faces = structured_cells(side.shape)
            yield f"{'ijk'[axis]}{'min' if end == 0 else 'max'}", side.T.ravel()[faces]


def _move(source: Path, target: Path, points: Floats) -> None:
    """Write the file with other coordinates of the nodes."""

    def changed(data: bytes) -> bytes:
        grid = _grid(source, data)
        number, _ = _joined(grid)
        moved = [block.copy() for block in grid.blocks]
        start = 0
        for block in moved:
            block[: points.shape[1]] = points[number[start : start + block.shape[1]]].T
            start += block.shape[1]
        for block in grid.blocks:
            block[:] = np.nan  # what is not a coordinate stays a number
        integers = [] if isinstance(grid.content, bytearray) else (~np.isnan(grid.content)).tolist()
        for block, values in zip(grid.blocks, moved, strict=True):
            block[:] = values
        if isinstance(grid.content, bytearray):
            return bytes(grid.content)
        pairs = zip(grid.content.tolist(), integers, strict=True)
        words = [str(int(value)) if whole else repr(value) for value, whole in pairs]
        axes, head = len(grid.counts[0]), integers.index(False)
        several = [" ".join(words[k : k + axes]) for k in range(head % axes, head, axes)]  # VTK counts those in a line
        return "\n".join([*words[: head % axes], *several, *words[head:], ""]).encode()

    edit(source, target, changed)


PLOT3D = Format("a Plot3D grid", (".xyz", ".p3d", ".x"), re.compile(rb"(?!)"), _read, move=_move)
