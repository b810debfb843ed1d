"""Builds the meshes of the correction's named cases with Gmsh: a slab, two blocks, and a box in a cube.

- ``correction_slab.npz``: unit square less [0.4, 0.6] × [0.48, 0.52], the mesh M1 of the comparison with other systems;
- ``correction_two_blocks.npz``: unit square less two blocks that will squeeze what is between them;
- ``correction_box.npz``: unit cube less a box of 0.2, tetrahedra.

Run: python build_correction_meshes.py
"""

import gmsh
import numpy as np
from gmsh_meshes import arrays, quiet_gmsh, rectangle, save, sizes_by

SLAB = ((0.4, 0.6, 0.48, 0.52),)
TWO_BLOCKS = ((0.2, 0.35, 0.45, 0.55), (0.65, 0.8, 0.45, 0.55))
OUTER_SIZE, INNER_SIZE = 0.0446, 0.04
BOX = (0.4, 0.2)  # lower corner and edge
BOX_SIZE = "0.07 + 0.02 * Sqrt((x - 0.5)^2 + (y - 0.5)^2 + (z - 0.5)^2)"


def square_less(boxes: tuple[tuple[float, ...], ...]) -> None:
    """Mesh the unit square less some boxes (x0, x1, y0, y1)."""
    sides = [rectangle((0.0, 1.0, 0.0, 1.0), OUTER_SIZE), *(rectangle(box, INNER_SIZE) for box in boxes)]
    gmsh.model.geo.addPlaneSurface([gmsh.model.geo.addCurveLoop(lines) for lines in sides])
    gmsh.model.geo.synchronize()


def cube_less_box() -> None:
    """Mesh the unit cube less the box, sizes growing with the distance from the centre."""
    occ, (low, edge) = gmsh.model.occ, BOX
    occ.cut([(3, occ.addBox(0, 0, 0, 1, 1, 1))], [(3, occ.addBox(low, low, low, edge, edge, edge))])
    occ.synchronize()
    sizes_by(BOX_SIZE)


def named(dimension: int) -> dict[str, np.ndarray]:
    """Generate the mesh; return it with the patches outer and body."""
    gmsh.model.mesh.generate(dimension)
    points, cells, boundary = arrays(dimension)
    outer = boundary[np.any((points[boundary] < 1e-9) | (points[boundary] > 1 - 1e-9), axis=1)]
    name = f"cells_{'triangle' if dimension == 2 else 'tetra'}"
    return {"points": points, name: cells, "patch_outer": outer, "patch_body": np.setdiff1d(boundary, outer)}


if __name__ == "__main__":
    for name, boxes in {"slab": SLAB, "two_blocks": TWO_BLOCKS}.items():
        with quiet_gmsh():
            square_less(boxes)
            save(f"correction_{name}", **named(2))
    with quiet_gmsh(Algorithm3D=10, MeshSizeExtendFromBoundary=0, MeshSizeFromPoints=0):  # HXT
        gmsh.option.setNumber("General.NumThreads", 1)
        cube_less_box()
        save("correction_box", **named(3))
