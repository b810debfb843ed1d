"""Computed periodic meshes: a block in a cell of a row of cells, straight or around an axis."""

import numpy as np
from box_meshes import box_mesh
from frame_meshes import tensor_grid, without_unused
from mesh_motion_numerics.mesh.boundary_facets import boundary_nodes
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


def joined_sector(kind: str, n: int, *, angle: float, cone: float = 0.0) -> Mesh:
    """A sector around z whose blade (moving) grows from the hub; hub and tip are slip. In space z is 0 … 0.4.

    The radii are 0.5 … 1 at z = 0, and grow with z by ``cone``.
    """
    d = 2 if kind == "quad" else 3
    points, cells = tensor_grid(*[np.linspace(0.0, 1.0, n + 1)] * d)
    middle = np.abs(points[cells].mean(axis=1) - [0.0, *[0.5] * (d - 1)])  # radius, angle, z
    points, cells = without_unused(points, cells[(middle > [0.6, *[0.2] * (d - 1)]).any(axis=1)])
    table = CellTable.from_arrays({kind: cells})
    rim = boundary_nodes(table)
    sides = {f"{'xyz'[axis]}{end}": np.flatnonzero(points[:, axis] == end) for axis in range(d) for end in (0, 1)}
    blade = np.flatnonzero(
        (np.abs(points - [0.0, *[0.5] * (d - 1)]) <= np.array([0.6, *[0.2] * (d - 1)]) + 1e-9).all(axis=1)
    )
    patches = {name: Patch("periodic" if name[0] == "y" else "slip", nodes) for name, nodes in sides.items()}
    patches["blade"] = Patch("moving", np.intersect1d(blade, rim))
    around, radius = points[:, 1] * angle, 0.5 + 0.5 * points[:, 0]
    placed = 0.4 * points
    radius = radius * (1.0 + cone * placed[:, -1]) if d == 3 else radius
    placed[:, 0], placed[:, 1] = radius * np.cos(around), radius * np.sin(around)
    return placed, table, patches


def turn(sectors: int, d: int, times: int = 1) -> np.ndarray:
    """(d, d) rotation by a sector about the z axis."""
    a = 2.0 * np.pi * times / sectors
    out = np.eye(d)
    out[:2, :2] = [[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]
    return out
