"""A square of quads for the client; its left side moves between fixed walls."""

import numpy as np
from frame_meshes import tensor_grid
from mesh_motion_client import Mesh, Patch

SIDE = 9


def square(nodes=SIDE):
    points, quads = tensor_grid(*[np.linspace(0, 1, nodes)] * 2)
    x, y = points.T
    left, rest = np.flatnonzero(x == 0), np.flatnonzero((x == 1) | (((y == 0) | (y == 1)) & (x > 0)))
    return Mesh(points, {"quad": quads}, {"left": Patch("moving", left), "walls": Patch("fixed", rest)})


def bulge(size):
    y = square().points[:SIDE, 1]
    return np.stack([size * np.sin(np.pi * y), 0.0 * y], axis=1)
