"""Computed meshes with slip walls: a straight and a bent duct with a block in it, in 2D and in 3D."""

import numpy as np
from box_meshes import box_mesh
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import Patch

Mesh = tuple[np.ndarray, CellTable, dict[str, Patch]]


def duct(kind: str, n: int = 10, *, bend: float = 0.0) -> Mesh:
    """The unit square or cube around a block (moving): its ends in x are fixed, its other sides slip.

    With a bend the duct's axis is an arc of that angle, and y = 0, y = 1 are curved; z = 0, z = 1 stay planar.
    """
    mesh = box_mesh(kind, n)
    points, d = mesh.points.copy(), mesh.points.shape[1]
    sides = {f"{'xyz'[axis]}{end}": mesh.points[:, axis] == end for axis in range(d) for end in (0, 1)}
    if bend:
        angle, radius = bend * (points[:, 0] - 0.5), 1.0 / bend + points[:, 1] - 0.5
        points[:, 0], points[:, 1] = radius * np.sin(angle), radius * np.cos(angle) - 1.0 / bend
    patches = {"body": Patch("moving", mesh.body)}
    for name, on_side in sides.items():
        patches[name] = Patch("fixed" if name.startswith("x") else "slip", np.flatnonzero(on_side))
    return points, mesh.cells, patches
