"""One reader for every mesh file, chosen by the file's suffix."""

from collections.abc import Callable
from pathlib import Path

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.files.cgns.zone import read_cgns
from mesh_motion_server.files.gmsh import read_gmsh
from mesh_motion_server.files.mesh_file import MeshFile
from mesh_motion_server.files.npz import read_npz
from mesh_motion_server.files.openfoam.polymesh import read_polymesh
from mesh_motion_server.files.su2 import read_su2
from mesh_motion_server.files.vtk import read_vtk

__all__ = ["READERS", "is_mesh", "read_mesh"]

READERS: dict[str, Callable[[Path], MeshFile]] = {
    ".npz": read_npz,
    ".msh": read_gmsh,
    ".su2": read_su2,
    ".vtk": read_vtk,
    ".vtu": read_vtk,
    ".pvtu": read_vtk,
    ".cgns": read_cgns,
    ".foam": read_polymesh,
}

#: Formats whose files may have several zones.
_ZONED: dict[str, Callable[[Path, str], MeshFile]] = {".su2": read_su2, ".cgns": read_cgns}


def is_mesh(path: Path) -> bool:
    """Whether the path is a mesh and not a case file: a known suffix, or a folder."""
    return path.suffix.lower() in READERS or path.is_dir()


def read_mesh(path: Path | str, zone: str = "") -> MeshFile:
    """Read a mesh with its patches.

    Parameters
    ----------
    path : path
        ``.npz``, ``.msh`` (Gmsh 2.2, 4.1), ``.su2``, ``.vtk``, ``.vtu``, ``.pvtu`` or ``.cgns``; an OpenFOAM case, its
        ``.foam`` file or a polyMesh folder.
    zone : str
        The name or number of a zone, if the file has several.

    Raises
    ------
    InvalidInput
        If the file is missing, of another format, damaged, or holds no usable mesh.
    """
    path = Path(path)
    folder = path.is_dir()
    reader = read_polymesh if folder else READERS.get(path.suffix.lower())
    if reader is None:
        known = f"known are {', '.join(READERS)} and OpenFOAM's folders"
        raise InvalidInput(f"{path}: unknown kind of mesh file; {known}", hint="a case file is named .toml")
    if not folder and not path.is_file():
        raise InvalidInput(f"{path}: no such mesh file", hint="paths in a case file are relative to the case file")
    try:
        if not zone:
            return reader(path)
        if not folder and path.suffix.lower() in _ZONED:
            return _ZONED[path.suffix.lower()](path, zone)
    except OSError as error:
        raise InvalidInput(f"{path}: cannot be read: {error.strerror or error}") from None
    raise InvalidInput(f"{path}: zone {zone!r} is asked for, but this format has no zones", hint="leave zone out")
