"""XDMF's grids as a mesh: topologies and geometries, and the arrays that name patches."""

import re
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.mesh.cells import CELL_TYPES
from numpy.typing import NDArray

from mesh_motion_server.files.mesh_file import MeshFile
from mesh_motion_server.files.packages import check_unpacked
from mesh_motion_server.files.text import integer
from mesh_motion_server.files.vtk.grid import KNOWN_TYPES, VtkGrid, lattice, structured_cells
from mesh_motion_server.files.vtk.reading import NUMBERED_PATCH_ARRAYS, PATCH_PREFIX, grids_as_mesh
from mesh_motion_server.files.xdmf.document import Document, item_type, kind_of

#: Number in mixed topologies, VTK's number, and number of nodes of an element (None: given in the file), by XDMF's
#: name.
_TYPES: dict[str, tuple[int, int, int | None]] = {
    "polyvertex": (1, 2, None), "polyline": (2, 4, None), "triangle": (4, 5, 3), "quadrilateral": (5, 9, 4),
    "tetrahedron": (6, 10, 4), "pyramid": (7, 14, 5), "wedge": (8, 13, 6), "hexahedron": (9, 12, 8),
    "edge_3": (34, 21, 3), "quadrilateral_9": (35, 28, 9), "triangle_6": (36, 22, 6), "quadrilateral_8": (37, 23, 8),
    "tetrahedron_10": (38, 24, 10), "pyramid_13": (39, 27, 13), "wedge_15": (40, 26, 15), "wedge_18": (41, 32, 18),
    "hexahedron_20": (48, 25, 20), "hexahedron_24": (49, 33, 24), "hexahedron_27": (50, 29, 27),
}  # fmt: skip
_OTHER_NAMES = {
    "edge3": "edge_3", "tri_6": "triangle_6", "triangle6": "triangle_6", "tet_10": "tetrahedron_10",
    "tetrahedron10": "tetrahedron_10", "quad_8": "quadrilateral_8", "quad_9": "quadrilateral_9",
    "hex_20": "hexahedron_20", "hex_24": "hexahedron_24", "hex_27": "hexahedron_27", "quad": "quadrilateral",
    "hexahedron20": "hexahedron_20", "hexahedron27": "hexahedron_27",
}  # fmt: skip
_MIXED = {number: (vtk, size) for number, vtk, size in _TYPES.values()}
_DIMENSIONS = {1: 0, 2: 0} | {code: CELL_TYPES[name].dimension for code, name in KNOWN_TYPES.items()}
WIDTHS = {"xyz": 3, "xy": 2, "x_y_z": 3, "x_y": 2}
_STRUCTURED = re.compile(r"([23])d(s|rect|corect)mesh")


def read(path: Path) -> MeshFile:
    """Read a mesh from ``.xdmf``; from a time series, the first step.

    Raises InvalidInput for files of numbers that are missing, items that are computed (functions), polygons and
    polyhedra.
    """
    return grids_as_mesh(path, _grids, [path])


def _grids(path: Path) -> list[VtkGrid]:
    with closing(Document.of(path)) as file:
        return [_joined([_grid(file, points, grid) for grid in grids]) for points, grids in by_points(file)]


def _uniform(file: Document, parent: ElementTree.Element) -> Iterator[ElementTree.Element]:
    """The grids in a domain or a collection, in the order of the file; from a time series, those of the first step."""
    for grid in file.children(parent, "Grid"):
        if grid.get("GridType", grid.get("Type", "Uniform")).lower() in ("collection", "tree"):
            in_time = grid.get("CollectionType", "Spatial").lower() == "temporal"
            yield from list(_uniform(file, grid))[: 1 if in_time else None]
        else:
            yield grid


def by_points(file: Document) -> list[tuple[ElementTree.Element, list[ElementTree.Element]]]:
    """The geometries of the file, with the grids on each."""
    found: dict[object, tuple[ElementTree.Element, list[ElementTree.Element]]] = {}
    for domain in file.root.iter("Domain"):
        for grid in _uniform(file, domain):
            geometry = _one(file, grid, "Geometry")
            found.setdefault(_content(file, geometry), (geometry, []))[1].append(grid)
    if not found:
        raise ValueError("it has no Grid")
    return [*found.values()]


def _one(file: Document, grid: ElementTree.Element, tag: str) -> ElementTree.Element:
    found = file.children(grid, tag)
    if not found:
        raise ValueError(f"Grid {grid.get('Name', '')!r} has no {tag}")
    return found[0]


