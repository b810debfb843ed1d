"""Clustering on a hierarchy of grids: one control point for all nodes of a grid cell, finer cells where necessary.

The boundary nodes are agglomerated by the cells of a grid over their bounding box, each cluster represented by the node
nearest to its centroid. The displacement is interpolated from the representatives; a cluster with an error above the
tolerance is divided by grid cells of half the size, and its representative remains a representative. Representatives
are nested and follow the shape of the surface and, through the errors, the motion (thesis §2.2.3).

References
----------
G. A. Strofylas, G. N. Lygidakis, I. K. Nikolos, "An agglomeration strategy for accelerating RBF-based mesh
deformation", Adv. Eng. Softw. 107 (2017) 13–37; thesis [43]. There clusters grow by fusion over the surface mesh; the
grid needs no surface mesh.
"""

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.reduction.problem import Reduced, ReductionProblem, lengths

from docs.studies.thesis._point_reduction.level_sum import LevelSum

__all__ = ["Clusters", "reduce"]


#: Clusters to begin with, at least.
_FIRST_CLUSTERS = 16
#: Halvings of the bounding box: finer than the distance below which points count as coinciding.
_MAX_DEPTH = 48


class Clusters:
    """Nodes by the cells of a hierarchy of grids.

    Parameters
    ----------
    points : (nb, d) array, mesh length unit

    Attributes
    ----------
    label : (nb,) int64 array
        Cluster of each node, 0 … count − 1.
    """

    def __init__(self, points: Floats) -> None:
        self._points = points
        low = points.min(axis=0)
        extent = max(float(np.max(points.max(axis=0) - low)), np.finfo(float).tiny)
        # the highest bit of a coordinate halves the box, the next one its halves, and so on
        scaled = (points - low) * (2.0**_MAX_DEPTH / extent)
        self._bits = np.minimum(scaled, 2.0**_MAX_DEPTH - 1.0).astype(np.int64)
        self._depth = np.zeros(len(points), dtype=np.int64)
        self.label = np.zeros(len(points), dtype=np.int64)
        self.count = 1

    def divide(self, chosen: Marks) -> None:
        """Divide the clusters of the chosen (nb) nodes, whole clusters of distinct nodes, until there are more."""
        before = self.count
        while self.count == before:
            self._depth += chosen
            shift = _MAX_DEPTH - self._depth
            cell = np.zeros(len(self.label), dtype=np.int64)
            for bits in self._bits.T:
                cell = 2 * cell + ((bits >> shift) & 1)
            children = (self.label << self._bits.shape[1]) + np.where(chosen, cell, 0)
            kept, self.label = np.unique(children, return_inverse=True)
            self.count = len(kept)

    def representatives(self, selected: Integers) -> Integers:
        """(count,) for each cluster its selected node, or without one the node nearest to its centroid."""
        size = np.bincount(self.label)
        sums = [np.bincount(self.label, weights=x) for x in self._points.T]
        away = self._points - (np.column_stack(sums) / size[:, None])[self.label]
        distance = np.einsum("ij,ij->i", away, away)
        distance[selected] = -1.0
        order = np.lexsort((distance, self.label))
        return order[np.searchsorted(self.label[order], np.arange(self.count))]


def reduce(problem: ReductionProblem) -> Reduced:
    """Divide the clusters with an error above the tolerance and interpolate again, until no such cluster is left."""
    field = LevelSum(problem)
    clusters = Clusters(problem.points)
    while clusters.count < min(_FIRST_CLUSTERS, problem.n_points):
        clusters.divide(np.ones(problem.n_points, dtype=bool))
    selected = np.empty(0, dtype=np.int64)
    size = lengths(problem.displacement)
    while True:
        selected = _extended(selected, clusters.representatives(selected), size, problem.limit)
        if field.replace(selected):
            return field.reduced()
        size = lengths(field.error)
        clusters.divide(_to_divide(clusters, size, problem.allowed_error))


def _extended(selected: Integers, representatives: Integers, size: Floats, limit: int) -> Integers:
    """The selected nodes and the new representatives; if limited, those with the largest error (nb,)."""
    new = np.setdiff1d(representatives, selected)
    if len(selected) + len(new) > limit:
        new = np.sort(new[np.argsort(-size[new], kind="stable")[: limit - len(selected)]])
    return np.concatenate([selected, new])


def _to_divide(clusters: Clusters, size: Floats, allowed: float) -> Marks:
    """Mark (nb) the nodes of clusters with several nodes, one of which has an error (nb,) above the limit."""
    several = np.bincount(clusters.label) > 1
    above = np.zeros(clusters.count, dtype=bool)
    above[clusters.label[size > allowed]] = True
    return np.asarray((several & above)[clusters.label])
