"""VTK's legacy and XML meshes, read with meshio (extra ``mesh``).

These formats have no patches. They are taken from arrays with agreed names:

- ``patch_<name>`` on points or cells: nonzero marks the patch ``<name>`` (this project's writer uses it);
- ``patch`` (or Gmsh's ``gmsh:physical``, ``CellEntityIds``), an integer array on points or cells: each value v > 0 is
  the patch ``"v"``; one of curves is ``"curve_v"`` if one of surfaces has the same number.

On cells, only cells of lower dimension than the mesh count: the faces of a 3D mesh, the edges of a 2D mesh.
"""

import contextlib
import io
import re
import tempfile
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.files.format import Format
from mesh_motion_server.files.mesh_file import MeshFile, assemble, group_names
from mesh_motion_server.files.packages import check_unpacked, load_meshio, most_unpacked, reason_of
from mesh_motion_server.files.vtk_pieces import PatchKey, VtkPiece, joined, separated, sources
from mesh_motion_server.files.vtu_inline import inlined, unpacked_bytes
from mesh_motion_server.numerics.arrays import Integers
from mesh_motion_server.numerics.mesh.cells import CELL_TYPES

__all__ = ["NUMBERED_PATCH_ARRAYS", "PATCH_PREFIX", "VTK", "VTU", "read_vtk"]

PATCH_PREFIX = "patch_"
NUMBERED_PATCH_ARRAYS = ("patch", "gmsh:physical", "CellEntityIds")
#: VTK's array of flags, and the flag of a cell that another piece has, too.
_GHOSTS, _DUPLICATE = "vtkGhostType", 1


def read_vtk(path: Path) -> MeshFile:
    """Read a mesh from ``.vtk``, ``.vtu`` or ``.pvtu``.

    Raises
    ------
    InvalidInput
        Without the extra ``mesh``, for a file meshio cannot read, and for cells other than first-order ones.
    """
    files = sources(path) if path.suffix.lower() == ".pvtu" else [path]
    meshes = [(file, mesh) for file in files for mesh in read_with_meshio(file)]
    types = {block.type for _, mesh in meshes for block in mesh.cells} & set(CELL_TYPES)
    dimension = max((CELL_TYPES[name].dimension for name in types), default=0)
    pieces = [_piece(file, mesh, dimension, ghosts=len(meshes) == 1) for file, mesh in meshes]
    whole, notes = joined(path, pieces) if pieces else (VtkPiece(np.empty((0, 3)), {}, {}), [])
    names = group_names([key for key in whole.patches if not isinstance(key, str)], {})
    patches: dict[str, list[Integers]] = defaultdict(list)
    for key, nodes in whole.patches.items():
        patches[key if isinstance(key, str) else names[key]].append(nodes)
    mesh = assemble(path, whole.points, whole.cells, {name: np.concatenate(parts) for name, parts in patches.items()})
    return replace(mesh, notes=(*mesh.notes, *notes))


def _piece(path: Path, mesh: Any, dimension: int, *, ghosts: bool) -> VtkPiece:
    """The content of a mesh of meshio, a part of one of this dimension; without ghost cells unless ``ghosts``."""
    foreign = sorted({block.type for block in mesh.cells} - set(CELL_TYPES) - {"vertex"})
    if foreign:
        raise InvalidInput(
            f"{path}: cells of type {', '.join(foreign)}; known are {', '.join(CELL_TYPES)}",
            hint="divide polygons and polyhedra into simple cells: ParaView's filters Triangulate and Tetrahedralize do"
            if any(name.startswith("poly") for name in foreign)
            else "save the mesh with first-order cells",
        )
    cells: dict[str, list[Integers]] = defaultdict(list)
    flags = mesh.cell_data.get(_GHOSTS, [None] * len(mesh.cells))
    for block, flag in zip(mesh.cells, flags, strict=True):
        if block.type in CELL_TYPES:
            nodes = np.asarray(block.data, dtype=np.int64)
            cells[block.type].append(nodes if ghosts or flag is None else nodes[(np.ravel(flag) & _DUPLICATE) == 0])
    return VtkPiece(
        mesh.points, {name: np.concatenate(parts) for name, parts in cells.items()}, _patches(mesh, dimension)
    )


