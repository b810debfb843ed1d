"""A boundary layer in a mesh of two partitions, over the wire: carried as in one mesh."""

import numpy as np
from frame_meshes import rotation, square_frame
from two_partitions import moved_in_two_parts

from mesh_motion_server.numerics.method import Method
from mesh_motion_server.numerics.motion.motion import MotionModel

SETTINGS = {"support_radius": 0.5, "displacement": "absolute", "boundary_layer_thickness": 0.08, "correction": "none"}


def test_a_layer_across_partitions_moves_as_in_one_mesh() -> None:
    points, cells, patches = square_frame(30, kind="quad")
    model = MotionModel.build(points, cells, patches, Method(**SETTINGS))
    goal = (points - 0.5) @ rotation(15.0).T + 0.5
    expected = model.move(points, goal[model.roles.moving])
    found = moved_in_two_parts((points, cells, patches), SETTINGS, lambda nodes: goal[nodes] - points[nodes])
    np.testing.assert_allclose(found, expected.points, atol=1e-12)
    layer = model.standard_motion.layer
    np.testing.assert_allclose(found[layer.nodes], goal[layer.nodes], atol=1e-12)
