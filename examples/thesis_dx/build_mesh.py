"""The unit square without a block of 0.1 × 0.2, in triangles: the mesh of thesis Tables 5.1 to 5.5. Needs gmsh."""

from __future__ import annotations

import tempfile
from pathlib import Path

import gmsh

from mesh_motion_server.files import read_mesh, write_npz

#: Interior size that comes closest to the thesis' 751 nodes with its 100 static and 16 moving ones.
SIZE = 0.0422


def main() -> None:
    """Write mesh.npz into the folder of this file."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("Mesh.Algorithm", 6)  # frontal Delaunay
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
    gmsh.option.setNumber("Mesh.MeshSizeMax", SIZE)
    outer = rectangle((0.0, 1.0, 0.0, 1.0), (25, 25))
    block = rectangle((0.45, 0.55, 0.4, 0.6), (3, 5))
    loops = [gmsh.model.geo.addCurveLoop(curves) for curves in (outer, block)]
    surface = gmsh.model.geo.addPlaneSurface(loops)
    gmsh.model.geo.synchronize()
    gmsh.model.addPhysicalGroup(1, outer, name="outer")
    gmsh.model.addPhysicalGroup(1, block, name="block")
    gmsh.model.addPhysicalGroup(2, [surface], name="fluid")
    gmsh.model.mesh.generate(2)
    with tempfile.TemporaryDirectory() as folder:
        gmsh.write(f"{folder}/mesh.msh")
        write_npz(Path(__file__).with_name("mesh.npz"), read_mesh(f"{folder}/mesh.msh"))
    gmsh.finalize()


def rectangle(box: tuple[float, float, float, float], segments: tuple[int, int]) -> list[int]:
    """The curves around (x0, x1, y0, y1), divided evenly into segments along x and y."""
    x0, x1, y0, y1 = box
    points = [gmsh.model.geo.addPoint(x, y, 0.0) for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))]
    curves = [gmsh.model.geo.addLine(points[i], points[(i + 1) % 4]) for i in range(4)]
    for number, curve in enumerate(curves):
        gmsh.model.geo.mesh.setTransfiniteCurve(curve, segments[number % 2] + 1)
    return curves


if __name__ == "__main__":
    main()
