"""Common parts of readers of packed files: the optional h5py (extra ``mesh``), byte limits, error texts."""

from importlib import import_module
from pathlib import Path
from typing import Any

from mesh_motion_protocol.errors import InvalidInput

#: Bytes that a packed file may always unpack to, and the factor of its own size that it may unpack to. Packed meshes
#: unpack to 1.5 to 40 times their size; a file of zeros that is made to fill the memory, to 1000 times.
_UNPACKED_BYTES = 1 << 30
_UNPACKED_RATIO = 200


def load_h5py(path: Path) -> Any:
    """Return the module h5py; InvalidInput if it is not installed."""
    try:
        return import_module("h5py")
    except ImportError:
        raise InvalidInput(
            f"{path}: {path.suffix} needs h5py, which is not installed",
            code="UNIMPLEMENTED",
            hint="pip install 'mesh-motion-server[mesh]', or use another format, for example .npz",
        ) from None


def most_unpacked(packed: int) -> int:
    """Largest number of bytes that a file of ``packed`` bytes may unpack to."""
    return max(_UNPACKED_BYTES, _UNPACKED_RATIO * packed)


def check_unpacked(path: Path, packed: int, unpacked: int) -> None:
    """Refuse a file that is made to fill the memory.

    Raises InvalidInput if ``unpacked`` bytes are more than a mesh in a file of ``packed`` bytes can have.
    """
    if unpacked > most_unpacked(packed):
        raise InvalidInput(
            f"{path}: {packed} bytes that hold {unpacked} or more, expected at most {most_unpacked(packed)}",
            hint="if it is a mesh, store it without compression",
        )


def reason_of(error: BaseException) -> str:
    """One line for an error that a package raised."""
    return next(iter(str(error).splitlines()), "") or type(error).__name__
