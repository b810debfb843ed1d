"""What the spare worker does while it waits: a tiny motion in 2D and 3D, which loads the compiled kernels.

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


def warm_up(numerics: str, interrupted: Callable[[], bool]) -> None:
    """Move tiny meshes with the module's ``MotionModel``, if it has one, until done or interrupted."""
    model_class: Any = getattr(importlib.import_module(numerics), "MotionModel", None)
    if model_class is None:
        return
    for points, cells in _meshes():
        if interrupted():
            return
        ends = {
            "moving": Patch("moving", np.flatnonzero(points[:, 0] == 0)),
            "fixed": Patch("fixed", np.flatnonzero(points[:, 0] == 1)),
        }
        try:
            model = model_class.build(points, cells, ends, Method(support_radius=2.0))
            model.summary(points)
            model.move(points, points[model.roles.moving] + 0.01)
        except MeshMotionError:
            return  # only a session's own request has somebody to tell


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
