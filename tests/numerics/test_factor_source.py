"""Names of states: equal for equal bits, and different for any likely other state."""

import numpy as np
import pytest
from mesh_motion_numerics.interpolation.factor_source import point_digest


@pytest.mark.parametrize("shape", [(0, 3), (1, 1), (5, 2), (4000, 3), (9000, 3)])
def test_equal_bits_have_equal_names(shape: tuple[int, int]) -> None:
    points = np.random.default_rng(0).random(shape)
    frozen = points.view()
    frozen.flags.writeable = False
    assert point_digest(points) == point_digest(points.copy()) == point_digest(frozen)
    assert len(point_digest(points)) == 32


def test_whatever_differs_has_another_name() -> None:
    points = np.random.default_rng(0).random((3000, 3))
    names = {point_digest(points), point_digest(points.reshape(-1, 2)), point_digest(points[:-1])}
    for row in (0, 1500, 2999):
        for axis in range(3):
            other = points.copy()
            other[row, axis] = np.nextafter(other[row, axis], 2.0)
            names.add(point_digest(other))
    mirrored, swapped = points.copy(), points.copy()
    mirrored[:, 1] *= -1.0
    swapped[[10, 20]] = swapped[[20, 10]]
    zero, minus = np.zeros((4, 3)), np.zeros((4, 3))
    minus[2, 1] = -0.0
    names |= {point_digest(each) for each in (mirrored, swapped, zero, minus)}
    assert len(names) == 3 + 9 + 4
