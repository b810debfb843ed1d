"""Meshes of a few cells of every type."""

from collections.abc import Iterator
from itertools import product

import numpy as np
from mesh_motion_numerics.mesh.cells import CellTable
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Mesh = tuple[FloatArray, CellTable]

#: Corners of the unit cube in the order of a hexahedron, and its division into other cells.
_CUBE = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)])
_CUTS: dict[str, list[list[int]]] = {
    "line": [[0, 1]],
    "triangle": [[0, 1, 2], [0, 2, 3]],
    "quad": [[0, 1, 2, 3]],
    "tetra": [[0, 1, 2, 6], [0, 2, 3, 6], [0, 3, 7, 6], [0, 7, 4, 6], [0, 4, 5, 6], [0, 5, 1, 6]],
    "hexahedron": [[0, 1, 2, 3, 4, 5, 6, 7]],
    "wedge": [[0, 1, 2, 4, 5, 6], [0, 2, 3, 4, 6, 7]],
    "pyramid": [[0, 1, 2, 3, 8], [7, 6, 5, 4, 8], [4, 5, 1, 0, 8], [5, 6, 2, 1, 8], [6, 7, 3, 2, 8], [7, 4, 0, 3, 8]],
}
_DIMENSION = {"line": 1, "triangle": 2, "quad": 2}


def tiny_meshes(rows: int = 4) -> Iterator[tuple[str, Mesh]]:
    for name in _CUTS:
        yield name, tiny_mesh(name, rows)


def tiny_mesh(name: str, rows: int = 4) -> Mesh:
    """A unit interval, square or cube with ``rows`` cells along each axis, divided into cells of the type ``name``."""
    dimension = _DIMENSION.get(name, 3)
    corners = _CUBE[: 2**dimension, :dimension]
    if name == "pyramid":
        corners = np.vstack([corners, [[0.5, 0.5, 0.5]]])
    cubes = np.array(list(product(range(rows), repeat=dimension)))
    places = (cubes[:, None, :] + corners).reshape(-1, dimension)
    points, numbers = np.unique(places, axis=0, return_inverse=True)
    nodes = numbers.reshape(len(cubes), len(corners))[:, np.array(_CUTS[name])].reshape(-1, len(_CUTS[name][0]))
    return points / rows, CellTable.from_arrays({name: nodes})
