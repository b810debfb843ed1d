"""Products with sparse rows, four columns at a time or as they come."""

import numpy as np
import pytest
from scipy.sparse import csr_array, random_array

from mesh_motion_server.numerics.sparse_products import in_lanes, product


@pytest.mark.parametrize("k", [1, 2, 3, 4, 5, 8, 12])
def test_products_are_those_of_the_dense_matrix(k: int) -> None:
    rng = np.random.default_rng(k)
    matrix = csr_array(random_array((300, 200), density=0.05, rng=rng))
    vectors = rng.normal(size=(200, k))
    expected = matrix.toarray() @ vectors
    np.testing.assert_allclose(product(matrix, vectors), expected, atol=1e-13)
    np.testing.assert_allclose(product(matrix, in_lanes(vectors))[:, :k], expected, atol=1e-13)


def test_lanes_are_filled_with_zeros() -> None:
    vectors = np.arange(6.0).reshape(2, 3)
    np.testing.assert_array_equal(in_lanes(vectors), [[0, 1, 2, 0], [3, 4, 5, 0]])
    whole = np.ones((3, 8))
    assert in_lanes(whole) is whole


def test_an_empty_row_is_zero() -> None:
    matrix = csr_array(
        (np.array([2.0]), np.array([1], dtype=np.int32), np.array([0, 0, 1], dtype=np.int32)), shape=(2, 3)
    )
    np.testing.assert_array_equal(product(matrix, np.ones((3, 4))), [[0.0] * 4, [2.0] * 4])
