"""The Newton iterations: descent, held nodes, both linear solvers, convergence."""

import mesh_motion_kernels as kernels
import numpy as np
import pytest
from box_meshes import shaken
from mesh_motion_numerics.correction.distortion import PNorm, distortion_gradient, mean_distortion
from mesh_motion_numerics.correction.free_region import gathered
from mesh_motion_numerics.correction.newton import Accuracy, newton
from scipy.sparse import csr_matrix, diags, eye, kron
from scipy.sparse.csgraph import connected_components


@pytest.mark.parametrize("kind", ["quad", "tetra", "pyramid"])
def test_a_shaken_box_mesh_finds_back(kind: str) -> None:
    points, region = shaken(kind, 0.015)
    norm = PNorm(2, 1)
    before, _ = mean_distortion(points, region.simplices, norm)
    result = newton(points, region, norm, iterations=30)
    assert result.distortion < before
    assert result.distortion == mean_distortion(result.points, region.simplices, norm)[0]
    assert np.array_equal(result.points[region.n_free :], points[region.n_free :])
    if kind == "quad":  # every quad a square again: the best there is
        assert result.distortion == pytest.approx(0.0, abs=1e-3)  # where a full step gains less
        assert result.iterations < 10


EXACT = Accuracy(full_step_gain=1e-14, least_decrement=1e-14, least_gain=1e-14)


def test_factorized_and_iterated_steps_agree() -> None:
    points, region = shaken("tetra", 0.015)
    direct = newton(points, region, PNorm(2, 1), iterations=20)
    accuracy = Accuracy(direct_unknowns=0, cg_reduction=1e-10, cg_iterations=2000)
    iterated = newton(points, region, PNorm(2, 1), iterations=20, accuracy=accuracy)
    np.testing.assert_allclose(iterated.points, direct.points, atol=1e-6)


def test_the_stationary_point_has_no_gradient() -> None:
    points, region = shaken("tetra", 0.01)
    norm = PNorm(8, 2)
    result = newton(points, region, norm, iterations=60, accuracy=EXACT)
    _, weights = mean_distortion(result.points, region.simplices, norm)
    gradient = gathered(region.adjacency, distortion_gradient(result.points, region.simplices, weights, norm))
    assert np.abs(gradient).max() < 1e-4


def grid_laplacian(n: int) -> csr_matrix:
    line = diags([-1.0, 2.0, -1.0], [-1, 0, 1], shape=(n, n))
    matrix = (kron(line, eye(n)) + kron(eye(n), line)).tocoo()
    order = np.lexsort((matrix.col != matrix.row, matrix.row))
    starts = np.concatenate([[0], np.cumsum(np.bincount(matrix.row, minlength=n * n))])
    return csr_matrix((matrix.data[order], matrix.col[order], starts), shape=matrix.shape)


def test_aggregates_are_neighbours_of_about_the_size() -> None:
    matrix = grid_laplacian(60)
    found = kernels.node_aggregates(matrix.indptr.astype(np.int64), matrix.indices.astype(np.int32), 64)
    within = matrix.multiply(found[:, None] == found[None, :]).tocsr()
    within.eliminate_zeros()
    sizes = np.bincount(found)
    assert connected_components(within)[0] == len(sizes)
    assert 64 // 4 <= sizes.min() <= 64 <= sizes.max() <= 3 * 64


def test_the_coarse_level_spares_most_iterations() -> None:
    matrix = grid_laplacian(60)
    starts, columns = matrix.indptr.astype(np.int64), matrix.indices.astype(np.int32)
    right, step = np.random.default_rng(1).normal(size=(matrix.shape[0], 1)), np.empty((matrix.shape[0], 1))
    system = starts, columns, matrix.data[:, None, None]
    made = []
    for size in (64, len(step)):
        aggregates = kernels.node_aggregates(starts, columns, size)
        made.append(kernels.block_conjugate_gradients(*system, aggregates, right, 1e-8, 1000, step))
        np.testing.assert_allclose(matrix @ step, right, atol=1e-6)
    assert made[0] < 0.6 * made[1]


def test_it_stops_when_it_is_good_enough() -> None:
    points, region = shaken("tetra", 0.015)
    asked: list[int] = []

    def good_enough(_: np.ndarray) -> bool:
        asked.append(1)
        return True

    assert newton(points, region, PNorm(2, 1), good_enough=good_enough).iterations == 2
    assert len(asked) == 1


def test_nothing_happens_beyond_the_barrier() -> None:
    points, region = shaken("quad", 0.015)
    points[0] += 1.0
    result = newton(points, region, PNorm(2, 1))
    assert result.iterations == 0
    assert np.array_equal(result.points, points)


@pytest.mark.parametrize("d", [1, 2, 3])
def test_the_block_factorization_solves_what_is_positive_definite_and_refuses_the_rest(d: int) -> None:
    grid, rng = grid_laplacian(17), np.random.default_rng(d)
    starts, columns = grid.indptr.astype(np.int64), grid.indices.astype(np.int32)
    n, rows = len(starts) - 1, np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    blocks = rng.normal(size=(len(columns), d, d))
    blocks[starts[:-1]] += 12.0 * d * np.eye(d)
    whole = np.zeros((n, d, n, d))
    whole[rows, :, columns] = blocks
    whole += whole.transpose(2, 3, 0, 1)
    blocks = np.ascontiguousarray(whole[rows, :, columns])
    order, ends, below = kernels.elimination(starts, columns, rng.normal(size=(n, 2)))
    assert np.array_equal(np.sort(order), np.arange(n))
    right, found = rng.normal(size=(n, d)), np.full((n, d), np.nan)
    factor = np.empty((n, d, d)), np.empty((len(below), d, d))
    assert kernels.block_cholesky(starts, columns, blocks, order, ends, below, *factor)
    kernels.block_cholesky_solve(order, ends, below, *factor, right, found)
    expected = np.linalg.solve(whole.reshape(n * d, n * d), right.ravel())
    np.testing.assert_allclose(found.ravel(), expected, atol=1e-12 * np.abs(expected).max())
    if d == 1:
        columns_of_it = np.stack([(c + 1.0) * right[:, 0] for c in range(6)], axis=1)
        together = np.full((n, 6), np.nan)
        kernels.block_cholesky_solve(order, ends, below, *factor, columns_of_it, together)
        np.testing.assert_allclose(together, found * np.arange(1.0, 7.0), rtol=1e-12)
    blocks[starts[n // 2]] -= 200.0 * np.eye(d)
    assert not kernels.block_cholesky(starts, columns, blocks, order, ends, below, *factor)


def test_nested_dissection_has_little_fill() -> None:
    n = 60
    grid, places = grid_laplacian(n), np.argwhere(np.ones((n, n))).astype(float, order="C")
    *_, below = kernels.elimination(grid.indptr.astype(np.int64), grid.indices.astype(np.int32), places)
    assert (
        len(below) < 10 * n**2 * np.log2(n) / 2
    )  # George's bound for a square is 31/4 n² log₂ n; a band would have n³
