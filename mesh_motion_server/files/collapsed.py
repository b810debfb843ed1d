"""Cells that name a node several times, as cells of simpler types: some programs write wedges as such hexahedra."""

from collections.abc import Mapping

import numpy as np
from mesh_motion_numerics.arrays import Integers
from mesh_motion_numerics.mesh.cells import CELL_TYPES
from mesh_motion_numerics.mesh.local_facets import LOCAL_FACETS

#: Types of cells by the numbers of nodes of their facets.
_TYPES = {(2, 2, 2): "triangle", (3, 3, 3, 3): "tetra", (3, 3, 3, 3, 4): "pyramid", (3, 3, 4, 4, 4): "wedge"}


def uncollapsed(cells: Mapping[str, Integers]) -> tuple[dict[str, Integers], int]:
    """The cells {type: (m, k) nodes}, and how many of them got a simpler type; those that fit none are unchanged."""
    parts: dict[str, list[Integers]] = {name: [] for name in cells}
    changed = 0
    for name, nodes in cells.items():
        ascending = np.sort(nodes, axis=1)
        twice = (ascending[:, 1:] == ascending[:, :-1]).any(axis=1)
        if not twice.any():
            parts[name].append(nodes)
            continue
        parts[name].append(nodes[~twice])
        left = nodes[twice]
        first = np.argmax(left[:, :, None] == left[:, None, :], axis=2)  # (r, k) the first place of each node
        for pattern in np.unique(first, axis=0):
            rows = left[(first == pattern).all(axis=1)]
            simple, order = _simple(name, pattern.tolist())
            parts.setdefault(simple, []).append(rows[:, order])
            changed += len(rows) * (simple != name)
    joined = {name: np.concatenate(some) for name, some in parts.items()}
    return {name: nodes for name, nodes in joined.items() if len(nodes)}, changed


def _simple(name: str, first: list[int]) -> tuple[str, list[int]]:
    """The simpler type of a cell, and for each of its nodes a local node; ``first`` has the first place of each node.

    The type and the nodes of the cell itself if it has no simpler type.
    """
    facets = [list(dict.fromkeys(first[local] for local in facet)) for facet in LOCAL_FACETS[name]]
    dimension = CELL_TYPES[name].dimension
    facets = [facet for facet in facets if len(facet) >= dimension]
    found = _TYPES.get(tuple(sorted(len(facet) for facet in facets)), "")
    distinct = list(dict.fromkeys(first))
    if not found or len(distinct) != CELL_TYPES[found].n_nodes:
        return name, list(range(len(first)))
    if dimension == 2:
        return found, distinct
    base = next(facet for facet in facets if len(facet) == len(LOCAL_FACETS[found][0]))[::-1]  # its normal points in
    if found != "wedge":
        return found, [*base, *(local for local in distinct if local not in base)]
    edges = {frozenset(pair) for facet in facets for pair in zip(facet, facet[1:] + facet[:1], strict=True)}
    top = [next(b for b in distinct if b not in base and frozenset((a, b)) in edges) for a in base]
    return found, [*base, *top]
