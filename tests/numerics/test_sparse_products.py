"""Products with sparse rows, and conjugate gradients with such matrices."""

import numpy as np
import pytest
from mesh_motion_numerics.interpolation.assembly import sparse_rows
from mesh_motion_numerics.interpolation.centres import CentreLayout
from mesh_motion_numerics.interpolation.evaluation import NearOperator
from mesh_motion_numerics.interpolation.factorizations.preconditioner import SparseInverse
from mesh_motion_numerics.interpolation.kernels import basis_named
from mesh_motion_numerics.interpolation.sparse_rows import SparseRows
from scipy.sparse import csr_array, random_array

C2 = basis_named("wendland-c2")


def _rows(matrix: csr_array) -> SparseRows:
    return SparseRows(matrix.indptr.astype(np.int32), matrix.indices.astype(np.int32), matrix.data)


@pytest.mark.parametrize("k", [1, 2, 3, 4, 5, 8, 12])
def test_products_are_those_of_the_dense_matrix(k: int) -> None:
    """A matrix with some empty rows."""
    rng = np.random.default_rng(k)
    matrix = csr_array(random_array((300, 200), density=0.02, rng=rng))
    rows, vectors = _rows(matrix), rng.normal(size=(200, k))
    np.testing.assert_allclose(rows.product(vectors), matrix.toarray() @ vectors, atol=1e-13)


@pytest.mark.parametrize("k", [1, 3, 4, 6])
def test_a_near_operator_and_its_transpose_are_those_of_the_dense_matrix(k: int) -> None:
    rng = np.random.default_rng(k)
    matrix, rows = csr_array(random_array((300, 200), density=0.02, rng=rng)), rng.permutation(400)[:300]
    operator, values, weights = NearOperator(rows, _rows(matrix)), np.zeros((400, k)), rng.normal(size=(200, k))
    operator.add(weights, values)
    np.testing.assert_allclose(values[rows], matrix.toarray() @ weights, atol=1e-13)
    counted = rng.normal(size=(400, k))
    np.testing.assert_allclose(operator.transpose(counted, 200), matrix.toarray().T @ counted[rows], atol=1e-13)


@pytest.mark.parametrize("k", [2, 3, 5])
def test_conjugate_gradients_solve_each_column(k: int) -> None:
    points = np.random.default_rng(k).random((2500, 3))  # more than one block of rows
    layout = CentreLayout.build(points, C2, 0.12)
    rows, inverse = sparse_rows(layout, C2, 0.12, points), SparseInverse(points, C2, 0.12, 16)
    matrix = rows.matrix(len(points))
    right = np.random.default_rng(1).normal(size=(2500, k))
    right[:, 1] = 0.0
    found = inverse.conjugate_gradients(rows, right, limit=1e-9, most=200)
    assert 1 < found.iterations < 200
    np.testing.assert_allclose(matrix @ found.solution, right, atol=2e-9)
    np.testing.assert_allclose(right - matrix @ found.solution, found.residual, atol=1e-12)
    np.testing.assert_array_equal(found.solution[:, 1], 0.0)
    assert inverse.conjugate_gradients(rows, right, limit=1e-9, most=2).iterations == 2
