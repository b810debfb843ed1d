"""Builds ``far_slab.npz`` with Gmsh: a slab of 1 × 0.1 in a square of 12, with cells that grow away from it.

A body far from every wall, as in external flow: what a reduction of the volume nodes is made for.

Run: python build_far_slab.py
"""

import gmsh
import numpy as np
from gmsh_meshes import arrays, quiet_gmsh, rectangle, save, sizes_by

DOMAIN = (-6.0, 6.0, -6.0, 6.0)
SLAB = (-0.5, 0.5, -0.05, 0.05)
#: 0.025 on the slab, growing by 0.07 a unit of distance, to 0.45 at the far wall.
SIZE = "0.025 + 0.07 * Sqrt(Max(0, Abs(x) - 0.5)^2 + Max(0, Abs(y) - 0.05)^2)"


if __name__ == "__main__":
    with quiet_gmsh(MeshSizeExtendFromBoundary=0, MeshSizeFromPoints=0):
        geo = gmsh.model.geo
        geo.addPlaneSurface([geo.addCurveLoop(rectangle(box)) for box in (DOMAIN, SLAB)])
        geo.synchronize()
        sizes_by(SIZE)
        gmsh.model.mesh.generate(2)
        points, cells, boundary = arrays(2)
    outer = np.abs(points[boundary]).max(axis=1) > 1.0
    patches = {"patch_outer": boundary[outer].astype(np.int32), "patch_slab": boundary[~outer].astype(np.int32)}
    save("far_slab", points=points, cells_triangle=cells.astype(np.int32), **patches)
