"""Layers of a given thickness, whatever their cells look like: how they are carried is tested on small meshes."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

from mesh_motion_numerics.motion.boundary_layer import BoundaryLayer


def with_layer(model: Any, patches: Any, thickness: float, *, offered: bool = False) -> Any:
    """The model, whose walls carry nodes up to a thickness always, or (``offered``) where that does no harm."""
    sliding = model.standard_motion.sliding
    layer = BoundaryLayer.build(model.points, model.cells, patches, thickness=thickness, sliding=sliding)
    if offered:
        return replace(model, layered=SimpleNamespace(layer=layer, needed_for=lambda moved, corrected: layer))
    return replace(model, standard_motion=model.standard_motion.with_layer(layer), layered=None)
