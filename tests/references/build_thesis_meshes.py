"""Builds the 2D test meshes of the thesis with Gmsh: Tables 5.1 and 5.6, and the coarsest mesh of Figs 3.7 to 3.11.

Unit square less a block of 0.1 × 0.2 (translations) or a slab of 0.2 × 0.04 (translation and rotation), spacing 0.04:
100 static nodes, 16 moving nodes (5 × 3 and 7 × 1 segments), 754 and 750 nodes; the thesis has 751. The coarse mesh has
the 416 triangles and the smallest edge of 0.04 of thesis Fig. 3.11, around the same block.
Run: python build_thesis_meshes.py
"""

from pathlib import Path

import gmsh
import numpy as np

# (x0, x1, y0, y1), segments along x and y, of a side of the square, and the interior size that comes closest
MESHES = {
    "thesis_block": ((0.45, 0.55, 0.4, 0.6), (3, 5), 25, 0.0422),
    "thesis_slab": ((0.4, 0.6, 0.48, 0.52), (7, 1), 25, 0.0424),
    "thesis_block_coarse": ((0.45, 0.55, 0.4, 0.6), (2, 5), 12, 0.0765),
}
SQUARE = (0.0, 1.0, 0.0, 1.0)


def rectangle(box: tuple[float, ...], segments: tuple[int, int]) -> list[int]:
    """Tags of the four sides, divided evenly."""
    x0, x1, y0, y1 = box
    corners = [gmsh.model.geo.addPoint(x, y, 0) for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))]
    sides = [gmsh.model.geo.addLine(corners[i], corners[(i + 1) % 4]) for i in range(4)]
    for i, side in enumerate(sides):
        gmsh.model.geo.mesh.setTransfiniteCurve(side, segments[i % 2] + 1)
    return sides


def build(box: tuple[float, ...], segments: tuple[int, int], outside: int, size: float) -> dict[str, np.ndarray]:
    """The arrays of a mesh file."""
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("Mesh.Algorithm", 6)  # frontal Delaunay
    gmsh.option.setNumber("Mesh.MeshSizeExtendFromBoundary", 0)
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    outer, inner = rectangle(SQUARE, (outside, outside)), rectangle(box, segments)
    geo = gmsh.model.geo
    geo.addPlaneSurface([geo.addCurveLoop(outer), geo.addCurveLoop(inner)])
    geo.synchronize()
    gmsh.model.mesh.generate(2)
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    number = np.full(int(tags.max()) + 1, -1)
    number[tags.astype(int)] = np.arange(len(tags))
    triangles = number[gmsh.model.mesh.getElementsByType(2)[1].astype(int)].reshape(-1, 3)

    def nodes(sides: list[int]) -> np.ndarray:
        return np.unique(
            np.concatenate([number[gmsh.model.mesh.getElementsByType(1, s)[1].astype(int)] for s in sides])
        )

    mesh = {
        "points": coordinates.reshape(-1, 3)[:, :2].copy(),
        "cells_triangle": triangles,
        "patch_outer": nodes(outer),
        "patch_block": nodes(inner),
    }
    gmsh.finalize()
    return mesh


if __name__ == "__main__":
    for name, choices in MESHES.items():
        np.savez_compressed(Path(__file__).with_name(f"{name}.npz"), **build(*choices))
