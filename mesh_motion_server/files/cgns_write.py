"""Writing CGNS files in HDF5: a new file with one zone, or one whose coordinates alone are replaced.

A patch is a family of the base by its name, boundary conditions of the zone that name this family, and its facets
sections of elements. The names of conditions and sections have at most 32 bytes and are told apart by numbers where
they are equal; the family's is always the patch's own. HDF5 holds CGNS' arrays transposed.
"""

from __future__ import annotations

import shutil
from itertools import chain, count
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.files.cgns import coordinate_nodes, the_zone
from mesh_motion_server.files.cgns_elements import TYPES
from mesh_motion_server.files.cgns_tree import Node
from mesh_motion_server.files.mesh_file import FloatArray, IntArray, MeshFile
from mesh_motion_server.files.packages import load_h5py
from mesh_motion_server.files.patch_facets import PatchFacets, facets_of_patches
from mesh_motion_server.files.replace import replaced_by_name

__all__ = ["add_node", "check_cgns", "check_move_cgns", "move_cgns", "new_cgns", "write_cgns"]

_VERSION = 3.4
_KINDS = {name: number for number, name in TYPES.items()}
_LONGEST_NAME = 32
_TYPE_NAMES = {"f4": "R4", "f8": "R8", "i4": "I4", "i8": "I8", "i1": "C1"}


def check_cgns(path: Path, mesh: MeshFile) -> None:
    """Refuse patches whose names CGNS cannot hold."""
    for name in mesh.patches:
        _check_name(path, name)


def write_cgns(path: Path, mesh: MeshFile) -> None:
    """Write a mesh.

    Raises
    ------
    InvalidInput
        Without h5py, and for patches whose names CGNS cannot hold.
    """
    check_cgns(path, mesh)
    with replaced_by_name(path) as partial, new_cgns(partial, path) as root:
        base = add_node(root, "Base", "CGNSBase_t", np.array([mesh.dimension, max(2, mesh.dimension)]))
        sizes = np.array([[len(mesh.points)], [mesh.n_cells], [0]])
        for name in mesh.patches:
            add_node(add_node(base, name, "Family_t"), "FamilyBC", "FamilyBC_t", "UserDefined")
        zone = add_node(base, _free_name(base, "Zone"), "Zone_t", sizes)
        add_node(zone, "ZoneType", "ZoneType_t", "Unstructured")
        grid = add_node(zone, "GridCoordinates", "GridCoordinates_t")
        columns = np.pad(mesh.points, ((0, 0), (0, max(0, 2 - mesh.dimension)))).T
        for axis, values in zip("XYZ", columns, strict=False):
            add_node(grid, f"Coordinate{axis}", "DataArray_t", np.ascontiguousarray(values))
        first = 1
        for name, nodes in mesh.cells.items():
            first = _add_section(zone, name, name, nodes, first)
        conditions = add_node(zone, "ZoneBC", "ZoneBC_t")
        for name, patch in facets_of_patches(mesh).items():
            first = _add_patch(zone, conditions, name, patch, first, mesh.dimension)


def _check_name(path: Path, name: str) -> None:
    """Refuse what is no name of a family: CGNS drops blanks at the ends and keeps names like " data" for itself."""
    if not 0 < len(name.encode()) <= _LONGEST_NAME or "/" in name or "\0" in name or name.strip() in ("", ".", ".."):
        wanted = f"1 to {_LONGEST_NAME} bytes, no '/'"
    elif name != name.strip():
        wanted = "no blank at its begin or end"
    else:
        return
    raise InvalidInput(f"{path}: patch {name!r} is no name for a family of CGNS: {wanted}", hint="rename the patch")


def _free_name(parent: Any, begin: str, end: str = "") -> str:
    """A name for a child that no other has: its begin, cut where it is too long, its end, and if need be a number."""
    tails = chain([end], (f"{end} {number}" for number in count(2)))
    names = (begin.encode()[: _LONGEST_NAME - len(tail)].decode(errors="ignore") + tail for tail in tails)
    return next(name for name in names if name not in parent)


def _add_patch(zone: Any, conditions: Any, name: str, patch: PatchFacets, first: int, dimension: int) -> int:
    """The sections and boundary conditions of a patch; returns the number of the next element."""
    begin = first
    for kind, nodes in patch.facets.items():
        first = _add_section(zone, _free_name(zone, name, f" {kind}"), kind, nodes, first)
    location = "FaceCenter" if dimension == 3 else "EdgeCenter"
    if first > begin:
        span = np.array([[begin], [first - 1]])
        _add_condition(conditions, _free_name(conditions, name), name, location, ("PointRange", span))
    if len(patch.loose):
        own = _free_name(conditions, name, "" if first == begin else " nodes")
        _add_condition(conditions, own, name, "Vertex", ("PointList", patch.loose[:, None] + 1))
    return first


