"""A periodic mesh in two partitions over the wire: a pair's nodes may be on different ranks."""

import numpy as np
import pytest
from periodic_meshes import periodic_box, sector
from two_partitions import moved_in_two_parts

from mesh_motion_server.numerics.method import Method
from mesh_motion_server.numerics.motion.motion import MotionModel

SETTINGS = {"support_radius": 0.8, "displacement": "absolute", "correction_target": "maximum"}


@pytest.mark.parametrize(("make", "threshold"), [(periodic_box, 0.8), (sector, 0.2)])
def test_pairs_across_partitions_move_as_in_one_mesh(make, threshold: float) -> None:
    mesh, settings = make("quad", 10, ends="slip"), {**SETTINGS, "quality_threshold": threshold}
    model = MotionModel.build(*mesh, Method(**settings))
    shift = np.array([0.1, 0.25])
    expected = model.move(mesh[0], mesh[0][model.roles.moving] + shift).points
    found = moved_in_two_parts(mesh, settings, lambda nodes: np.tile(shift, (len(nodes), 1)))
    # the mesh is merged in another order of its cells, and a descent ends where little is gained
    np.testing.assert_allclose(found, expected, atol=1e-12 if threshold == 0.2 else 1e-3)
    periodic = model.standard_motion.periodic
    assert np.abs(periodic.tied(found, model.roles.moving) - found).max() <= 1e-15
