"""A cylinder of quads between a piston on the left and a wall on the right."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mesh_motion_server.files import MeshFile, write_npz

LENGTH, BORE, COLUMNS, ROWS = 2.0, 1.0, 32, 16


def main() -> None:
    """Write mesh.npz into the folder of this file."""
    x, y = np.meshgrid(np.linspace(0.0, LENGTH, COLUMNS + 1), np.linspace(0.0, BORE, ROWS + 1))
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    corner = (np.arange(ROWS)[:, None] * (COLUMNS + 1) + np.arange(COLUMNS)).ravel()
    quads = np.stack([corner, corner + 1, corner + COLUMNS + 2, corner + COLUMNS + 1], axis=1)
    patches = {
        "piston": np.flatnonzero(points[:, 0] == 0.0),
        "head": np.flatnonzero(points[:, 0] == LENGTH),
        "liner": np.flatnonzero((points[:, 1] == 0.0) | (points[:, 1] == BORE)),
    }
    path = Path(__file__).with_name("mesh.npz")
    write_npz(path, MeshFile(points, {"quad": quads}, patches, path))


if __name__ == "__main__":
    main()
