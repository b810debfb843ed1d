"""Bodies in a far field, as (points, cells, patches)."""

import numpy as np
from box_meshes import box_mesh
from mesh_motion_numerics.mesh.cells import CellTable
from sliding_meshes import Mesh

from docs.studies.aerofoil_grids import c_grid, o_grid


def near_block(kind: str, n: int = 5) -> Mesh:
    """A block of side 0.2 in a box of side 1."""
    mesh = box_mesh(kind, n)
    return mesh.points, mesh.cells, mesh.patches


def far_block(kind: str, n: int) -> Mesh:
    """A block of side 0.2 in a box of side 3.4: the cells around it grow to four times their size."""
    points, cells, patches = near_block(kind, n)
    away = points - 0.5
    distance = np.maximum(np.abs(away).max(axis=1, keepdims=True), 0.1)
    return 0.5 + away * (4.0 - 0.3 / distance), cells, patches


def aerofoil() -> Mesh:
    """An aerofoil with a sharp edge in a far field of 20 chords; its nodes need two scales."""
    grid = o_grid("sharp", around=64, layers=24, first=1e-3, far=20.0)
    return grid.points, CellTable.from_arrays(grid.cells), grid.patches


def cusped_aerofoil() -> Mesh:
    """An aerofoil with a cusp in a C-grid: at its edge the wall's nodes are much closer than the layer is high."""
    grid = c_grid("cusped", far=50.0)
    return grid.points, CellTable.from_arrays(grid.cells), grid.patches


def bare_aerofoil() -> Mesh:
    """An aerofoil without layers, whose nodes are far enough from each other for one matrix."""
    grid = o_grid("blunt", around=100, layers=30, first=2e-2, far=50.0)
    return grid.points, CellTable.from_arrays(grid.cells), grid.patches
