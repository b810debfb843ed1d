"""Boundary nodes that a correction may move: along their slip or symmetry surface, and together with periodic images.

Each step of the Newton iterations is tangential, trial positions are projected back exactly, and no facet that faces
outwards may turn over. So nodes stay on their surface and within its rim, rims on their curves, and corners in place.
The images of a periodic node are one unknown, so the mesh is improved across a periodic side as in the interior.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.correction.free_region import FreeRegion
from mesh_motion_numerics.correction.linked_unknowns import LinkedUnknowns, StepSolver, System
from mesh_motion_numerics.correction.outward_facets import OutwardFacets
from mesh_motion_numerics.mesh.periodic_nodes import PeriodicNodes
from mesh_motion_numerics.mesh.points import marks_at, rows_among
from mesh_motion_numerics.mesh.roles import SLIDING_ROLES, Patch, nodes_with
from mesh_motion_numerics.mesh.sliding import SlidingSurfaces
from mesh_motion_numerics.mesh.surface_constraints import OnFacets, OnPlanes, OnPrism


@dataclass(frozen=True, eq=False)
class BoundaryConstraint:
    """The constraint of the boundary nodes of a mesh."""

    released: Marks  # (n,). Nodes that may move
    sliding: SlidingSurfaces | None  # Surfaces of the sliding nodes
    periodic: PeriodicNodes | None
    facets: OutwardFacets  # Facets of the sliding patches

    @classmethod
    def build(
        cls,
        points: Floats,
        facets: Mapping[str, Integers],
        patches: Mapping[str, Patch],
        surfaces: Mapping[str, Integers],
        sliding: SlidingSurfaces | None,
        periodic: PeriodicNodes | None,
    ) -> BoundaryConstraint | None:
        """Build the constraint of a mesh with reference ``points`` (n, d); None if no boundary node may move.

        Parameters
        ----------
        points : (n, d) array, mesh length unit
        facets : dict of (f, k) int64 arrays
            The facets of the whole boundary, with outward normals, by type.
        surfaces : dict of (p,) int64 arrays
            The nodes of the :func:`.whole_walls`.
        """
        released = marks_at(len(points), *(() if periodic is None else (periodic.members,)))
        released[nodes_with(patches, ("moving", "fixed", *SLIDING_ROLES))] = False
        if sliding is not None:
            released[sliding.nodes] = sliding.freedom() > 0
        released &= ~_on_other_facets(len(points), facets, patches, surfaces)
        if periodic is not None:
            released &= ~_torn(released, periodic) & ~_sliding_on_axis(periodic, sliding)
        if not released.any():
            return None
        chosen = None if sliding is None else sliding.of(released[sliding.nodes])
        outward = OutwardFacets.of_pieces(points, () if sliding is None else sliding.pieces)
        return cls(released, chosen, periodic, outward)

    def smooth(self) -> BoundaryConstraint | None:
        """Return the constraint of nodes with constant directions; None if there are none.

        These are nodes on planes, on curved walls that are straight in one direction (only along it, so from their
        places in the plain motion: :meth:`RegionConstraint.through`), and periodic ones.
        """
        released, sliding = self.released.copy(), self.sliding
        if sliding is not None:
            planes = [(rows, s.straight if isinstance(s, OnFacets | OnPrism) else s) for rows, s in sliding.groups]
            sliding = replace(sliding, groups=tuple((rows, s) for rows, s in planes if isinstance(s, OnPlanes)))
            constant = marks_at(len(sliding.nodes), *(rows for rows, _ in sliding.groups))
            released[sliding.nodes[~constant]] = False
            sliding = sliding.of(constant)
        if self.periodic is not None:
            released &= ~_torn(released, self.periodic)
        return replace(self, released=released, sliding=sliding) if released.any() else None

    def with_walls_held(self) -> BoundaryConstraint | None:
        """Return the constraint without its sliding nodes; None if no other node may move."""
        released = self.released.copy()
        if self.sliding is not None:
            released[self.sliding.nodes] = False
        if self.periodic is not None:
            released &= ~_torn(released, self.periodic)
        return replace(self, released=released, sliding=None) if released.any() else None

    def renumbered(self, rows: Integers, points: Floats) -> BoundaryConstraint | None:
        """Return the constraint of a region with nodes at ``points`` (k, d); ``rows`` (k,): mesh rows, ascending, or -1

        This is for the smooth correction, which turns no facet over. None if no node of the region may move; a node
        whose image is outside the region may not move.
        """
        here = np.flatnonzero(rows >= 0)
        place = np.full(len(self.released), -1, dtype=np.int64)
        place[rows[here]] = here
        released = np.zeros(len(rows), dtype=bool)
        released[here] = self.released[rows[here]]
        periodic, sliding = self.periodic, self.sliding
        if periodic is not None:
            torn = place[periodic.members]
            periodic = periodic.renumbered(place, points)
            released[np.setdiff1d(torn[torn >= 0], periodic.members)] = False
        if not released.any():
            return None
        if sliding is not None:
            sliding = sliding.of(place[sliding.nodes] >= 0)
            sliding = replace(sliding, nodes=place[sliding.nodes], lines=())
        return BoundaryConstraint(released, sliding, periodic, OutwardFacets(()))

    def closed(self, marked: Marks) -> Marks:
        """The marked (n,) nodes and their periodic images."""
        return marked if self.periodic is None else self.periodic.closed(marked)

    def of(self, region: FreeRegion) -> RegionConstraint | None:
        """Return the constraint of a region's free nodes; None if all of them may move freely."""
        free = marks_at(len(self.released), region.free) & self.released
        if not free.any():
            return None
        local = rows_among(len(free), region.nodes)
        representatives, orbits = np.arange(region.n_free), None
        if self.periodic is not None:
            orbits = self.periodic.of(free[self.periodic.members])
            representatives[local[orbits.members]] = local[orbits.roots]
        sliding = None
        if self.sliding is not None:
            nodes = self.sliding.nodes
            own = nodes if self.periodic is None else self.periodic.root_of(nodes)
            sliding = self.sliding.of(free[nodes] & (own == nodes))
        links = LinkedUnknowns.build(region.adjacency, representatives)
        return RegionConstraint(links, sliding, orbits, local, self.facets.among(free, local))


