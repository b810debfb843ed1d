"""Patches and their roles: which nodes have prescribed positions, which are fixed, which slide.

A node on several patches gets one role: moving overrides fixed, fixed overrides slip and symmetry. A node on a periodic
patch always moves like its image; without another role it is free to move anywhere.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers

#: Every role in messages and case files.
ROLES = ("moving", "fixed", "slip", "symmetry", "periodic")
#: Roles whose nodes stay on their initial surface.
SLIDING_ROLES = ("slip", "symmetry")


@dataclass(frozen=True, eq=False)
class Patch:
    """A named part of the boundary."""

    role: str  # one of :data:`ROLES`
    nodes: Integers  # (p,). Node indices, 0-based


@dataclass(frozen=True, eq=False)
class BoundaryRoles:
    """The nodes of each kind, ascending, disjoint."""

    #: moving, fixed: (k,), (f,). Nodes whose positions the driver prescribes; nodes that keep their reference positions
    moving: Integers
    fixed: Integers
    sliding: Integers  # (s,). Nodes of slip and symmetry patches that are neither moving nor fixed
    periodic: Integers  # (p,). Nodes of periodic patches with none of these roles

    @classmethod
    def from_patches(cls, patches: Mapping[str, Patch]) -> BoundaryRoles:
        """Sort the nodes of checked patches (:mod:`.patch_check`) by role and precedence."""
        moving = nodes_with(patches, ("moving",))
        fixed = np.setdiff1d(nodes_with(patches, ("fixed",)), moving)
        sliding = np.setdiff1d(nodes_with(patches, SLIDING_ROLES), np.union1d(moving, fixed))
        periodic = np.setdiff1d(nodes_with(patches, ("periodic",)), np.concatenate([moving, fixed, sliding]))
        return cls(moving, fixed, sliding, periodic)

    def without(self, points: Floats, loose: Integers) -> tuple[Floats, BoundaryRoles]:
        """Points and roles of the mesh without ``loose`` nodes (l,) of no cell and no role, which may be anywhere."""
        if not len(loose):
            return points, self
        kept = ~np.isin(np.arange(len(points)), loose)
        number = np.cumsum(kept) - 1
        kinds = (self.moving, self.fixed, self.sliding, self.periodic)
        return points[kept], BoundaryRoles(*(number[nodes] for nodes in kinds))

    @cached_property
    def prescribed(self) -> Integers:
        """(k + f,) moving and fixed nodes, ascending."""
        return np.union1d(self.moving, self.fixed)

    @cached_property
    def moving_rows(self) -> Integers:
        """(k,) rows of the moving nodes among the prescribed ones."""
        return np.searchsorted(self.prescribed, self.moving)

    @cached_property
    def all(self) -> Integers:
        """(k + f + s,) all nodes with a prescribed position and all sliding nodes, ascending: the control points."""
        return np.union1d(self.prescribed, self.sliding)


def nodes_with(patches: Mapping[str, Patch], roles: tuple[str, ...]) -> Integers:
    """(p,) nodes of all patches with one of these roles, ascending, each once."""
    chosen = [np.asarray(p.nodes, dtype=np.int64) for p in patches.values() if p.role in roles]
    return np.unique(np.concatenate(chosen)) if chosen else np.empty(0, dtype=np.int64)
