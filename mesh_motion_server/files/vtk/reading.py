"""VTK's meshes: legacy, XML and HDF5.

These formats have no patches. Patches are made from arrays with these names:

- ``patch_<name>`` on points or cells: nonzero marks the patch ``<name>`` (this project's writer uses it);
- whole numbers on the cells of lower dimension than the mesh, the faces of a 3D mesh and the edges of a 2D mesh, in one
  of :data:`NUMBERED_PATCH_ARRAYS`, which other programs and their converters write: each value is the patch with that
  name; a patch of curves is ``"curve_v"`` if a patch of surfaces has the same number;
- the same array on points, if no such cells have it.
"""

import re
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.mesh.cells import CELL_TYPES
from mesh_motion_protocol.errors import InvalidInput
from numpy.typing import NDArray

from mesh_motion_server.files.format import Format
from mesh_motion_server.files.mesh_file import MeshFile, assemble, by_corners, by_name, concatenated, named_groups
from mesh_motion_server.files.moved import edit, replaced
from mesh_motion_server.files.packages import reason_of
from mesh_motion_server.files.vtk.grid import VtkGrid
from mesh_motion_server.files.vtk.hdf import move_hdf, read_hdf
from mesh_motion_server.files.vtk.legacy import read_legacy
from mesh_motion_server.files.vtk.pieces import PatchKey, VtkPiece, joined, numbering, sources
from mesh_motion_server.files.vtk.polyhedra import divided
from mesh_motion_server.files.vtk.scikit_fem import marked_sides
from mesh_motion_server.files.vtk.xml import read_xml, with_points

PATCH_PREFIX = "patch_"
#: Arrays of numbers that name patches; the first existing one is used. The comment after each names the program that
#: writes it.
NUMBERED_PATCH_ARRAYS = {
    "patch": "this project's",
    "gmsh:physical": "Gmsh, by meshio",
    "CellEntityIds": "Gmsh, by VTK",
    "cell_tags": "MED, by meshio: families, negative ones of cells",
    "point_tags": "MED, by meshio",
    "medit:ref": "Medit, by meshio",
    "netgen:index": "Netgen, by meshio",
    "ObjectId": "Exodus' sets, by ParaView",
    "Label": "FreeFEM: labels of faces and edges",
    "GeometryIds": "Elmer: boundaries, whose numbers follow those of the bodies",
    "MaterialID": "deal.II: on faces the boundary's number",
    "gmsh:geometrical": "Gmsh, by meshio: surfaces and curves of the geometry",
}
#: Our type's name, rows (m,) among all cells, and corner nodes (m, k), for each cell type of a grid.
Listed = list[tuple[str, Integers, Integers]]
#: VTK's array of flags, and the flag of a cell that another piece also has.
_GHOSTS, _DUPLICATE = "vtkGhostType", 1


def _read_vtu(path: Path) -> MeshFile:
    """Read a mesh from ``.vtu``, ``.vts`` or ``.pvtu``.

    Raises InvalidInput for other XML files and damaged ones.
    """
    return grids_as_mesh(path, read_xml, sources(path) if path.suffix.lower() == ".pvtu" else [path])


def _read_vtk(path: Path) -> MeshFile:
    """Read a mesh from ``.vtk``. Raises InvalidInput for surfaces and damaged files."""
    return grids_as_mesh(path, lambda file: [read_legacy(file.read_bytes()).grid()], [path])


def _read_hdf(path: Path) -> MeshFile:
    """Read a mesh from ``.vtkhdf``.

    Raises InvalidInput without h5py, for other kinds of grids and damaged files.
    """
    return grids_as_mesh(path, read_hdf, [path])


def grids_as_mesh(path: Path, read: Callable[[Path], list[VtkGrid]], files: list[Path]) -> MeshFile:
    """The mesh of all grids in the files.

    Raises InvalidInput if ``read`` raises anything but an OSError, for cells that cannot be divided, and pieces that do
    not fit together.

    Parameters
    ----------
    read : function (path)
        The grids of one file.
    """
    grids: list[tuple[Path, VtkGrid]] = []
    for file in files:
        with _named_errors(file):
            grids += [(file, grid) for grid in read(file) if len(grid.types)]
    listed = []
    for row, (file, grid) in enumerate(grids):
        with _named_errors(file):
            simple = divided(file, grid if len(grids) == 1 else _without_ghosts(grid))
            grids[row] = file, simple
            listed.append(simple.cells())
    dimension = max((CELL_TYPES[name].dimension for cells in listed for name, _, _ in cells), default=0)
    _require_alike(path, [grid for _, grid in grids])
    marks = _patches([grid for _, grid in grids], listed, dimension)
    pieces = [
        VtkPiece(grid.points, _by_type(cells), own) for (_, grid), cells, own in zip(grids, listed, marks, strict=True)
    ]
    whole, notes = joined(path, pieces) if pieces else (VtkPiece(np.empty((0, 3)), {}, {}), [])
    patches, of_names = by_name(named_groups(whole.patches))
    mesh = assemble(path, whole.points, whole.cells, patches)
    higher = sum(
        int(grid.is_higher[rows].sum())
        for (_, grid), cells in zip(grids, listed, strict=True)
        for name, rows, _ in cells
        if CELL_TYPES[name].dimension == dimension
    )
    notes = [*notes, *of_names, *by_corners(higher)]
    if not patches:
        notes += _no_patches([grid for _, grid in grids])
    return replace(mesh, notes=(*mesh.notes, *notes))


