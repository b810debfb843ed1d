"""Exodus II meshes: netCDF, in its classic form and in HDF5 (extra ``mesh``). Side sets and node sets become patches.

So do blocks of lower dimension that have a name.

Sandia report SAND92-2137 (2006), https://sandialabs.github.io/seacas-docs/
"""

import re
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.mesh.cells import CELL_TYPES
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.files.format import Format
from mesh_motion_server.files.hdf5 import opened_hdf5
from mesh_motion_server.files.mesh_file import MeshFile, assemble_elements, by_name
from mesh_motion_server.files.moved import copied_hdf5
from mesh_motion_server.files.packages import check_unpacked, reason_of
from mesh_motion_server.files.replace import replacing
from mesh_motion_server.files.sides import BEAMS, SHELLS, Sides, side_nodes
from mesh_motion_server.files.sides import EXODUS as SIDES
from mesh_motion_server.files.text import text_of

_TYPES = {"BAR": "line", "BEA": "line", "TRU": "line", "EDG": "line", "TRI": "triangle", "QUA": "quad", "SHE": "quad",
          "TET": "tetra", "HEX": "hexahedron", "WED": "wedge", "PYR": "pyramid", "SPH": "", "CIR": "",
          "POI": ""}  # fmt: skip


def _read(path: Path) -> MeshFile:
    """Read a mesh from ``.exo``, ``.e`` or ``.g``.

    Raises InvalidInput without h5py for a file in HDF5; for unknown elements, and damaged files.
    """
    with _opened(path) as data:
        points = _points(data)
        blocks = _blocks(path, data, *points.shape)
        sets = _sets(data, points, blocks)
        dimension = max((CELL_TYPES[name].dimension for name, _, _ in blocks.values() if name), default=0)
        for number, (cell, nodes, _) in blocks.items():
            if cell and CELL_TYPES[cell].dimension < dimension and (name := _own_name(data, "eb", number)):
                sets[name].append((CELL_TYPES[cell].dimension, nodes.ravel()))
        patches, notes = by_name(sets)
        elements = [(name, nodes) for name, nodes, _ in blocks.values()]
        mesh = assemble_elements(path, points, elements, {name: nodes for name, nodes in patches.items() if len(nodes)})
        return replace(mesh, notes=(*mesh.notes, *notes))


