"""Layers of a given thickness, for any cells: tests use small meshes for the carrying of layers."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

from mesh_motion_numerics.motion.boundary_layer import BoundaryLayer


def with_layer(model: Any, patches: Any, thickness: float, *, offered: bool = False) -> Any:
    """The model, whose walls always carry nodes up to a thickness, or (with ``offered``) only if that does no harm."""
    sliding = model.standard_motion.sliding
    layer = BoundaryLayer.build(model.points, model.cells, patches, thickness=thickness, sliding=sliding)
    if offered:
        return replace(model, layered=SimpleNamespace(layer=layer, thin=True, spoiled_by=lambda moved: True))
    return replace(model, standard_motion=model.standard_motion.with_layer(layer), layered=None)
