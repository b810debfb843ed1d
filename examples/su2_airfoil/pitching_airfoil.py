"""SU2: an airfoil pitches; for each angle the server moves the mesh, and a .su2 file is written for SU2_CFD.

Only the coordinates in the file change: markers, elements and numbering stay, so that SU2 restarts from the solution of
the previous angle (RESTART_SOL= YES). python pitching_airfoil.py --out meshes [--mesh naca0012.su2] [--config case.cfg]
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
from mesh_motion_client import Mesh, Patch, connect

from mesh_motion_server.files import read_mesh

AROUND, OUTWARD, RADIUS = 96, 24, 12.0  # of the mesh that is made where none is given
PIVOT = np.array([0.25, 0.0])


def naca0012(path: Path) -> None:
    """Write an O-mesh of quadrilaterals about a NACA 0012 of chord 1, closed at its trailing edge."""
    angle = 2.0 * np.pi * np.arange(AROUND) / AROUND
    x = 0.5 * (1.0 + np.cos(angle))
    shape = 0.2969 * np.sqrt(x) - 0.126 * x - 0.3516 * x**2 + 0.2843 * x**3 - 0.1036 * x**4
    foil = np.stack([x, 0.6 * shape * np.sign(np.sin(angle)) * (np.abs(np.sin(angle)) > 1e-12)], axis=1)
    circle = np.array([0.5, 0.0]) + RADIUS * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    share = (np.expm1(4.0 * np.arange(OUTWARD + 1) / OUTWARD) / np.expm1(4.0))[:, None, None]
    points = ((1.0 - share) * foil + share * circle).reshape(-1, 2)
    at, after = np.arange(AROUND), (np.arange(AROUND) + 1) % AROUND
    rings = [(ring * AROUND, (ring + 1) * AROUND) for ring in range(OUTWARD)]
    quads = np.concatenate([np.stack([a + at, b + at, b + after, a + after], axis=1) for a, b in rings])
    last = OUTWARD * AROUND
    lines = ["NDIME= 2", f"NELEM= {len(quads)}", *(f"9 {' '.join(map(str, quad))}" for quad in quads)]
    lines += [f"NPOIN= {len(points)}", *(f"{px!r} {py!r}" for px, py in points.tolist()), "NMARK= 2"]
    for name, first in (("airfoil", 0), ("farfield", last)):
        lines += [f"MARKER_TAG= {name}", f"MARKER_ELEMS= {AROUND}"]
        lines += [f"3 {first + a} {first + b}" for a, b in zip(at, after, strict=True)]
    path.write_text("\n".join(lines) + "\n")


def with_points(text: str, points: np.ndarray) -> str:
    """The same .su2 file with other coordinates (n, d); SU2's index after the coordinates of a row is kept."""
    head, count, rest = re.split(r"(NPOIN=[^\n]*\n)", text)
    lines = rest.split("\n")
    dimension = points.shape[1]
    for row, values in enumerate(points.tolist()):
        lines[row] = " ".join([*map(repr, values), *lines[row].split()[dimension:]])
    return head + count + "\n".join(lines)


def pitched(points: np.ndarray, degrees: float) -> np.ndarray:
    """(p, 2) displacement of points that turn nose up about the pivot."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return (points - PIVOT) @ (np.array([[c, s], [-s, c]]) - np.eye(2)).T


def main() -> int:
    """Write one file for each angle; run SU2_CFD on each if a configuration is given."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--server", help="endpoint; default: a private server")
    parser.add_argument("--mesh", type=Path, help="default: an O-mesh about a NACA 0012")
    parser.add_argument("--marker", default="airfoil", help="the marker that moves; all others are fixed")
    parser.add_argument(
        "--config", type=Path, help="configuration of SU2 with MESH_FILENAME= mesh.su2; SU2_CFD is run with it"
    )
    parser.add_argument("--angles", type=float, nargs="+", default=[5.0, 10.0, 15.0], metavar="DEGREES")
    parser.add_argument("--out", type=Path, default=Path("out/su2_airfoil"))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    source = options.mesh or options.out / "naca0012.su2"
    if options.mesh is None:
        naca0012(source)
    file, text = read_mesh(source), source.read_text()
    patches = {name: Patch("moving" if name == options.marker else "fixed", n) for name, n in file.patches.items()}
    whole = Mesh(file.points, file.cells, patches)
    with connect(options.server) as server, server.open(whole, {"displacement": "absolute"}) as session:
        foil = whole.points[session.moving_nodes]
        for angle in options.angles:
            moved = session.move(pitched(foil, angle))
            quality = session.commit().quality["size_skew"]["min"]
            mesh = options.out / f"pitched_{angle:g}.su2"
            mesh.write_text(with_points(text, whole.points + moved.displacement))
            sys.stdout.write(f"{mesh}  min size-skew {quality:.3f}\n")
            if options.config is not None:
                (options.out / "mesh.su2").write_bytes(mesh.read_bytes())
                subprocess.run(["SU2_CFD", str(options.config.resolve())], cwd=options.out, check=True)
        session.close("discard")
    return 0


if __name__ == "__main__":
    sys.exit(main())
