"""A wave tank with a wall of paddles that is plane at rest, and nearly plane after the first step."""

import numpy as np
from frame_meshes import tensor_grid
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel

FIRST, SECOND = (-0.0107, -0.0101, -0.0094, -0.0086), (-0.0146, -0.0166, -0.0183, -0.0198)


def tank() -> MotionModel:
    points, cells = tensor_grid(np.linspace(0.0, 4.0, 41), np.linspace(0.0, 0.32, 9))
    node = np.arange(len(points)).reshape(41, 9)
    patches = {"paddles": Patch("moving", node[0]), "end": Patch("fixed", node[-1])}
    patches |= {"floor": Patch("slip", node[:, 0]), "top": Patch("slip", node[:, -1])}
    return MotionModel.build(points, CellTable.from_arrays({"quad": cells}), patches, Method())


def test_small_steps_of_the_wall_do_not_reach_far_into_the_domain() -> None:
    """Interpolated from the first step's mesh alone, some node moved by 0.20, ten times as far as the wall."""
    model = tank()
    wall = model.points[model.roles.moving]
    paddle = np.minimum(wall[:, 1] / 0.08, 3.0).astype(int)
    first, second = (wall + np.column_stack([np.array(x)[paddle], np.zeros(len(wall))]) for x in (FIRST, SECOND))
    committed = model.move(model.points, first).points
    found = model.move(committed, second)
    assert np.abs(found.points - model.points).max() == -min(SECOND)
    np.testing.assert_array_equal(found.points, model.move(model.points, second).points)
