"""HDF5 files of other programs, read with h5py (extra ``mesh``): errors of one line, no array larger than its file."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from mesh_motion_protocol.errors import InvalidInput
from numpy.typing import NDArray

from mesh_motion_server.files.packages import check_unpacked, load_h5py, reason_of


@contextmanager
def opened_hdf5(path: Path, what: str) -> Iterator[Any]:
    """Open the file for reading.

    Raises InvalidInput if it is no HDF5 file, or if reading in the block fails because something is missing or damaged.
    """
    h5py = load_h5py(path)
    try:
        with h5py.File(path, "r", locking=False) as file:
            yield file
    except (OSError, KeyError, ValueError, IndexError, RuntimeError, TypeError, OverflowError, MemoryError) as error:
        raise InvalidInput(f"{path}: malformed or damaged {what}: {reason_of(error)}") from None


def array_of(path: Path, data: Any, kinds: str) -> NDArray[Any]:
    """Return the values of a data set as float64 ("f") or int64 ("iu").

    Raises InvalidInput if its numbers are of another kind, or if it would fill the memory.
    """
    if not hasattr(data, "dtype") or data.dtype.kind not in kinds:
        got = getattr(data, "dtype", "a group")
        raise InvalidInput(f"{path}: {data.name}: {got}, expected {'real numbers' if kinds == 'f' else 'integers'}")
    return whole_of(path, data).astype(np.float64 if kinds == "f" else np.int64)


def whole_of(path: Path, data: Any) -> NDArray[Any]:
    """Return the values of a data set of any type. Raises InvalidInput if it would fill the memory."""
    check_unpacked(path, data.id.get_storage_size(), data.nbytes)
    return np.asarray(data[()])
