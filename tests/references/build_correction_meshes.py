"""Builds the meshes of the correction's named cases with Gmsh: a slab, two blocks, and a box in a cube.

- ``correction_slab.npz``: unit square less [0.4, 0.6] × [0.48, 0.52], the mesh M1 of the comparison with other systems;
- ``correction_two_blocks.npz``: unit square less two blocks that will squeeze what is between them;
- ``correction_box.npz``: unit cube less a box of 0.2, tetrahedra.

Run: python build_correction_meshes.py
"""

from pathlib import Path

import gmsh
import numpy as np

SLAB = ((0.4, 0.6, 0.48, 0.52),)
TWO_BLOCKS = ((0.2, 0.35, 0.45, 0.55), (0.65, 0.8, 0.45, 0.55))
OUTER_SIZE, INNER_SIZE = 0.0446, 0.04
BOX = (0.4, 0.2)  # lower corner and edge
BOX_SIZE = "0.07 + 0.02 * Sqrt((x - 0.5)^2 + (y - 0.5)^2 + (z - 0.5)^2)"


def square_less(boxes: tuple[tuple[float, ...], ...]) -> None:
    """Mesh the unit square less some boxes (x0, x1, y0, y1)."""
    gmsh.option.setNumber("Mesh.Algorithm", 6)  # frontal Delaunay
    loops = [rectangle((0.0, 1.0, 0.0, 1.0), OUTER_SIZE)] + [rectangle(box, INNER_SIZE) for box in boxes]
    gmsh.model.geo.addPlaneSurface(loops)
    gmsh.model.geo.synchronize()
    gmsh.model.mesh.generate(2)


def rectangle(box: tuple[float, ...], size: float) -> int:
    """Curve loop around (x0, x1, y0, y1)."""
    x0, x1, y0, y1 = box
    geo = gmsh.model.geo
    corners = [geo.addPoint(x, y, 0, size) for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))]
    return geo.addCurveLoop([geo.addLine(corners[i], corners[(i + 1) % 4]) for i in range(4)])


def cube_less_box() -> None:
    """Mesh the unit cube less the box, sizes growing with the distance from the centre."""
    gmsh.option.setNumber("Mesh.Algorithm3D", 10)  # HXT
    gmsh.option.setNumber("General.NumThreads", 1)
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
    gmsh.option.setNumber("Mesh.MeshSizeFromPoints", 0)
    occ, (low, edge) = gmsh.model.occ, BOX
    occ.cut([(3, occ.addBox(0, 0, 0, 1, 1, 1))], [(3, occ.addBox(low, low, low, edge, edge, edge))])
    occ.synchronize()
    field = gmsh.model.mesh.field.add("MathEval")
    gmsh.model.mesh.field.setString(field, "F", BOX_SIZE)
    gmsh.model.mesh.field.setAsBackgroundMesh(field)
    gmsh.model.mesh.generate(3)


def arrays(dimension: int) -> dict[str, np.ndarray]:
    """The mesh as arrays: points, cells of positive size, and the nodes of the outer and the inner boundary."""
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    nodes = gmsh.model.mesh.getElementsByType({2: 2, 3: 4}[dimension])[1].reshape(-1, dimension + 1)
    used, cells = np.unique(nodes, return_inverse=True)
    row = {int(tag): i for i, tag in enumerate(tags)}
    points = coordinates.reshape(-1, 3)[[row[int(tag)] for tag in used], :dimension]
    cells = cells.reshape(nodes.shape)
    flipped = np.linalg.det(points[cells[:, 1:]] - points[cells[:, :1]]) < 0
    cells[flipped] = cells[flipped][:, [1, 0, *range(2, dimension + 1)]]
    facets = np.sort(np.concatenate([np.delete(cells, i, axis=1) for i in range(dimension + 1)]), axis=1)
    unique, count = np.unique(facets, axis=0, return_counts=True)
    boundary = np.unique(unique[count == 1])
    outer = boundary[np.any((points[boundary] < 1e-9) | (points[boundary] > 1 - 1e-9), axis=1)]
    return {
        "points": points,
        f"cells_{'triangle' if dimension == 2 else 'tetra'}": cells,
        "patch_outer": outer,
        "patch_body": np.setdiff1d(boundary, outer),
    }


def build(name: str) -> dict[str, np.ndarray]:
    """Arrays of one mesh."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    if name == "box":
        cube_less_box()
    else:
        square_less(SLAB if name == "slab" else TWO_BLOCKS)
    mesh = arrays(3 if name == "box" else 2)
    gmsh.finalize()
    return mesh


if __name__ == "__main__":
    for name in ("slab", "two_blocks", "box"):
        np.savez_compressed(Path(__file__).parent / f"correction_{name}.npz", **build(name))
