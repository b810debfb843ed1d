"""The flag's motion: two periods of the S-shaped bending that FSI2 of Turek and Hron shows, tip ± 80 mm.

The flag bends as a beam that keeps its length and its thickness: the slope of the centre line is a sum of the first two
modes of a clamped beam, the line is the integral of the slope, and the cross-sections stay normal to it. The second
mode alone cannot lift the tip of such a beam above 68 mm; with this much of the first, the tip goes back by 27 mm when
it is up by 80 mm, as FSI2's does (-14.58 ± 12.44 mm).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.files import read_mesh

HERE = Path(__file__).parent
ROOT, LENGTH, CENTRE_LINE = 0.25, 0.35, 0.2
TIP, PERIODS, STEPS_PER_PERIOD = 0.08, 2, 32
#: Roots β of cos β cosh β = -1, the constants σ of their modes, and the share of each mode at the tip.
MODES = ((1.875104069, 0.7340955138, 0.585), (4.694091133, 1.018467319, 0.415))

FloatArray = NDArray[np.float64]


def main() -> None:
    """Write motion.npz into the folder of this file."""
    mesh = read_mesh(HERE / "mesh.npz")
    nodes = mesh.patches["flag"]
    amplitude = find_amplitude()
    steps = np.arange(1, PERIODS * STEPS_PER_PERIOD + 1)
    angles = amplitude * np.sin(2 * np.pi * steps / STEPS_PER_PERIOD)
    displacement = np.stack([bend(mesh.points[nodes], angle) for angle in angles])
    np.savez_compressed(HERE / "motion.npz", node_ids=nodes, displacement=displacement)


def find_amplitude() -> float:
    """The amplitude for which the tip rises by TIP, by bisection."""
    tip = np.array([[ROOT + LENGTH, CENTRE_LINE]])
    low, high = 0.0, 0.4
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if bend(tip, middle)[0, 1] < TIP else (low, middle)
    return low


def bend(points: FloatArray, amplitude: float) -> FloatArray:
    """(n, 2) displacement of points (n, 2) of the undeformed flag."""
    arc = np.linspace(0.0, LENGTH, 2001)
    slope = amplitude * mode_slope(arc / LENGTH)
    line_x, line_y = (integral(f(slope), arc) for f in (np.cos, np.sin))
    along = np.clip(points[:, 0] - ROOT, 0.0, None)
    across = points[:, 1] - CENTRE_LINE
    angle = np.interp(along, arc, slope)
    x = ROOT + np.interp(along, arc, line_x) - across * np.sin(angle)
    y = CENTRE_LINE + np.interp(along, arc, line_y) + across * np.cos(angle)
    moved = np.stack([x, y], axis=1) - points
    moved[points[:, 0] <= ROOT] = 0.0
    return moved


def mode_slope(z: FloatArray) -> FloatArray:
    """Slope of the centre line at z = s / L, up to a factor: each mode is 1 at the tip, times its share."""
    total = np.zeros_like(z)
    for beta, sigma, share in MODES:
        b = beta * z
        tip = np.cosh(beta) - np.cos(beta) - sigma * (np.sinh(beta) - np.sin(beta))
        total += share * beta * (np.sinh(b) + np.sin(b) - sigma * (np.cosh(b) - np.cos(b))) / tip
    return total


def integral(values: FloatArray, at: FloatArray) -> FloatArray:
    """Trapezoidal integral from the first point to each point."""
    return np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(at))])


if __name__ == "__main__":
    main()
