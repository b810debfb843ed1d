import os

import numpy as np
import pytest
from mesh_motion_numerics.arrays import bytes_of
from mesh_motion_numerics.interpolation.factorizations.dense import PanelCholesky
from mesh_motion_protocol.errors import QualityRefused
from scipy.linalg import lapack


def random_definite(n, seed=0):
    a = np.random.default_rng(seed).standard_normal((n, n))
    return a @ a.T + n * np.eye(n)


def panels_of(matrix):
    return lambda first, last: matrix[first:, first:last].copy()


@pytest.mark.parametrize("n", [1, 2, 383, 384, 385, 1000, 1537])  # around multiples of the panel's width
def test_solutions(n):
    matrix = random_definite(n)
    rhs = np.random.default_rng(1).standard_normal((n, 3))
    factor = PanelCholesky(n, panels_of(matrix))
    assert np.allclose(matrix @ factor.solve(rhs), rhs, rtol=0, atol=1e-11)


def test_only_the_lower_triangle_is_stored():
    factor = PanelCholesky(1500, panels_of(random_definite(1500)))
    assert bytes_of(factor) <= 0.7 * 8 * 1500**2


def test_the_right_hand_side_is_left_alone():
    rhs = np.ones((50, 2))
    PanelCholesky(50, panels_of(random_definite(50))).solve(rhs)
    assert (rhs == 1).all()


@pytest.mark.parametrize("bad", [0, 511, 512, 700])
def test_a_lost_pivot_is_an_error(bad):
    matrix = random_definite(800)
    matrix[bad] = matrix[:, bad] = 0.0
    with pytest.raises(QualityRefused, match="singular to working precision"):
        PanelCholesky(800, panels_of(matrix))


def test_a_pivot_of_rounding_is_an_error():
    matrix = np.array([[1.0, 1.0], [1.0, 1.0 + 1e-15]])
    with pytest.raises(QualityRefused, match="singular"):
        PanelCholesky(2, panels_of(matrix))


def test_the_library_sees_small_blocks_only(monkeypatch):
    orders = []
    library = lapack.dpotrf
    monkeypatch.setattr(lapack, "dpotrf", lambda block, **how: orders.append(len(block)) or library(block, **how))
    PanelCholesky(2000, panels_of(random_definite(2000)))
    assert sum(orders) == 2000
    assert max(orders) <= 512


@pytest.mark.slow
@pytest.mark.skipif("MESH_MOTION_LARGE_TESTS" not in os.environ, reason="half a minute to minutes, 1.3 GB")
def test_an_order_at_which_the_library_s_own_factorization_crashes():
    n = 17_896  # two threads of OpenBLAS end the process there; half a matrix is 1.3 GB

    def panel(first, last):
        # φ = exp(−|i − j|/10): Toeplitz, definite, its inverse tridiagonal
        return np.exp(-np.abs(np.arange(first, n)[:, None] - np.arange(first, last)) / 10.0)

    factor = PanelCholesky(n, panel)
    x = np.cos(np.arange(n) / 1000.0)[:, None]
    ahead, behind = np.zeros_like(x), np.zeros_like(x)  # the matrix product by two recursions
    decay = np.exp(-0.1)
    for i in range(1, n):
        behind[i] = decay * (behind[i - 1] + x[i - 1])
        ahead[n - 1 - i] = decay * (ahead[n - i] + x[n - i])
    assert np.allclose(factor.solve(x + ahead + behind), x, rtol=0, atol=1e-9)
