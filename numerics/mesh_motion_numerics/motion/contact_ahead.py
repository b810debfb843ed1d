"""The number of further steps like the last one until no mesh with this boundary is valid: it meets itself.

A node meets a facet when the simplex of both has no volume while the node is inside the facet. This volume is a
polynomial along the step, so its first root is exact, like that of a cell (:mod:`.headroom`). Two edges that meet are
found when one of their nodes has passed the other facet. Not found: a flat part of the boundary that folds onto itself.
A cell all of whose nodes have prescribed positions may invert earlier: no correction moves it.
"""

from __future__ import annotations

from dataclasses import dataclass

import mesh_motion_kernels as kernels
import numpy as np
from numpy.typing import NDArray

from mesh_motion_numerics.arrays import Floats, Marks
from mesh_motion_numerics.mesh.boundary_crossing import BoundaryFacets
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.morton import morton_codes

_SPLITS = {"line": ((0, 1),), "triangle": ((0, 2, 1),), "quad": ((0, 2, 1), (0, 3, 2))}
_INSIDE = 1e-6  # share of a facet by which a node may be outside of it
_AT_ONCE = 256  # the first pairs are tested before all others
_GROWTH = 2.0  # of the number of steps that are looked ahead


@dataclass(frozen=True, eq=False)
class ContactAhead:
    """The facets of a boundary all of whose nodes have prescribed positions.

    Attributes
    ----------
    facets : (f, d) int32 array
        Segments or triangles, neighbours next to each other; followed by a node on their inner side, where the cells
        are, they are a simplex of positive volume.
    moving : (f,) bool array
        Whether a node of the facet moves.
    stiff : CellTable or None
        The cells without a free node, if there are any.
    """

    facets: NDArray[np.int32]
    moving: Marks
    stiff: CellTable | None

    @classmethod
    def build(cls, boundary: BoundaryFacets, points: Floats, stiff: CellTable | None = None) -> ContactAhead:
        """Build it for reference coordinates (n, d)."""
        parts = [nodes[:, list(one)] for name, nodes in boundary.nodes.items() for one in _SPLITS[name]]
        facets = np.concatenate(parts).astype(np.int32)
        facets = facets[np.argsort(morton_codes(points[facets].mean(axis=1)), kind="stable")]
        return cls(facets, np.asarray(boundary.moving[facets].any(axis=1)), stiff)

    def steps(self, points: Floats, before: Floats, first: float, most: float) -> float:
        """Steps like that from ``before`` to ``points`` (n, d) until no mesh is valid; ``inf`` above ``most``.

        ``first``: number of steps before which all cells are valid.
        """
        if self.stiff is not None:
            every = np.arange(len(self.stiff))
            stiff = float(kernels.first_inversions(points, before, self.stiff.nodes, every, most, 1)[0][0])
            return min(stiff, self._meeting(points, before, first, min(most, stiff)))
        return self._meeting(points, before, first, most)

    def _meeting(self, points: Floats, before: Floats, first: float, most: float) -> float:
        """Steps until the boundary meets itself; ``inf`` above ``most``."""
        ahead = first
        while ahead < most:
            ahead = min(_GROWTH * max(ahead, 1.0), most)
            found = self._within(points, before, ahead)
            if found <= ahead:
                return found
        return float(np.inf)

    def _within(self, points: Floats, before: Floats, ahead: float) -> float:
        """The same for the next steps ``ahead``."""
        way = points - before
        simplices = kernels.approaching_nodes(points, points + ahead * way, self.facets, self.moving)
        every = np.arange(len(simplices))
        for count in sorted({min(_AT_ONCE, len(simplices)), len(simplices)} - {0}):
            steps, numbers = kernels.first_inversions(points, before, [simplices], every, ahead, count)
            own = simplices[numbers[: np.count_nonzero(steps <= ahead)]]
            inside = _inside(points[own] + steps[: len(own), None, None] * way[own])
            if inside.any():
                return float(steps[np.argmax(inside)])
            if len(own) < count:
                break
        return float(np.inf)


def _inside(corners: Floats) -> Marks:
    """Whether the last of the points (s, d + 1, d), which lies in the plane of the others, is between them."""
    edges, at = corners[:, 1:-1] - corners[:, :1], corners[:, -1] - corners[:, 0]
    products = edges @ edges.swapaxes(1, 2)
    flat = np.linalg.det(products) <= 0.0
    products[flat] = np.eye(edges.shape[1])
    shares = np.linalg.solve(products, edges @ at[..., None])[..., 0]
    return np.asarray((np.minimum(shares.min(axis=1), 1.0 - shares.sum(axis=1)) >= -_INSIDE) & ~flat)
