"""HDF5 by h5py (extra ``mesh``): found when it is needed, and errors that name the file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mesh_motion_server.errors import InvalidInput

__all__ = ["load_h5py"]


def load_h5py(path: Path) -> Any:
    """The module h5py.

    Raises
    ------
    InvalidInput
        If it is not installed.
    """
    try:
        import h5py  # noqa: PLC0415  (an extra, needed for these formats only)
    except ImportError:
        raise InvalidInput(
            f"{path}: {path.suffix} needs h5py, which is not installed",
            code="UNIMPLEMENTED",
            hint="pip install 'mesh-motion-server[mesh]', or take another format",
        ) from None
    return h5py
