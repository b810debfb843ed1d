"""A box of hexahedra around a smaller box: a structured grid, graded towards the inner box, without its middle."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.files import MeshFile, write_npz

INNER, ROWS_OUTSIDE, ROWS_INSIDE = (0.4, 0.6), 5, 3


def main() -> None:
    """Write mesh.npz into the folder of this file."""
    low, high = INNER
    spacing = np.linspace(0.0, 1.0, ROWS_OUTSIDE + 1)
    outside = low * (1.0 - (1.0 - spacing) ** 1.35)  # finer towards the inner box
    inside = np.linspace(low, high, ROWS_INSIDE + 1)
    line = np.concatenate([outside, inside[1:-1], 1.0 - outside[::-1]])
    path = Path(__file__).with_name("mesh.npz")
    points, cells = grid_less_middle(line, range(ROWS_OUTSIDE, ROWS_OUTSIDE + ROWS_INSIDE))
    at_outer = (np.abs(points - 0.5) > 0.5 - 1e-9).any(axis=1)
    at_inner = (np.abs(points - 0.5) < 0.5 * (high - low) + 1e-9).all(axis=1)
    patches = {"box": np.flatnonzero(at_inner), "outer": np.flatnonzero(at_outer)}
    write_npz(path, MeshFile(points, {"hexahedron": cells}, patches, path))


def grid_less_middle(line: NDArray[np.float64], middle: range) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Points (n, 3) and hexahedra (m, 8) of the grid line × line × line without the cells middle × middle × middle."""
    n = len(line)
    points = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).reshape(-1, 3)
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    kept = [cell for cell in product(range(n - 1), repeat=3) if not all(i in middle for i in cell)]
    cells = np.array([[((i + a) * n + j + b) * n + k + c for a, b, c in corners] for i, j, k in kept])
    used, numbered = np.unique(cells, return_inverse=True)
    return points[used], numbered.reshape(cells.shape)


if __name__ == "__main__":
    main()
