"""Grids with layers of thin cells on a moving wall, whole and cut across the layer, and the motion of the wall."""

import numpy as np
from mesh_motion_client import Mesh, Patch
from mesh_motion_numerics.mesh.cells import CellTable
from own_ranks import as_client

from docs.studies.aerofoil_grids import o_grid, wing


def grid(kind):
    """An aerofoil with first cells of 1e-4 chords (``even``: 0.02) in quads or triangles, or a wing; narrow domains."""
    if kind == "wing":
        found = wing(o_grid("blunt", around=24, layers=12, first=1e-3, far=8.0), stations=6)
    elif kind == "even":
        found = o_grid("blunt", around=64, layers=16, first=0.02, far=8.0)
    else:
        found = o_grid("blunt", around=32, layers=16, first=1e-4, far=8.0)
    cells = found.cells
    if kind == "triangles":
        quads = cells["quad"]
        cells = {"triangle": np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])}
    return as_client(found.points, CellTable.from_arrays(cells), found.patches)


def pitched(points, degrees):
    """Displacements of points (k, d) that rotate in 2D, and rise."""
    a, shift = np.radians(degrees), np.zeros_like(points)
    shift[:, 0] = (np.cos(a) - 1.0) * points[:, 0] - np.sin(a) * points[:, 1]
    shift[:, 1] = np.sin(a) * points[:, 0] + (np.cos(a) - 1.0) * points[:, 1] + 0.01 * degrees
    return shift


def beyond_the_wall(whole):
    """The mesh in two pieces; the outer one has a part of the layer, but no node of the wall."""
    (name, cells), reached = next(iter(whole.cells.items())), np.zeros(len(whole.points), dtype=bool)
    (wall,) = (patch.nodes for patch in whole.patches.values() if patch.role == "moving")
    reached[wall] = True
    for _ in range(2):
        inner = reached[cells].any(axis=1)
        reached[cells[inner]] = True
    pieces = []
    for own in (inner, ~inner):
        nodes, rows = np.unique(cells[own], return_inverse=True)
        found = {key: np.flatnonzero(np.isin(nodes, patch.nodes)) for key, patch in whole.patches.items()}
        patches = {key: Patch(whole.patches[key].role, on) for key, on in found.items() if len(on)}
        pieces.append(Mesh(whole.points[nodes], {name: rows.reshape(-1, cells.shape[1])}, patches, nodes))
    return pieces
