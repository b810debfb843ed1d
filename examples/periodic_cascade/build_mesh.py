"""One blade of a row, in triangles; its upper and lower sides are each other's images. Needs gmsh."""

from __future__ import annotations

import itertools
import tempfile
from pathlib import Path

import gmsh
import numpy as np

from mesh_motion_server.files import read_mesh, write_npz

PITCH = 0.8
INLET, OUTLET = -0.8, 1.8
THICKNESS, CAMBER, STAGGER = 0.1, 0.12, np.radians(-30.0)  # of a chord of 1, about its middle
SIZE_BLADE, SIZE_FAR = 0.018, 0.06


def main() -> None:
    """Write mesh.npz into the folder of this file."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("Mesh.Algorithm", 6)
    blade = blade_curves()
    lower, upper, inlet, outlet = passage()
    outer = gmsh.model.geo.addCurveLoop([*lower, outlet, *(-curve for curve in reversed(upper)), -inlet])
    fluid = gmsh.model.geo.addPlaneSurface([outer, gmsh.model.geo.addCurveLoop(blade)])
    gmsh.model.geo.synchronize()
    upwards = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, PITCH, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    gmsh.model.mesh.setPeriodic(1, upper, lower, upwards)
    for name, curves in {"blade": blade, "lower": lower, "upper": upper, "inlet": [inlet], "outlet": [outlet]}.items():
        gmsh.model.addPhysicalGroup(1, curves, name=name)
    gmsh.model.addPhysicalGroup(2, [fluid], name="fluid")
    gmsh.model.mesh.generate(2)
    with tempfile.TemporaryDirectory() as folder:
        gmsh.write(f"{folder}/mesh.msh")
        write_npz(Path(__file__).with_name("mesh.npz"), read_mesh(f"{folder}/mesh.msh"))
    gmsh.finalize()


def blade_curves() -> list[int]:
    """A cambered four-digit section with a closed trailing edge: its lower and its upper side."""
    s = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, 21)))
    half = 5 * THICKNESS * (0.2969 * np.sqrt(s) - 0.126 * s - 0.3516 * s**2 + 0.2843 * s**3 - 0.1036 * s**4)
    line = 4.0 * CAMBER * s * (1.0 - s)
    nose, tail = (point(x, 0.0, SIZE_BLADE) for x in (0.0, 1.0))
    sides = []
    for sign in (-1.0, 1.0):
        between = [point(x, y, SIZE_BLADE) for x, y in zip(s[1:-1], (line + sign * half)[1:-1], strict=True)]
        sides.append(gmsh.model.geo.addSpline([nose, *between, tail]))
    return [sides[0], -sides[1]]


def point(x: float, y: float, size: float) -> int:
    """A point of the blade, turned by the stagger about the middle of the chord."""
    c, s = np.cos(STAGGER), np.sin(STAGGER)
    return int(gmsh.model.geo.addPoint(0.5 + c * (x - 0.5) - s * y, s * (x - 0.5) + c * y, 0.0, size))


def passage() -> tuple[list[int], list[int], int, int]:
    """Curves of the lower and the upper side, from the inlet to the outlet; the inlet and the outlet, upwards."""
    bend = 0.5 * np.tan(STAGGER)
    path = [(INLET, -bend), (0.0, -bend), (1.0, bend), (OUTLET, bend)]
    sides, ends = [], []
    for shift in (-0.5 * PITCH, 0.5 * PITCH):
        points = [gmsh.model.geo.addPoint(x, y + shift, 0.0, SIZE_FAR) for x, y in path]
        sides.append([gmsh.model.geo.addLine(a, b) for a, b in itertools.pairwise(points)])
        ends.append((points[0], points[-1]))
    inlet, outlet = (gmsh.model.geo.addLine(ends[0][i], ends[1][i]) for i in (0, 1))
    return sides[0], sides[1], inlet, outlet


if __name__ == "__main__":
    main()