@contextmanager
def _named_errors(file: Path) -> Iterator[None]:
    """Name the file in errors of a damaged file."""
    try:
        yield
    except (OSError, InvalidInput):
        raise
    except Exception as error:
        hint = "divide such cells into simple ones: ParaView's filters Triangulate and Tetrahedralize do"
        raise InvalidInput(
            f"{file}: not readable as {file.suffix}: {reason_of(error)}",
            hint=hint if "VTK's type" in str(error) else "",
        ) from None


def _no_patches(grids: list[VtkGrid]) -> list[str]:
    """Describe the arrays in the file, if it has no patches."""
    found = {
        what: sorted({repr(name) for grid in grids for name in getattr(grid, f"{what}_arrays")})
        for what in ("point", "cell")
    }
    texts = [f"{', '.join(names[:8])} on {what}s" for what, names in found.items() if names]
    return [
        f"its arrays are {' and '.join(texts) or 'none'}, and none of them names patches: give it an array "
        "patch_<name> on points, or faces with whole numbers in an array patch"
    ]


def _require_alike(path: Path, grids: list[VtkGrid]) -> None:
    """Raise if a piece lacks an array of numbers that names patches in another one: its part of them would be lost."""
    has = [{name for name in NUMBERED_PATCH_ARRAYS if name in {*g.cell_arrays, *g.point_arrays}} for g in grids]
    for number, (grid, own) in enumerate(zip(grids, has, strict=True), 1):
        lost = sorted(set().union(*has) - own)
        if lost and len(grid.types):
            raise InvalidInput(
                f"{path}: piece {number} has no array {lost[0]!r}, by which another piece names its patches",
                hint="save the array with all pieces",
            )


def _without_ghosts(grid: VtkGrid) -> VtkGrid:
    """The grid without the cells that another piece has, too."""
    flags = grid.cell_arrays.get(_GHOSTS)
    if flags is None or flags.dtype.kind not in "iu":
        return grid
    return grid.of_rows(np.flatnonzero((flags.ravel().astype(np.int64) & _DUPLICATE) == 0))


def _by_type(cells: Listed) -> dict[str, Integers]:
    """The nodes of the cells of each type."""
    own: dict[str, list[Integers]] = defaultdict(list)
    for name, _, nodes in cells:
        own[name].append(nodes)
    return concatenated(own)


def _patches(grids: list[VtkGrid], listed: list[Listed], dimension: int) -> list[dict[PatchKey, Integers]]:
    """For each grid, {name or group: (p,) node ids, with repeats}; one array of numbers is used for all grids."""
    facets = [_facets(grid, cells, dimension) for grid, cells in zip(grids, listed, strict=True)]
    found = [_named(grid, own) for grid, own in zip(grids, facets, strict=True)]
    for own, grid, cells in zip(found, grids, listed, strict=True):
        whole = [of for of in cells if CELL_TYPES[of[0]].dimension == dimension]
        sides = marked_sides(_flat(grid.cell_arrays), whole)
        own |= {(dimension - 1, name): nodes for name, nodes in sides.items()}
    for name in NUMBERED_PATCH_ARRAYS:
        marked = [_numbered(name, grid, own, dimension) for grid, own in zip(grids, facets, strict=True)]
        found = [of | (own or {}) for of, own in zip(found, marked, strict=True)]
        if any(found) and any(own is not None for own in marked):
            break
    return found


def _facets(grid: VtkGrid, cells: Listed, dimension: int) -> list[tuple[int, Integers]]:
    """Dimension and rows (m,) of the cells that are a part of the boundary of cells of this dimension."""
    facets = [(0, np.flatnonzero(grid.types == 1))]
    facets += [(CELL_TYPES[name].dimension, rows) for name, rows, _ in cells]
    return [(own, rows) for own, rows in facets if own < dimension and len(rows)]


