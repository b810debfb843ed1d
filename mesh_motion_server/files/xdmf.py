"""XDMF, versions 2 and 3: uniform grids and collections of them, with numbers in the file, in HDF5 or in raw files.

XDMF has no patches: they are taken from arrays as those of VTK's files are. A grid of the mesh's points with cells of
lower dimension, as FEniCS writes its tags, is one of numbered patches whatever its array is called.

https://www.xdmf.org/index.php/XDMF_Model_and_Format
"""

import re
import shutil
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.parsers import expat

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.mesh.cells import CELL_TYPES
from mesh_motion_protocol.errors import InvalidInput
from numpy.typing import NDArray

from mesh_motion_server.files.format import Format
from mesh_motion_server.files.mesh_file import MeshFile
from mesh_motion_server.files.moved import Place, copied_hdf5, edit, replaced
from mesh_motion_server.files.packages import check_unpacked, load_h5py
from mesh_motion_server.files.replace import replaced_by_name
from mesh_motion_server.files.vtk.grid import KNOWN_TYPES, VtkGrid, structured_cells
from mesh_motion_server.files.vtk.reading import NUMBERED_PATCH_ARRAYS, PATCH_PREFIX, grids_as_mesh

__all__ = ["XDMF"]

#: Number in mixed topologies, VTK's number, and nodes of an element (None: the file says it), by XDMF's name.
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
_WIDTHS = {"xyz": 3, "xy": 2, "x_y_z": 3, "x_y": 2}
_STRUCTURED = re.compile(r"([23])d(s|rect|corect)mesh")
_INCLUDE = "{http://www.w3.org/2001/XInclude}include"
_CHOICE = re.compile(r"/\*\[((?:\s*(?:or)?\s*self::\w+)+)\s*\]$")
_KINDS = {"float": "f", "int": "i", "uint": "u", "char": "i", "uchar": "u", "short": "i", "ushort": "u"}
_SHORT = {"char": 1, "uchar": 1, "short": 2, "ushort": 2}


@dataclass(eq=False)
class _File:
    """An XDMF file, its elements with what they include, and the files of its numbers."""

    path: Path
    root: ElementTree.Element
    packed: int
    open_files: dict[Path, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, path: Path) -> "_File":
        data = path.read_bytes()
        try:
            return cls(path, ElementTree.fromstring(data), len(data))
        except ElementTree.ParseError as error:
            raise ValueError(str(error)) from None

    def close(self) -> None:
        """Close the files of the numbers."""
        for file in self.open_files.values():
            file.close()

    def found(self, path: str) -> list[ElementTree.Element]:
        """The elements at an XPath as XDMF's references have it."""
        place = re.sub(r"^(xpointer|element)\((.*)\)$", r"\2", path.strip())
        choice = _CHOICE.search(place)
        tags = re.findall(r"self::(\w+)", choice[1]) if choice else []
        place = place[: choice.start()] if choice else place
        place = f".{place}" if place.startswith("//") else re.sub(rf"^/{self.root.tag}/", "./", place)
        try:
            found = self.root.findall(place)
        except SyntaxError:
            found = []
        found = [child for one in found for child in one if child.tag in tags] if tags else found
        if not found:
            raise ValueError(f"the reference {path.strip()!r} leads to nothing that is known")
        return found

    def children(self, parent: ElementTree.Element, tag: str) -> list[ElementTree.Element]:
        """Elements of a kind in another one, included ones too."""
        found = []
        for child in parent:
            listed = [child]
            if child.tag == _INCLUDE:  # of several at its place XDMF takes the first
                listed = self.found(child.get("xpointer", ""))
                listed = listed if len({one.tag for one in listed}) == len(listed) else listed[:1]
            elif child.get("Reference"):
                listed = self.found(
                    child.get("Reference", "") if child.get("Reference") != "XML" else child.text or ""
                )[:1]
            found += [one for one in listed if one.tag == tag]
        return found

    def item(self, parent: ElementTree.Element, number: int = 0) -> ElementTree.Element:
        """The item of numbers of an element."""
        items = self.children(parent, "DataItem")
        if len(items) <= number:
            raise ValueError(f"{parent.tag} {parent.get('Name', '')!r} has {len(items)} items, expected {number + 1}")
        kind = _item_type(items[number])
        if kind != "uniform":
            raise ValueError(f"{parent.tag} {parent.get('Name', '')!r}: items of type {kind} are not read")
        return items[number]

    def values(self, item: ElementTree.Element) -> NDArray[Any]:
        """The numbers of an item in its shape."""
        shape = [int(word) for word in item.get("Dimensions", "").split()]
        form, text = item.get("Format", "XML").lower(), (item.text or "").strip()
        dtype = _dtype(item)
        if form == "hdf":
            values = self._hdf5(text)
        elif form == "binary":
            raw = self.named(text).read_bytes()[int(item.get("Seek", "0")) :]
            values = np.frombuffer(raw, dtype, count=int(np.prod(shape, dtype=np.int64)))
        elif form == "xml":
            words = text.split()
            try:
                values = np.array(words, dtype=np.int64 if dtype[1] in "iu" else np.float64)
            except ValueError:
                values = np.array(words, dtype=np.float64)
        else:
            raise ValueError(f"an item of the format {form}, expected XML, HDF or Binary")
        if values.size != int(np.prod(shape, dtype=np.int64)):
            raise ValueError(f"an item of {values.size} numbers, but Dimensions {item.get('Dimensions')!r}")
        return values.reshape(shape)

    def named(self, name: str) -> Path:
        """A file of numbers that this one names."""
        place = self.path.parent / name
        if not place.is_file():
            raise ValueError(f"there is no {place}, which has its numbers")
        return place

    def _hdf5(self, text: str) -> NDArray[Any]:
        name, _, inner = text.rpartition(":")
        place = self.named(name.strip())
        if place not in self.open_files:
            self.open_files[place] = load_h5py(place).File(place, "r", locking=False)
        data = self.open_files[place][inner.strip()]
        if getattr(data, "dtype", None) is None or data.dtype.kind not in "iuf":
            raise ValueError(f"{text}: expected an array of numbers")
        check_unpacked(place, data.id.get_storage_size(), data.nbytes)
        return np.asarray(data[()])