def _content(file: Document, element: ElementTree.Element) -> object:
    """A key that is equal for two elements with the same meaning."""
    items = [(one.text or "").strip() for item in file.children(element, "DataItem") for one in item.iter("DataItem")]
    return kind_of(element), element.get("Dimensions"), *items


@dataclass(frozen=True, eq=False)
class _Grid:
    """A grid, and the elements that describe its cells."""

    grid: VtkGrid
    cells: object
    name: str

    @property
    def dimension(self) -> int:
        """Dimension of the cells."""
        return max((_DIMENSIONS.get(code, 3) for code in np.unique(self.grid.types).tolist()), default=0)


def _grid(file: Document, geometry: ElementTree.Element, grid: ElementTree.Element) -> _Grid:
    topology = _one(file, grid, "Topology")
    structured = _STRUCTURED.fullmatch(kind_of(topology))
    if structured:
        counts = [integer(word) for word in topology.get("Dimensions", topology.get("NumberOfElements", "")).split()]
        check_unpacked(file.path, file.packed, 64 * int(np.prod(counts, dtype=np.float64)))
        code, nodes = structured_cells(counts[::-1])
        types, sizes, nodes = np.full(len(nodes), code), np.full(len(nodes), nodes.shape[1]), nodes.ravel()
        points = _structured_points(file, geometry, counts)
    else:
        types, sizes, nodes = _cells(file, topology)
        points = _points(file, geometry)
    arrays: dict[str, dict[str, NDArray[Any]]] = {"Node": {}, "Cell": {}}
    for attribute in file.children(grid, "Attribute"):
        name, center = attribute.get("Name", ""), attribute.get("Center", "Node").capitalize()
        if center in arrays:
            count = len(points) if center == "Node" else len(types)
            arrays[center][name] = _array(file, attribute, count, on_cells=center == "Cell")
    offsets = np.concatenate([[0], np.cumsum(sizes)])
    whole = VtkGrid(points, types, offsets, nodes, arrays["Node"], arrays["Cell"])
    return _Grid(whole, _content(file, topology), grid.get("Name", ""))


def _array(file: Document, attribute: ElementTree.Element, count: int, *, on_cells: bool) -> NDArray[Any]:
    """The numbers of a node or cell array with one per row, if they can name patches; otherwise zeros."""
    name, items = attribute.get("Name", ""), file.children(attribute, "DataItem")
    scalar = attribute.get("AttributeType", "Scalar").lower() == "scalar"
    kept = on_cells and bool(items) and item_type(items[0]) == "uniform"
    if not scalar or not (kept or name.startswith(PATCH_PREFIX) or name in NUMBERED_PATCH_ARRAYS):
        return np.broadcast_to(0.0, count)
    return _whole(file.values(file.item(attribute)).reshape(count))


def _whole(values: NDArray[Any]) -> NDArray[Any]:
    """The array as whole numbers if all values are whole: text files may not give the type."""
    rounded = values.astype(np.int64) if np.isfinite(values).all() else values
    return rounded if values.dtype.kind in "iu" or (rounded == values).all() else values


def _cells(file: Document, topology: ElementTree.Element) -> tuple[Integers, Integers, Integers]:
    """VTK's type and the number of nodes (m,) of each cell, and all nodes one after the other."""
    kind = kind_of(topology)
    kind = _OTHER_NAMES.get(kind, kind)
    values = file.values(file.item(topology)).astype(np.int64)
    base = integer(topology.get("BaseOffset", "0"))
    if kind == "mixed":
        return _mixed(values.ravel(), base)
    if kind not in _TYPES:
        raise ValueError(f"a topology of type {kind}; known are {', '.join(_TYPES)}, mixed and structured ones")
    _, code, size = _TYPES[kind]
    size = size or int(topology.get("NodesPerElement", values.shape[-1] if values.ndim > 1 else 1))
    if values.size % size:
        raise ValueError(f"a topology of type {kind} with {values.size} numbers, expected {size} for each cell")
    count = values.size // size
    return np.full(count, 3 if (kind, size) == ("polyline", 2) else code), np.full(count, size), values.ravel() - base