@dataclass(frozen=True, eq=False)
class RegionConstraint:
    """The constraint of a region's free nodes: sliding nodes with periodic images are roots.

    ``local`` (n,) is the region's numbering.
    """

    links: LinkedUnknowns
    sliding: SlidingSurfaces | None
    orbits: PeriodicNodes | None
    local: Integers
    facets: OutwardFacets

    def through(self, positions: Floats) -> RegionConstraint:
        """The same constraint, with the planes through the mesh's ``positions`` (n, d)."""
        if self.sliding is None:
            return self
        return replace(self, sliding=replace(self.sliding, reference=positions[self.sliding.nodes]))

    def across(self, points: Floats, changes: Floats) -> Floats:
        """The part of ``changes`` (f, d) of free nodes that is not a step from local positions (l, d)."""
        if self.sliding is None:
            return np.zeros_like(changes)
        matrices = self._matrices(points)
        return np.asarray(changes - np.einsum("fij,fkj,fk->fi", matrices, matrices, changes))

    def step(self, points: Floats, hessian: Floats, right: Floats, solve: StepSolver) -> Floats:
        """A tangential step (f, d), equal for periodic images: admissible to first order.

        Parameters
        ----------
        points : (l, d) array, mesh length unit
            Admissible positions of the region's nodes.
        hessian : (b, d, d) array
            In the pattern of the region's :class:`NodeAdjacency`.
        right : (f, d) array
            −g.
        """
        return self.solver(points, hessian, lambda adjacency, blocks: partial(solve, adjacency, blocks))(right)

    def solver(self, points: Floats, hessian: Floats, system: System) -> Callable[[Floats], Floats]:
        """Return a function from right sides (f, d) to such steps; ``system`` prepares the reduced system once."""
        matrices = self._matrices(points)
        solve = system(self.links.adjacency, self.links.reduce(matrices, hessian))
        return lambda right: self.links.expand(matrices, solve(self.links.gather(matrices, right)))

    def _matrices(self, points: Floats) -> Floats:
        """(f, d, d) matrices M of the free nodes' links, at local positions (l, d)."""
        d = points.shape[1]
        matrices = np.broadcast_to(np.eye(d), (len(self.links.targets), d, d)).copy()
        if self.sliding is not None:
            rows = self.local[self.sliding.nodes]
            matrices[rows] = self.sliding.tangents(points[rows])
        if self.orbits is not None:
            matrices[self.local[self.orbits.members]] = self.orbits.matrices @ matrices[self.local[self.orbits.roots]]
        return matrices

    def retract(self, points: Floats, trial: Floats) -> Floats | None:
        """The trial points (l, d) put back onto the surfaces, with equal images; None if a facet turned over."""
        trial = self.placed(trial)
        turned = self.facets.outward(points) & ~self.facets.outward(trial)
        return None if turned.any() else trial

    def placed(self, points: Floats) -> Floats:
        """The points (l, d) put back onto the surfaces in place, with equal images."""
        if self.sliding is not None:
            rows = self.local[self.sliding.nodes]
            points[rows] = self.sliding.project(points[rows])
        if self.orbits is not None:
            points[self.local[self.orbits.members]] = self.orbits.images(points[self.local[self.orbits.roots]])
        return points


def _torn(released: Marks, periodic: PeriodicNodes) -> Marks:
    """(n,) periodic nodes with an image that is not released."""
    return periodic.closed(marks_at(len(released), periodic.members) & ~released)


def _sliding_on_axis(periodic: PeriodicNodes, sliding: SlidingSurfaces | None) -> Marks:
    """(n,) nodes on an axis of rotation that also slide: they stay held, because no node has both constraints."""
    on_axis = periodic.members[periodic.on_axis]
    return marks_at(len(periodic.reference), *(() if sliding is None else (np.intersect1d(on_axis, sliding.nodes),)))


def _on_other_facets(
    n: int, facets: Mapping[str, Integers], patches: Mapping[str, Patch], surfaces: Mapping[str, Integers]
) -> Marks:
    """(n,) nodes with a boundary facet that belongs to no sliding and no periodic patch."""
    sides = [*surfaces.values(), *(patch.nodes for patch in patches.values() if patch.role == "periodic")]
    marks = [marks_at(n, nodes) for nodes in sides]
    return marks_at(n, *(rows[~np.any([own[rows].all(axis=1) for own in marks], axis=0)] for rows in facets.values()))
