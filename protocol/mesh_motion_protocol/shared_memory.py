"""Large arrays of a reply in memory that its receiver shares (SPEC.md, section 22): written once, sent by no socket.

The receiver makes anonymous memory and offers it with its request; a sender on its machine writes the arrays there.
A random key at its beginning shows that both mean the same memory: in another container a process's number may be that
of another process. The sender writes to the descriptor and maps nothing, so nobody's truncation can end it.
"""

from __future__ import annotations

import mmap
import os
import secrets
import stat
import sys
import weakref
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mesh_motion_protocol.errors import ProtocolError

if sys.platform == "linux":
    import fcntl

__all__ = ["FEATURE", "SUPPORTED", "SharedMemory", "is_large", "written"]

#: In HELLO and WELCOME.
FEATURE = "shared-memory"
SUPPORTED = sys.platform == "linux"
#: Arrays of fewer bytes go faster as frames.
_LEAST_BYTES = 1 << 20
_KEY_BYTES = 16
#: Arrays begin at multiples of this, the first one behind the key.
_ALIGNMENT = 64


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
        descriptor = os.memfd_create("mesh-motion")
        weakref.finalize(self, os.close, descriptor)
        key = secrets.token_bytes(_KEY_BYTES)
        os.ftruncate(descriptor, nbytes + 4 * _ALIGNMENT)
        os.pwrite(descriptor, key, 0)
        self._map = mmap.mmap(descriptor, 0)
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
    memory = _opened(offer) if SUPPORTED else None
    if memory is None:
        return {}
    found: dict[int, int] = {}
    try:
        at, room = _ALIGNMENT, os.fstat(memory).st_size
        for index, array in enumerate(arrays):
            if is_large(array) and at + array.nbytes <= room:
                raw = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<")).reshape(-1).data.cast("B")
                _write(memory, raw, at)
                found[index] = at
                at += -(-raw.nbytes // _ALIGNMENT) * _ALIGNMENT
    except OSError:
        return {}
    finally:
        os.close(memory)
    return found


def _opened(offer: Mapping[str, Any]) -> int | None:
    """A descriptor of anonymous memory that begins with the offer's key."""
    process, descriptor, key = offer.get("process"), offer.get("descriptor"), offer.get("key")
    if type(process) is not int or type(descriptor) is not int or type(key) is not bytes or len(key) != _KEY_BYTES:
        return None
    path = f"/proc/{process}/fd/{descriptor}"
    try:
        if not stat.S_ISREG(os.stat(path).st_mode):  # opening anything else might do something
            return None
        memory = os.open(path, os.O_RDWR)
    except OSError:
        return None
    try:
        fcntl.fcntl(memory, fcntl.F_GET_SEALS)  # refused for a file on a disk
        named = os.fstat(memory).st_nlink  # as a file in a folder of memory (tmpfs) is, which may have seals too
        if not named and os.pread(memory, _KEY_BYTES, 0) == key:
            return memory
    except OSError:
        pass
    os.close(memory)
    return None


def _write(memory: int, raw: memoryview, at: int) -> None:
    done = 0
    while done < raw.nbytes:
        done += os.pwrite(memory, raw[done:], at + done)
