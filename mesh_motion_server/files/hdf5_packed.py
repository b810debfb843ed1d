"""What the arrays of an HDF5 file unpack to, told before HDF5 unpacks them."""

from __future__ import annotations

import math
import zlib
from typing import Any

from mesh_motion_server.files.memory import most_memory

__all__ = ["Unpacked"]

#: No filter of HDF5 makes arrays smaller than this.
_BEST_COMPRESSION = 1100
_SMALL = 1 << 16
#: HDF5's numbers of gzip, and of the filters that keep the length, but for a checksum.
_GZIP, _SHUFFLE, _FLETCHER32 = 1, 2, 3
_CHECKSUMS = 64


class Unpacked:
    """The arrays read of a file, and of those that it links to: what they are together, and what they take there."""

    def __init__(self) -> None:
        self._stored: dict[tuple[int, int], int] = {}  # by file and place: many names may stand for one array
        self._size = 0

    def add(self, data: Any) -> None:
        """Count one of h5py's datasets before it is read.

        Raises
        ------
        ValueError
            If it does not lie in the file, if a chunk unpacks to more than a chunk, or if all arrays so far are more
            than those of a mesh may be that takes what they take.
        """
        import h5py  # noqa: PLC0415  (where a dataset is, there it is)

        stored, size = data.id.get_storage_size(), data.size * data.dtype.itemsize
        largest = max(size, _chunk_bytes(data))
        if size > _SMALL + _BEST_COMPRESSION * stored or largest > most_memory(stored):
            raise ValueError(f"{data.size} values, of which only {stored} bytes lie in the file")
        place = h5py.h5o.get_info(data.id)
        self._stored[place.fileno, place.addr] = stored
        self._size += size
        packed = sum(self._stored.values())
        if self._size > most_memory(packed):
            raise ValueError(f"with it the arrays are {self._size} bytes, of which only {packed} lie in the file")
        _check_chunks(data)


def _chunk_bytes(data: Any) -> int:
    """Of an unpacked chunk; HDF5 holds one, however few of its values are in the array. 0 without chunks."""
    return math.prod(data.chunks) * int(data.dtype.itemsize) if data.chunks else 0


def _check_chunks(data: Any) -> None:
    """Refuse chunks that gzip unpacks to more than a chunk; those that could not fill the memory are not looked at."""
    plan = data.id.get_create_plist()
    filters = [plan.get_filter(number)[0] for number in range(plan.get_nfilters())]
    packing = [code for code in filters if code not in (_SHUFFLE, _FLETCHER32)]
    if len(packing) > 1:
        raise ValueError("its data are packed more than once; pack them once, as by h5repack -f GZIP=1")
    if packing != [_GZIP]:
        return
    chunks: list[Any] = []
    data.id.chunk_iter(chunks.append)
    most = _chunk_bytes(data) + _CHECKSUMS
    for chunk in chunks:
        skipped = chunk.filter_mask >> filters.index(_GZIP) & 1
        if skipped or _BEST_COMPRESSION * chunk.size <= most_memory(chunk.size):
            continue
        _, content = data.id.read_direct_chunk(chunk.chunk_offset)
        if len(zlib.decompressobj().decompress(content, most + 1)) > most:
            raise ValueError(f"a chunk of {chunk.size} bytes unpacks to more than the {most - _CHECKSUMS} of a chunk")
