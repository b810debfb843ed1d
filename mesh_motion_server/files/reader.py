"""One reader for every mesh file, chosen by the file's suffix."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.files.gmsh import read_gmsh
from mesh_motion_server.files.mesh_file import MeshFile
from mesh_motion_server.files.npz import read_npz
from mesh_motion_server.files.su2 import read_su2
from mesh_motion_server.files.vtk import read_vtk

__all__ = ["READERS", "read_mesh"]

READERS: dict[str, Callable[[Path], MeshFile]] = {
    ".npz": read_npz,
    ".msh": read_gmsh,
    ".su2": read_su2,
    ".vtk": read_vtk,
    ".vtu": read_vtk,
}


def read_mesh(path: Path | str) -> MeshFile:
    """Read a mesh with its patches.

    Parameters
    ----------
    path : path
        ``.npz``, ``.msh`` (Gmsh 2.2, 4.1), ``.su2``, ``.vtk`` or ``.vtu``.

    Raises
    ------
    InvalidInput
        If the file is missing, of another format, damaged, or holds no usable mesh.
    """
    path = Path(path)
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise InvalidInput(f"{path}: unknown kind of mesh file; known are {', '.join(READERS)}")
    if not path.is_file():
        raise InvalidInput(f"{path}: no such mesh file", hint="paths in a case file are relative to the case file")
    try:
        return reader(path)
    except OSError as error:
        raise InvalidInput(f"{path}: cannot be read: {error.strerror or error}") from None
