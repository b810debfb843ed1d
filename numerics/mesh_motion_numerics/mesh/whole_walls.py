"""The facets of sliding walls, where patches do not share the nodes of their common rim.

Many codes list a node with one patch only: the corner of two walls is on the first of them, and the last facet of the
second one has all its nodes in no patch. A wall that ended there would let its corner slide, and change the domain. So
each such facet belongs to the patch whose own facets it continues most smoothly.
"""

from collections.abc import Mapping

import numpy as np
from scipy.sparse import csr_array

from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.mesh.points import marks_at
from mesh_motion_numerics.mesh.roles import SLIDING_ROLES, Patch
from mesh_motion_numerics.mesh.smooth_pieces import SMOOTH_COSINE, all_marked, area_vectors, widened


def whole_walls(points: Floats, facets: Mapping[str, Integers], patches: Mapping[str, Patch]) -> dict[str, Integers]:
    """Nodes (p,) of each slip or symmetry patch, together with the nodes of facets at its rim that are in no
    patch and continue only this one.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
    facets : dict of (f, k) int64 arrays
        Of the whole boundary, pointing outwards, by type.
    patches : dict of Patch
        Of every role.
    """
    walls = [name for name, patch in sorted(patches.items()) if patch.role in SLIDING_ROLES]
    if not walls:
        return {}
    listed = {name: marks_at(len(points), patch.nodes) for name, patch in sorted(patches.items())}
    if facets:
        width = {1: 1, 2: 2, 3: 4}[points.shape[1]]
        table = np.concatenate([widened(block, width) for block in facets.values()])
        lost = np.flatnonzero(all_marked(np.logical_or.reduce(list(listed.values())), table))
        lost = orphans = _of_no_patch(lost, table, listed)
        while len(lost):
            added = _continued(points, table, lost, listed, walls)
            if not any(map(len, added.values())):
                break
            for name, nodes in added.items():
                listed[name][nodes] = True
            lost = _of_no_patch(lost, table, listed)
        for name in walls:
            gained = all_marked(listed[name], table) & ~all_marked(marks_at(len(points), patches[name].nodes), table)
            gained[orphans] = False
            if gained.any():  # two rims that are one cell apart: a facet of another patch would be one of this wall
                listed[name] = marks_at(len(points), patches[name].nodes)
    return {name: np.flatnonzero(listed[name]) for name in walls}


def _continued(
    points: Floats, table: Integers, lost: Integers, listed: Mapping[str, Marks], walls: list[str]
) -> dict[str, Integers]:
    """Nodes that each wall gains by those of the ``lost`` facets (rows of the table) that continue it."""
    normals = area_vectors(points, table)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    at = _incidence(table, len(points))
    likeness = np.stack([_likeness(at, normals, lost, marks, all_marked(marks, table)) for marks in listed.values()])
    best = np.argmax(likeness, axis=0)
    added = {}
    for number, name in enumerate(listed):
        if name in walls:
            nodes = np.unique(table[lost[(best == number) & (likeness[number] >= SMOOTH_COSINE)]])
            nodes = nodes[nodes >= 0]
            added[name] = nodes[~listed[name][nodes]]
    return added


def _of_no_patch(rows: Integers, table: Integers, listed: Mapping[str, Marks]) -> Integers:
    """Rows (l,) of the table whose facet belongs to no patch."""
    belongs: Marks = np.logical_or.reduce([all_marked(marks, table[rows]) for marks in listed.values()])
    found: Integers = rows[~belongs]
    return found


def _incidence(table: Integers, n_points: int) -> csr_array:
    """(f, n) with a one for each corner of each facet."""
    rows, columns = np.nonzero(table >= 0)
    return csr_array((np.ones(len(rows)), (rows, table[rows, columns])), shape=(len(table), n_points))


def _likeness(at: csr_array, normals: Floats, lost: Integers, listed: Marks, own: Marks) -> Floats:
    """(l,) largest cosine between each lost facet and the patch's own facets at the patch's nodes of it.

    −1 without any; just enough where the patch has no facet of its own.
    """
    touched = at[lost].multiply(listed[None, :]).tocsr()
    if not own.any():
        return np.where(touched.sum(axis=1) > 0, SMOOTH_COSINE, -1.0)
    rows, columns = (touched @ at[own].T).nonzero()
    found = np.full(len(lost), -1.0)
    np.maximum.at(found, rows, np.einsum("ij,ij->i", normals[lost][rows], normals[own][columns]))
    return found
