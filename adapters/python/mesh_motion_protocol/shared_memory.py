"""Large arrays of a reply in memory that its receiver shares (SPEC.md, section 22): written once, not sent by a socket.

The receiver makes anonymous memory and offers it with its request; a sender on the same machine writes the arrays
there. A random key at the start of the memory shows that both mean the same memory: in another container the same
process id may belong to another process. The size of the memory is sealed, so the sender can map it safely: nothing can
truncate it.
"""

from __future__ import annotations

import mmap
import os
import secrets
import stat
import sys
import weakref
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mesh_motion_protocol.errors import ProtocolError

if sys.platform == "linux":
    import fcntl

    #: Allocate all pages at once: a page fault for each one takes longer than the copy.
    _FLAGS = mmap.MAP_SHARED | mmap.MAP_POPULATE

__all__ = ["FEATURE", "SUPPORTED", "SharedMemory", "is_large", "written"]

#: Name of this feature in HELLO and WELCOME.
FEATURE = "shared-memory"
SUPPORTED = sys.platform == "linux"
#: Smaller arrays, in bytes, are sent faster as frames.
_LEAST_BYTES = 1 << 20
#: Random bytes at the start of a memory: a sender writes only into a file that begins with the key of its request.
_KEY_BYTES = 16
#: Arrays begin at multiples of this number of bytes; the first one follows the key.
_ALIGNMENT = 64
#: Number of memories that a sender keeps mapped although their owners may be gone: four for each of some ranks.
_MAPPED = 64


class SharedMemory:
    """Memory for the large arrays of one reply at a time; it exists as long as this object, or an array in it.

    Parameters
    ----------
    nbytes : int
        Size of these arrays.

    Attributes
    ----------
    offer : dict
        Description of the memory in the request: ``memory`` of MOVE.

    Raises
    ------
    OSError
        If no memory can be had.
    """

    def __init__(self, nbytes: int) -> None:
        descriptor = os.memfd_create("mesh-motion", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
        weakref.finalize(self, os.close, descriptor)
        key = secrets.token_bytes(_KEY_BYTES)
        os.ftruncate(descriptor, nbytes + 4 * _ALIGNMENT)
        os.pwrite(descriptor, key, 0)
        fcntl.fcntl(descriptor, fcntl.F_ADD_SEALS, fcntl.F_SEAL_SHRINK)
        self._map = mmap.mmap(descriptor, 0, flags=_FLAGS)
        self.offer = {"process": os.getpid(), "descriptor": descriptor, "key": key}

    def holds(self, nbytes: int) -> bool:
        """Whether arrays of this many bytes fit in, and no array of an earlier reply is still in use."""
        if nbytes + 4 * _ALIGNMENT > len(self._map):
            return False
        try:
            self._map.resize(len(self._map))  # raises an error while an array refers to the memory
        except BufferError:
            return False
        return True

    def array(self, at: Any, items: int, dtype: str) -> NDArray[Any]:
        """Return an array of ``items`` of 8 bytes, from the byte ``at`` on.

        Raises
        ------
        ProtocolError
            INVALID_ARGUMENT.HEADER if the array would be outside the memory.
        """
        last = len(self._map) - 8 * items
        if type(at) is not int or not items or at % _ALIGNMENT or not _ALIGNMENT <= at <= last:
            raise ProtocolError(f"an array of {items} items cannot lie at {at!r:.40}", code="INVALID_ARGUMENT.HEADER")
        return np.frombuffer(self._map, dtype=dtype, count=items, offset=at)


def is_large(array: NDArray[Any]) -> bool:
    """Whether an array is written to offered memory: its items have 8 bytes, and there are enough of them."""
    return array.dtype.itemsize == 8 and array.nbytes >= _LEAST_BYTES


def written(offer: Mapping[str, Any], arrays: Sequence[NDArray[Any]]) -> dict[int, int]:
    """Write the large arrays of ``arrays`` to the offered memory.

    Returns
    -------
    dict
        Index → place in the memory. Empty if there is no offer, or if this process may not write to the memory.
    """
    process, descriptor, key = offer.get("process"), offer.get("descriptor"), offer.get("key")
    if type(process) is not int or type(descriptor) is not int or type(key) is not bytes or not SUPPORTED:
        return {}
    places: dict[int, int] = {}
    end = _ALIGNMENT
    for index, array in enumerate(arrays):
        if is_large(array):
            places[index] = end
            end += -(-array.nbytes // _ALIGNMENT) * _ALIGNMENT
    if not places:
        return {}
    try:
        memory = _mapped(process, descriptor, key, end)
    except (OSError, ValueError):
        return {}
    for index, at in places.items():
        array = arrays[index]
        np.frombuffer(memory, array.dtype.newbyteorder("<"), array.size, at)[:] = array.reshape(-1)
    return places


@lru_cache(_MAPPED)
def _mapped(process: int, descriptor: int, key: bytes, nbytes: int) -> mmap.mmap:
    """Map the first bytes of anonymous memory that begins with the key and that no process can shrink.

    Raises
    ------
    OSError, ValueError
        If there is no such memory, or if it is smaller.
    """
    path = f"/proc/{process}/fd/{descriptor}"
    if not stat.S_ISREG(os.stat(path).st_mode):  # opening another kind of file might have side effects
        raise OSError(f"{path} is not a file")
    memory = os.open(path, os.O_RDWR)
    try:
        sealed = fcntl.fcntl(memory, fcntl.F_GET_SEALS) & fcntl.F_SEAL_SHRINK  # a file without a name
        if not sealed or os.pread(memory, _KEY_BYTES, 0) != key:
            raise OSError(f"{path} is not the memory that is offered")
        if os.fstat(memory).st_size < nbytes:
            raise OSError(f"{path} is too small")
        os.posix_fallocate(memory, 0, nbytes)  # too little memory gives an error here; later it would end the process
        return mmap.mmap(memory, nbytes, flags=_FLAGS)
    finally:
        os.close(memory)
