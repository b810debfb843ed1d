"""Small meshes judged relative to rest are raised beyond the threshold, but not near walls, and not if that reduces
areas.
"""

import numpy as np
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel
from mesh_motion_numerics.quality.metrics import cell_quality, cells_at_rest

AROUND, LAYERS = 48, 12


def cascade(*, split: bool = False) -> tuple[np.ndarray, CellTable, dict[str, Patch]]:
    """A stretched O-grid about an inclined blade in a passage as high as the blade is long."""
    angle = 2.0 * np.pi * np.arange(AROUND) / AROUND
    turn = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])
    blade = np.column_stack([0.5 * np.cos(angle), 0.06 * np.sin(angle)]) @ turn
    side = np.column_stack([np.cos(angle - 0.4), np.sin(angle - 0.4)])
    side *= np.array([1.2, 0.5]) / np.abs(side).max(axis=1)[:, None]
    share = ((1.5 ** np.arange(LAYERS + 1) - 1.0) / (1.5**LAYERS - 1.0))[:, None, None]
    points = (blade * (1.0 - share) + side * share).reshape(-1, 2)
    i, j = np.arange(AROUND), np.roll(np.arange(AROUND), -1)
    quads = np.concatenate([np.column_stack([i, i + AROUND, j + AROUND, j]) + k * AROUND for k in range(LAYERS)])
    kind = {"triangle": np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])} if split else {"quad": quads}
    patches = {"blade": Patch("moving", i), "sides": Patch("fixed", i + LAYERS * AROUND)}
    return points, CellTable.from_arrays(kind), patches


def model_of(mesh: tuple[np.ndarray, CellTable, dict[str, Patch]] | None = None, **choices: object) -> MotionModel:
    points, cells, patches = mesh or cascade()
    return MotionModel.build(points, cells, patches, Method(**choices))


def pitched(model: MotionModel, degrees: float, shift: float = 0.0) -> np.ndarray:
    """Targets: the blade turned about its middle and shifted upwards."""
    a = np.radians(degrees)
    turn = np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
    return model.points[model.roles.moving] @ turn.T + [0.0, shift]


def extremes(model: MotionModel, points: np.ndarray) -> tuple[float, float]:
    return cell_quality(points, model.cells, cells_at_rest(model.points, model.cells)).relative_extremes()


def test_a_mesh_above_the_threshold_is_left_as_it_was_interpolated() -> None:
    targets = pitched(model_of(), 15.0, 0.1)
    other_metric = {"quality_metric": "size-skew", "quality_threshold": 0.02}
    for choices in ({"displacement": "relative"}, other_metric, {"correction_target": "threshold"}):
        model = model_of(**choices)
        plain = model_of(**choices, correction="none").move(model.points, targets)
        assert plain.reached
        assert np.array_equal(model.move(model.points, targets).points, plain.points)


def test_in_short_steps_no_node_jumps() -> None:
    """A flow solver interprets a displacement within a time step as a velocity."""
    model = model_of()
    committed, ratios = model.points, []
    for share in np.linspace(0.0, 1.0, 61)[1:]:
        motion = model.move(committed, pitched(model, 15.0 * share, 0.1 * share))
        steps = np.linalg.norm(motion.points - committed, axis=1)
        ratios.append(steps.max() / steps[model.roles.moving].max())
        committed = motion.points
    assert max(ratios) < 1.6  # one and a half times, or the interpolation's own
