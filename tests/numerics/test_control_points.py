import numpy as np
import pytest
from mesh_motion_numerics.interpolation.control_points import checked_control_points
from mesh_motion_protocol.errors import InvalidInput


def test_a_copy_comes_back():
    points = np.random.default_rng(0).random((5, 3)).astype(np.float32)
    checked = checked_control_points(points)
    assert checked.dtype == np.float64
    assert checked.flags["C_CONTIGUOUS"]
    assert np.array_equal(checked, points)


@pytest.mark.parametrize("copies", [2, 3])
@pytest.mark.parametrize("offset", [0.0, 1e-14])
def test_two_that_coincide_are_named(copies, offset):
    points = np.random.default_rng(0).random((50, 3))
    points[[11, 30, 41][:copies]] = points[11]
    points[30] += offset
    with pytest.raises(InvalidInput, match=r"control points 11 and (30|41) coincide") as caught:
        checked_control_points(points)
    assert caught.value.details["control_points"][0] == 11


def test_close_points_of_a_fine_mesh_are_fine():
    points = np.linspace(0, 1e-9, 5)[:, None] + [[0.0, 0.0]] * 5
    assert len(checked_control_points(np.vstack([points, [[1.0, 1.0]]]))) == 6
