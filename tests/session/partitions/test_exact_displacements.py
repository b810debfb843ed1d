"""A Move's answer, made without temporary arrays, equals that from whole arrays."""

import numpy as np
import pytest

from mesh_motion_server.session.partitions.exact_displacements import differences_of, settle


@pytest.mark.parametrize("count", [1, 63, 40_001, 400_001])
@pytest.mark.parametrize("offset", [0.0, 100.0])
@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_the_answer_is_that_of_whole_arrays(count: int, offset: float, dimension: int) -> None:
    random = np.random.default_rng(count)
    base = offset + random.normal(size=(count, dimension))
    nodes = np.unique(random.integers(0, count, 1 + count // 9))
    prescribed = random.normal(size=(len(nodes), dimension))
    moved = base + 0.3 * random.normal(size=base.shape)
    moved[nodes] = base[nodes] + prescribed
    displacement = moved - base
    displacement[nodes] = prescribed
    rows = random.integers(0, count, 2 * count)
    np.testing.assert_array_equal(differences_of(moved, base, rows), (moved - base)[rows])
    settled = moved.copy()
    exact = settle(settled, base, nodes, prescribed)
    np.testing.assert_array_equal(settled, base + displacement)
    np.testing.assert_array_equal(settled[nodes], moved[nodes])
    assert exact == np.array_equal(settled, moved)


def test_sums_that_round_elsewhere_are_found() -> None:
    base, moved = np.full((9, 2), 1.0), np.full((9, 2), 1.0)
    moved[4, 1] = 1e-30  # 1 + (1e-30 - 1) is 0
    none = np.empty(0, dtype=np.int64)
    assert not settle(moved.copy(), base, none, np.empty((0, 2)))
    assert not settle(moved.copy(), base, np.array([4]), moved[4:5] - base[4:5])
    moved[4, 1] = 1.5
    assert settle(moved.copy(), base, none, np.empty((0, 2)))
    assert settle(moved.copy(), base, np.array([4]), np.array([[0.0, 0.5]]))


def test_a_node_may_have_another_position_than_it_was_moved_to() -> None:
    base = np.zeros((3, 1))
    settled = base.copy()
    assert not settle(settled, base, np.array([1]), np.array([[0.25]]))
    np.testing.assert_array_equal(settled[:, 0], [0.0, 0.25, 0.0])
