"""A square of quads for the client; its left side moves between fixed walls."""

import numpy as np
from mesh_motion_client import Mesh, Patch

SIDE = 9


def square(nodes=SIDE):
    x, y = (each.ravel() for each in np.meshgrid(np.linspace(0, 1, nodes), np.linspace(0, 1, nodes), indexing="ij"))
    node = np.arange(nodes * nodes).reshape(nodes, nodes)
    quads = np.stack([node[:-1, :-1], node[1:, :-1], node[1:, 1:], node[:-1, 1:]], axis=-1).reshape(-1, 4)
    left, rest = np.flatnonzero(x == 0), np.flatnonzero((x == 1) | (((y == 0) | (y == 1)) & (x > 0)))
    return Mesh(
        np.stack([x, y], axis=1), {"quad": quads}, {"left": Patch("moving", left), "walls": Patch("fixed", rest)}
    )


def bulge(size):
    y = square().points[:SIDE, 1]
    return np.stack([size * np.sin(np.pi * y), 0.0 * y], axis=1)