def _is_hdf5(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(4) == b"\x89HDF"


@contextmanager
def _opened(path: Path) -> Iterator[dict[str, Any]]:
    """The variables of a file by their names."""
    if _is_hdf5(path):
        with opened_hdf5(path, "Exodus file") as root:
            for name in root:
                check_unpacked(path, root[name].id.get_storage_size(), root[name].nbytes)
            yield {name: (root[name][()], root[name].attrs.get("elem_type", "")) for name in root if _needed(name)}
        return
    from scipy.io import netcdf_file  # noqa: PLC0415 - a quarter of a second

    try:
        with netcdf_file(path, "r", mmap=False) as file:
            found = file.variables
            yield {n: (found[n].data.copy(), getattr(found[n], "elem_type", "")) for n in found if _needed(n)}
    except InvalidInput:
        raise
    except Exception as error:
        raise InvalidInput(f"{path}: malformed or damaged Exodus file: {reason_of(error)}") from None


_NEEDED = re.compile(r"coord[xyz]?|(connect|elem_ss|side_ss|node_ns)\d+|[sn]s_(names|prop1)|eb_names")


def _needed(name: str) -> bool:
    return _NEEDED.fullmatch(name) is not None


def _points(data: dict[str, Any]) -> Floats:
    """(n, d) the coordinates."""
    if "coord" in data:
        return np.asarray(data["coord"][0], dtype=np.float64).T
    columns = [data[f"coord{axis}"][0] for axis in "xyz" if f"coord{axis}" in data]
    if not columns:
        raise ValueError("neither coord nor coordx is among its variables: is it a netCDF file of another program?")
    return np.column_stack(columns).astype(np.float64)


def _blocks(path: Path, data: dict[str, Any], n_points: int, dimension: int) -> dict[int, tuple[str, Integers, Sides]]:
    """Our type, nodes (m, k) and the sides of the elements of each block, in the order of the element numbers."""
    found = {}
    for number in sorted(int(name.removeprefix("connect")) for name in data if name.startswith("connect")):
        values, kind = data[f"connect{number}"]
        kind = (kind.decode("ascii", errors="replace") if isinstance(kind, bytes) else str(kind)).strip("\0 ")
        nodes = np.asarray(values).astype(np.int64) - 1
        name = _TYPES.get(kind[:3].upper())
        if name is None or nodes.ndim != 2:
            raise InvalidInput(
                f"{path}: block {number} of elements of type {kind!r}; known are {', '.join(_TYPES)}",
                hint="save the mesh without this block; polygons or polyhedra: take ParaView's filter Triangulate or "
                "Tetrahedralize and save as .vtu",
            )
        sides = BEAMS if kind[:3].upper() == "BEA" else SIDES
        if ("SHELL" in kind.upper() and name != "hexahedron") or (name == "triangle" and dimension == 3):
            sides = SHELLS
        if kind[:5].upper() == "SHELL" and nodes.shape[1] in (3, 6):
            name = "triangle"
        if name and nodes.shape[1] < CELL_TYPES[name].n_nodes:
            raise ValueError(f"block {number}: elements {kind} with too few nodes, {nodes.shape[1]}")
        wrong = np.argwhere((nodes < 0) | (nodes >= n_points))
        if len(wrong):
            node = int(nodes[tuple(wrong[0])]) + 1
            raise ValueError(
                f"block {number}: element {int(wrong[0, 0]) + 1} names node {node}, but the last node is {n_points}"
            )
        found[number] = (name, nodes, sides)
    return found


def _sets(
    data: dict[str, Any], points: Floats, blocks: dict[int, tuple[str, Integers, Sides]]
) -> dict[str, list[tuple[int, Integers]]]:
    """Dimension and nodes of side sets and node sets, by their names, or their numbers if they have none."""
    starts = np.cumsum([0, *(len(nodes) for _, nodes, _ in blocks.values())])
    plane = all(
        CELL_TYPES[name].dimension < 3 for name, _, _ in blocks.values() if name
    )  # faces of shells are no boundary
    found: dict[str, list[tuple[int, Integers]]] = defaultdict(list)
    for kind in ("ss", "ns"):
        listed = [name.removeprefix(f"elem_{kind}").removeprefix(f"node_{kind}") for name in data]
        for number in sorted(int(name) for name in listed if name.isdigit()):
            name = _name(data, kind, number)
            if kind == "ns":
                nodes = np.asarray(data[f"node_ns{number}"][0]).astype(np.int64) - 1
            else:
                elements = np.asarray(data[f"elem_ss{number}"][0]).astype(np.int64) - 1
                sides = np.asarray(data[f"side_ss{number}"][0]).astype(np.int64)
                wrong = (elements < 0) | (elements >= starts[-1])
                if wrong.any() or len(elements) != len(sides):
                    reason = f"names element {int(elements[wrong][0]) + 1}" if wrong.any() else "has other counts"
                    raise ValueError(f"side set {name!r} {reason} than the {int(starts[-1])} elements that there are")
                parts = [np.empty(0, dtype=np.int64)]
                for (cell, of, table), start in zip(blocks.values(), starts, strict=False):
                    own = (elements >= start) & (elements < start + len(of))
                    if table is SHELLS and plane:
                        own &= (sides != 1) & (sides != 2)
                    if own.any():
                        parts.append(side_nodes(cell, of[elements[own] - start], sides[own], table))
                nodes = np.concatenate(parts)
            found[name].append((0 if kind == "ns" else points.shape[1] - 1, nodes))
    return found


def _name(data: dict[str, Any], kind: str, number: int) -> str:
    """The name of a set, or its number; node sets without a name are ``nodes_<number>``."""
    if name := _own_name(data, kind, number):
        return name
    numbers = np.ravel(data.get(f"{kind}_prop1", ([],))[0])
    own = int(numbers[number - 1]) if number <= len(numbers) else number
    return str(own) if kind == "ss" else f"nodes_{own}"


def _own_name(data: dict[str, Any], kind: str, number: int) -> str:
    """The name of a set or a block, "" if it has none."""
    names = np.asarray(data.get(f"{kind}_names", ([],))[0])
    if number > len(names):
        return ""
    return text_of(names[number - 1].tobytes().split(b"\0")[0]).strip()


def _move(source: Path, target: Path, points: Floats) -> None:
    """Write the file with other coordinates of the nodes; results in the file are kept."""
    if _is_hdf5(source):
        with copied_hdf5(source, target) as variables:
            _overwrite(variables, points)
        return
    from scipy.io import netcdf_file  # noqa: PLC0415 - a quarter of a second

    with replacing(target) as file:
        file.write(source.read_bytes())
        file.flush()
        with netcdf_file(file.name, "a", mmap=False) as opened:
            _overwrite(opened.variables, points)


def _overwrite(variables: Any, points: Floats) -> None:
    for axis, column in enumerate(points.T):
        if "coord" in variables:
            variables["coord"][axis] = column
        else:
            variables[f"coord{'xyz'[axis]}"][:] = column


EXODUS = Format(
    "an Exodus mesh",
    (".exo", ".e", ".ex2", ".exii", ".g", ".gen"),
    re.compile(rb"\A(CDF[\1\2]|\x89HDF)"),
    _read,
    move=_move,
)