def _add_condition(conditions: Any, name: str, family: str, location: str, listed: tuple[str, IntArray]) -> None:
    condition = add_node(conditions, name, "BC_t", "FamilySpecified")
    label = "IndexRange_t" if listed[0] == "PointRange" else "IndexArray_t"
    add_node(condition, listed[0], label, listed[1])
    add_node(condition, "GridLocation", "GridLocation_t", location)
    add_node(condition, "FamilyName", "FamilyName_t", family)


def _add_section(zone: Any, name: str, kind: str, nodes: IntArray, first: int) -> int:
    """Elements of one type; returns the number of the next element."""
    last = first + len(nodes) - 1
    section = add_node(zone, name, "Elements_t", np.array([_KINDS[kind], 0]))
    add_node(section, "ElementRange", "IndexRange_t", np.array([first, last]))
    add_node(section, "ElementConnectivity", "DataArray_t", nodes.ravel() + 1)
    return last + 1


def new_cgns(partial: Path, path: Path) -> Any:
    """An HDF5 file with what CGNS wants at its root; errors name ``path``."""
    root = load_h5py(path).File(partial, "w", locking=False, track_order=True)
    _label(root, "HDF5 MotherNode", "Root Node of HDF5 File", "MT")
    root.create_dataset(" format", data=np.frombuffer(b"IEEE_LITTLE_32\0", np.int8))
    root.create_dataset(" hdf5version", data=np.frombuffer(b"HDF5 Version 1.8".ljust(33, b"\0"), np.int8))
    add_node(root, "CGNSLibraryVersion", "CGNSLibraryVersion_t", np.array([_VERSION], dtype=np.float32))
    return root


def add_node(parent: Any, name: str, label: str, data: NDArray[Any] | str | None = None) -> Any:
    """Add a node with characters, integers (32 bits if they fit, but for a connectivity's own width) or reals."""
    group = parent.create_group(name, track_order=True)
    if isinstance(data, str):
        data = np.frombuffer(data.encode(), np.int8)
    if data is not None and data.dtype.kind == "i" and data.dtype.itemsize == 8:
        small = not data.size or int(np.abs(data).max()) < 2**31
        data = data.astype(np.int32) if small else data
    _label(group, name, label, "MT" if data is None else _TYPE_NAMES[data.dtype.str[1:]])
    if data is not None:
        group.create_dataset(" data", data=data)
    return group


def _label(group: Any, name: str, label: str, kind: str) -> None:
    """The attributes of a node, of the lengths that the format fixes."""
    for key, text, length in (("name", name, 33), ("label", label, 33), ("type", kind, 3)):
        group.attrs.create(key, np.bytes_(text.encode()), dtype=f"S{length}")
    group.attrs.create("flags", np.array([1], dtype=np.int32))


def move_cgns(path: Path, mesh: MeshFile, points: FloatArray) -> None:
    """Copy the file and replace its coordinates; those of single precision become double.

    Raises
    ------
    InvalidInput
        If the coordinates lie in another file, which the copy's links name: it would be written into.
    """
    h5py = load_h5py(mesh.path)
    with replaced_by_name(path) as partial:
        shutil.copyfile(mesh.path, partial)
        with h5py.File(partial, "r+", locking=False) as root:
            nodes = _own_coordinates(mesh, root)
            size = len(nodes[0].reals())
            for node, values in zip(nodes, points[:size, : mesh.dimension].T, strict=False):
                _replace_data(node, values)


def check_move_cgns(path: Path, mesh: MeshFile) -> None:
    """Refuse what :func:`move_cgns` does."""
    with load_h5py(path).File(mesh.path, "r", locking=False) as root:
        _own_coordinates(mesh, root)


def _own_coordinates(mesh: MeshFile, root: Any) -> list[Node]:
    """The nodes of the coordinates, all in the root's own file."""
    nodes = coordinate_nodes(the_zone(Node(mesh.path, "/", root), mesh.zone)[1])
    for node in nodes:
        if node.group.file != root:
            raise node.refused(
                f"it lies in another file, {node.group.file.filename}, which would be changed",
                f"cgnsconvert -f -l {mesh.path.name} whole.cgns makes one file of both; or write another format",
            )
    return nodes


def _replace_data(node: Node, values: FloatArray) -> None:
    """Write the array anew if it is of single precision or, by a link or HDF5's own means, in another file."""
    data = node.group[" data"]
    if data.dtype.itemsize == 8 and data.file == node.group.file and not (data.is_virtual or data.external):
        data[...] = values
        return
    del node.group[" data"]
    node.group.create_dataset(" data", data=np.ascontiguousarray(values))
    node.group.attrs.modify("type", np.bytes_(b"R8"))
