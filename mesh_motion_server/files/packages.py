"""The optional packages of some formats (extra ``mesh``): imported on demand; the text of their errors."""

from importlib import import_module
from pathlib import Path
from typing import Any

from mesh_motion_server.errors import InvalidInput

__all__ = ["load_h5py", "load_meshio", "reason_of"]


def load_h5py(path: Path) -> Any:
    """The module h5py; InvalidInput if it is not installed."""
    return _loaded("h5py", path)


def load_meshio(path: Path) -> Any:
    """The module meshio; InvalidInput if it is not installed."""
    return _loaded("meshio", path)


def reason_of(error: BaseException) -> str:
    """One line for an error that a package raised."""
    return next(iter(str(error).splitlines()), "") or type(error).__name__


def _loaded(package: str, path: Path) -> Any:
    try:
        return import_module(package)
    except ImportError:
        raise InvalidInput(
            f"{path}: {path.suffix} needs {package}, which is not installed",
            code="UNIMPLEMENTED",
            hint="pip install 'mesh-motion-server[mesh]', or take another format, such as .npz",
        ) from None
