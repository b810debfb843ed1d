"""Builds ``far_slab.npz`` with Gmsh: a slab of 1 × 0.1 in a square of 12, with cells that grow away from it.

A body far from every wall, as in external flow: what a reduction of the volume nodes is made for.

Run: python build_far_slab.py
"""

from pathlib import Path

import gmsh
import numpy as np

DOMAIN = (-6.0, 6.0, -6.0, 6.0)
SLAB = (-0.5, 0.5, -0.05, 0.05)
#: 0.025 on the slab, growing by 0.07 a unit of distance, to 0.45 at the far wall.
SIZE = "0.025 + 0.07 * Sqrt(Max(0, Abs(x) - 0.5)^2 + Max(0, Abs(y) - 0.05)^2)"


def rectangle(box: tuple[float, ...]) -> int:
    """Curve loop around (x0, x1, y0, y1)."""
    x0, x1, y0, y1 = box
    geo = gmsh.model.geo
    corners = [geo.addPoint(x, y, 0) for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))]
    return geo.addCurveLoop([geo.addLine(corners[i], corners[(i + 1) % 4]) for i in range(4)])


def build() -> dict[str, np.ndarray]:
    """Points, triangles of positive size, and the nodes of the outer wall and of the slab."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("Mesh.Algorithm", 6)  # frontal Delaunay
    for option in ("ExtendFromBoundary", "FromPoints"):
        gmsh.option.setNumber(f"Mesh.MeshSize{option}", 0)
    gmsh.model.geo.addPlaneSurface([rectangle(DOMAIN), rectangle(SLAB)])
    gmsh.model.geo.synchronize()
    field = gmsh.model.mesh.field.add("MathEval")
    gmsh.model.mesh.field.setString(field, "F", SIZE)
    gmsh.model.mesh.field.setAsBackgroundMesh(field)
    gmsh.model.mesh.generate(2)
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    nodes = gmsh.model.mesh.getElementsByType(2)[1].reshape(-1, 3)
    gmsh.finalize()
    order = np.argsort(tags)
    points = coordinates.reshape(-1, 3)[order][:, :2]
    cells = np.searchsorted(tags[order], nodes)
    flipped = np.linalg.det(points[cells[:, 1:]] - points[cells[:, :1]]) < 0
    cells[flipped] = cells[flipped][:, [1, 0, 2]]
    outer = np.flatnonzero((np.abs(points) > 6.0 - 1e-9).any(axis=1))
    slab = np.flatnonzero((np.abs(points) < np.array([0.5, 0.05]) + 1e-9).all(axis=1))
    return {
        "points": points,
        "cells_triangle": cells.astype(np.int32),
        "patch_outer": outer.astype(np.int32),
        "patch_slab": slab.astype(np.int32),
    }


if __name__ == "__main__":
    np.savez_compressed(Path(__file__).parent / "far_slab.npz", **build())
