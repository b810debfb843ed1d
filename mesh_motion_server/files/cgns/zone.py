"""Read an unstructured zone, or all structured zones, of a CGNS file in HDF5 with h5py (extra ``mesh``).

Boundary conditions become patches with the names of their families; in files from Gmsh, a family refers to the name of
its physical group. In a zone without boundary conditions, the sections of lower dimension become patches with their
names; for polyhedra, these are the NGON_n sections that have no face between two cells.

https://cgns.github.io/CGNS_docs_current/sids/index.html
"""

import re
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.mesh.cells import CELL_TYPES
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.files.cgns.conditions import read_conditions
from mesh_motion_server.files.cgns.elements import NFACE, NGON, VERTEX, Elements, ListedElements, read_elements
from mesh_motion_server.files.cgns.faces import NumberedFaces, join_faces
from mesh_motion_server.files.cgns.structured import numbering, read_structured
from mesh_motion_server.files.cgns.tree import Node, open_cgns
from mesh_motion_server.files.format import Format
from mesh_motion_server.files.mesh_file import MeshFile, assemble, assemble_elements, by_name, chosen_zone, named_groups
from mesh_motion_server.files.moved import copied_hdf5
from mesh_motion_server.files.polyhedra.cells import find_cells
from mesh_motion_server.files.polyhedra.pieces import divide
from mesh_motion_server.files.sides import CGNS as SIDES
from mesh_motion_server.files.sides import side_nodes
from mesh_motion_server.files.vtk.pieces import PatchKey

_AXES = ("CoordinateX", "CoordinateY", "CoordinateZ")


def read_cgns(path: Path, zone: str = "") -> MeshFile:
    """Read a mesh from ``.cgns``; ``zone`` selects one of several zones by its name or number.

    Raises InvalidInput without h5py; for ADF files, several bases, several unstructured zones if none is chosen, other
    elements, and damaged files.
    """
    with open_cgns(path) as root:
        base, nodes = _the_zones(root, zone)
        if _is_structured(nodes[0]):
            return replace(read_structured(path, base, nodes, [_points(node) for node in nodes]), zone=zone)
        (node,) = nodes
        points = _points(node)
        written = root.child("CGNSLibraryVersion")
        version = float(written.reals()[0]) if written is not None else 4.0
        parts = [part for section in node.children("Elements_t") for part in read_elements(section, version)]
        listed = [part for part in parts if isinstance(part, ListedElements)]
        fixed = [part for part in parts if isinstance(part, Elements)]
        fixed = [_on_its_cells(part, fixed) for part in fixed]
        for part in fixed:
            _check_nodes(node, part, len(points))
        mesh = (
            _polyhedral(path, base, node, points, listed, fixed) if listed else _simple(path, base, node, points, fixed)
        )
        read = _cell_count(listed) if listed else mesh.n_cells
        return replace(mesh, zone=node.name, notes=(*mesh.notes, *_other_count(node, read)))


def _cell_count(listed: list[ListedElements]) -> int:
    """The number of polyhedra."""
    return sum(len(part.numbers) for part in listed if part.kind == NFACE)


def _other_count(zone: Node, read: int) -> list[str]:
    """A note if the zone announces another number of cells than it has."""
    counts = zone.integers()
    announced = int(counts[1]) if len(counts) > 1 else read
    return [f"zone {zone.name!r} announces {announced} cells, but has {read}"] if announced != read else []


def _the_zones(root: Node, name: str) -> tuple[Node, list[Node]]:
    """The only base and its zone with this name; without a name its single zone, or all if they are structured."""
    if not root.children("CGNSBase_t"):
        raise InvalidInput(
            f"{root.path}: it has no base (CGNSBase_t): not a CGNS file",
            hint="meshio's .cgns has none: let meshio write another format, for example .vtu",
        )
    base = root.only("CGNSBase_t", "bases")
    zones = {zone.name: zone for zone in base.children("Zone_t")}
    if not name and zones and all(_is_structured(zone) for zone in zones.values()):
        return base, list(zones.values())
    return base, [zones[chosen_zone(root.path, list(zones), name)]]


