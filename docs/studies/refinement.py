"""Uniform refinement of simplex meshes: a stored mesh of thousands of nodes becomes one of tens of thousands."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.quality.metrics import reference_sizes
from numpy.typing import NDArray

from docs.studies.moved_bodies import StoredMesh

__all__ = ["refined"]

Indices = NDArray[np.int64]

#: Children by corners 0 … d and then the edges' middles in the order of ``combinations``; eight tetrahedra by the
#: octahedron's diagonal between the middles of the edges 02 and 13.
_CHILDREN = {
    2: ((0, 3, 4), (1, 5, 3), (2, 4, 5), (3, 5, 4)),
    3: (
        (0, 4, 5, 6),
        (1, 4, 7, 8),
        (2, 5, 7, 9),
        (3, 6, 8, 9),
        (5, 8, 4, 6),
        (5, 8, 6, 9),
        (5, 8, 9, 7),
        (5, 8, 7, 4),
    ),
}


def refined(mesh: StoredMesh, times: int = 1) -> StoredMesh:
    """The mesh with every triangle cut into four or tetrahedron into eight, a given number of times."""
    for _ in range(times):
        mesh = _once(mesh)
    return mesh


def _once(mesh: StoredMesh) -> StoredMesh:
    """One refinement; the midpoint of a boundary edge is on every patch that has both ends of the edge."""
    cells, d = mesh.cells.blocks[0].nodes.astype(np.int64), mesh.points.shape[1]  # keys of edges exceed 2³¹
    pairs = np.array(list(combinations(range(d + 1), 2)))
    edges = np.sort(cells[:, pairs].reshape(-1, 2), axis=1)
    unique, numbers = np.unique(edges, axis=0, return_inverse=True)
    points = np.vstack([mesh.points, mesh.points[unique].mean(axis=1)])
    middles = len(mesh.points) + numbers.reshape(len(cells), len(pairs))
    children = np.hstack([cells, middles])[:, np.array(_CHILDREN[d])].reshape(-1, d + 1)
    name = mesh.cells.blocks[0].type.name
    negative = reference_sizes(points, CellTable.from_arrays({name: children})) < 0
    children[negative] = children[negative][:, [1, 0, *range(2, d + 1)]]
    boundary = _boundary_edges(cells, unique)
    patches = {key: _with_middles(patch, boundary, unique, len(mesh.points)) for key, patch in mesh.patches.items()}
    return StoredMesh(points, CellTable.from_arrays({name: children}), patches)


def _boundary_edges(cells: Indices, edges: Indices) -> NDArray[np.bool_]:
    """(e,) bool array: True for an edge (e, 2) on a facet that belongs to one cell only."""
    width = cells.shape[1]
    facets = np.sort(np.concatenate([np.delete(cells, i, axis=1) for i in range(width)]), axis=1)
    unique, count = np.unique(facets, axis=0, return_counts=True)
    outer = unique[count == 1]
    sides = np.concatenate([outer[:, list(pair)] for pair in combinations(range(width - 1), 2)])
    scale = int(cells.max()) + 1
    return np.isin(edges[:, 0] * scale + edges[:, 1], sides[:, 0] * scale + sides[:, 1])


def _with_middles(patch: Patch, boundary: NDArray[np.bool_], edges: Indices, n: int) -> Patch:
    """The patch with the midpoints of its edges (e, 2); the midpoints are numbered from n."""
    both = boundary & np.isin(edges, patch.nodes).all(axis=1)
    return Patch(patch.role, np.concatenate([patch.nodes, n + np.flatnonzero(both)]))
