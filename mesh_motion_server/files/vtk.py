"""VTK's legacy and XML meshes, read with meshio (extra ``mesh``).

These formats have no patches. They are taken from arrays with agreed names:

- ``patch_<name>`` on points or cells: nonzero marks the patch ``<name>`` (this project's writer uses it);
- ``patch`` (or Gmsh's ``gmsh:physical``, ``CellEntityIds``), an integer array on points or cells: each value v > 0 is
  the patch ``"v"``.

On cells, only cells of lower dimension than the mesh count: the faces of a 3D mesh, the edges of a 2D mesh.
"""

import contextlib
import io
import tempfile
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.files.mesh_file import MeshFile, assemble
from mesh_motion_server.files.packages import load_meshio, reason_of
from mesh_motion_server.files.vtu_inline import inlined
from mesh_motion_server.numerics.arrays import Integers
from mesh_motion_server.numerics.mesh.cells import CELL_TYPES

__all__ = ["NUMBERED_PATCH_ARRAYS", "PATCH_PREFIX", "read_vtk"]

PATCH_PREFIX = "patch_"
NUMBERED_PATCH_ARRAYS = ("patch", "gmsh:physical", "CellEntityIds")


def read_vtk(path: Path) -> MeshFile:
    """Read a mesh from ``.vtk`` or ``.vtu``.

    Raises
    ------
    InvalidInput
        Without the extra ``mesh``, for a file meshio cannot read, and for cells other than first-order ones.
    """
    mesh = read_with_meshio(path)
    blocks = [(block.type, np.asarray(block.data, dtype=np.int64)) for block in mesh.cells]
    foreign = sorted({name for name, _ in blocks} - set(CELL_TYPES) - {"vertex"})
    if foreign:
        raise InvalidInput(
            f"{path}: cells of type {', '.join(foreign)}; known are {', '.join(CELL_TYPES)}",
            hint="divide polygons and polyhedra into simple cells: ParaView's filters Triangulate and Tetrahedralize do"
            if any(name.startswith("poly") for name in foreign)
            else "save the mesh with first-order cells",
        )
    cells: dict[str, list[Integers]] = defaultdict(list)
    for name, nodes in blocks:
        if name in CELL_TYPES:
            cells[name].append(nodes)
    return assemble(path, mesh.points, {name: np.concatenate(parts) for name, parts in cells.items()}, _patches(mesh))


def read_with_meshio(path: Path) -> Any:
    """Read the file as a mesh of meshio."""
    meshio = load_meshio(path)
    chatter = io.StringIO()  # meshio prints its warnings; this reader raises errors
    try:
        with contextlib.redirect_stdout(chatter), contextlib.redirect_stderr(chatter):
            return _read(meshio, path)
    except OSError:
        raise
    except (Exception, SystemExit) as error:  # meshio raises every kind of error on damaged files, and may exit
        raise InvalidInput(f"{path}: not readable as {path.suffix}: {_reason(error, chatter.getvalue())}") from None


def _reason(error: BaseException, chatter: str) -> str:
    """The error of meshio; if it exits, the first line that it printed."""
    if isinstance(error, KeyError):
        return f"meshio does not know {error}"
    printed = [line.strip() for line in chatter.splitlines() if line.strip()]
    return printed[0] if isinstance(error, SystemExit) and printed else reason_of(error)


def _read(meshio: Any, path: Path) -> Any:
    """Read the file, or a copy of it without appended data."""
    copied = inlined(path) if path.suffix.lower() == ".vtu" else None
    if copied is None:
        return meshio.read(path)
    with tempfile.TemporaryDirectory(prefix="mesh-motion-") as folder:
        copy = Path(folder, "inlined.vtu")
        copy.write_bytes(copied)
        return meshio.read(copy)


def _patches(mesh: Any) -> dict[str, Integers]:
    """{name: (p,) node ids, with repeats} from the arrays with agreed names."""
    found: dict[str, list[Integers]] = defaultdict(list)
    everything = np.arange(len(mesh.points))[:, None]
    for name, values in mesh.point_data.items():
        _collect(found, name, values, everything)
    dimension = max((CELL_TYPES[block.type].dimension for block in mesh.cells if block.type in CELL_TYPES), default=0)
    for name, per_block in mesh.cell_data.items():
        for block, values in zip(mesh.cells, per_block, strict=True):
            if block.type == "vertex" or CELL_TYPES[block.type].dimension < dimension:
                _collect(found, name, values, np.asarray(block.data, dtype=np.int64))
    return {name: np.concatenate(parts) for name, parts in found.items()}


def _collect(found: dict[str, list[Integers]], name: str, values: NDArray[Any], nodes: Integers) -> None:
    """Add the nodes (m, k) whose row the array ``values`` (m,) marks."""
    values = np.squeeze(np.asarray(values))
    if values.ndim != 1:
        return
    if name.startswith(PATCH_PREFIX):
        found[name.removeprefix(PATCH_PREFIX)].append(nodes[values != 0].ravel())
    elif name in NUMBERED_PATCH_ARRAYS and values.dtype.kind in "iu":
        for value in np.unique(values[values > 0]):
            found[str(int(value))].append(nodes[values == value].ravel())
