"""Computed periodic meshes: a block in a cell of a row of cells, straight or around an axis."""

import numpy as np
from box_meshes import box_mesh
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import Patch

Mesh = tuple[np.ndarray, CellTable, dict[str, Patch]]


def periodic_box(kind: str, n: int = 10, *, axes: str = "y", shear: float = 0.0, ends: str = "fixed") -> Mesh:
    """The unit square or cube around a block (moving), periodic along the axes, its other sides with the role ``ends``.

    With a shear, y grows by this amount along x: the periodic sides are oblique.
    """
    mesh = box_mesh(kind, n)
    patches = {"body": Patch("moving", mesh.body)}
    for axis in range(mesh.points.shape[1]):
        for end in (0, 1):
            nodes = np.flatnonzero(mesh.points[:, axis] == end)
            patches[f"{'xyz'[axis]}{end}"] = Patch("periodic" if "xyz"[axis] in axes else ends, nodes)
    points = mesh.points.copy()
    points[:, 1] += shear * points[:, 0]
    return points, mesh.cells, patches


def sector(kind: str, n: int = 10, *, sectors: float = 6, ends: str = "fixed") -> Mesh:
    """The box bent around the z axis: x is the radius less 1, y the angle; its sides in y are periodic."""
    points, cells, patches = periodic_box(kind, n, ends=ends)
    angle, radius = points[:, 1] * 2.0 * np.pi / sectors, 1.0 + points[:, 0]
    turned = points.copy()
    turned[:, 0], turned[:, 1] = radius * np.sin(angle), radius * np.cos(angle)
    turned[:, 0] *= -1.0  # anticlockwise with y: cells keep their orientation
    return turned, cells, patches


def turn(sectors: int, d: int, times: int = 1) -> np.ndarray:
    """(d, d) rotation by a sector about the z axis."""
    a = 2.0 * np.pi * times / sectors
    out = np.eye(d)
    out[:2, :2] = [[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]
    return out
