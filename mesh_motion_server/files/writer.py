"""Writing meshes: in any format, or with the coordinates alone replaced in the file that a mesh came from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.errors import InvalidInput, ResourceError
from mesh_motion_server.files.cgns_write import check_cgns, check_move_cgns, move_cgns, write_cgns
from mesh_motion_server.files.gmsh_write import check_gmsh, move_gmsh, write_gmsh
from mesh_motion_server.files.mesh_file import FloatArray, MeshFile
from mesh_motion_server.files.npz import write_npz
from mesh_motion_server.files.packages import load_h5py, load_meshio
from mesh_motion_server.files.polymesh_place import is_a_time, target_folder
from mesh_motion_server.files.polymesh_write import (
    check_move_polymesh,
    check_polymesh,
    move_polymesh,
    write_polymesh,
)
from mesh_motion_server.files.replace import require_file_place, require_folder_place
from mesh_motion_server.files.su2_write import check_su2, move_su2, write_su2
from mesh_motion_server.files.vtk_write import check_vtk, move_vtk, write_vtk

__all__ = ["check_target", "write_mesh", "write_moved"]

_FOLDER = "a folder"
_Write = Callable[[Path, MeshFile], None]
_Move = Callable[[Path, MeshFile, FloatArray], None]


def _anything(path: Path, mesh: MeshFile) -> None:
    """The format takes every mesh."""


@dataclass(frozen=True)
class _Format:
    """How a format is written: a new file, other coordinates; what either refuses, and the package that is needed."""

    write: _Write
    move: _Move
    check: _Write = _anything
    check_move: _Write = _anything
    needs: tuple[Callable[[Path], object], ...] = ()


def _move_npz(path: Path, mesh: MeshFile, points: FloatArray) -> None:
    """The archive has nothing but the mesh."""
    write_npz(path, replace(mesh, points=points))


_FORMATS = {
    ".npz": _Format(write_npz, _move_npz),
    ".msh": _Format(write_gmsh, move_gmsh, check_gmsh),
    ".su2": _Format(write_su2, move_su2, check_su2),
    ".vtu": _Format(write_vtk, move_vtk, check_vtk, needs=(load_meshio,)),
    ".vtk": _Format(write_vtk, move_vtk, check_vtk, needs=(load_meshio,)),
    ".cgns": _Format(write_cgns, move_cgns, check_cgns, check_move_cgns, (load_h5py,)),
    _FOLDER: _Format(write_polymesh, move_polymesh, check_polymesh, check_move_polymesh),
}


def _kind(path: Path) -> str:
    """The format of a path: its suffix; a folder, or what may become one, is OpenFOAM's."""
    suffix = path.suffix.lower()
    is_folder = path.is_dir() or suffix in ("", ".foam") or is_a_time(path)
    return _FOLDER if is_folder else suffix


def check_target(path: Path, mesh: MeshFile | None = None) -> None:
    """Say before any work whether a mesh can be written there.

    Parameters
    ----------
    path : path
    mesh : MeshFile, optional
        With it also what :func:`write_moved` would refuse, but for the coordinates.

    Raises
    ------
    InvalidInput
        For unknown formats, packages that are not installed, a place that is taken or missing, and what the format
        cannot hold.
    ResourceError
        If nothing may be written there.
    """
    kind = _kind(path)
    if kind not in _FORMATS:
        known = ", ".join(suffix for suffix in _FORMATS if suffix != _FOLDER)
        raise InvalidInput(f"{path}: unknown kind of mesh file; {known} and OpenFOAM's folders can be written")
    for load in _FORMATS[kind].needs:
        load(path)
    if kind == _FOLDER:
        require_folder_place(target_folder(path))
    else:
        require_file_place(path)
    if mesh is not None:
        (_FORMATS[kind].check_move if kind == _kind(mesh.path) else _FORMATS[kind].check)(path, mesh)


def write_mesh(path: Path, mesh: MeshFile) -> None:
    """Write a mesh in the format of the file's suffix; without one it is an OpenFOAM case.

    Cells that are listed the other way round are written as their mirror images.

    Raises
    ------
    InvalidInput
        If the format cannot hold the mesh, or is unknown.
    ResourceError
        If the file cannot be written.
    """
    _write(path, mesh.oriented())


def write_moved(path: Path, mesh: MeshFile, points: NDArray[np.generic]) -> None:
    """Write a mesh with other coordinates; in the format it was read from, everything else of its file is kept.

    Parameters
    ----------
    path : path
        May be the file that the mesh was read from.
    mesh : MeshFile
        As :func:`~mesh_motion_server.files.read_mesh` gave it.
    points : (n, d) array
        In the order of its nodes.

    Raises
    ------
    InvalidInput
        For coordinates of another shape or that are not finite, and as :func:`write_mesh` does.
    ResourceError
        If the file cannot be written.
    """
    real = points.dtype.kind == "f"
    if not real or points.shape != mesh.points.shape or not bool(np.isfinite(points.astype(np.float64)).all()):
        raise InvalidInput(
            f"{path}: expected finite real coordinates of shape {mesh.points.shape} for {mesh.path.name}, got an array "
            f"of {points.dtype} of shape {points.shape}" + (", not all finite" if real else "")
        )
    if _kind(path) != _kind(mesh.path):
        _write(path, replace(mesh.oriented(), points=points.astype(np.float64)))
        return
    check_target(path)
    try:
        _FORMATS[_kind(path)].move(path, mesh, points.astype(np.float64))
    except OSError as error:
        raise ResourceError(f"{path}: cannot be written: {error.strerror or error}") from None


def _write(path: Path, mesh: MeshFile) -> None:
    """A new file."""
    check_target(path)
    try:
        _FORMATS[_kind(path)].write(path, mesh)
    except OSError as error:
        raise ResourceError(f"{path}: cannot be written: {error.strerror or error}") from None
