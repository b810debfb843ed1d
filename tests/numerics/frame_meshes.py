"""Computed meshes: a square frame of triangles or quads around a square block, and its extrusion."""

import numpy as np
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import Patch


def tensor_grid(*axes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points of a tensor grid, the last axis fastest, and its quads or hexahedra."""
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))
    number = np.arange(len(points)).reshape([len(axis) for axis in axes])
    corners = [(0, 0), (1, 0), (1, 1), (0, 1)]
    if len(axes) == 3:
        corners = [(*corner, z) for z in (0, 1) for corner in corners]
    cut = [tuple(slice(a, a + n - 1) for a, n in zip(corner, number.shape, strict=True)) for corner in corners]
    return points, np.stack([number[part].ravel() for part in cut], axis=1)


def ring_grid(radii: np.ndarray, around: int) -> tuple[np.ndarray, np.ndarray]:
    """Points on circles about the origin, circle by circle, and the quads between the circles."""
    angle = 2.0 * np.pi * np.arange(around) / around
    points = np.stack([np.outer(radii, np.cos(angle)), np.outer(radii, np.sin(angle))], axis=-1).reshape(-1, 2)
    number = np.arange(len(points)).reshape(len(radii), around)
    after = np.roll(number, -1, axis=1)
    return points, np.stack([number[:-1], number[1:], after[1:], after[:-1]], axis=-1).reshape(-1, 4)


def without_unused(points: np.ndarray, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The points that cells (m, c) use, and the cells with new node numbers."""
    used, numbers = np.unique(cells, return_inverse=True)
    return points[used], numbers.reshape(cells.shape)


def square_frame(
    n: int = 15, *, kind: str = "triangle", outer: str = "fixed"
) -> tuple[np.ndarray, CellTable, dict[str, Patch]]:
    """Unit square of n × n squares less the middle fifth; patches ``block`` (moving) and ``outer``."""
    points, quads = tensor_grid(*[np.linspace(0.0, 1.0, n + 1)] * 2)
    low = (2 * n) // 5
    points, quads = without_unused(points, quads[np.abs(points[quads].mean(axis=1) - 0.5).max(axis=1) > 0.5 - low / n])
    nodes = quads if kind == "quad" else np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    on_outer = np.any((points == 0.0) | (points == 1.0), axis=1)
    centred = np.abs(points - 0.5).max(axis=1)
    on_block = np.isclose(centred, 0.5 - low / n)
    patches = {"block": Patch("moving", np.flatnonzero(on_block)), "outer": Patch(outer, np.flatnonzero(on_outer))}
    return points, CellTable.from_arrays({kind: nodes}), patches


def cloud(n, d, seed=0):
    """Jittered grid points: random, but at least a third of the spacing apart."""
    rng = np.random.default_rng(seed)
    side = int(np.ceil(n ** (1 / d)))
    places = np.stack(np.meshgrid(*[np.linspace(0, 1, side)] * d, indexing="ij"), axis=-1).reshape(-1, d)
    return places + rng.uniform(-1, 1, places.shape) / (3 * side)


def rotation(degrees: float) -> np.ndarray:
    a = np.deg2rad(degrees)
    return np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
