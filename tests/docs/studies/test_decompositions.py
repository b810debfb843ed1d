"""Each decomposition reproduces B, its rotations are rotations, and known deformations are recognised."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from docs.studies.thesis._decompositions import deformation, eigen, polar, qr, rotation_angle, svd

DIMENSIONS = pytest.mark.parametrize("d", [2, 3])


def turn(angle: float, axis: tuple[float, float, float] | None = None) -> np.ndarray:
    if axis is None:
        return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def transpose(a: np.ndarray) -> np.ndarray:
    return np.swapaxes(a, -1, -2)


@DIMENSIONS
@given(seed=st.integers(0, 2**32 - 1))
def test_reconstruction_and_proper_rotations(d, seed):
    B = deformation(np.random.default_rng(seed).normal(size=(20, d, d)))
    det, identity = np.linalg.det(B), np.broadcast_to(np.eye(d), B.shape)

    values, vectors = eigen(B)
    np.testing.assert_allclose(B @ vectors, vectors * values[:, None, :], atol=1e-12)
    assert (np.diff(values.real, axis=1) >= 0).all()

    rotation, stretch = polar(B)
    np.testing.assert_allclose(rotation @ stretch, B, atol=1e-13)
    np.testing.assert_allclose(stretch, transpose(stretch), atol=1e-13)
    assert ((np.linalg.eigvalsh(stretch)[:, 0] > 0) == (det > 0)).all()

    left, stretches, right = svd(B)
    np.testing.assert_allclose((left * stretches[:, None, :]) @ transpose(right), B, atol=1e-13)
    np.testing.assert_allclose(np.prod(stretches, axis=1), det, rtol=1e-9, atol=1e-12)
    assert (stretches[:, :-1] > 0).all()

    turned, triangle = qr(B)
    np.testing.assert_allclose(turned @ triangle, B, atol=1e-13)
    np.testing.assert_allclose(np.tril(triangle, -1), 0.0, atol=1e-14)
    diagonal = np.diagonal(triangle, axis1=1, axis2=2)
    assert (diagonal[:, :-1] > 0).all()
    assert (np.sign(diagonal[:, -1]) == np.sign(det)).all()

    for Q in (rotation, left, right, turned):
        np.testing.assert_allclose(Q @ transpose(Q), identity, atol=1e-13)
        np.testing.assert_allclose(np.linalg.det(Q), 1.0, rtol=1e-12)


@pytest.mark.parametrize("angle", [0.0, 0.3, 1.0, np.pi / 2, 2.5])
@pytest.mark.parametrize("axis", [None, (0, 0, 1), (1, 2, -2)])
def test_a_turned_and_stretched_cell_is_split_into_turn_and_stretch(angle, axis):
    Q = turn(angle, axis)
    stretch = np.diag([2.0, 0.5, 1.0][: len(Q)])
    found = polar((Q @ stretch)[None])
    np.testing.assert_allclose(found.rotation[0], Q, atol=1e-15)
    np.testing.assert_allclose(found.stretch[0], stretch, atol=1e-15)
    assert rotation_angle(found.rotation)[0] == pytest.approx(angle, abs=1e-15)
    assert rotation_angle(qr((Q @ stretch)[None]).rotation)[0] == pytest.approx(angle, abs=1e-15)


@DIMENSIONS
def test_an_inverted_cell_has_one_negative_stretch_and_a_rotation(d):
    B = np.diag([1.5, -0.2, 1.1][:d])[None]
    assert svd(B).stretches[0, -1] == pytest.approx(-0.2)
    np.testing.assert_allclose(polar(B).rotation[0], np.eye(d), atol=1e-15)  # not a reflection: thesis (5.12)
    assert np.linalg.eigvalsh(polar(B).stretch[0])[0] == pytest.approx(-0.2)


def test_two_reversed_directions_are_half_a_turn():
    """Thesis Fig. 5.8: the determinant does not see it, the polar decomposition calls it a rotation."""
    B = np.diag([-0.3, -0.6])[None]
    assert (eigen(B).values.real < 0).all()
    assert abs(rotation_angle(polar(B).rotation)[0]) == pytest.approx(np.pi)
    assert sorted(svd(B).stretches[0]) == pytest.approx([0.3, 0.6])


@DIMENSIONS
def test_a_collapsed_cell_is_no_error(d):
    B = np.zeros((1, d, d))
    B[0, 0, 0] = 1.0
    for decomposition in (polar, svd, qr, eigen):
        for part in decomposition(B):
            assert np.isfinite(part).all()
