"""CGNS files made node by node, and a mesh of simple cells in such a file."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.files.cgns.elements import TYPES

_TYPE_NAMES = {"f4": "R4", "f8": "R8", "i4": "I4", "i8": "I8", "i1": "C1"}


def new_cgns(path: Path) -> Any:
    """Make an HDF5 file with the items that CGNS requires at its root."""
    root = h5py.File(path, "w", locking=False, track_order=True)
    _label(root, "HDF5 MotherNode", "Root Node of HDF5 File", "MT")
    root.create_dataset(" format", data=np.frombuffer(b"IEEE_LITTLE_32\0", np.int8))
    root.create_dataset(" hdf5version", data=np.frombuffer(b"HDF5 Version 1.8".ljust(33, b"\0"), np.int8))
    add_node(root, "CGNSLibraryVersion", "CGNSLibraryVersion_t", np.array([3.4], dtype=np.float32))
    return root


def add_node(parent: Any, name: str, label: str, data: NDArray[Any] | str | None = None) -> Any:
    """Add a node with characters, integers (32 bits if they fit, except in a connectivity) or reals."""
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
    """Write the attributes of a node, with the lengths that the format fixes."""
    for key, text, length in (("name", name, 33), ("label", label, 33), ("type", kind, 3)):
        group.attrs.create(key, np.bytes_(text.encode()), dtype=f"S{length}")
    group.attrs.create("flags", np.array([1], dtype=np.int32))


def add_cells(zone: Any, cells: dict[str, NDArray[np.int64]]) -> None:
    numbers, first = {name: number for number, name in TYPES.items()}, 1
    for name, nodes in cells.items():
        section = add_node(zone, name, "Elements_t", np.array([numbers[name], 0]))
        add_node(section, "ElementRange", "IndexRange_t", np.array([first, first + len(nodes) - 1]))
        add_node(section, "ElementConnectivity", "DataArray_t", nodes.ravel() + 1)
        first += len(nodes)
