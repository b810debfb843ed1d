"""Boundary facets that must not turn over when their nodes slide: a node that passes its neighbour, or its patch's rim,
turns a facet over.

A facet faces outwards if its area vector has a positive component along the outward normal of the reference mesh at
that place: the normal of the whole piece if it is planar, of the nearest reference facet otherwise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.mesh.closest_point import FacetSet
from mesh_motion_numerics.mesh.smooth_pieces import Piece, area_vectors, widened


@dataclass(frozen=True, eq=False)
class _Facets:
    """Facets (f, w) of one piece, and the data for their outward normals.

    normals : (1, d) array of a planar piece, (s, d) of the reference facets of a curved one
    reference : FacetSet or None
        The reference facets of a curved piece.
    """

    facets: Integers
    normals: Floats
    reference: FacetSet | None

    def outward(self, points: Floats) -> Marks:
        """(f,) whether each facet faces outwards with the nodes at points (l, d)."""
        normals = self.normals
        if self.reference is not None:
            real = (self.facets >= 0)[:, :, None]
            centres = np.where(real, points[self.facets], 0.0).sum(axis=1) / real.sum(axis=1)
            normals = normals[self.reference.nearest(centres)[1]]
        return np.asarray(np.sum(area_vectors(points, self.facets) * normals, axis=1) > 0.0)


@dataclass(frozen=True, eq=False)
class OutwardFacets:
    """The facets of the sliding pieces."""

    blocks: tuple[_Facets, ...]

    @classmethod
    def of_pieces(cls, points: Floats, pieces: Sequence[Piece]) -> OutwardFacets:
        """Build them for pieces of the reference mesh with nodes at points (n, d)."""
        blocks = []
        for piece in pieces:
            if piece.normal is not None:
                blocks.append(_Facets(piece.facets, area_vectors(points, piece.facets).sum(axis=0)[None], None))
            else:
                simplices = widened(piece.simplices, piece.facets.shape[1])
                corners = FacetSet(points[piece.simplices])
                blocks.append(_Facets(piece.facets, area_vectors(points, simplices), corners))
        return cls(tuple(blocks))

    def among(self, free: Marks, local: Integers) -> OutwardFacets:
        """Return the facets with a free (n,) node, in the numbering ``local`` (n,) of a region with all their nodes."""
        blocks = []
        for block in self.blocks:
            real = block.facets >= 0
            chosen = (free[block.facets] & real).any(axis=1)
            if chosen.any():
                facets = np.where(real, local[block.facets], -1)[chosen]
                blocks.append(_Facets(facets, block.normals, block.reference))
        return OutwardFacets(tuple(blocks))

    def outward(self, points: Floats) -> Marks:
        """Whether each facet faces outwards with the nodes at points (l, d)."""
        return np.concatenate([np.empty(0, dtype=bool), *(block.outward(points) for block in self.blocks)])
