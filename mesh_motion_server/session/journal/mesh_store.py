"""A session's mesh in the form in which its partitions uploaded it, in one immutable file.

``mesh.bin``: magic "MMMESH" 01 0a, the header's length (8 bytes, little-endian), the header (a msgpack list with one
map per partition: nodes, dimension, cells {type: rows}, or counted {type: rows} where the cells stay with the client,
patches {name: [role, rows]}, and there facets and near {type: rows}), zeros up to a multiple of 8,
then per partition, little-endian and row by row: coordinates (doubles), global ids, cells by type, patches by name,
facets and cells near walls by type (64-bit integers). Its sha256 is in the journal's first record.
"""

import hashlib
import struct
from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.mesh.cells import CELL_TYPES
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_protocol.errors import DataLoss
from numpy.typing import NDArray

from mesh_motion_server.failpoints import failpoint
from mesh_motion_server.session.journal.filesystem import FileSystem, reading, unreadable, write_all
from mesh_motion_server.session.partitions.facets import FACET_NODES
from mesh_motion_server.session.partitions.meshes import PartitionMesh

MESH = "mesh.bin"
"""The file's name in a session's folder."""

_MAGIC = b"MMMESH\x01\n"
_LENGTH = struct.Struct("<Q")
_START = len(_MAGIC) + _LENGTH.size
#: Number of rows written at a time: half a megabyte of tetrahedra.
_BLOCK_ROWS = 1 << 14


def write_mesh(path: Path, files: FileSystem, partitions: Sequence[PartitionMesh]) -> bytes:
    """Write and sync the file (not its folder); return its sha256."""
    header = msgpack.packb([_describe(partition) for partition in partitions])
    head = _MAGIC + _LENGTH.pack(len(header)) + header
    head += bytes(-len(head) % 8)
    digest = hashlib.sha256()
    handle = files.create(path, len(head) + 8 * sum(_count(partition) for partition in partitions))
    try:
        offset = 0
        for part in chain([head], (b.data.cast("B") for partition in partitions for b in _blocks(partition))):
            offset = write_all(files, handle, offset, part)
            digest.update(part)
        failpoint("store.mesh.unsynced")
        files.sync(handle)
    finally:
        files.close(handle)
    return digest.digest()


def read_mesh(path: Path, files: FileSystem, digest: bytes) -> list[PartitionMesh]:
    """Read the partitions, bitwise as they were written.

    Raises DataLoss: DATA_LOSS.CHECKSUM if the file is missing or not the one that was written; RESOURCE_EXHAUSTED.DISK
    if the disk does not give it; UNIMPLEMENTED.VERSION for another format.
    """
    try:
        failpoint("store.mesh.read")
        with reading(files, path) as handle:
            magic = files.read(handle, 0, len(_MAGIC))
            other_format = magic[:6] == _MAGIC[:6] and magic != _MAGIC
            data = files.read(handle, 0, files.size(handle)) if other_format or has_its_length(path, files) else b""
    except OSError as error:
        raise unreadable("the mesh", error) from error
    if hashlib.sha256(data).digest() != digest:
        raise DataLoss(
            "the stored mesh does not match its digest",
            hint="restore the session's folder from a backup, or discard the session",
            details={"file": path.name},
        )
    if data[: len(_MAGIC)] != _MAGIC:
        raise DataLoss(
            f"the stored mesh has format {data[6]}; this version reads format {_MAGIC[6]}",
            code="UNIMPLEMENTED.VERSION",
            hint="open it with the version of the server that wrote it",
            details={"file": path.name},
        )
    (length,) = _LENGTH.unpack_from(data, len(_MAGIC))
    end = _START + length
    reader = _Reader(data, end + -end % 8)
    return [_restore(described, reader) for described in msgpack.unpackb(data[_START:end])]


def verifies(path: Path, files: FileSystem, digest: bytes, most: int) -> bool:
    """Whether the file is the one that was written; beyond ``most`` bytes, only whether it :func:`has_its_length`.

    Raises OSError if the disk does not give the file.
    """
    with reading(files, path) as handle:
        size = files.size(handle)
        if size <= most:
            return hashlib.sha256(files.read(handle, 0, size)).digest() == digest
    return has_its_length(path, files)


