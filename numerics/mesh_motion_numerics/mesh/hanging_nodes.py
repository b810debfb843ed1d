"""Refuses cells that do not fit together: nodes that hang on a facet of another cell, and quads next to triangles.

Interpolation moves a hanging node without its facet: a gap opens or cells overlap, and the quality of no cell shows it.
The same happens between a quad and two triangles if their corners leave the common plane. Nodes in patches are allowed:
the sides of an interface between two non-matching meshes have given displacements.
"""

import mesh_motion_kernels as kernels
import numpy as np
from mesh_motion_protocol.errors import InvalidInput
from scipy.spatial import cKDTree

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.mesh.boundary_facets import boundary_facets
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.points import padded

#: Distances as shares of the facet's radius: a node this near is on the facet; a node this near to a corner is at its
#: place.
_ON, _AT_A_CORNER = 1e-6, 1e-3


def refuse_hanging_nodes(points: Floats, cells: CellTable, floating: Integers) -> None:
    """Refuse a mesh in which boundary nodes in no patch (``floating``, (f,)) lie on a facet of another cell.

    Raises InvalidInput; names the first node and the facet.
    """
    if not len(floating):
        return
    found: list[tuple[int, Integers]] = []
    for facets in boundary_facets(cells).values():
        if facets.shape[1] > 1:
            found += _on_facets(points, facets, floating)
    if not found:
        return
    node, facet = min(found, key=lambda pair: pair[0])
    count = len({pair[0] for pair in found})
    raise InvalidInput(
        f"node {node} hangs: it lies on the facet of nodes {facet.tolist()}, whose cell does not have it"
        f" ({count} such node{'s' if count > 1 else ''})",
        code="INVALID_ARGUMENT.MESH",
        hint="split the larger cells, or make both sides patches if two meshes meet there that do not match",
        details={"node": node, "nodes": facet.tolist(), "count": count},
    )


def refuse_split_facets(cells: CellTable, floating: Integers) -> None:
    """Refuse a mesh in which a quad of the boundary, with nodes in no patch (``floating``, (f,)), covers a triangle.

    Raises InvalidInput; names the first quad and the triangle.
    """
    facets = boundary_facets(cells)
    if "quad" not in facets or "triangle" not in facets:
        return
    quads, triangles = facets["quad"], facets["triangle"]
    quads = quads[np.isin(quads, floating).any(axis=1)]
    if not len(quads):
        return
    of_quads = np.concatenate([np.sort(np.delete(quads, corner, axis=1), axis=1) for corner in range(4)])
    rows = np.concatenate([of_quads, np.sort(triangles, axis=1)])
    number = np.unique(rows, axis=0, return_inverse=True)[1].reshape(-1)
    covering = np.isin(number[: len(of_quads)], number[len(of_quads) :])
    if not covering.any():
        return
    split = np.unique(np.flatnonzero(covering) % len(quads))
    quad = quads[split[0]]
    triangle = triangles[np.isin(triangles, quad).all(axis=1)][0]
    raise InvalidInput(
        f"the facet of nodes {quad.tolist()} of a cell covers the facet of nodes {triangle.tolist()} of another one"
        f" ({len(split)} such facet{'s' if len(split) > 1 else ''}); expected cells that share whole facets",
        code="INVALID_ARGUMENT.MESH",
        hint="put pyramids between hexahedra and tetrahedra, or make both sides patches if two meshes meet there",
        details={"facet": quad.tolist(), "nodes": triangle.tolist(), "count": len(split)},
    )


def _on_facets(points: Floats, facets: Integers, nodes: Integers) -> list[tuple[int, Integers]]:
    """Each node of (k,) that lies on one of the facets (f, w) without being its corner, with that facet."""
    corners = points[facets]
    centres = corners.mean(axis=1)
    radius = np.linalg.norm(corners - centres[:, None], axis=2).max(axis=1)
    near = cKDTree(points[nodes]).query_ball_point(centres, radius, return_sorted=True)
    rows = np.repeat(np.arange(len(facets)), [len(found) for found in near])
    some = nodes[np.concatenate(near).astype(np.int64)]
    ends = np.linalg.norm(corners[rows] - points[some][:, None], axis=2).min(axis=1)
    other = ends > _AT_A_CORNER * radius[rows]
    rows, some = rows[other], some[other]
    away = np.min([_distances(points, part[rows], some) for part in _simplices(facets)], axis=0)
    on = away < _ON * radius[rows]
    return [(int(node), facets[row]) for node, row in zip(some[on], rows[on], strict=True)]


def _simplices(facets: Integers) -> list[Integers]:
    """The facets, with each quad as two triangles."""
    return [facets] if facets.shape[1] < 4 else [facets[:, [0, 1, 2]], facets[:, [0, 2, 3]]]


def _distances(points: Floats, facets: Integers, nodes: Integers) -> Floats:
    """(k,) distance of each node (k,) from its facet (k, w)."""
    width = facets.shape[1]
    places, corners = padded(points[nodes]), padded(points[facets.reshape(-1)]).reshape(-1, width, 3)
    own, out, rows = np.arange(len(nodes) + 1), np.empty_like(places), np.zeros(len(nodes), dtype=np.int64)
    kernels.closest_points(places, corners, own, own[:-1].copy(), out, rows)
    away: Floats = np.linalg.norm(out - places, axis=1)
    return away