def _item_type(item: ElementTree.Element) -> str:
    return item.get("ItemType", item.get("Type", "Uniform")).lower()


def _dtype(item: ElementTree.Element) -> str:
    """NumPy's type of the numbers of an item."""
    kind = item.get("NumberType", item.get("DataType", "Float")).lower()
    order = ">" if item.get("Endian", "").lower() == "big" else "<"
    return f"{order}{_KINDS.get(kind, 'f')}{_SHORT.get(kind, int(item.get('Precision', '4')))}"


def _read(path: Path) -> MeshFile:
    """Read a mesh from ``.xdmf``: of a series in time, the first.

    Raises
    ------
    InvalidInput
        For files of numbers that are missing, items that are computed (hyperslabs, functions), polygons and polyhedra.
    """
    return grids_as_mesh(path, _grids, [path])


def _grids(path: Path) -> list[VtkGrid]:
    with closing(_File.of(path)) as file:
        return [_joined([_grid(file, points, grid) for grid in grids]) for points, grids in _by_points(file)]


def _uniform(file: _File, parent: ElementTree.Element) -> Iterator[ElementTree.Element]:
    """The grids in a domain or in a collection, in the order of the file; of one in time, those of its first step."""
    for grid in file.children(parent, "Grid"):
        if grid.get("GridType", grid.get("Type", "Uniform")).lower() in ("collection", "tree"):
            in_time = grid.get("CollectionType", "Spatial").lower() == "temporal"
            yield from list(_uniform(file, grid))[: 1 if in_time else None]
        else:
            yield grid


def _by_points(file: _File) -> list[tuple[ElementTree.Element, list[ElementTree.Element]]]:
    """The geometries of the file with the grids on each."""
    found: dict[object, tuple[ElementTree.Element, list[ElementTree.Element]]] = {}
    for domain in file.root.iter("Domain"):
        for grid in _uniform(file, domain):
            geometry = _one(file, grid, "Geometry")
            found.setdefault(_content(file, geometry), (geometry, []))[1].append(grid)
    if not found:
        raise ValueError("it has no Grid")
    return [*found.values()]


def _one(file: _File, grid: ElementTree.Element, tag: str) -> ElementTree.Element:
    found = file.children(grid, tag)
    if not found:
        raise ValueError(f"Grid {grid.get('Name', '')!r} has no {tag}")
    return found[0]


