"""Compile the kernels once, before anybody waits for them: tiny motions through every path of the numerics.

The compiled code is kept by numba beside the sources (or in ``NUMBA_CACHE_DIR``) and found by every later process.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from itertools import product

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.errors import NumericalError
from mesh_motion_server.numerics.cells import CellTable
from mesh_motion_server.numerics.method import Method
from mesh_motion_server.numerics.motion import MotionModel
from mesh_motion_server.numerics.reduction import REDUCTIONS
from mesh_motion_server.numerics.roles import Patch

__all__ = ["compile_kernels", "tiny_mesh", "tiny_meshes"]

FloatArray = NDArray[np.float64]
Mesh = tuple[FloatArray, CellTable]

#: Corners of the unit cube in the order of a hexahedron, and how it is cut into other cells.
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
_MANY_ROWS = 32  # squares along each side of a mesh whose correction has some two thousand unknowns


def compile_kernels(told: Callable[[str], None] = lambda _: None) -> float:
    """Move tiny meshes of every cell type by every method; return the seconds it took.

    Parameters
    ----------
    told
        Called with what is compiled next, a few words, before each of some ten parts.
    """
    begin = time.perf_counter()
    for name, (points, cells) in tiny_meshes():
        told(f"{name} cells")
        for method in _methods(points.shape[1]):
            _move(points, cells, method, sliding=name in ("quad", "hexahedron"))
    told("large meshes")
    _many_unknowns()
    return time.perf_counter() - begin


def _many_unknowns() -> None:
    """A correction of more nodes than are solved for directly."""
    points, cells = tiny_mesh("triangle", _MANY_ROWS)
    _move(points, cells, Method(support_radius=1.0, correction_target="maximum", quality_threshold=0.9), sliding=False)


def tiny_meshes(rows: int = 4) -> Iterator[tuple[str, Mesh]]:
    """:func:`tiny_mesh` for each type of cell, with its name."""
    for name in _CUTS:
        yield name, tiny_mesh(name, rows)


def tiny_mesh(name: str, rows: int = 4) -> Mesh:
    """A unit interval, square or cube of ``rows`` cells along each axis, cut into cells of the type ``name``."""
    dimension = _DIMENSION.get(name, 3)
    corners = _CUBE[: 2**dimension, :dimension]
    if name == "pyramid":
        corners = np.vstack([corners, [[0.5, 0.5, 0.5]]])
    cubes = np.array(list(product(range(rows), repeat=dimension)))
    places = (cubes[:, None, :] + corners).reshape(-1, dimension)
    points, numbers = np.unique(places, axis=0, return_inverse=True)
    nodes = numbers.reshape(len(cubes), len(corners))[:, np.array(_CUTS[name])].reshape(-1, len(_CUTS[name][0]))
    return points / rows, CellTable.from_arrays({name: nodes})


def _methods(dimension: int) -> Iterator[Method]:
    """Every path that has kernels of its own."""
    corrections = ("none", "explicit", "enrichment", "optimised")
    for correction in corrections if dimension > 1 else (*corrections, "imposed-gradient"):
        yield Method(support_radius=1.0, correction=correction, quality_threshold=0.6)
    yield Method(support_radius=1.0, correction="none", displacement="reanchored")
    for predictor in ("centre-gradient", "edge-midpoint-gradient", "sampled"):
        yield Method(support_radius=1.0, correction="none", predictor=predictor)
    for solver in ("sparse", "iterative", "two-scale"):
        yield Method(support_radius=1.0, correction="none", solver=solver)
    yield Method(support_radius=1.0, correction="none", volume_reduction="background-grid")
    yield Method(support_radius=1.0, displacement="absolute", correction_in_time="smooth")
    if dimension > 1:
        yield Method(support_radius=1.0, correction="none", boundary_layer_thickness=0.3)
        for reduction in REDUCTIONS:
            yield Method(support_radius=1.0, correction="none", reduction=reduction)


def _move(points: FloatArray, cells: CellTable, method: Method, *, sliding: bool) -> None:
    """Push the lower side in and turn it a little; a refusal has compiled what it needed."""
    lower, upper = np.flatnonzero(points[:, 0] == 0.0), np.flatnonzero(points[:, 0] == 1.0)
    patches = {"moving": Patch("moving", lower), "fixed": Patch("fixed", upper)}
    if sliding:
        patches["side"] = Patch("slip", np.flatnonzero(points[:, 1] == 0.0))
    model = MotionModel.build(points, cells, patches, method)
    targets = points[model.roles.moving].copy()
    targets[:, 0] += 0.55 + 0.1 * targets[:, -1]
    model.without_distributions().summary(points)
    try:
        model.move(points, targets)
    except NumericalError:
        return
