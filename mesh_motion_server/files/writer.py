"""Writing a mesh: as this project's archive, as VTU for ParaView, or in its own format with moved nodes."""

from pathlib import Path

import numpy as np
from mesh_motion_protocol.errors import InvalidInput, ResourceExhausted
from numpy.typing import NDArray

from mesh_motion_server.files.format import Format
from mesh_motion_server.files.mesh_file import MeshFile
from mesh_motion_server.files.npz import write_npz
from mesh_motion_server.files.reader import SUFFIXES, format_of
from mesh_motion_server.files.replace import require_file_place, require_folder_place
from mesh_motion_server.files.vtk.reading import PATCH_PREFIX
from mesh_motion_server.files.vtk.vtu import write_vtu


def check_target(path: Path, source: Path | None = None) -> Format | None:
    """Check before any work that a mesh can be written there.

    Raises InvalidInput for formats other than ``.npz``, ``.vtu`` and that of ``source``; for a path that is a folder or
    has no folder. Raises ResourceExhausted if the folder is not writable.

    Returns
    -------
    Format or None
        The format of ``source``, if a copy of that file with moved nodes is to be written.
    """
    ending, of_source = path.suffix.lower(), source.suffix.lower() if source else ""
    if ending == ".npz" or (ending == ".vtu" and (source is None or of_source != ".vtu" or not source.exists())):
        require_file_place(path)
        return None
    own = format_of(source) if source is not None else None
    of_folder = own is not None and (own.folder or of_source == ".foam")
    fits = ending not in SUFFIXES if of_folder else ending == of_source
    if source is None or own is None or own.move is None or not fits:
        form = "a folder" if of_folder or source is None else source.suffix
        also = f" and, as {own.name}, {form}" if own and own.move else ""
        hint = "name a new folder, without an ending" if of_folder else "give a file name with such an ending"
        raise InvalidInput(f"{path}: .npz and .vtu are written{also}", hint=hint)
    if of_folder:
        require_folder_place(path)
        if path.exists():
            raise InvalidInput(f"{path}: exists already", hint="name a new folder")
    else:
        require_file_place(path)
    return own


def write_mesh(path: Path, mesh: MeshFile) -> None:
    """Write a mesh in the format of the file's suffix.

    In ``.vtu`` its patches are point arrays ``patch_<name>``. In the format of the file that the mesh was read from, it
    is that file with the coordinates of the mesh. Raises InvalidInput, ResourceExhausted as :func:`check_target`.
    """
    own = check_target(path, mesh.path)
    try:
        if own is not None and own.move is not None:
            own.move(mesh.path, path, mesh.points, *([mesh.zone] if own.zoned else []))
        elif path.suffix.lower() == ".npz":
            write_npz(path, mesh)
        else:
            write_vtu(path, mesh.points, mesh.cell_table, point_data=patch_marks(mesh))
    except OSError as error:
        raise ResourceExhausted(f"{path}: cannot be written: {error.strerror or error}") from None


def patch_marks(mesh: MeshFile) -> dict[str, NDArray[np.uint8]]:
    """Arrays ``patch_<name>`` (n,) of a mesh's nodes: 1 on the patch, else 0. Readers find the patches by them."""
    marks = {PATCH_PREFIX + name: np.zeros(len(mesh.points), dtype=np.uint8) for name in mesh.patches}
    for name, nodes in mesh.patches.items():
        marks[PATCH_PREFIX + name][nodes] = 1
    return marks
