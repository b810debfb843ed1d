"""Edges, triangles and tetrahedra for preCICE's mappings: facets of a patch, and cells of a mesh cut into simplices.

preCICE needs them for a mapping that projects or interpolates within cells. It knows no cells other than simplices:
quadrilaterals and cells with more nodes are cut, each by one fixed scheme.
"""

from __future__ import annotations

from itertools import groupby

import numpy as np
from mesh_motion_client import Mesh
from numpy.typing import NDArray

__all__ = ["cell_simplices", "patch_facets"]

_Table = dict[str, tuple[tuple[int, ...], ...]]

#: Facets of a cell, by the positions of their nodes, those with fewer nodes first.
_FACETS: _Table = {
    "triangle": ((0, 1), (1, 2), (2, 0)),
    "quad": ((0, 1), (1, 2), (2, 3), (3, 0)),
    "tetra": ((0, 1, 2), (0, 1, 3), (1, 2, 3), (0, 2, 3)),
    "pyramid": ((0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4), (0, 1, 2, 3)),
    "wedge": ((0, 1, 2), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    "hexahedron": ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
}
#: Simplices that fill a cell.
_SIMPLICES: _Table = {
    "line": ((0, 1),),
    "triangle": ((0, 1, 2),),
    "quad": ((0, 1, 2), (0, 2, 3)),
    "tetra": ((0, 1, 2, 3),),
    "pyramid": ((0, 1, 2, 4), (0, 2, 3, 4)),
    "wedge": ((0, 1, 2, 5), (0, 1, 5, 4), (0, 4, 5, 3)),
    "hexahedron": ((0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6)),
}
#: The type of a facet by the number of its corners, for its division into simplices.
_FACET_TYPES = {2: "line", 3: "triangle", 4: "quad"}


def cell_simplices(mesh: Mesh) -> NDArray[np.int64]:
    """(s, d + 1) nodes of the triangles or tetrahedra that fill the cells of a mesh in d dimensions."""
    cut = [_cut(cells, kind) for kind, cells in mesh.cells.items() if len(_SIMPLICES[kind][0]) == mesh.dimension + 1]
    return np.concatenate([np.empty((0, mesh.dimension + 1), dtype=np.int64), *cut])


def patch_facets(mesh: Mesh, nodes: NDArray[np.int64]) -> NDArray[np.int64]:
    """(f, d) positions in ``nodes`` (p,) of the edges or triangles of the boundary that have all nodes there."""
    position = np.full(len(mesh.points), -1, dtype=np.int64)
    position[nodes] = np.arange(len(nodes))
    found: dict[int, list[NDArray[np.int64]]] = {}
    for kind, cells in mesh.cells.items():
        for size, facets in groupby(_FACETS.get(kind, ()), key=len):
            rows = position[np.concatenate([cells[:, facet] for facet in facets])]
            found.setdefault(size, []).append(rows[(rows >= 0).all(axis=1)])
    cut = [_cut(_once(np.concatenate(rows)), _FACET_TYPES[size]) for size, rows in found.items()]
    return np.concatenate([np.empty((0, mesh.dimension), dtype=np.int64), *cut])


def _once(facets: NDArray[np.int64]) -> NDArray[np.int64]:
    """The boundary's facets (f, k): no other facet has the same nodes."""
    _, first, count = np.unique(np.sort(facets, axis=1), axis=0, return_index=True, return_counts=True)
    alone: NDArray[np.int64] = facets[np.sort(first[count == 1])]
    return alone


def _cut(cells: NDArray[np.integer], kind: str) -> NDArray[np.int64]:
    """(s, k) simplices of the cells of a type."""
    return np.concatenate([cells[:, simplex] for simplex in _SIMPLICES[kind]]).astype(np.int64)
