"""One displacement for a node of several parts: the tolerance, the choice, and refusals."""

import itertools

import numpy as np
import pytest
from mesh_motion_protocol.shared_nodes import AGREEMENT, Torn, united

EXTENT = 8.0


def test_the_larger_of_each_component_is_taken_whatever_the_order():
    rows = [np.array([[1.0, -0.0], [2.0, 2.0]]), np.array([[1.0 + 2e-16, 0.0]]), np.array([[1.0, 1e-9], [3.0, 3.0]])]
    places = [np.array([1, 0]), np.array([1]), np.array([1, 2])]
    found = {
        united([rows[i] for i in order], [places[i] for i in order], 3, EXTENT).tobytes()
        for order in itertools.permutations(range(3))
    }
    assert found == {np.array([[2.0, 2.0], [np.nextafter(1.0, 2), 1e-9], [3.0, 3.0]]).tobytes()}


def test_zeros_of_both_signs_are_one_and_a_lone_one_keeps_its_sign():
    zero, minus = np.zeros((1, 1)), np.full((1, 1), -0.0)
    at = np.array([0])
    assert united([zero, minus], [at, at], 1, 1.0).tobytes() == united([minus, zero], [at, at], 1, 1.0).tobytes()
    assert np.signbit(united([minus], [at], 1, 1.0)).all()


@pytest.mark.parametrize("size", [1e-20, 1.0, 1e20])
def test_the_tolerance_follows_the_mesh(size):
    at = [np.array([0]), np.array([1, 0])]
    rows = [np.array([[0.25 * size]]), np.array([[0.0], [(0.25 + 0.99 * AGREEMENT * EXTENT) * size]])]
    assert united(rows, at, 2, EXTENT * size)[0] == rows[1][1]
    rows[1][1] = (0.25 + 1.01 * AGREEMENT * EXTENT) * size
    with pytest.raises(Torn) as caught:
        united(rows, at, 2, EXTENT * size)
    assert (caught.value.place, caught.value.parts) == (0, (0, 1))
    np.testing.assert_array_equal(caught.value.values, [rows[0][0], rows[1][1]])


def test_no_rows_are_no_error():
    assert united([np.empty((0, 3))], [np.empty(0, dtype=np.int64)], 0, 1.0).shape == (0, 3)


def test_single_precision_is_rounding():
    exact = np.random.default_rng(0).uniform(-EXTENT, EXTENT, size=(1000, 3))
    at = np.arange(1000)
    united([exact, exact.astype(np.float32).astype(np.float64)], [at, at], 1000, EXTENT)