def _content(file: _File, element: ElementTree.Element) -> object:
    """What two elements have in common that say the same."""
    items = [(item.text or "").strip() for item in file.children(element, "DataItem")]
    return _kind(element), element.get("Dimensions"), *items


def _kind(element: ElementTree.Element) -> str:
    """The type of a topology or a geometry, lower case."""
    return element.get(f"{element.tag}Type", element.get("Type", "XYZ")).lower()


@dataclass(frozen=True, eq=False)
class _Grid:
    """A grid, and what its cells are said by."""

    grid: VtkGrid
    cells: object
    name: str

    @property
    def dimension(self) -> int:
        """Of the cells."""
        return max((_DIMENSIONS.get(code, 3) for code in np.unique(self.grid.types).tolist()), default=0)


def _grid(file: _File, geometry: ElementTree.Element, grid: ElementTree.Element) -> _Grid:
    topology = _one(file, grid, "Topology")
    structured = _STRUCTURED.fullmatch(_kind(topology))
    if structured:
        counts = [int(word) for word in topology.get("Dimensions", topology.get("NumberOfElements", "")).split()]
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


def _array(file: _File, attribute: ElementTree.Element, count: int, *, on_cells: bool) -> NDArray[Any]:
    """The numbers of one node or cell a row, where they can name patches; of results, large or computed, zeros."""
    name, items = attribute.get("Name", ""), file.children(attribute, "DataItem")
    scalar = attribute.get("AttributeType", "Scalar").lower() == "scalar"
    kept = on_cells and bool(items) and _item_type(items[0]) == "uniform"
    if not scalar or not (kept or name.startswith(PATCH_PREFIX) or name in NUMBERED_PATCH_ARRAYS):
        return np.broadcast_to(0.0, count)
    return _whole(file.values(file.item(attribute)).reshape(count))


def _whole(values: NDArray[Any]) -> NDArray[Any]:
    """As whole numbers where all are: text may not say that it is of such."""
    rounded = values.astype(np.int64) if np.isfinite(values).all() else values
    return rounded if values.dtype.kind in "iu" or (rounded == values).all() else values


def _cells(file: _File, topology: ElementTree.Element) -> tuple[Integers, Integers, Integers]:
    """VTK's type and the number of nodes (m,) of each cell, and all nodes one after the other."""
    kind = _kind(topology)
    kind = _OTHER_NAMES.get(kind, kind)
    values = file.values(file.item(topology)).astype(np.int64)
    base = int(topology.get("BaseOffset", "0"))
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


def _points(file: _File, geometry: ElementTree.Element) -> Floats:
    """(n, 3)."""
    kind = _kind(geometry)
    if kind not in _WIDTHS:
        raise ValueError(f"a geometry of type {kind}; known are {', '.join(_WIDTHS)} for cells that list their nodes")
    width = _WIDTHS[kind]
    if "_" in kind:
        points = np.column_stack([file.values(file.item(geometry, axis)).ravel() for axis in range(width)])
    else:
        points = file.values(file.item(geometry)).reshape(-1, width)
    return np.pad(points.astype(np.float64), ((0, 0), (0, 3 - width)))


def _structured_points(file: _File, geometry: ElementTree.Element, counts: list[int]) -> Floats:
    """(n, 3) of a block of ``counts`` nodes, the last direction fastest."""
    kind = _kind(geometry)
    if kind in _WIDTHS:
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
    axes = [of.ravel() for of in np.meshgrid(*lines, indexing="ij")][::-1]  # x is the last direction
    return np.pad(np.column_stack(axes), ((0, 0), (0, 3 - len(axes))))


def _joined(grids: list[_Grid]) -> VtkGrid:
    """One grid of those on the same points; cells that are there twice, as in the steps of a series, count once."""
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


def _texts(data: bytes) -> list[tuple[int, int]]:
    """Where the text of each item begins and ends in the file, in the order of their beginnings."""
    found: list[list[int]] = []
    open_items: list[list[int]] = []
    parser = expat.ParserCreate()

    def start(tag: str, _: dict[str, str]) -> None:
        if tag == "DataItem":
            found.append([])
            open_items.append(found[-1])

    def text(_: str) -> None:
        if open_items and not open_items[-1]:
            open_items[-1].append(parser.CurrentByteIndex)

    def end(tag: str) -> None:
        if tag == "DataItem":
            item = open_items.pop()
            item[:] = [*item[:1], parser.CurrentByteIndex] if item else [parser.CurrentByteIndex] * 2

    parser.StartElementHandler, parser.CharacterDataHandler, parser.EndElementHandler = start, text, end
    parser.Parse(data, True)
    return [(item[0], item[1]) for item in found]


