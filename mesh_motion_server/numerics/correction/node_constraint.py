"""Interfaces of a constraint on free nodes, so that a correction can move nodes with restricted freedom.

A node on a slip wall may move along it, the two nodes of a periodic pair must move alike. A :class:`NodeConstraint`
tells a correction which held nodes it may release, and which nodes must be free together. Its
:class:`RegionConstraint` gives the Newton iterations a step that is admissible to first order, and puts their trial
points back onto the walls exactly.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from mesh_motion_server.numerics.arrays import Floats, Marks
from mesh_motion_server.numerics.correction.free_region import FreeRegion, NodeAdjacency

__all__ = ["NodeConstraint", "RegionConstraint", "StepSolver"]


StepSolver = Callable[[NodeAdjacency, Floats, Floats], Floats]
"""(adjacency, Hessian blocks (b, d, d), −g (f, d)) → step (f, d)."""


class RegionConstraint(Protocol):
    """The constraint of a region's free nodes."""

    def step(self, points: Floats, hessian: Floats, right: Floats, solve: StepSolver) -> Floats:
        """An admissible step (f, d), to first order.

        Parameters
        ----------
        points : (l, d) array, mesh length unit
            Admissible positions of the region's nodes.
        hessian : (b, d, d) array
            In the pattern of the region's :class:`NodeAdjacency`.
        right : (f, d) array
            −g.
        solve : StepSolver
            Solves the reduced system.
        """
        ...

    def retract(self, points: Floats, trial: Floats) -> Floats | None:
        """The trial points (l, d) put back onto the walls; None if they are too far from ``points``."""
        ...


class NodeConstraint(Protocol):
    """The constraint of all nodes of a mesh."""

    @property
    def released(self) -> Marks:
        """(n,) bool: nodes of the boundary that may move if they satisfy this constraint."""
        ...

    def closed(self, marked: Marks) -> Marks:
        """The marked (n,) nodes and all nodes that must be free with them."""
        ...

    def of(self, region: FreeRegion) -> RegionConstraint | None:
        """The constraint of a region's free nodes; None if they all are free."""
        ...
