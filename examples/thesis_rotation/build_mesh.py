"""The unit square without a slab, in triangles: de Boer's and the thesis' two-dimensional test. Needs gmsh."""

from __future__ import annotations

import tempfile
from pathlib import Path

import gmsh

from mesh_motion_server.files import read_mesh, write_npz

SIZE, SIZE_AT_THE_SLAB = 0.0446, 0.04


def main() -> None:
    """Write mesh.npz into the folder of this file."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("Mesh.Algorithm", 6)  # frontal Delaunay
    outer = rectangle(0.0, 1.0, 0.0, 1.0, SIZE)
    slab = rectangle(0.4, 0.6, 0.48, 0.52, SIZE_AT_THE_SLAB)
    loops = [gmsh.model.geo.addCurveLoop(curves) for curves in (outer, slab)]
    surface = gmsh.model.geo.addPlaneSurface(loops)
    gmsh.model.geo.synchronize()
    gmsh.model.addPhysicalGroup(1, outer, name="outer")
    gmsh.model.addPhysicalGroup(1, slab, name="block")
    gmsh.model.addPhysicalGroup(2, [surface], name="fluid")
    gmsh.model.mesh.generate(2)
    with tempfile.TemporaryDirectory() as folder:
        gmsh.write(f"{folder}/mesh.msh")
        write_npz(Path(__file__).with_name("mesh.npz"), read_mesh(f"{folder}/mesh.msh"))
    gmsh.finalize()


def rectangle(x0: float, x1: float, y0: float, y1: float, size: float) -> list[int]:
    """The curves around [x0, x1] × [y0, y1]."""
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    points = [gmsh.model.geo.addPoint(x, y, 0.0, size) for x, y in corners]
    return [gmsh.model.geo.addLine(points[i], points[(i + 1) % 4]) for i in range(4)]


if __name__ == "__main__":
    main()
