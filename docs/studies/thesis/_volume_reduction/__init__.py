"""Volume reduction: sums over control points are evaluated at fewer places than there are nodes (thesis §2.2.1).

One algorithm per module, all called ``reduce(problem) -> VolumeField``; :data:`VOLUME_REDUCTIONS` chooses by name. The
moving boundary is exact with each: its nodes are set to their targets in any case, and there the fields agree with the
targets.

==================  =======================================================================  ======================
name                what it does                                                             ``length``
==================  =======================================================================  ======================
enclosing-box       nodes outside a box around the body rest: :mod:`.enclosing_box`          margin around the body
wall-function       displacement fades out at a distance D: :mod:`.wall_function`            D
background-grid     sums at the points of a coarse grid: :mod:`.background_grid`             spacing of the grid
==================  =======================================================================  ======================
"""

from __future__ import annotations

from collections.abc import Callable

from docs.studies.thesis._volume_reduction import background_grid, enclosing_box, wall_function
from docs.studies.thesis._volume_reduction.problem import (
    Field,
    VolumeDisplacement,
    VolumeField,
    VolumeProblem,
)

__all__ = [
    "VOLUME_REDUCTIONS",
    "Field",
    "VolumeDisplacement",
    "VolumeField",
    "VolumeProblem",
]

VOLUME_REDUCTIONS: dict[str, Callable[[VolumeProblem], VolumeField]] = {
    "enclosing-box": enclosing_box.reduce,
    "wall-function": wall_function.reduce,
    "background-grid": background_grid.reduce,
}
