"""Meshes made of arithmetic: a square frame of triangles or quads around a square block, and its extrusion."""

import numpy as np
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import Patch


def square_frame(
    n: int = 15, *, kind: str = "triangle", outer: str = "fixed"
) -> tuple[np.ndarray, CellTable, dict[str, Patch]]:
    """Unit square of n × n squares less the middle fifth; patches ``block`` (moving) and ``outer``."""
    axis = np.linspace(0.0, 1.0, n + 1)
    x, y = np.meshgrid(axis, axis, indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel()])
    i, j = (a.ravel() for a in np.meshgrid(np.arange(n), np.arange(n), indexing="ij"))
    low, high = (2 * n) // 5, n - (2 * n) // 5
    hole = (i >= low) & (i < high) & (j >= low) & (j < high)
    corner = (i * (n + 1) + j)[~hole]
    quads = np.column_stack([corner, corner + n + 1, corner + n + 2, corner + 1])
    nodes = quads if kind == "quad" else np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    used, numbers = np.unique(nodes, return_inverse=True)
    points = points[used]
    on_outer = np.any((points == 0.0) | (points == 1.0), axis=1)
    centred = np.abs(points - 0.5).max(axis=1)
    on_block = np.isclose(centred, 0.5 - low / n)
    patches = {"block": Patch("moving", np.flatnonzero(on_block)), "outer": Patch(outer, np.flatnonzero(on_outer))}
    return points, CellTable.from_arrays({kind: numbers.reshape(nodes.shape)}), patches


def cloud(n, d, seed=0):
    """Jittered grid points: random, but nowhere closer than a third of the spacing."""
    rng = np.random.default_rng(seed)
    side = int(np.ceil(n ** (1 / d)))
    grid = np.stack(np.meshgrid(*[np.linspace(0, 1, side)] * d, indexing="ij"), axis=-1).reshape(-1, d)
    return grid + rng.uniform(-1, 1, grid.shape) / (3 * side)


def rotation(degrees: float) -> np.ndarray:
    a = np.deg2rad(degrees)
    return np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