def _named(grid: VtkGrid, facets: list[tuple[int, Integers]]) -> dict[PatchKey, Integers]:
    """Patches from arrays named after them."""
    found: dict[PatchKey, list[Integers]] = defaultdict(list)
    for name, values in _flat(grid.point_arrays).items():
        if name.startswith(PATCH_PREFIX):
            found[0, name.removeprefix(PATCH_PREFIX)].append(np.flatnonzero(values))
    for name, values in _flat(grid.cell_arrays).items():
        if name.startswith(PATCH_PREFIX):
            for dimension, rows in facets:
                found[dimension, name.removeprefix(PATCH_PREFIX)].append(_nodes_of(grid, rows[values[rows] != 0]))
    return concatenated(found)


def _numbered(
    name: str, grid: VtkGrid, facets: list[tuple[int, Integers]], dimension: int
) -> dict[PatchKey, Integers] | None:
    """Groups from the array of numbers with this name; None if it marks no cell or point here."""
    on_cells, on_points = _numbers(grid.cell_arrays, name), _numbers(grid.point_arrays, name)
    marked: list[tuple[int, Integers, Integers | None]] = []
    if on_cells is not None:
        marked = [(own, on_cells[rows], rows) for own, rows in facets]
    if not any((values != 0).any() for _, values, _ in marked):
        marked = [] if on_points is None else [(dimension - 1, on_points, None)]
    found: dict[PatchKey, list[Integers]] = defaultdict(list)
    for own, values, chosen_rows in marked:
        for value in np.unique(values[values != 0 if name == "cell_tags" else values > 0]).tolist():
            chosen = np.flatnonzero(values == value)
            found[own, value].append(chosen if chosen_rows is None else _nodes_of(grid, chosen_rows[chosen]))
    return concatenated(found) if marked else None


def _flat(arrays: Mapping[str, NDArray[np.generic]]) -> dict[str, NDArray[np.generic]]:
    """The arrays with one value for each row."""
    return {name: values.ravel() for name, values in arrays.items() if values.size == len(values)}


def _numbers(arrays: Mapping[str, NDArray[np.generic]], name: str) -> Integers | None:
    """An array of whole numbers, one for each row."""
    values = _flat(arrays).get(name)
    return values.astype(np.int64) if values is not None and values.dtype.kind in "iu" else None


def _nodes_of(grid: VtkGrid, rows: Integers) -> Integers:
    """All nodes of some cells, including those between corners."""
    counts = np.diff(grid.offsets)[rows]
    starts = np.repeat(grid.offsets[rows] - np.cumsum([0, *counts[:-1]])[: len(rows)], counts)
    nodes: Integers = grid.connectivity[starts + np.arange(int(counts.sum()))]
    return nodes


def _move(source: Path, target: Path, points: Floats) -> None:
    """Write the legacy file with other coordinates of the points."""

    def changed(data: bytes) -> bytes:
        places = read_legacy(data).places
        if not places:
            raise InvalidInput(f"{source}: a grid without a list of points", hint="take .vtu")
        return replaced(data, places, points)

    edit(source, target, changed)


def _move_xml(source: Path, target: Path, points: Floats) -> None:
    """Write the file with other coordinates of the points; nodes of several pieces at one place move together."""
    grids = read_xml(source)
    used = [grid for grid in grids if len(grid.types)]
    first, number = [0], np.arange(len(points))
    if len(used) > 1:
        whole = [divided(source, _without_ghosts(grid)).points for grid in used]
        first = np.cumsum([0, *map(len, whole)]).tolist()
        number, _ = numbering(source, np.concatenate(whole), np.array(first))
    for grid, start in zip(used, first, strict=False):
        grid.points[:, : points.shape[1]] = points[number[start : start + len(grid.points)]]
    edit(source, target, lambda data: with_points(source, data, [grid.points for grid in grids]))


PVTU = Format("a list of VTK's pieces", (".pvtu",), re.compile(rb"<VTKFile\b[^>]*\btype\s*=\s*[\"']PU"), _read_vtu)
VTU = Format("a VTK file in XML", (".vtu", ".vts"), re.compile(rb"<VTKFile\b"), _read_vtu, move=_move_xml)
VTK = Format("a legacy VTK file", (".vtk",), re.compile(rb"\A\s*# vtk DataFile"), _read_vtk, move=_move)
VTKHDF = Format("a VTKHDF file", (".vtkhdf", ".hdf"), re.compile(rb"\A\x89HDF"), _read_hdf, move=move_hdf)
