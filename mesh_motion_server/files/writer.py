"""Writing a mesh: as this project's archive, or as VTU, which ParaView and meshio read."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.errors import InvalidInput, ResourceError
from mesh_motion_server.files.mesh_file import MeshFile
from mesh_motion_server.files.npz import write_npz
from mesh_motion_server.files.replace import require_file_place
from mesh_motion_server.files.vtk import PATCH_PREFIX
from mesh_motion_server.files.vtu import write_vtu

__all__ = ["check_target", "patch_marks", "write_mesh"]


def check_target(path: Path) -> None:
    """Check before any work that a mesh can be written there.

    Raises
    ------
    InvalidInput
        For formats other than ``.npz`` and ``.vtu``, and a path that is a folder or has no folder.
    ResourceError
        If the folder is not writable.
    """
    if path.suffix.lower() not in (".npz", ".vtu"):
        raise InvalidInput(
            f"{path}: .npz and .vtu are written",
            hint=f"write .vtu, then meshio convert {path.with_suffix('.vtu').name} {path.name}",
        )
    require_file_place(path)


def write_mesh(path: Path, mesh: MeshFile) -> None:
    """Write a mesh in the format of the file's suffix; in ``.vtu`` its patches are point arrays ``patch_<name>``.

    Raises
    ------
    InvalidInput, ResourceError
        As :func:`check_target`.
    """
    check_target(path)
    try:
        if path.suffix.lower() == ".npz":
            write_npz(path, mesh)
            return
        write_vtu(path, mesh.points, mesh.cell_table, point_data=patch_marks(mesh))
    except OSError as error:
        raise ResourceError(f"{path}: cannot be written: {error.strerror or error}") from None


def patch_marks(mesh: MeshFile) -> dict[str, NDArray[np.uint8]]:
    """Arrays ``patch_<name>`` (n,) of a mesh's nodes: 1 on the patch, else 0. Readers find the patches by them."""
    marks = {PATCH_PREFIX + name: np.zeros(len(mesh.points), dtype=np.uint8) for name in mesh.patches}
    for name, nodes in mesh.patches.items():
        marks[PATCH_PREFIX + name][nodes] = 1
    return marks
