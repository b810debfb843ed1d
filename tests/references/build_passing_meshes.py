"""Builds the meshes of bodies that pass each other with Gmsh: two blocks, and two ellipses, 0.5 long and 0.16 thick.

``passing_blocks.npz`` and ``passing_ellipses.npz``: the box [−1.5, 1.5] × [−1, 1] less bodies about (−0.4, 0.13) and
(0.4, −0.13), so that a gap of 0.1 is left between them when they are side by side.

Run: python build_passing_meshes.py
"""

import gmsh
import numpy as np
from gmsh_meshes import arrays, quiet_gmsh, save

HALF = (1.5, 1.0)
CENTRES = ((-0.4, 0.13), (0.4, -0.13))
LENGTH, THICKNESS = 0.25, 0.08  # halves
SIZE_FAR, SIZE_NEAR, REACH = 0.15, 0.03, 0.75


def geometry(kind: str) -> None:
    occ = gmsh.model.occ
    box = occ.addRectangle(-HALF[0], -HALF[1], 0, 2 * HALF[0], 2 * HALF[1])
    bodies = [(2, body(kind, x, y)) for x, y in CENTRES]
    occ.cut([(2, box)], bodies)
    occ.synchronize()
    inner = [curve for _, curve in gmsh.model.getEntities(1) if is_inner(curve)]
    field = gmsh.model.mesh.field
    distance, threshold = field.add("Distance"), field.add("Threshold")
    field.setNumbers(distance, "CurvesList", inner)
    field.setNumber(distance, "Sampling", 200)
    for name, value in (
        ("InField", distance), ("SizeMin", SIZE_NEAR), ("SizeMax", SIZE_FAR), ("DistMin", 0), ("DistMax", REACH),
    ):  # fmt: skip
        field.setNumber(threshold, name, value)
    field.setAsBackgroundMesh(threshold)


def body(kind: str, x: float, y: float) -> int:
    occ = gmsh.model.occ
    if kind == "ellipses":
        return occ.addDisk(x, y, 0, LENGTH, THICKNESS)
    return occ.addRectangle(x - LENGTH, y - THICKNESS, 0, 2 * LENGTH, 2 * THICKNESS)


def is_inner(curve: int) -> bool:
    low_x, low_y, _, high_x, high_y, _ = gmsh.model.getBoundingBox(1, curve)
    return max(-low_x, high_x) < HALF[0] - 1e-3 and max(-low_y, high_y) < HALF[1] - 1e-3


if __name__ == "__main__":
    for kind in ("blocks", "ellipses"):
        with quiet_gmsh(MeshSizeExtendFromBoundary=0, MeshSizeFromPoints=0):
            geometry(kind)
            gmsh.model.mesh.generate(2)
            points, cells, boundary = arrays(2)
        outer = boundary[(np.abs(np.abs(points[boundary]) - HALF) < 1e-9).any(axis=1)]
        inner = np.setdiff1d(boundary, outer)
        upper = points[inner, 1] > 0
        bodies = {"patch_upper": inner[upper], "patch_lower": inner[~upper]}
        save(f"passing_{kind}", points=points, cells_triangle=cells, patch_outer=outer, **bodies)
