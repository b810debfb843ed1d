"""A boundary layer gives way rather than spoil cells, or have a motion refused that is valid without it.

First go the layer's nodes in cells that carrying alone would spoil: in concave corners that close, for example. If no
valid mesh is found with the rest of it, the layer gives way near the worst cells, and if that does not help,
everywhere; also if the mesh is nearly inverted, where giving way at least doubles its minimum quality.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.errors import NumericalError
from mesh_motion_server.numerics.correction.trial_nodes import TrialMesh
from mesh_motion_server.numerics.motion.boundary_layer import BoundaryLayer
from mesh_motion_server.numerics.motion.motion_found import Motion

__all__ = ["LayerAttempts", "fitting_layer", "given_way"]

Floats = NDArray[np.float64]

NEARLY_INVERTED = 0.2
"""Share of the threshold below which a mesh is nearly inverted, and of a layer cell's quality in the reference mesh."""

_WORTH_IT = 2.0  # times the minimum quality with more of the layer


def fitting_layer(
    layer: BoundaryLayer, moved: Floats, mesh: TrialMesh, valid: Floats | None = None
) -> BoundaryLayer | None:
    """The layer without the cells that it would spoil and no correction could mend; itself if there is none.

    Parameters
    ----------
    layer : BoundaryLayer
    moved : (n, d) array, mesh length unit
        The moving nodes where they shall be, all others as in the reference mesh.
    mesh : TrialMesh
    valid : (n, d) array, mesh length unit, optional
        A valid mesh that a correction is to begin from: what of the layer gave way there does so here.
    """
    trial = moved.copy()
    trial[layer.nodes] = layer.carried(moved)
    if valid is not None:
        away = (valid != trial).any(axis=1)
        return layer.without(away) if away[layer.nodes].any() else layer
    known = layer.known
    inside = np.concatenate([known[block.nodes].all(axis=1) for block in layer.cells])
    numbers = np.flatnonzero(inside)
    spoiled = ~(mesh.quality_of(trial, numbers) > NEARLY_INVERTED * mesh.quality_of(layer.points, numbers))
    inside[numbers] = spoiled
    return layer.giving_way(inside) if spoiled.any() else layer


@dataclass(eq=False)
class LayerAttempts:
    """Which part of a boundary layer the next attempt keeps, by what the attempts before it gave.

    Attributes
    ----------
    layer : BoundaryLayer or None
        Of the next attempt.
    threshold : float
        Of the quality.
    least : float
        Minimum quality that an attempt with a layer must reach; otherwise there is none.
    best : (Motion, BoundaryLayer or None) or None
        What was accepted, and its layer.
    over : bool
        Whether ``best`` is the answer.
    """

    layer: BoundaryLayer | None
    threshold: float
    least: float = -math.inf
    best: tuple[Motion, BoundaryLayer | None] | None = None
    over: bool = False

    @property
    def answer(self) -> tuple[Motion, BoundaryLayer | None]:
        """The motion, and what is left of the layer; once it is over."""
        assert self.best is not None
        return self.best

    def accepted(self, motion: Motion) -> None:
        """The attempt gave this motion."""
        if self.best is None or motion.corrected.metric.min > _WORTH_IT * max(self.best[0].corrected.metric.min, 0.0):
            self.best = motion, self.layer
        self._go_on([cell.number for cell in motion.corrected.worst])

    def refused(self, refusal: NumericalError) -> None:
        """The attempt was refused.

        Raises
        ------
        NumericalError
            The refusal, where nothing is left to try.
        """
        if self.layer is None and self.best is None:
            raise refusal
        self._go_on(refusal.cells)

    def _go_on(self, cells: Sequence[int]) -> None:
        """What comes after an attempt with these worst cells."""
        minimum = -math.inf if self.best is None else self.best[0].corrected.metric.min
        settled = self.best is not None and (self.layer is None or minimum >= NEARLY_INVERTED * self.threshold)
        if self.layer is not None and not settled:
            self.layer = self.layer.without_near(cells)
        elif self.best is not None and self.best[1] is not None and minimum < self.least:
            self.layer = self.best = None
        else:
            self.over = True


def given_way(asked: BoundaryLayer, left: BoundaryLayer | None) -> list[str]:
    """A warning where nodes of a layer gave way."""
    gone = len(asked.nodes) - (0 if left is None else len(left.nodes))
    return [f"the boundary layer gave way at {gone} of its {len(asked.nodes)} nodes"] if gone else []