def read_with_meshio(path: Path) -> list[Any]:
    """Read the file as meshes of meshio: one for each piece that has cells."""
    meshio = load_meshio(path)
    chatter = io.StringIO()  # meshio prints its warnings; this reader raises errors
    try:
        with contextlib.redirect_stdout(chatter), contextlib.redirect_stderr(chatter):
            return _read(meshio, path)
    except (OSError, InvalidInput):
        raise
    except (Exception, SystemExit) as error:  # meshio raises every kind of error on damaged files, and may exit
        raise InvalidInput(f"{path}: not readable as {path.suffix}: {_reason(error, chatter.getvalue())}") from None


def _reason(error: BaseException, chatter: str) -> str:
    """The error of meshio; if it exits, the first line that it printed."""
    if isinstance(error, KeyError):
        return f"meshio does not know {error}"
    printed = [line.strip() for line in chatter.splitlines() if line.strip()]
    return printed[0] if isinstance(error, SystemExit) and printed else reason_of(error)


def _read(meshio: Any, path: Path) -> list[Any]:
    """Read the file, or copies of it without appended data and with one piece each."""
    raw = path.read_bytes() if path.suffix.lower() == ".vtu" else b""
    copied = inlined(raw) if raw else None
    if b"compressor" in raw:
        check_unpacked(path, len(raw), unpacked_bytes(copied or raw, most_unpacked(len(raw))))
    if copied is None and raw.count(b"<Piece") < 2:
        return [meshio.read(path)]
    found = []
    with tempfile.TemporaryDirectory(prefix="mesh-motion-") as folder:
        copy = Path(folder, "copy.vtu")
        for content in separated(raw if copied is None else copied):
            copy.write_bytes(content)
            found.append(meshio.read(copy))
    return found


def _patches(mesh: Any, dimension: int) -> dict[PatchKey, Integers]:
    """{name or group: (p,) node ids, with repeats} from the arrays with agreed names."""
    found: dict[PatchKey, list[Integers]] = defaultdict(list)
    everything = np.arange(len(mesh.points))[:, None]
    for name, values in (mesh.point_data or {}).items():
        _collect(found, name, values, everything, dimension - 1)
    for name, per_block in mesh.cell_data.items():
        for block, values in zip(mesh.cells, per_block, strict=True):
            own = 0 if block.type == "vertex" else CELL_TYPES[block.type].dimension
            if own < dimension:
                _collect(found, name, values, np.asarray(block.data, dtype=np.int64), own)
    return {name: np.concatenate(parts) for name, parts in found.items()}


def _collect(
    found: dict[PatchKey, list[Integers]], name: str, values: NDArray[Any], nodes: Integers, dimension: int
) -> None:
    """Add the nodes (m, k) whose row the array ``values`` (m,) marks; numbers count apart in each dimension."""
    values = np.asarray(values)
    if values.size != len(nodes):
        return
    values = values.reshape(len(nodes))
    if name.startswith(PATCH_PREFIX):
        found[name.removeprefix(PATCH_PREFIX)].append(nodes[values != 0].ravel())
    elif name in NUMBERED_PATCH_ARRAYS and values.dtype.kind in "iu":
        for value in np.unique(values[values > 0]):
            found[dimension, int(value)].append(nodes[values == value].ravel())


VTU = Format("a VTU mesh", (".vtu", ".pvtu"), re.compile(rb"<VTKFile\b"), read_vtk)
VTK = Format("a VTK mesh", (".vtk",), re.compile(rb"\A\s*# vtk DataFile"), read_vtk)
