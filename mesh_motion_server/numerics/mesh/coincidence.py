"""Points at the same place: duplicate nodes of a wake, of the two sides of an interface or of a baffle."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from mesh_motion_server.numerics.mesh.points import bounding_box

__all__ = ["coincident_nodes", "first_at_place"]

# rounding of coordinates, relative to the extent
_SAME_PLACE = 1e-13


def first_at_place(points: NDArray[np.float64], extent: float) -> NDArray[np.int64]:
    """For each point the lowest number of the points closer than 10⁻¹³ of an extent, directly or through a chain.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
    extent : float, mesh length unit

    Returns
    -------
    (n,) int64 array
    """
    place = np.arange(len(points))
    order = np.lexsort(points.T)  # identical points first: a tree of many identical points takes quadratic time
    same = np.r_[False, (points[order[1:]] == points[order[:-1]]).all(axis=1)]
    place[order] = np.minimum.reduceat(order, np.flatnonzero(~same))[np.cumsum(~same) - 1]
    distinct = np.flatnonzero(place == np.arange(len(points)))
    a, b = cKDTree(points[distinct]).query_pairs(_SAME_PLACE * extent, output_type="ndarray").T
    if not len(a):
        return place
    near = coo_array((np.ones(len(a), dtype=bool), (a, b)), shape=(len(distinct), len(distinct)))
    count, group = connected_components(near, directed=False)
    first = np.full(count, len(points))
    np.minimum.at(first, group, distinct)
    return np.asarray(first[group][np.searchsorted(distinct, place)])


def coincident_nodes(points: NDArray[np.float64], nodes: NDArray[np.int64]) -> NDArray[np.int64]:
    """(c, 2) pairs of the nodes (b,), ascending, of a mesh ``points`` (n, d): the first at a place, and another."""
    first = nodes[first_at_place(points[nodes], float(np.ptp(bounding_box(points), axis=0).max()))]
    others = first != nodes
    return np.column_stack([first[others], nodes[others]])
