"""Corrections by polar, singular value and QR stretches: what each preserves, and what it repairs."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from docs.studies.thesis._cell_corrections import CELL_CORRECTIONS
from docs.studies.thesis._decompositions import polar, qr, svd

ALL = pytest.mark.parametrize("name", CELL_CORRECTIONS)


def corrected(name: str, B) -> np.ndarray:
    B = np.array(B, dtype=float)
    return B + CELL_CORRECTIONS[name](B - np.eye(len(B)))


@ALL
@pytest.mark.parametrize(
    ("B", "expected"),
    [
        ([[-0.3]], [[0.1]]),
        (np.diag([2.0, -0.4]), np.diag([2.0, 0.1])),
        (np.diag([2.0, 0.5]), np.diag([2.0, 0.6])),
        (np.diag([0.9, 3.0, 0.2]), np.diag([0.9, 3.0, 0.3])),
    ],
)
def test_scaling_along_the_axes_is_the_same_for_all(name: str, B, expected) -> None:
    expected = np.array(expected)
    if name == "svd" and np.linalg.det(B) > 0:  # takes from the largest what it gives to the smallest
        expected = expected - 0.1 * (expected == expected.max())
    np.testing.assert_allclose(corrected(name, B), expected, atol=1e-14)


@given(seed=st.integers(0, 2**32 - 1), d=st.sampled_from([2, 3]))
def test_rotations_are_kept_and_small_stretches_grow(seed: int, d: int) -> None:
    B = np.eye(d) + np.random.default_rng(seed).normal(size=(d, d))
    before = svd(B[None]).stretches[0]
    after = svd(corrected("polar", B)[None]).stretches[0]
    np.testing.assert_allclose(polar(corrected("polar", B)[None]).rotation, polar(B[None]).rotation, atol=1e-8)
    expected = np.where(before <= 0, 0.1, before)
    if (before > 0).all():
        expected[np.argmin(expected)] += 0.1
    np.testing.assert_allclose(np.sort(after), np.sort(expected), atol=1e-9)
    assert np.linalg.cond(corrected("svd", B)) <= np.linalg.cond(corrected("polar", B)) + 1e-9
    split, again = qr(B[None]), qr(corrected("qr", B)[None])
    np.testing.assert_allclose(again.rotation, split.rotation, atol=1e-9)
    np.testing.assert_allclose(np.triu(again.triangle[0], 1), np.triu(split.triangle[0], 1), atol=1e-9)


@given(seed=st.integers(0, 2**32 - 1), d=st.sampled_from([2, 3]))
@ALL
def test_an_inverted_cell_becomes_valid(seed: int, d: int, name: str) -> None:
    B = np.eye(d) + np.random.default_rng(seed).normal(size=(d, d))
    if np.linalg.det(B) > 0 or (name == "eigen" and np.linalg.cond(np.linalg.eig(B)[1]) > 100):
        return
    assert np.linalg.det(corrected(name, B)) > 0


@given(seed=st.integers(0, 2**32 - 1))
def test_polar_and_svd_do_not_depend_on_the_coordinates(seed: int) -> None:
    rng = np.random.default_rng(seed)
    B, (turn, _) = np.eye(3) + rng.normal(size=(3, 3)), np.linalg.qr(rng.normal(size=(3, 3)))
    for name in ("polar", "svd"):
        turned = corrected(name, turn @ B @ turn.T)
        np.testing.assert_allclose(turned, turn @ corrected(name, B) @ turn.T, atol=1e-7)
