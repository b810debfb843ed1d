"""Boundary nodes that a correction may move: along their slip or symmetry surface.

Each step of the Newton iterations is tangential, what is tried is projected back exactly, and no facet that faces
outwards may turn over: so nodes stay on their surface and within its rim, rims on their curves, and corners in place.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.numerics.boundary_facets import boundary_facets
from mesh_motion_server.numerics.cells import CellTable
from mesh_motion_server.numerics.free_region import FreeRegion
from mesh_motion_server.numerics.linked_unknowns import LinkedUnknowns
from mesh_motion_server.numerics.node_constraint import StepSolver
from mesh_motion_server.numerics.outward_facets import OutwardFacets
from mesh_motion_server.numerics.sliding import SlidingSurfaces

__all__ = ["BoundaryConstraint"]

Floats = NDArray[np.float64]
Marks = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class BoundaryConstraint:
    """The constraint of the boundary nodes of a mesh.

    Attributes
    ----------
    released : (n,) bool array
        Nodes that may move.
    sliding : SlidingSurfaces
        Of those that slide.
    facets : OutwardFacets
        Of the sliding patches.
    """

    released: Marks
    sliding: SlidingSurfaces
    facets: OutwardFacets

    @classmethod
    def build(
        cls, points: Floats, cells: CellTable, patches: Mapping[str, NDArray[np.int64]], sliding: SlidingSurfaces
    ) -> BoundaryConstraint | None:
        """The constraint of a mesh with reference coordinates ``points`` (n, d); None if no boundary node may move.

        Parameters
        ----------
        points : (n, d) array, mesh length unit
        cells : CellTable
        patches : dict of (p,) int64 arrays
            Nodes of each slip or symmetry patch.
        sliding : SlidingSurfaces
        """
        may_slide = (sliding.freedom() > 0) & ~_on_other_facets(len(points), cells, patches)[sliding.nodes]
        if not may_slide.any():
            return None
        released = np.zeros(len(points), dtype=bool)
        released[sliding.nodes[may_slide]] = True
        facets = OutwardFacets.of_pieces(points, sliding.pieces)
        return cls(released, sliding.of(may_slide), facets)

    def closed(self, marked: Marks) -> Marks:
        """The marked (n,) nodes and all that must be free with them: here none."""
        return marked

    def of(self, region: FreeRegion) -> _RegionConstraint | None:
        """The constraint of a region's free nodes; None if they all are free."""
        free = np.zeros(len(self.released), dtype=bool)
        free[region.free] = True
        free &= self.released
        if not free.any():
            return None
        local = np.full(len(free), -1, dtype=np.int64)
        local[region.nodes] = np.arange(len(region.nodes))
        sliding = self.sliding.of(free[self.sliding.nodes])
        links = LinkedUnknowns.build(region.adjacency, np.arange(region.n_free))
        return _RegionConstraint(links, sliding, local[sliding.nodes], self.facets.among(free, local))


@dataclass(frozen=True, eq=False)
class _RegionConstraint:
    """Of the f free nodes of a region with l nodes; ``rows`` (s,) are those that slide."""

    links: LinkedUnknowns
    sliding: SlidingSurfaces
    rows: NDArray[np.int64]
    facets: OutwardFacets

    def step(self, points: Floats, hessian: Floats, right: Floats, solve: StepSolver) -> Floats:
        """A tangential step (f, d)."""
        d = points.shape[1]
        matrices = np.broadcast_to(np.eye(d), (len(right), d, d)).copy()
        matrices[self.rows] = self.sliding.tangents(points[self.rows])
        blocks, reduced = self.links.reduce(matrices, hessian, right)
        return self.links.expand(matrices, solve(self.links.adjacency, blocks, reduced))

    def retract(self, points: Floats, trial: Floats) -> Floats | None:
        """The trial points (l, d) put back onto the surfaces; None where a facet turned over."""
        trial[self.rows] = self.sliding.project(trial[self.rows])
        turned = self.facets.outward(points) & ~self.facets.outward(trial)
        return None if turned.any() else trial


def _on_other_facets(n: int, cells: CellTable, patches: Mapping[str, NDArray[np.int64]]) -> Marks:
    """(n,) nodes with a boundary facet that belongs to none of the patches."""
    found = np.zeros(n, dtype=bool)
    for facets in boundary_facets(cells).values():
        other = np.ones(len(facets), dtype=bool)
        for nodes in patches.values():
            inside = np.zeros(n, dtype=bool)
            inside[nodes] = True
            other &= ~inside[facets].all(axis=1)
        found[facets[other]] = True
    return found
