"""The wing's motion: it bends with the tip up by two fifths of the span, and its end twists by 30 degrees."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.files import read_mesh

HERE = Path(__file__).parent
SPAN, SWEEP, ROOT_CHORD, TIP_CHORD = 0.762, 0.809396, 0.557784, 0.368199
TIP_RISE, TWIST, STEPS = 0.3, np.deg2rad(-30.0), 10


def main() -> None:
    """Write motion.npz into the folder of this file."""
    mesh = read_mesh(HERE / "mesh.npz")
    nodes = mesh.patches["wing"]
    displacement = np.stack([deform(mesh.points[nodes], step / STEPS) for step in range(1, STEPS + 1)])
    np.savez_compressed(HERE / "motion.npz", node_ids=nodes, displacement=displacement)


def deform(points: NDArray[np.float64], fraction: float) -> NDArray[np.float64]:
    """(n, 3) displacement at a fraction of the motion: sections turn about the elastic axis at 40 % of the chord."""
    t = points[:, 2] / SPAN
    axis = t * SWEEP + 0.4 * (ROOT_CHORD + t * (TIP_CHORD - ROOT_CHORD))
    angle = fraction * TWIST * t**2
    x, y = points[:, 0] - axis, points[:, 1]
    moved = np.zeros_like(points)
    moved[:, 0] = x * np.cos(angle) - y * np.sin(angle) - x
    moved[:, 1] = x * np.sin(angle) + y * np.cos(angle) - y + fraction * TIP_RISE * t**2 * (3.0 - t) / 2.0
    return moved


if __name__ == "__main__":
    main()