def _mixed(values: Integers, base: int) -> tuple[Integers, Integers, Integers]:
    types: list[int] = []
    sizes: list[int] = []
    starts: list[int] = []
    place = 0
    listed = values.tolist()
    while place < len(listed):
        if listed[place] not in _MIXED:
            raise ValueError(f"cell {len(types)} of a mixed topology is of type {listed[place]}, which is not read")
        code, size = _MIXED[listed[place]]
        place += 1
        if size is None:
            size = listed[place]
            place += 1
            code = 3 if (code, size) == (4, 2) else code
        types.append(code)
        sizes.append(size)
        starts.append(place)
        place += size
    if place > len(listed):
        raise ValueError(f"cell {len(types) - 1} of a mixed topology has nodes beyond its end")
    counts = np.array(sizes, dtype=np.int64)
    first = np.cumsum(counts) - counts
    rows = np.repeat(np.array(starts, dtype=np.int64) - first, counts) + np.arange(int(counts.sum()))
    return np.array(types, dtype=np.int64), counts, values[rows] - base


def _points(file: Document, geometry: ElementTree.Element) -> Floats:
    """(n, 3)."""
    kind = kind_of(geometry)
    if kind not in WIDTHS:
        raise ValueError(f"a geometry of type {kind}; known are {', '.join(WIDTHS)} for cells that list their nodes")
    width = WIDTHS[kind]
    if "_" in kind:
        points = np.column_stack([file.values(file.item(geometry, axis)).ravel() for axis in range(width)])
    else:
        points = file.values(file.item(geometry)).reshape(-1, width)
    return np.pad(points.astype(np.float64), ((0, 0), (0, 3 - width)))


def _structured_points(file: Document, geometry: ElementTree.Element, counts: list[int]) -> Floats:
    """(n, 3) points of a block of ``counts`` nodes, the last direction fastest."""
    kind = kind_of(geometry)
    if kind in WIDTHS:
        return _points(file, geometry)
    if kind in ("vxvyvz", "vxvy"):
        lines = [file.values(file.item(geometry, axis)).ravel() for axis in range(len(counts))][::-1]
    elif kind in ("origin_dxdydz", "origin_dxdy"):
        origin, steps = (file.values(file.item(geometry, number)).ravel() for number in (0, 1))
        lines = [start + step * np.arange(count) for start, step, count in zip(origin, steps, counts, strict=True)]
    else:
        raise ValueError(f"a geometry of type {kind}, which is not read")
    if [len(line) for line in lines] != counts:
        raise ValueError(f"{[len(line) for line in lines]} lines of nodes, but Dimensions {counts}")
    return lattice(lines[::-1])  # x is the last direction


def _joined(grids: list[_Grid]) -> VtkGrid:
    """One grid from all grids on the same points; repeated cells, as in the steps of a series, count once."""
    kept: dict[object, _Grid] = {}
    for one in grids:
        same = kept.setdefault(one.cells, one)
        same.grid.cell_arrays.update(one.grid.cell_arrays)
        same.grid.point_arrays.update(one.grid.point_arrays)
    parts = [*kept.values()]
    if len(parts) == 1:
        return parts[0].grid
    dimension = max(one.dimension for one in parts)
    numbered: dict[int, str] = {}
    for one in parts:
        arrays = one.grid.cell_arrays
        whole = [values for values in arrays.values() if values.dtype.kind in "iu" and values.ndim == 1]
        named = any(name.startswith(PATCH_PREFIX) or name in NUMBERED_PATCH_ARRAYS for name in arrays)
        if one.dimension < dimension and whole and not named:
            if one.dimension in numbered:
                both = f"{numbered[one.dimension]!r} and {one.name!r}"
                raise ValueError(f"the grids {both} number patches of the same cells: save one of them")
            numbered[one.dimension] = one.name
            arrays["patch"] = whole[0]
    names = {name: values for one in parts for name, values in one.grid.cell_arrays.items()}
    cells = {
        name: np.concatenate(
            [
                one.grid.cell_arrays.get(name, np.zeros((len(one.grid.types), *values.shape[1:]), values.dtype))
                for one in parts
            ]
        )
        for name, values in names.items()
    }
    points = {name: values for one in parts for name, values in one.grid.point_arrays.items()}
    offsets = np.concatenate([[0], np.cumsum(np.concatenate([np.diff(one.grid.offsets) for one in parts]))])
    types, nodes = (np.concatenate([getattr(one.grid, of) for one in parts]) for of in ("types", "connectivity"))
    return VtkGrid(parts[0].grid.points, types, offsets, nodes, points, cells)
