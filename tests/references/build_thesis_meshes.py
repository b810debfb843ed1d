"""Builds the 2D test meshes of the thesis with Gmsh: Tables 5.1 and 5.6, and the coarsest mesh of Figs 3.7 to 3.11.

Unit square less a block of 0.1 × 0.2 (translations) or a slab of 0.2 × 0.04 (translation and rotation), spacing 0.04:
100 static nodes, 16 moving nodes (5 × 3 and 7 × 1 segments), 754 and 750 nodes; the thesis has 751. The coarse mesh has
the 416 triangles and the smallest edge of 0.04 of thesis Fig. 3.11, around the same block.
Run: python build_thesis_meshes.py
"""

import gmsh
import numpy as np
from gmsh_meshes import arrays, quiet_gmsh, rectangle, save

# (x0, x1, y0, y1), segments along x and y, of a side of the square, and the interior size that comes closest
MESHES = {
    "thesis_block": ((0.45, 0.55, 0.4, 0.6), (3, 5), 25, 0.0422),
    "thesis_slab": ((0.4, 0.6, 0.48, 0.52), (7, 1), 25, 0.0424),
    "thesis_block_coarse": ((0.45, 0.55, 0.4, 0.6), (2, 5), 12, 0.0765),
}
SQUARE = (0.0, 1.0, 0.0, 1.0)


def divided(box: tuple[float, ...], segments: tuple[int, int]) -> int:
    sides = rectangle(box)
    for i, side in enumerate(sides):
        gmsh.model.geo.mesh.setTransfiniteCurve(side, segments[i % 2] + 1)
    return gmsh.model.geo.addCurveLoop(sides)


if __name__ == "__main__":
    for name, (box, segments, outside, size) in MESHES.items():
        with quiet_gmsh(MeshSizeExtendFromBoundary=0, MeshSizeMax=size):
            gmsh.model.geo.addPlaneSurface([divided(SQUARE, (outside, outside)), divided(box, segments)])
            gmsh.model.geo.synchronize()
            gmsh.model.mesh.generate(2)
            points, cells, boundary = arrays(2)
        outer = np.any((points[boundary] < 1e-9) | (points[boundary] > 1 - 1e-9), axis=1)
        patches = {"patch_outer": boundary[outer], "patch_block": boundary[~outer]}
        save(name, points=points, cells_triangle=cells, **patches)
