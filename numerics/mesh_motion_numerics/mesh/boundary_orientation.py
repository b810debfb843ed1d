"""Detects a closed part of the boundary that is turned inside out: it crosses nothing, yet no valid mesh exists.

Cells with positive corners may still fill such a part if they go twice round a node: the mesh then overlaps itself. The
volume inside a closed surface is V = 1/d ∮ x · n dA (the divergence theorem). With normals that point out of the mesh
it is positive for an outer boundary and negative for a hole, and keeps its sign as long as the mesh is valid. The two
sides of a baffle are a hole without volume; when they separate, V becomes negative.
"""

from collections.abc import Mapping

import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.mesh.neighbours import parts_of
from mesh_motion_numerics.mesh.smooth_pieces import all_marked, area_vectors, of_one_width

#: Rounding error of the sum of a part's contributions, relative to their size.
_ROUNDING = 1e-12


def overturned_place(
    facets: Mapping[str, Integers], prescribed: Marks, reference: Floats, points: Floats
) -> Floats | None:
    """Centre (d,) of the first part of the boundary that is turned inside out, None if there is none.

    Parameters
    ----------
    facets : dict of (f, k) int64 arrays
        The whole boundary, pointing outwards, by type.
    prescribed : (n,) bool array
        Nodes with prescribed positions; a part with any other node is not tested.
    reference, points : (n, d) arrays, mesh length unit
        Before and after the motion.
    """
    if reference.shape[1] == 1 or not facets:
        return None
    rows = of_one_width(facets)
    parts, whole = closed_parts(rows, prescribed, len(points))
    before, after = (_signs(parts, _contributions(places, rows)) for places in (reference, points))
    lost = np.flatnonzero(whole & np.where(before == 0.0, after > 0.0, before * after <= 0.0))
    if not len(lost):
        return None
    nodes = np.unique(rows[parts == lost[0]])
    centre: Floats = points[nodes[nodes >= 0]].mean(axis=0)
    return centre


def outer_nodes(facets: Mapping[str, Integers], reference: Floats) -> Marks:
    """(n,) whether each node of a mesh (n, d) is on a part of the boundary that is not a hole."""
    found = np.zeros(len(reference) + 1, dtype=bool)  # the last one for the -1 of a triangle
    if facets:
        rows = of_one_width(facets)
        parts = parts_of(rows, len(reference))
        found[rows[(_signs(parts, _contributions(reference, rows)) > 0.0)[parts]]] = True
    return found[:-1]


def closed_parts(rows: Integers, prescribed: Marks, count: int) -> tuple[Integers, Marks]:
    """(f,) number of the connected part of the boundary of each facet (f, w); (p,) whether all nodes are prescribed."""
    parts = parts_of(rows, count)
    whole = np.ones(parts.max() + 1, dtype=bool)
    whole[parts[~all_marked(prescribed, rows)]] = False
    return parts, whole


def _signs(parts: Integers, contributions: Floats) -> Floats:
    """(p,) sign of the volume of each part, 0 where the sum of its contributions (f,) is only rounding."""
    volume, largest = np.bincount(parts, contributions), np.bincount(parts, np.abs(contributions))
    return np.where(np.abs(volume) <= _ROUNDING * largest, 0.0, np.sign(volume))


def _contributions(places: Floats, rows: Integers) -> Floats:
    """(f,) x · n dA / d of each facet, with x from the middle of the domain to reduce rounding."""
    used, numbers = np.unique(np.maximum(rows, 0), return_inverse=True)
    numbers = np.where(rows < 0, -1, numbers.reshape(rows.shape))
    centred = places[used]
    centred -= 0.5 * (centred.min(axis=0) + centred.max(axis=0))
    real = (rows >= 0)[:, :, None]
    middles = np.where(real, centred[numbers], 0.0).sum(axis=1) / real.sum(axis=1)
    products: Floats = np.sum(middles * area_vectors(centred, numbers), axis=1) / places.shape[1]
    return products
