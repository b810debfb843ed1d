"""Meshes of other packages: PyVista, meshio and Gmsh objects in memory, and files through the server's readers.

Each package is imported only when it is needed.

Their meshes have cells of several dimensions and three coordinates: the cells of the highest dimension become the mesh,
the others its patches.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from mesh_motion_protocol.errors import InvalidInput, meant
from mesh_motion_protocol.flat_points import is_flat
from numpy.typing import NDArray

if TYPE_CHECKING:
    from mesh_motion_client.mesh import Mesh

__all__ = ["Content", "from_file", "from_gmsh", "from_meshio", "from_pyvista", "optional_package", "to_pyvista"]

Floats = NDArray[np.float64]
Ints = NDArray[np.integer]

#: Dimension of each cell type, and its numbers in VTK and in Gmsh.
_TYPES = {
    "line": (1, 3, 1),
    "triangle": (2, 5, 2),
    "quad": (2, 9, 3),
    "tetra": (3, 10, 4),
    "pyramid": (3, 14, 7),
    "wedge": (3, 13, 6),
    "hexahedron": (3, 12, 5),
}
#: VTK types that are ours with another node order: pixels and voxels, the cells of images along the axes.
_ALIGNED = {8: ("quad", [0, 1, 3, 2]), 11: ("hexahedron", [0, 1, 3, 2, 4, 5, 7, 6])}
#: VTK types that are not cells (none, a vertex, several vertices), and names of types that are never accepted.
_NO_CELLS = (0, 1, 2)
_ODD = {4: "polylines", 6: "triangle strips", 7: "polygons", 15: "prisms", 16: "prisms", 42: "polyhedra"}
_PREFIX = "patch_"
#: Arrays of numbers on cells that name patches, as in files; the first existing one is used.
_NUMBERS = ("patch", "gmsh:physical", "CellEntityIds", "cell_tags", "medit:ref", "netgen:index", "ObjectId", "Label",
            "GeometryIds", "MaterialID", "gmsh:geometrical")  # fmt: skip


class Content(NamedTuple):
    """The parts of a mesh: points (n, d), cells by type, the nodes of each patch."""

    points: Floats
    cells: dict[str, Ints]
    patches: dict[str, NDArray[Any]]


def optional_package(name: str) -> Any:
    """Import an optional package; raise InvalidInput with the command that installs it if it cannot be imported."""
    try:
        return import_module(name)
    except (ImportError, OSError) as error:  # Gmsh's wheel needs system libraries
        raise InvalidInput(
            f"this needs {name}, which cannot be imported: {error}", hint=f"pip install {name}"
        ) from error


# --- PyVista ---------------------------------------------------------------------------------------------------------


def to_pyvista(mesh: Mesh, points: Floats) -> Any:
    """Return a ``pyvista.UnstructuredGrid`` of a mesh with points (n, d); arrays ``patch_<name>`` mark the patches."""
    types = [np.full(len(nodes), _TYPES[name][1], dtype=np.uint8) for name, nodes in mesh.cells.items()]
    rows = [np.insert(nodes, 0, nodes.shape[1], axis=1).ravel() for nodes in mesh.cells.values()]
    in_space = np.zeros((len(points), 3))
    in_space[:, : points.shape[1]] = points
    grid = optional_package("pyvista").UnstructuredGrid(np.concatenate(rows), np.concatenate(types), in_space)
    for name, patch in mesh.patches.items():
        marks = np.zeros(len(points), dtype=np.uint8)
        marks[patch.nodes] = 1
        grid.point_data[_PREFIX + name] = marks
    return grid


def from_pyvista(dataset: Any, wanted: Iterable[str]) -> Content:
    """Return the content of a dataset; patches are arrays of points or cells, or numbers of cells, as in files.

    The patch ``name`` has the nodes where the array ``name`` or ``patch_<name>`` is not 0.
    """
    if not hasattr(dataset, "cast_to_unstructured_grid"):
        raise InvalidInput(
            f"expected a dataset of PyVista, got {type(dataset).__name__}",
            hint="pyvista.read(…), or Mesh.load of a file",
        )
    grid = dataset.cast_to_unstructured_grid()
    ours = {number: (name, slice(None)) for name, (_, number, _) in _TYPES.items()} | _ALIGNED
    kinds = set(np.unique(grid.celltypes).tolist()).difference(_NO_CELLS)
    for kind in sorted(kinds - set(ours)):  # check before cells_dict, which does not support polyhedra
        raise InvalidInput(
            f"the mesh has cells of VTK's type {kind} ({_ODD.get(kind, 'of another shape, or curved')}); "
            f"expected {', '.join(_TYPES)}, pixels, voxels",
            hint="dataset.triangulate() divides them; curved ones: save a .vtu for Mesh.load, which takes corners",
        )
    blocks = [(ours[kind][0], np.asarray(grid.cells_dict[kind])[:, ours[kind][1]]) for kind in sorted(kinds)]
    of_cells = {
        name: [np.asarray(values)[grid.celltypes == kind] for kind in sorted(kinds)]
        for name, values in grid.cell_data.items()
        if np.ndim(values) == 1
    }
    found: dict[str, Ints] = {
        name.removeprefix(_PREFIX): np.flatnonzero(values) for name, values in grid.point_data.items()
    }
    for name, parts in of_cells.items():
        own = _nodes(nodes[marks != 0] for (_, nodes), marks in zip(blocks, parts, strict=True))
        found.setdefault(name.removeprefix(_PREFIX), own)
    for name, nodes in _numbered(blocks, of_cells).items():
        found.setdefault(name, nodes)
    _check_patches("the arrays and numbers", wanted, found)
    return _content(grid.points, _by_type(blocks), {name: found[name] for name in wanted})


# --- meshio ----------------------------------------------------------------------------------------------------------


def from_meshio(mesh: Any, wanted: Iterable[str]) -> Content:
    """Return the content of a ``meshio.Mesh``; patches are sets of points or cells, Gmsh's named groups, or numbers.

    A patch of curves is ``curve_<number>`` where a surface has that number, as in files.
    """
    if not all(hasattr(mesh, name) for name in ("points", "cells", "point_sets", "cell_sets", "field_data")):
        raise InvalidInput(
            f"expected a meshio.Mesh, got {type(mesh).__name__}", hint="meshio.read(…), or Mesh.load of a file"
        )
    blocks = [(block.type, np.asarray(block.data)) for block in mesh.cells]
    found = {name: np.asarray(nodes) for name, nodes in mesh.point_sets.items()}
    for name, rows in mesh.cell_sets.items():
        found[name] = _nodes(block.data[chosen] for block, chosen in zip(mesh.cells, rows, strict=True) if len(chosen))
    groups = mesh.cell_data.get("gmsh:physical", [])
    for name, (number, _) in mesh.field_data.items():
        marked = zip(mesh.cells, groups, strict=False)
        found.setdefault(name, _nodes(block.data[np.asarray(group) == number] for block, group in marked))
    for name, nodes in _numbered(blocks, mesh.cell_data).items():
        found.setdefault(name, nodes)
    _check_patches("the sets of points and cells", wanted, found)
    cells = _by_type([block for block in blocks if block[0] != "vertex"])
    return _content(mesh.points, cells, {name: found[name] for name in wanted})


def _by_type(blocks: Iterable[tuple[str, Ints]]) -> dict[str, Ints]:
    """The cells of several blocks by their type."""
    found: dict[str, list[Ints]] = {}
    for name, nodes in blocks:
        found.setdefault(name, []).append(nodes)
    return {name: np.concatenate(parts) for name, parts in found.items()}


def _numbered(blocks: Sequence[tuple[str, Ints]], arrays: Mapping[str, Sequence[Any]]) -> dict[str, Ints]:
    """The nodes of each number below the cells' dimension, in the first of :data:`_NUMBERS` that has one.

    Arrays have a part for each block of cells.
    """
    of = [_TYPES[name][0] if name in _TYPES else 0 for name, _ in blocks]
    found: dict[str, Ints] = {}
    for array in (arrays[name] for name in _NUMBERS if name in arrays):
        for dimension in range(max(of, default=0) - 1, 0, -1):
            marked = zip(blocks, array, of, strict=False)
            own = [(nodes, np.asarray(numbers)) for (_, nodes), numbers, kind in marked if kind == dimension]
            taken = set(found)
            for number in np.unique(np.concatenate([np.empty(0, np.int64), *(numbers for _, numbers in own)])).tolist():
                if number:
                    name = f"curve_{int(number)}" if str(int(number)) in taken else str(int(number))
                    found[name] = _nodes(nodes[numbers == number] for nodes, numbers in own)
        if found:
            break
    return found


# --- Gmsh ------------------------------------------------------------------------------------------------------------


def from_gmsh() -> Content:
    """Return the content of Gmsh's current model; its physical groups below the cells' dimension are the patches.

    Nodes are in the order of their tags. A group without a name has its number; where a surface has that number, a
    curve is ``curve_<number>``, a point ``point_<number>``, as in files. Groups with one name are one patch.
    """
    gmsh = optional_package("gmsh")
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    order = np.argsort(tags)
    tags, points = np.asarray(tags)[order], np.reshape(coordinates, (-1, 3))[order]
    names = {number: name for name, (_, _, number) in _TYPES.items()}
    cells: dict[str, Ints] = {}
    for kind, _, nodes in zip(*gmsh.model.mesh.getElements(), strict=True):
        name, dimension, _, count, *_ = gmsh.model.mesh.getElementProperties(kind)
        if dimension and int(kind) not in names:
            raise InvalidInput(
                f"Gmsh's model has cells of the type {name}; expected {', '.join(_TYPES)}",
                hint="gmsh.model.mesh.setOrder(1) makes them straight; Mesh.load of a file takes their corners",
            )
        if dimension:
            cells[names[int(kind)]] = np.searchsorted(tags, nodes).reshape(-1, count)
    if not cells:
        raise InvalidInput("Gmsh's model has no mesh", hint="call gmsh.model.mesh.generate(…) before")
    highest = max(_TYPES[name][0] for name in cells)
    groups = [group for group in gmsh.model.getPhysicalGroups() if group[0] < highest]
    named = {group: gmsh.model.getPhysicalName(*group) for group in groups}
    patches: dict[str, Ints] = {}
    for dimension, number in sorted(groups, key=lambda group: (not named[group], -group[0])):
        name = named[dimension, number]
        if not name:
            name = str(number) if str(number) not in patches else f"{('point', 'curve', 'surface')[dimension]}_{number}"
        found = np.searchsorted(tags, gmsh.model.mesh.getNodesForPhysicalGroup(dimension, number)[0])
        patches[name] = _nodes([patches.get(name, found), found])
    return _content(points, cells, patches)


# --- files ------------------------------------------------------------------------------------------------------------


def from_file(path: str | os.PathLike[str], zone: str) -> Content:
    """Read the content of a mesh file with the readers of the server's package; ``zone`` as for ``Mesh.load``."""
    if not Path(path).exists():
        raise InvalidInput(f"{os.fspath(path)}: cannot be read: there is no such file")
    try:
        # the metadata of the server's package names its reader: the client imports no module of the server by name
        read_mesh = next(iter(entry_points(group="mesh_motion_client", name="read_mesh"))).load()
    except (ImportError, StopIteration) as error:
        raise InvalidInput(
            f"{os.fspath(path)}: the server's package reads all mesh files but .npz: {str(error) or 'not installed'}",
            hint="pip install 'mesh-motion-server[server]', or give the .npz of mesh-motion convert",
        ) from error
    read = read_mesh(Path(path), zone)
    return Content(read.points, dict(read.cells), dict(read.patches))