def _is_structured(zone: Node) -> bool:
    kind = zone.child("ZoneType")
    known = kind.text() if kind is not None else "Structured"
    if known not in ("Structured", "Unstructured"):
        raise zone.refused(f"a zone of type {known}")
    return known == "Structured"


def _coordinate_nodes(zone: Node) -> list[Node]:
    """The arrays of x, y and, if any, z."""
    grid = zone.child("GridCoordinates") or zone.only("GridCoordinates_t", "grids of coordinates")
    found = [node for axis in _AXES if (node := grid.child(axis)) is not None]
    if [node.name for node in found] not in (list(_AXES[:2]), list(_AXES)):
        names = ", ".join(node.name for node in grid.children("DataArray_t")) or "none"
        raise grid.refused(f"coordinates {names}; expected {', '.join(_AXES)}")
    return found


def _points(zone: Node) -> Floats:
    """(n, 2 | 3) the coordinates."""
    counts = zone.integers()
    columns = [node.reals() for node in _coordinate_nodes(zone)]
    for axis, column in zip(_AXES, columns, strict=False):
        expected = int(np.prod(counts[: max(1, len(counts) // 3)])) if len(counts) else -1
        if len(column) != expected:
            raise zone.refused(f"{expected} nodes, but {len(column)} values of {axis}")
    return np.column_stack(columns)


def _on_its_cells(part: Elements, parts: list[Elements]) -> Elements:
    """The elements with the nodes of their cells' sides, where the section has zeros instead, as IOSS writes it."""
    if part.parents is None:
        return part
    (cells, sides), nodes = part.parents.T, part.nodes.copy()
    for of in parts:
        for side in range(1, 1 + len(SIDES.corners.get(of.name, ()))):
            rows = np.flatnonzero((sides == side) & np.isin(cells, of.numbers))
            own = of.nodes[np.searchsorted(of.numbers, cells[rows])]
            found = side_nodes(of.name, own, sides[rows], SIDES)
            if len(rows) and len(found) == nodes[rows].size:
                nodes[rows] = found.reshape(len(rows), -1)
    return replace(part, nodes=nodes)


def _check_nodes(zone: Node, part: Elements, n_points: int) -> None:
    wrong = (part.nodes < 0) | (part.nodes >= n_points)
    if wrong.any():
        row, column = (int(v) for v in np.argwhere(wrong)[0])
        node = int(part.nodes[row, column]) + 1
        raise zone.refused(
            f"element {int(part.numbers[row])} of section {part.section!r} names node {node}, "
            f"but there are the nodes 1 to {n_points}"
        )


def _simple(path: Path, base: Node, zone: Node, points: Floats, fixed: list[Elements]) -> MeshFile:
    """A zone of cells of known types."""
    cells = [(part.name, part.nodes) for part in fixed if part.name != VERTEX]
    dimension = max((CELL_TYPES[name].dimension for name, _ in cells), default=0)
    flat = [part for part in fixed if _dimension(part) < dimension]
    numbers = _numbers(flat), _numbers([part for part in fixed if part not in flat])
    nodes_of: dict[PatchKey, list[Integers]] = defaultdict(list)
    conditions = read_conditions(base, zone, len(points))
    for condition in conditions:
        condition.check(*numbers, "an element of lower dimension than the cells")
        named = [part.nodes[condition.elements(part.numbers)] for part in flat]
        of = max((_dimension(part) for part, nodes in zip(flat, named, strict=True) if len(nodes)), default=0)
        nodes_of[_patch_key(condition.patch, of)] += [condition.nodes, *(nodes.ravel() for nodes in named)]
    if not conditions:
        for part in flat:
            nodes_of[_dimension(part), part.section].append(part.nodes.ravel())
    found = {key: np.concatenate(parts) for key, parts in nodes_of.items() if parts}
    patches, notes = by_name(named_groups({key: nodes for key, nodes in found.items() if len(nodes)}))
    mesh = assemble_elements(path, points, cells, patches)
    return replace(mesh, notes=(*mesh.notes, *notes))


def _dimension(part: Elements) -> int:
    return 0 if part.name == VERTEX else CELL_TYPES[part.name].dimension


def _patch_key(name: str, dimension: int) -> PatchKey:
    """The key of a group.

    Gmsh writes a group without a name as the family of its number; it numbers curves and surfaces separately.
    """
    return dimension, int(name) if name.isdecimal() and str(int(name)) == name else name


def _numbers(parts: list[Elements]) -> Integers:
    """The numbers of all elements of these sections."""
    return np.concatenate([np.empty(0, dtype=np.int64), *(part.numbers for part in parts)])


def _patches(nodes_of: dict[str, list[Integers]]) -> dict[str, Integers]:
    """The nodes of each patch that is not empty."""
    joined = {name: np.concatenate(parts) for name, parts in nodes_of.items() if parts}
    return {name: nodes for name, nodes in joined.items() if len(nodes)}


def _polyhedral(
    path: Path, base: Node, zone: Node, points: Floats, listed: list[ListedElements], fixed: list[Elements]
) -> MeshFile:
    """A zone of polyhedra; cells that are not simple are divided into pieces."""
    single = [part for part in fixed if part.name == VERTEX]
    if len(single) < len(fixed) or points.shape[1] != 3:
        raise zone.refused(
            "NGON_n faces mixed with other elements, or in 2D; they are read only as faces of polyhedra in a 3D zone"
        )
    faces = join_faces(zone, points, listed)
    pieces = divide(faces.mesh, find_cells(faces.mesh))
    boundary = np.arange(faces.mesh.n_inner, faces.mesh.n_faces)
    numbers = np.concatenate([faces.numbers[boundary], _numbers(single)])
    volumes = np.concatenate([numbers[:0], *(part.numbers for part in listed if part.kind == NFACE)])
    chosen: dict[str, list[Integers]] = defaultdict(list)
    nodes_of: dict[str, list[Integers]] = defaultdict(list)
    conditions = read_conditions(base, zone, len(points))
    for condition in conditions:
        condition.check(numbers, volumes, "a face of the boundary")
        chosen[condition.patch].append(boundary[condition.elements(faces.numbers[boundary])])
        nodes_of[condition.patch].append(condition.nodes)
        nodes_of[condition.patch] += [part.nodes[condition.elements(part.numbers)].ravel() for part in single]
    if not conditions:
        chosen |= _boundary_sections(listed, faces)
    for name, parts in chosen.items():
        nodes_of[name] += [of.ravel() for of in pieces.facets(faces.mesh, np.unique(np.concatenate(parts))).values()]
    return assemble(path, pieces.points, pieces.cells, _patches(nodes_of))


def _boundary_sections(listed: list[ListedElements], faces: NumberedFaces) -> dict[str, list[Integers]]:
    """{section: [(k,) faces]} of the NGON_n sections without a face between two cells."""
    found = {}
    for part in listed:
        rows = np.flatnonzero(np.isin(faces.numbers, part.numbers))
        if part.kind == NGON and len(rows) and rows.min() >= faces.mesh.n_inner:
            found[part.section] = [rows]
    return found


def _move(source: Path, target: Path, points: Floats, zone: str) -> None:
    """Write the file with other coordinates of the nodes of one zone, or of all structured zones."""
    with copied_hdf5(source, target) as file:
        _, nodes = _the_zones(Node(source, "/", file), zone)
        old = [_points(node) for node in nodes]
        number = numbering(source, nodes, old)[0] if _is_structured(nodes[0]) else np.arange(len(old[0]))
        starts = np.cumsum([0, *map(len, old)])
        for node, start, end in zip(nodes, starts, starts[1:], strict=False):
            for axis, column in zip(_coordinate_nodes(node), points[number[start:end]].T, strict=False):
                axis.replace(column)


CGNS = Format("a CGNS mesh", (".cgns",), re.compile(rb"\A\x89HDF|ADF"), read_cgns, True, _move)