def has_its_length(path: Path, files: FileSystem) -> bool:
    """Whether the file is as long as its header says; reads only the header, and so finds no wrong numbers.

    Raises OSError if the disk does not give the file.
    """
    with reading(files, path) as handle:
        size, head = files.size(handle), files.read(handle, 0, _START)
        if len(head) < _START:
            return False
        (length,) = _LENGTH.unpack_from(head, len(_MAGIC))
        header = files.read(handle, _START, min(length, size))
    end = _START + length
    try:
        return bool(size == end + -end % 8 + 8 * sum(map(_described_count, msgpack.unpackb(header))))
    except (ValueError, LookupError, TypeError, AttributeError):  # the header is damaged
        return False


def _describe(partition: PartitionMesh) -> dict[str, Any]:
    """One partition's map in the header."""
    described: dict[str, Any] = {
        "nodes": partition.points.shape[0],
        "dimension": partition.points.shape[1],
        "cells": {},
        "patches": {name: [patch.role, len(patch.nodes)] for name, patch in partition.patches.items()},
    }
    for name in partition.cells:
        pieces = partition.cell_pieces(name)
        key = "cells" if any(piece.size for piece in pieces) or not pieces else "counted"
        described.setdefault(key, {})[name] = sum(map(len, pieces))
    if partition.facets:
        described["facets"] = {name: len(rows) for name, rows in partition.facets.items()}
    if partition.near:
        described["near"] = {name: len(rows) for name, rows in partition.near.items()}
    return described


def _count(partition: PartitionMesh) -> int:
    """Number of numbers that are written for a partition."""
    cells = sum(piece.size for name in partition.cells for piece in partition.cell_pieces(name))
    patches = sum(len(patch.nodes) for patch in partition.patches.values())
    parts = sum(rows.size for types in (partition.facets, partition.near) for rows in types.values())
    return partition.points.size + len(partition.global_ids) + cells + patches + parts


def _described_count(described: dict[str, Any]) -> int:
    """Number of numbers that are written for a partition, from its map in the header."""
    cells = sum(rows * CELL_TYPES[name].n_nodes for name, rows in described["cells"].items())
    patches = sum(rows for _, rows in described["patches"].values())
    facets = sum(rows * FACET_NODES[name] for name, rows in described.get("facets", {}).items())
    near = sum(rows * CELL_TYPES[name].n_nodes for name, rows in described.get("near", {}).items())
    return int(described["nodes"] * (described["dimension"] + 1) + cells + patches + facets + near)


def _blocks(partition: PartitionMesh) -> Iterator[NDArray[Any]]:
    """Yield a partition's arrays as they are written, some rows at a time, so that widened rows stay in the cache."""
    cells = [piece for name in partition.cells for piece in partition.cell_pieces(name)]
    numbers = [partition.global_ids, *cells, *(patch.nodes for patch in partition.patches.values())]
    numbers += [*partition.facets.values(), *partition.near.values()]
    for array, dtype in [(partition.points, "<f8"), *((array, "<i8") for array in numbers)]:
        for start in range(0, len(array) if array.size else 0, _BLOCK_ROWS):
            yield np.ascontiguousarray(array[start : start + _BLOCK_ROWS], dtype=dtype)


class _Reader:
    """Takes one array after the other from the file's bytes."""

    def __init__(self, data: bytes, offset: int) -> None:
        self._data = data
        self._offset = offset

    def floats(self, rows: int, columns: int) -> Floats:
        """The next (rows, columns) doubles."""
        taken = np.frombuffer(self._data, "<f8", rows * columns, self._offset)
        self._offset += taken.nbytes
        return taken.reshape(rows, columns).astype(np.float64, copy=False)

    def integers(self, count: int) -> Integers:
        """The next ``count`` integers."""
        taken = np.frombuffer(self._data, "<i8", count, self._offset)
        self._offset += taken.nbytes
        return taken.astype(np.int64, copy=False)


def _restore(described: dict[str, Any], reader: _Reader) -> PartitionMesh:
    """Restore one partition from its map and the arrays that follow."""
    nodes = described["nodes"]
    return PartitionMesh(
        points=reader.floats(nodes, described["dimension"]),
        global_ids=reader.integers(nodes),
        cells={
            name: reader.integers(rows * CELL_TYPES[name].n_nodes).reshape(rows, -1)
            for name, rows in described["cells"].items()
        }
        | {name: np.empty((rows, 0), dtype=np.int64) for name, rows in described.get("counted", {}).items()},
        patches={name: Patch(role, reader.integers(rows)) for name, (role, rows) in described["patches"].items()},
        facets={
            name: reader.integers(rows * FACET_NODES[name]).reshape(rows, -1)
            for name, rows in described.get("facets", {}).items()
        },
        near={
            name: reader.integers(rows * CELL_TYPES[name].n_nodes).reshape(rows, -1)
            for name, rows in described.get("near", {}).items()
        },
    )
