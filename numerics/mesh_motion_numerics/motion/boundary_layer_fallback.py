"""A boundary layer gives way where it would spoil cells, or where a motion is valid only without it.

First the layer loses its nodes in cells that it would spoil by itself, for example in concave corners that close. If no
valid mesh is found with the rest, the layer gives way near the worst cells, and if that does not help, everywhere. It
also gives way if the mesh is nearly inverted and its minimum quality at least doubles without the layer.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mesh_motion_protocol.errors import QualityRefused

from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.correction.trial_nodes import TrialMesh
from mesh_motion_numerics.motion.boundary_layer import BoundaryLayer
from mesh_motion_numerics.motion.motion_found import Motion

__all__ = ["LayerAttempts", "fitting_layer", "given_way"]


NEARLY_INVERTED = 0.2
"""Share of the threshold below which a mesh is nearly inverted, and of a layer cell's quality in the reference mesh."""

_WORTH_IT = 2.0  # factor on the minimum quality that justifies a smaller layer


def fitting_layer(
    layer: BoundaryLayer, moved: Floats, mesh: TrialMesh, valid: Floats | None = None
) -> BoundaryLayer | None:
    """The layer without the cells that it would spoil and no correction could repair; unchanged if there are none.

    Parameters
    ----------
    moved : (n, d) array, mesh length unit
        The moving nodes at their targets, all others as in the reference mesh.
    valid : (n, d) array, mesh length unit, optional
        A valid mesh from which a correction will begin: the layer's parts that gave way there also give way here.
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
    """Decides from the earlier attempts which part of a boundary layer the next attempt keeps.

    Attributes
    ----------
    layer : BoundaryLayer or None
        The layer of the next attempt.
    threshold : float
        The quality threshold.
    least : float
        Minimum quality that an attempt with a layer must reach; below it, the next attempt has no layer.
    best : (Motion, BoundaryLayer or None) or None
        The accepted motion and its layer.
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
        """The motion and the rest of the layer; only once ``over``."""
        assert self.best is not None
        return self.best

    def accepted(self, motion: Motion) -> None:
        """Record the motion of an accepted attempt."""
        if self.best is None or motion.corrected.metric.min > _WORTH_IT * max(self.best[0].corrected.metric.min, 0.0):
            self.best = motion, self.layer
        self._go_on([cell.number for cell in motion.corrected.worst])

    def refused(self, refusal: QualityRefused) -> None:
        """Record a refused attempt.

        Raises
        ------
        QualityRefused
            The refusal, if nothing is left to try.
        """
        if self.layer is None and self.best is None:
            raise refusal
        self._go_on(refusal.cells)

    def _go_on(self, cells: Sequence[int]) -> None:
        """Choose the layer of the next attempt after one with these worst cells."""
        minimum = -math.inf if self.best is None else self.best[0].corrected.metric.min
        settled = self.best is not None and (self.layer is None or minimum >= NEARLY_INVERTED * self.threshold)
        if self.layer is not None and not settled:
            self.layer = self.layer.without_near(cells)
        elif self.best is not None and self.best[1] is not None and minimum < self.least:
            self.layer = self.best = None
        else:
            self.over = True


def given_way(asked: BoundaryLayer, left: BoundaryLayer | None) -> list[str]:
    """A warning if nodes of a layer gave way."""
    gone = len(asked.nodes) - (0 if left is None else len(left.nodes))
    return [f"the boundary layer gave way at {gone} of its {len(asked.nodes)} nodes"] if gone else []
