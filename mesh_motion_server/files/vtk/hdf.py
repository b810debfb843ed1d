"""VTK's files in HDF5 (VTKHDF), read with h5py (extra ``mesh``): the parts of an unstructured grid, of its first step.

https://docs.vtk.org/en/latest/vtk_file_formats/vtkhdf_file_format/
"""

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from mesh_motion_numerics.arrays import Floats
from mesh_motion_protocol.errors import InvalidInput
from numpy.typing import NDArray

from mesh_motion_server.files.hdf5 import array_of, opened_hdf5, whole_of
from mesh_motion_server.files.moved import copied_hdf5
from mesh_motion_server.files.text import text_of
from mesh_motion_server.files.vtk.grid import POLYHEDRON, CellFaces, VtkGrid

_COUNTS = ("NumberOfPoints", "NumberOfCells", "NumberOfConnectivityIds")


def read_hdf(path: Path) -> list[VtkGrid]:
    """The parts of a ``.vtkhdf`` file.

    Raises InvalidInput without h5py; for files of other kinds and damaged ones.
    """
    with opened_hdf5(path, "VTKHDF file") as file:
        if "VTKHDF" not in file:
            raise InvalidInput(f"{path}: an HDF5 file without VTK's group 'VTKHDF'", hint="of which program is it?")
        root = file["VTKHDF"]
        kind = np.bytes_(root.attrs.get("Type", b"")).decode("utf-8", errors="replace")
        if kind != "UnstructuredGrid":
            hint = "ParaView's filters Merge Blocks and Append Datasets make one of it; save the result as .vtu"
            raise InvalidInput(f"{path}: a VTK file of type {kind!r}, expected UnstructuredGrid", hint=hint)
        count = len(root["NumberOfCells"])
        if "Steps/NumberOfParts" in root:
            count = int(whole_of(path, root["Steps/NumberOfParts"])[0])
        points, cells, nodes = (array_of(path, root[name], "iu")[:count].tolist() for name in _COUNTS)
        xyz = _split(array_of(path, root["Points"], "f"), points)
        types, connectivity = (
            _split(array_of(path, root[name], "iu"), sizes)
            for name, sizes in (("Types", cells), ("Connectivity", nodes))
        )
        offsets = _split(array_of(path, root["Offsets"], "iu"), [size + 1 for size in cells])
        of_points, of_cells = (
            [{name: values[part] for name, values in arrays.items()} for part in range(count)]
            for what, sizes in (("PointData", points), ("CellData", cells))
            for arrays in [_arrays(path, root.get(what, {}), sizes)]
        )
        has_faces = "FaceConnectivity" in root and any((of == POLYHEDRON).any() for of in types)
        faces = _faces(path, root, count, cells) if has_faces else [None] * count
        grids = zip(xyz, types, offsets, connectivity, of_points, of_cells, faces, strict=True)
        return [VtkGrid(*parts) for parts in grids]


def move_hdf(source: Path, target: Path, points: Floats) -> None:
    """Write a copy of the file in which the points of the first step have other coordinates."""
    with copied_hdf5(source, target) as file:
        listed = file["VTKHDF/Points"]
        if len(file["VTKHDF/NumberOfPoints"]) > 1:
            raise InvalidInput(f"{source}: several parts, each with points of its own", hint="take .vtu")
        listed[: int(file["VTKHDF/NumberOfPoints"][0]), : points.shape[1]] = points[: len(listed)]


def _faces(path: Path, root: Any, count: int, cells: list[int]) -> list[CellFaces]:
    """The faces of the polyhedra of each part."""

    def parts(name: str, sizes: list[int]) -> list[NDArray[Any]]:
        return _split(array_of(path, root[name], "iu").astype(np.int64), sizes)

    faces, nodes, of_cells = (
        array_of(path, root[f"NumberOf{what}"], "iu")[:count].tolist()
        for what in ("Faces", "FaceConnectivityIds", "PolyhedronToFaceIds")
    )
    return [
        CellFaces.of_lists(listed, face_ends[1:], of_cell, cell_ends[1:])
        for listed, face_ends, of_cell, cell_ends in zip(
            parts("FaceConnectivity", nodes),
            parts("FaceOffsets", [size + 1 for size in faces]),
            parts("PolyhedronToFaces", of_cells),
            parts("PolyhedronOffsets", [size + 1 for size in cells]),
            strict=True,
        )
    ]


def _split(values: NDArray[Any], sizes: list[int]) -> list[NDArray[Any]]:
    """The values of each part; those that follow belong to later steps."""
    ends = np.cumsum([0, *sizes])
    if ends[-1] > len(values):
        raise ValueError(f"{len(values)} rows of an array, expected {ends[-1]}")
    return [values[start:end] for start, end in pairwise(ends)]


def _arrays(path: Path, group: Any, sizes: list[int]) -> dict[str, list[NDArray[Any]]]:
    """The arrays of numbers on points or cells, in parts."""
    return {
        text_of(name) if isinstance(name, bytes) else name: _split(whole_of(path, data), sizes)
        for name, data in group.items()  # h5py gives a name that is not in UTF-8 as bytes
        if getattr(getattr(data, "dtype", None), "kind", "") in ("i", "u", "f")
    }
