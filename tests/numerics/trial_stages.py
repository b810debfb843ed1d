"""A standard motion as a field: its stages, one after the other, at any points."""

import numpy as np
from mesh_motion_numerics.motion.standard_motion import StandardTrial


def displacement_by(trial: StandardTrial, points: np.ndarray) -> np.ndarray:
    """(n, d) total displacement of points (n, d)."""
    moved = points
    for stage in trial.stages:
        moved = stage.positions(moved)
    return moved - points
