"""A small task with the cell types of a large one: loads a system's compiled kernels before the clock starts."""

from __future__ import annotations

from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.task import Task

__all__ = ["small_task"]

Ints = NDArray[np.int64]

#: Nodes on an edge of the box, by dimension: about a thousand free nodes, enough for every solver to be used.
_SIDE = {2: 32, 3: 12}


def small_task(task: Task) -> Task:
    """A unit box around a moving cube, displaced far enough to distort the cells between them."""
    dimension = task.points.shape[1]
    axis = np.linspace(0, 1, _SIDE[dimension])
    points = np.stack(np.meshgrid(*[axis] * dimension, indexing="ij"), axis=-1).reshape(-1, dimension)
    cubes = _cubes(dimension)
    inside = np.all(np.abs(points[cubes].mean(axis=1) - 0.5) < 0.2, axis=1)
    body, cubes = cubes[inside], cubes[~inside]
    used = np.isin(np.arange(len(points)), cubes)
    number = np.cumsum(used) - 1
    points = points[used]
    cells = {name: _CELLS_OF_CUBE[name](number[cubes]) for name in task.cells}
    moving = number[np.intersect1d(body, cubes)]
    fixed = np.flatnonzero(np.any((points == 0) | (points == 1), axis=1))
    return Task(points, cells, moving, fixed, np.full((1, len(moving), dimension), 0.12))


def _cubes(dimension: int) -> Ints:
    """Nodes of every square or cube of the grid, corners in binary order (the last axis changes fastest)."""
    side = _SIDE[dimension]
    number = np.arange(side**dimension).reshape((side,) * dimension)
    corners = [number[tuple(slice(o, o + side - 1) for o in offset)] for offset in np.ndindex((2,) * dimension)]
    return np.stack([corner.ravel() for corner in corners], axis=1)


def _simplices(cube: Ints) -> Ints:
    """Kuhn's subdivision of squares or cubes (corners in binary order) into simplices of positive volume."""
    dimension = cube.shape[1].bit_length() - 1
    parts = []
    for path in permutations(range(dimension)):
        corners = np.cumsum([0, *(2 ** (dimension - 1 - axis) for axis in path)])
        even = np.linalg.det(np.eye(dimension)[list(path)]) > 0
        parts.append(cube[:, corners if even else corners[[1, 0, *range(2, dimension + 1)]]])
    return np.concatenate(parts)


def _blocks(cube: Ints) -> Ints:
    """Squares or cubes in VTK's order of nodes."""
    return cube[:, [0, 2, 3, 1] if cube.shape[1] == 4 else [0, 4, 6, 2, 1, 5, 7, 3]]


_CELLS_OF_CUBE = {"triangle": _simplices, "tetra": _simplices, "quad": _blocks, "hexahedron": _blocks}
