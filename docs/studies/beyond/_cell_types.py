"""Graded meshes of quads, hexahedra, wedges and mixed cells: the unit square or cube without a body, [0.4, 0.6]^d."""

from __future__ import annotations

from functools import cache

import numpy as np
from mesh_motion_numerics.mesh.cells import CellTable
from numpy.typing import NDArray

from docs.studies.beyond._motions import Body

__all__ = ["KINDS", "graded"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: The cells around the body, and those of the rest.
KINDS = {
    "quads": ("quad", "quad"),
    "quads, triangles": ("quad", "triangle"),
    "hexahedra": ("hexahedron", "hexahedron"),
    "wedges": ("wedge", "wedge"),
    "hexahedra, wedges": ("hexahedron", "wedge"),
}
_PARTS = {
    "quad": ((0, 1, 2, 3),),
    "triangle": ((0, 1, 2), (0, 2, 3)),
    "hexahedron": (tuple(range(8)),),
    "wedge": ((0, 1, 2, 4, 5, 6), (0, 2, 3, 4, 6, 7)),
}
_QUAD = ((0, 0), (1, 0), (1, 1), (0, 1))
_CORNERS = {2: _QUAD, 3: tuple((x, y, z) for z in (0, 1) for x, y in _QUAD)}
_GRADING = 1.4  # cells at the outside are about twice as long as those at the body


@cache
def graded(kind: str) -> Body:
    """The mesh of one of :data:`KINDS`: 400 boxes in 2D, 1000 in 3D, before they are cut."""
    near, far = KINDS[kind]
    d = 2 if near == "quad" else 3
    points, boxes = _boxes(_axis(8, 4) if d == 2 else _axis(4, 2), d)
    around = (np.abs(points[boxes].mean(axis=1) - 0.5) < 0.2).all(axis=1)
    cells: dict[str, list[Ints]] = {near: [], far: []}
    for name, chosen in ((near, boxes[around]), (far, boxes[~around])):
        cells[name] += [chosen[:, part] for part in _PARTS[name]]
    table = CellTable.from_arrays({name: np.concatenate(parts) for name, parts in cells.items()})
    outer = ((points < 1e-9) | (points > 1 - 1e-9)).any(axis=1)
    body = ((points > 0.4 - 1e-9) & (points < 0.6 + 1e-9)).all(axis=1)
    return Body.build(points, table, np.flatnonzero(body), np.flatnonzero(outer))


def _axis(second: int, along: int) -> Floats:
    """Grid lines: given numbers of boxes next to the body (finer towards it) and along it."""
    side = 0.4 * (1.0 - np.linspace(1.0, 0.0, second + 1) ** _GRADING)
    return np.concatenate([side[:-1], np.linspace(0.4, 0.6, along + 1), 1.0 - side[-2::-1]])


def _boxes(axis: Floats, d: int) -> tuple[Floats, Ints]:
    """Points and boxes of the grid, without the body's."""
    n = len(axis) - 1
    points = np.stack(np.meshgrid(*[axis] * d, indexing="ij"), axis=-1).reshape(-1, d)
    number = np.arange(len(points)).reshape((n + 1,) * d)
    corners = _CORNERS[d]
    boxes = np.stack([number[tuple(slice(a, a + n) for a in corner)].ravel() for corner in corners], axis=1)
    boxes = boxes[~(np.abs(points[boxes].mean(axis=1) - 0.5) < 0.1).all(axis=1)]
    used, numbers = np.unique(boxes, return_inverse=True)
    return points[used], numbers.reshape(boxes.shape)
