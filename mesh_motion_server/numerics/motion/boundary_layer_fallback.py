"""A boundary layer gives way rather than spoil cells, or have a motion refused that is valid without it.

First go the layer's nodes in cells that carrying alone would spoil: in concave corners that close, for example. If no
valid mesh is found with the rest of it, the layer gives way near the worst cells, and if that does not help,
everywhere; also if the mesh is nearly inverted, where giving way at least doubles its minimum quality.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.errors import NumericalError
from mesh_motion_server.numerics.correction.trial_nodes import TrialMesh
from mesh_motion_server.numerics.motion.boundary_layer import BoundaryLayer
from mesh_motion_server.numerics.quality.quality_summary import Judgement

__all__ = ["fitting_layer", "given_way", "move_with_layer"]

Floats = NDArray[np.float64]

NEARLY_INVERTED = 0.2
"""Share of the threshold below which a mesh is nearly inverted, and of a layer cell's quality in the reference mesh."""

_WORTH_IT = 2.0  # times the minimum quality with more of the layer


class _Judged(Protocol):
    """A motion, with the quality of its mesh."""

    @property
    def corrected(self) -> Judgement: ...


_M = TypeVar("_M", bound=_Judged)


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


def move_with_layer(
    layer: BoundaryLayer | None, move: Callable[[BoundaryLayer | None], _M], threshold: float
) -> tuple[_M, BoundaryLayer | None]:
    """The motion, and what is left of the layer.

    Parameters
    ----------
    layer : BoundaryLayer or None
    move : callable
        The motion with a layer, or without one; raises NumericalError where it is refused.
    threshold : float
        Of the quality.

    Raises
    ------
    NumericalError
        If the motion is refused without a layer too.
    """
    best: tuple[_M, BoundaryLayer | None] | None = None
    while True:
        try:
            motion = move(layer)
        except NumericalError as refusal:
            if layer is None and best is None:
                raise
            cells = list(refusal.cells)
        else:
            if best is None or motion.corrected.metric.min > _WORTH_IT * max(best[0].corrected.metric.min, 0.0):
                best = motion, layer
            cells = [cell.number for cell in motion.corrected.worst]
        if best is not None and (layer is None or best[0].corrected.metric.min >= NEARLY_INVERTED * threshold):
            return best
        layer = None if layer is None else layer.without_near(cells)


def given_way(asked: BoundaryLayer, left: BoundaryLayer | None) -> list[str]:
    """A warning where nodes of a layer gave way."""
    gone = len(asked.nodes) - (0 if left is None else len(left.nodes))
    return [f"the boundary layer gave way at {gone} of its {len(asked.nodes)} nodes"] if gone else []
