"""Algorithm 1 on each kind of cell: reversed, compressed, turning, sheared."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mesh_motion_numerics.correction.enrichment.eigen_correction import eigen_correction


def corrected(B) -> np.ndarray:
    B = np.array(B, dtype=float)
    return B + eigen_correction(B - np.eye(len(B)))


@pytest.mark.parametrize(
    ("B", "expected"),
    [
        ([[-0.3]], [[0.1]]),
        ([[0.5]], [[0.6]]),
        (np.diag([2.0, -0.4]), np.diag([2.0, 0.1])),
        (np.diag([2.0, 0.0]), np.diag([2.0, 0.1])),
        (np.diag([-0.5, -0.4]), np.diag([0.1, 0.1])),  # valid by its determinant, yet reversed: Fig. 5.8
        (np.diag([2.0, 0.5]), np.diag([2.0, 0.6])),
        (np.diag([0.9, 3.0, 0.2]), np.diag([0.9, 3.0, 0.3])),
        (np.diag([-1.0, 3.0, -0.2]), np.diag([0.1, 3.0, 0.1])),
    ],
)
def test_scaling_along_the_axes(B, expected):
    np.testing.assert_allclose(corrected(B), expected, atol=1e-15)


def test_a_turning_cell_grows_in_both_directions():
    B = 0.4 * np.array([[np.cos(1.0), -np.sin(1.0)], [np.sin(1.0), np.cos(1.0)]])
    np.testing.assert_allclose(corrected(B), B + 0.05 * np.eye(2), atol=1e-15)
    B3 = np.eye(3)
    B3[:2, :2] = B
    np.testing.assert_allclose(corrected(B3), B3 + np.diag([0.05, 0.05, 0.0]), atol=1e-15)


def test_a_shear_is_not_blown_up():
    for shear in (1.0, 100.0):
        B = np.array([[1.0, shear], [0.0, 1.0]])
        np.testing.assert_allclose(corrected(B), B + 0.05 * np.eye(2), atol=1e-15)
    np.testing.assert_allclose(corrected([[-0.2, 1.0], [0.0, -0.2]]), [[0.1, 1.0], [0.0, 0.1]], atol=1e-15)


@given(seed=st.integers(0, 2**32 - 1), d=st.sampled_from([1, 2, 3]))
def test_real_directions_are_kept_and_inversions_mended(seed, d):
    B = np.eye(d) + np.random.default_rng(seed).normal(size=(d, d))
    new = corrected(B)
    values, vectors = np.linalg.eig(B)
    assert np.isfinite(new).all()
    if np.iscomplexobj(values) or np.linalg.cond(vectors) > 50:
        return
    np.testing.assert_allclose(new @ vectors / vectors, (new @ vectors / vectors)[:1].repeat(d, 0), rtol=1e-6)
    assert np.linalg.det(new) > 0
