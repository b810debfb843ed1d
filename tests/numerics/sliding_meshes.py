"""Computed meshes with slip walls around a block, in 2D and in 3D: straight and bent ducts, discs and rounded boxes."""

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


def rounded(d: int, *, power: float = 2.0, around: int = 32, across: int = 6, along: int = 2) -> Mesh:
    """A square block (moving) in a disc of radius 0.5 or a cylinder of height 0.5; with more than 2 in a rounded box.

    Its wall has no end and slips, as do the planes z = 0 and z = 0.5. The cells are quads or hexahedra.
    """
    angle = np.arange(around) * 2.0 * np.pi / around
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    square = circle / np.abs(circle).max(axis=1)[:, None]
    outer = circle / np.sum(np.abs(circle) ** power, axis=1)[:, None] ** (1.0 / power)
    part = np.linspace(0.0, 1.0, across + 1)[:, None, None]
    flat = ((1.0 - part) * 0.12 * square + part * 0.5 * outer).reshape(-1, 2)
    number = np.arange(len(flat)).reshape(across + 1, around)
    after = np.roll(number, -1, axis=1)
    quads = np.stack([number[:-1], number[1:], after[1:], after[:-1]], axis=-1).reshape(-1, 4)
    if d == 2:
        patches = {"body": Patch("moving", number[0]), "wall": Patch("slip", number[-1])}
        return flat, CellTable.from_arrays({"quad": quads}), patches
    heights = np.linspace(0.0, 0.5, along + 1)
    points = np.concatenate([np.column_stack([flat, np.full(len(flat), height)]) for height in heights])
    layers = len(flat) * np.arange(along + 1)[:, None]
    hexahedra = np.concatenate([np.hstack([quads + low, quads + low + len(flat)]) for low in layers[:-1, 0]])
    patches = {
        "body": Patch("moving", (layers + number[0]).ravel()),
        "wall": Patch("slip", (layers + number[-1]).ravel()),
        "low": Patch("slip", np.arange(len(flat))),
        "high": Patch("slip", layers[-1, 0] + np.arange(len(flat))),
    }
    return points, CellTable.from_arrays({"hexahedron": hexahedra}), patches
