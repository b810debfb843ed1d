"""What the spare worker does while it waits: tiny motions in 2D and 3D, which load the compiled kernels.

Loading them takes a second or two; so the first BUILD and MOVE of a session do not pay for it.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.errors import MeshMotionError
from mesh_motion_server.numerics.cells import CellTable
from mesh_motion_server.numerics.method import Method
from mesh_motion_server.numerics.roles import Patch

__all__ = ["warm_up"]

#: A square and a cube in simplices.
_CUTS = {
    "triangle": [[0, 1, 3], [0, 3, 2]],
    "tetra": [[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]],
}
_ROWS = 3
#: What small and large meshes are solved by.
_SOLVERS = ("auto", "two-scale")


def warm_up(numerics: str, interrupted: Callable[[], bool]) -> None:
    """Move tiny meshes with the module's ``MotionModel``, if it has one, until done or interrupted."""
    model_class: Any = getattr(importlib.import_module(numerics), "MotionModel", None)
    if model_class is None:
        return
    for points, cells in _meshes():
        for solver in _SOLVERS:
            if interrupted():
                return
            try:
                _move(model_class, points, cells, Method(support_radius=2.0, solver=solver))
            except MeshMotionError:
                return  # only a session's own request has somebody to tell


def _move(model_class: Any, points: NDArray[np.float64], cells: CellTable, method: Method) -> None:
    """Build a model of a mesh, judge it and move one end a little."""
    ends = {
        "moving": Patch("moving", np.flatnonzero(points[:, 0] == 0)),
        "fixed": Patch("fixed", np.flatnonzero(points[:, 0] == 1)),
    }
    model = model_class.build(points, cells, ends, method)
    model.summary(points)
    model.move(points, points[model.roles.moving] + 0.01)


def _meshes() -> Iterator[tuple[NDArray[np.float64], CellTable]]:
    """Unit square and cube of ``_ROWS`` boxes along each axis, cut into simplices."""
    for name, cuts in _CUTS.items():
        dimension = len(cuts[0]) - 1
        corners = np.array(list(product((0, 1), repeat=dimension)))[:, ::-1]
        boxes = np.array(list(product(range(_ROWS), repeat=dimension)))
        places = (boxes[:, None] + corners).reshape(-1, dimension)
        points, numbers = np.unique(places, axis=0, return_inverse=True)
        nodes = numbers.reshape(len(boxes), -1)[:, np.array(cuts)].reshape(-1, len(cuts[0]))
        yield points / _ROWS, CellTable.from_arrays({name: nodes})
