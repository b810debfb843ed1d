"""Copies of mesh files in which only the coordinates are new: everything else stays as the other program wrote it.

Coordinates are replaced in place: numbers in the rows of a text, values in a binary block, data sets of HDF5.
Text has as many digits as needed to be read as the same number again.
"""

import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from mesh_motion_numerics.arrays import Floats
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.files.packages import load_h5py
from mesh_motion_server.files.replace import replaced_by_name, replacing

_NUMBER = re.compile(rb"[^\s,()]+")
#: Characters that have a meaning in XDMF or EnSight's case files, or that no text in UTF-8 has.
_NO_NAME = re.compile(r"[\x00-\x1f\x7f\ud800-\udfff&<>:*?\"]")


def companions(target: Path) -> str:
    """The beginning of the names of further files, which the text of ``target`` will contain."""
    if odd := _NO_NAME.search(target.stem):
        raise InvalidInput(f"{target}: it names its other files after itself, without {odd[0]!r}", hint="rename it")
    return target.stem


@dataclass(frozen=True)
class Place:
    """The place of the coordinates of the next ``count`` nodes in a file."""

    count: int
    #: first, stride: the place of the first node's x, and the distance to the next node's x: in bytes of the file, or
    #: in numbers of its text
    first: int
    stride: int
    dtype: str = ""  # type of a binary coordinate
    text: tuple[int, int] = (0, 0)  # begin and end of the text, if it is text


def replaced(data: bytes, places: list[Place], points: Floats) -> bytes:
    """The file with other coordinates (n, d) of the nodes at these places, which are in the order of the nodes."""
    starts = np.cumsum([0, *(place.count for place in places)])
    content = bytearray(data)
    texts = []
    for place, start in zip(places, starts, strict=False):
        values = points[start : start + place.count]
        if place.dtype:
            shape, strides = values.shape, (place.stride, np.dtype(place.dtype).itemsize)
            np.ndarray(shape, place.dtype, content, place.first, strides)[:] = values
        else:
            texts.append((place, values))
    texts.sort(key=lambda one: one[0].text, reverse=True)  # from the end, because the text changes its length
    for (begin, end), group in groupby(texts, key=lambda one: one[0].text):
        words = re.split(rb"(\s+)", data[begin:end])  # alternating numbers and blanks
        ahead = 2 * (words[0] == b"")
        for place, values in group:
            for row, node in enumerate(values.tolist()):
                for axis, value in enumerate(node):
                    words[ahead + 2 * (place.first + row * place.stride + axis)] = repr(value).encode()
        content[begin:end] = b"".join(words)
    return bytes(content)


def edit(source: Path, target: Path, change: Callable[[bytes], bytes]) -> None:
    """Write the changed content of ``source`` to ``target``."""
    content = change(source.read_bytes())
    with replacing(target) as file:
        file.write(content)


def edit_lines(source: Path, target: Path, change: Callable[[list[bytes]], None]) -> None:
    """Write ``source`` with changed lines; ``change`` gets the lines with their ends."""

    def changed(data: bytes) -> bytes:
        lines = data.splitlines(keepends=True)
        change(lines)
        return b"".join(lines)

    edit(source, target, changed)


def move_rows(lines: list[bytes], first: int, points: Floats, *, column: int = 0, comment: bytes = b"") -> int:
    """Replace the coordinates in the rows from line ``first`` on, one for each node; the line after the last one.

    Raises InvalidInput if a row has fewer numbers, or there are fewer rows.

    Parameters
    ----------
    points : (n, d) array
        The numbers ``column`` to ``column + d - 1`` of the rows, counted from 0. Other numbers of a row are not
        changed.
    comment : bytes
        Lines that begin so are not rows; nor are blank ones.
    """
    place = first
    for node, values in enumerate(points.tolist()):
        while place < len(lines) and (
            lines[place].isspace() or (comment and lines[place].lstrip().startswith(comment))
        ):
            place += 1
        line = lines[place] if place < len(lines) else b""
        found = [match.span() for match in _NUMBER.finditer(line)][column : column + len(values)]
        if len(found) < len(values):
            raise InvalidInput(
                f"line {place + 1}, expected as the row of node {node}, has no {len(values)} numbers: {line[:40]!r}",
                hint="write .npz or .vtu",
            )
        parts, end = [], 0
        for (begin, stop), value in zip(found, values, strict=True):
            parts += [line[end:begin], repr(value).encode()]
            end = stop
        lines[place] = b"".join([*parts, line[end:]])
        place += 1
    return place


@contextmanager
def copied_hdf5(source: Path, target: Path) -> Iterator[Any]:
    """A copy of an HDF5 file, open for changes; it gets the name ``target`` when the block ends without an error."""
    h5py = load_h5py(source)
    with replaced_by_name(target) as partial:
        shutil.copyfile(source, partial)
        with h5py.File(partial, "r+", locking=False) as file:
            yield file
