"""Writing VTK's meshes: a new file with its patches as point arrays, or one whose coordinates alone are replaced."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.files.mesh_file import FloatArray, MeshFile
from mesh_motion_server.files.packages import load_meshio
from mesh_motion_server.files.replace import replaced_by_name
from mesh_motion_server.files.vtk import PATCH_PREFIX, read_with_meshio

__all__ = ["check_vtk", "move_vtk", "write_vtk"]


def check_vtk(path: Path, mesh: MeshFile) -> None:
    """Refuse patches whose names no array of ``.vtk`` can have."""
    spaced = [name for name in mesh.patches if path.suffix.lower() == ".vtk" and len(name.split()) != 1]
    if spaced:
        raise InvalidInput(
            f"{path}: patch {spaced[0]!r} is no name for an array of .vtk", hint="write .vtu, or rename it"
        )


def write_vtk(path: Path, mesh: MeshFile) -> None:
    """Write a mesh as ``.vtu`` or ``.vtk``: its patches are arrays ``patch_<name>`` of the points.

    meshio writes both: of raw appended data, as :mod:`.vtu` writes it, meshio 5.3 may take one array for another when
    other programs read it (:mod:`.vtu_inline`).
    """
    check_vtk(path, mesh)
    points = np.pad(mesh.points, ((0, 0), (0, 3 - mesh.dimension)))
    grid = load_meshio(path).Mesh(points, list(mesh.cells.items()), point_data=_patches(mesh))
    with replaced_by_name(path) as partial:
        grid.write(partial, file_format=path.suffix.lower().removeprefix("."))


def move_vtk(path: Path, mesh: MeshFile, points: FloatArray) -> None:
    """Write the file again with other coordinates (n, d); cells and arrays stay, as far as meshio keeps them."""
    grid = read_with_meshio(mesh.path)
    grid.points = np.array(grid.points, dtype=np.float64)
    grid.points[:, : mesh.dimension] = points
    with replaced_by_name(path) as partial:
        grid.write(partial, file_format=path.suffix.lower().removeprefix("."))


def _patches(mesh: MeshFile) -> dict[str, np.ndarray]:
    """{array: (n,) 1 on the patch, 0 elsewhere}."""
    found = {}
    for name, nodes in mesh.patches.items():
        found[PATCH_PREFIX + name] = np.zeros(len(mesh.points), dtype=np.uint8)
        found[PATCH_PREFIX + name][nodes] = 1
    return found
