"""What readers of packed files share: the optional h5py (extra ``mesh``), what a file may hold, the text of errors."""

from importlib import import_module
from pathlib import Path
from typing import Any

from mesh_motion_protocol.errors import InvalidInput

__all__ = ["check_unpacked", "load_h5py", "most_unpacked", "reason_of"]

#: A packed file may always hold so many bytes, and more if they are at most so many times those of the file. Packed
#: meshes are 1.5 to 40 times as large; a file that is made to fill the memory, of zeros, 1000 times.
_UNPACKED_BYTES = 1 << 30
_UNPACKED_RATIO = 200


def load_h5py(path: Path) -> Any:
    """The module h5py; InvalidInput if it is not installed."""
    try:
        return import_module("h5py")
    except ImportError:
        raise InvalidInput(
            f"{path}: {path.suffix} needs h5py, which is not installed",
            code="UNIMPLEMENTED",
            hint="pip install 'mesh-motion-server[mesh]', or take another format, such as .npz",
        ) from None


def most_unpacked(packed: int) -> int:
    """Bytes that a file of ``packed`` bytes may hold."""
    return max(_UNPACKED_BYTES, _UNPACKED_RATIO * packed)


def check_unpacked(path: Path, packed: int, unpacked: int) -> None:
    """Refuse a file that is made to fill the memory.

    Raises
    ------
    InvalidInput
        If ``unpacked`` bytes are more than a mesh in a file of ``packed`` bytes has.
    """
    if unpacked > most_unpacked(packed):
        raise InvalidInput(
            f"{path}: {packed} bytes that hold {unpacked} or more, expected at most {most_unpacked(packed)}",
            hint="if it is a mesh all the same, store it without compression",
        )


def reason_of(error: BaseException) -> str:
    """One line for an error that a package raised."""
    return next(iter(str(error).splitlines()), "") or type(error).__name__