# --- what they share -------------------------------------------------------------------------------------------------


def _content(points: Any, cells: Mapping[str, Ints], patches: dict[str, Ints]) -> Content:
    """Keep the cells of the highest dimension, and the same number of coordinates."""
    odd = sorted(set(cells) - set(_TYPES))
    if odd or not cells:
        raise InvalidInput(
            f"the mesh has {'cells of type ' + odd[0] if odd else 'no cells'}; expected {', '.join(_TYPES)}",
            hint="first-order cells: divide polygons and polyhedra, save curved cells by their corners" if odd else "",
        )
    highest = max(_TYPES[name][0] for name in cells)
    points = np.asarray(points, dtype=np.float64)
    if len(points) and not is_flat(points, highest):
        raise InvalidInput(
            f"the cells are {highest}D, but the coordinate {'xyz'[highest]} varies",
            hint="a 2D mesh must lie in the x-y plane; a 3D mesh needs its volume cells",
        )
    own = {name: nodes for name, nodes in cells.items() if _TYPES[name][0] == highest}
    return Content(points[:, :highest], own, patches)


def _nodes(parts: Iterable[Any]) -> Ints:
    """The nodes of some cells, each once."""
    return np.unique(np.concatenate([np.empty(0, dtype=np.int64), *(np.ravel(part) for part in parts)]))


def _check_patches(where: str, wanted: Iterable[str], found: Mapping[str, Any]) -> None:
    """Raise InvalidInput for a patch that does not exist."""
    for name in wanted:
        if name not in found:
            raise InvalidInput(
                f"patch {name!r} is not among {where} {sorted(found)}",
                hint=meant(name, found) or "roles name the patches",
            )
