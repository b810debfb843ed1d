"""Large arrays of a reply in memory that its receiver shares (SPEC.md, section 22): written once, sent by no socket.

The receiver makes anonymous memory and offers it with its request; a sender on its machine writes the arrays there.
A random key at its beginning shows that both mean the same memory: in another container a process's number may be that
of another process. Its size is sealed, so the sender can map it: no truncation can end it.
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

    #: Pages are there at once: a fault for each one takes longer than the copy.
    _FLAGS = mmap.MAP_SHARED | mmap.MAP_POPULATE

__all__ = ["FEATURE", "SUPPORTED", "SharedMemory", "is_large", "written"]

#: In HELLO and WELCOME.
FEATURE = "shared-memory"
SUPPORTED = sys.platform == "linux"
#: Arrays of fewer bytes go faster as frames.
_LEAST_BYTES = 1 << 20
_KEY_BYTES = 16
#: Arrays begin at multiples of this, the first one behind the key.
_ALIGNMENT = 64
#: Memories that a sender keeps mapped, whose owners may be gone: four of each of some ranks.
_MAPPED = 64


class SharedMemory:
    """Memory for the large arrays of one reply at a time; it lasts as long as this, or an array in it.

    Parameters
    ----------
    nbytes : int
        Of these arrays.

    Attributes
    ----------
    offer : dict
        What the request says of it: ``memory`` of MOVE.

    Raises
    ------
    OSError
        If there is none.
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
        """Whether arrays of so many bytes fit in, and no array of an earlier reply is in use any more."""
        if nbytes + 4 * _ALIGNMENT > len(self._map):
            return False
        try:
            self._map.resize(len(self._map))  # refused while an array refers to it
        except BufferError:
            return False
        return True

    def array(self, at: Any, items: int, dtype: str) -> NDArray[Any]:
        """``items`` of 8 bytes from the byte ``at`` on.

        Raises
        ------
        ProtocolError
            INVALID_ARGUMENT.HEADER if they lie elsewhere than they may.
        """
        last = len(self._map) - 8 * items
        if type(at) is not int or not items or at % _ALIGNMENT or not _ALIGNMENT <= at <= last:
            raise ProtocolError(f"an array of {items} items cannot lie at {at!r:.40}", code="INVALID_ARGUMENT.HEADER")
        return np.frombuffer(self._map, dtype=dtype, count=items, offset=at)


def is_large(array: NDArray[Any]) -> bool:
    """Whether an array is written to memory that is offered: 8 bytes an item, and enough of them."""
    return array.dtype.itemsize == 8 and array.nbytes >= _LEAST_BYTES


def written(offer: Mapping[str, Any], arrays: Sequence[NDArray[Any]]) -> dict[int, int]:
    """Write the large ones of ``arrays`` to the memory that is offered.

    Returns
    -------
    dict
        Index → where it lies. Empty where the offer is none, or not of memory that this process may write to.
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
    """The first bytes of anonymous memory that begins with the key, and that no process can make smaller.

    Raises
    ------
    OSError, ValueError
        If there is none, or less.
    """
    path = f"/proc/{process}/fd/{descriptor}"
    if not stat.S_ISREG(os.stat(path).st_mode):  # opening anything else might do something
        raise OSError(f"{path} is no file")
    memory = os.open(path, os.O_RDWR)
    try:
        sealed = fcntl.fcntl(memory, fcntl.F_GET_SEALS) & fcntl.F_SEAL_SHRINK  # of no file that has a name
        if not sealed or os.pread(memory, _KEY_BYTES, 0) != key:
            raise OSError(f"{path} is not the memory that is offered")
        if os.fstat(memory).st_size < nbytes:
            raise OSError(f"{path} is too small")
        os.posix_fallocate(memory, 0, nbytes)  # a lack of memory is an error here, and would be the end later
        return mmap.mmap(memory, nbytes, flags=_FLAGS)
    finally:
        os.close(memory)