def _move(source: Path, target: Path, points: Floats) -> None:
    """Write the file with other coordinates, and copies of the files of its numbers named like it."""
    with closing(_File.of(source)) as file:
        (geometry, *others) = [of for of, _ in _by_points(file)]
        if others or _kind(geometry) not in _WIDTHS:
            raise InvalidInput(
                f"{source}: {'grids with points of their own' if others else 'a grid without a list of points'}",
                hint="take .vtu",
            )
        apart = "_" in _kind(geometry)
        own = [file.item(geometry, axis) for axis in range(points.shape[1] if apart else 1)]
        columns = [points[:, [axis]] for axis in range(points.shape[1])] if apart else [points]
        places = dict(zip(own, columns, strict=True))
        width = 1 if apart else _WIDTHS[_kind(geometry)]
        items = [*file.root.iter("DataItem")]
        names = _copies(file, items, target)
    data = source.read_bytes()
    changes = []
    for item, (begin, end) in zip(items, _texts(data), strict=True):
        name, colon, inner = _named(item)
        if name:
            changes.append((begin, end, f"{names[name]}{colon}{inner}".encode()))
        elif item in places:
            place = Place(len(points), 0, width, text=(0, end - begin))
            changes.append((begin, end, replaced(data[begin:end], [place], places[item])))
    for name, new in names.items():
        moved = {item: values for item, values in places.items() if _named(item)[0] == name}
        _copy(source.parent / name, target.parent / new, moved, width)

    def change(content: bytes) -> bytes:
        for begin, end, text in reversed(changes):
            content = content[:begin] + text + content[end:]
        return content

    edit(source, target, change)


def _named(item: ElementTree.Element) -> tuple[str, str, str]:
    """The file that has the numbers of an item, ":" and the place in it; "" where they are in the XML itself."""
    form, text = item.get("Format", "XML").lower(), (item.text or "").strip()
    if form == "hdf":
        name, colon, inner = text.rpartition(":")
        return name.strip(), colon, inner
    return (text, "", "") if form == "binary" else ("", "", "")


def _copies(file: _File, items: list[ElementTree.Element], target: Path) -> dict[str, str]:
    """{name of a file of numbers: the name of its copy}."""
    names: dict[str, str] = {}
    for item in items:
        name = _named(item)[0]
        if name and name not in names:
            file.named(name)
            names[name] = f"{target.stem}{f'_{len(names)}' if names else ''}{Path(name).suffix}"
    for name, new in names.items():
        place = target.parent / new
        other = next((one for one in names if place.exists() and one != name and file.named(one).samefile(place)), "")
        if other:
            raise InvalidInput(
                f"{target}: the copy of {name} would replace {other}", hint="take another name or folder"
            )
    return names


def _copy(source: Path, target: Path, moved: dict[ElementTree.Element, Floats], width: int) -> None:
    """Copy a file of numbers with other coordinates in the items that are ``moved``."""
    if not moved:
        with replaced_by_name(target) as partial:
            shutil.copyfile(source, partial)
    elif next(iter(moved)).get("Format", "").lower() == "hdf":
        with copied_hdf5(source, target) as file:
            for item, values in moved.items():
                data = file[_named(item)[2].strip()]
                columns = data[()].reshape(-1, width)
                columns[:, : values.shape[1]] = values
                data[...] = columns.reshape(data.shape)
    else:
        places = [
            Place(len(values), int(item.get("Seek", "0")), width * int(dtype[2:]), dtype=dtype)
            for item, values in moved.items()
            for dtype in [_dtype(item)]
        ]
        edit(source, target, lambda data: _raw(data, places, [*moved.values()]))


def _raw(data: bytes, places: list[Place], values: list[Floats]) -> bytes:
    for place, one in zip(places, values, strict=True):
        data = replaced(data, [place], one)
    return data


XDMF = Format("an XDMF file", (".xdmf", ".xmf", ".xdmf2", ".xdmf3"), re.compile(rb"<Xdmf\b"), _read, move=_move)
