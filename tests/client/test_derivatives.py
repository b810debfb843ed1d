"""Derivatives through the client: shapes, the chosen state, and their use by an optimiser."""

import numpy as np
import pytest
from client_square import SIDE, bulge, square
from mesh_motion_client import InvalidInput, SessionError, connect


@pytest.fixture(scope="module")
def session():
    with connect() as server, server.open(square()) as opened:
        yield opened


def test_vectors_one_by_one_and_together(session):
    assert session.derivatives
    session.move(bulge(0.2))
    v = np.random.default_rng(1).standard_normal((3, SIDE, 2))
    together = session.tangent(v)
    assert together.shape == (3, SIDE * SIDE, 2)
    for one, found in zip(v, together, strict=True):
        assert (session.tangent(one) == found).all()
    w = np.random.default_rng(2).standard_normal((3, SIDE * SIDE, 2))
    back = session.cotangent(w)
    assert back.shape == v.shape
    assert session.cotangent(w[0]).tobytes() == back[0].tobytes()
    np.testing.assert_allclose(np.einsum("cij,cij->c", w, together), np.einsum("cij,cij->c", back, v), rtol=1e-10)
    session.rollback()


def test_a_trial_knows_where_it_is(session):
    first = session.move(bulge(0.1))
    second = session.move(bulge(0.2))
    v = np.ones((SIDE, 2))
    with pytest.raises(SessionError, match="iteration 1, is not where the session is"):
        first.tangent(v)
    at_trial, weights = second.tangent(v), second.cotangent(second.displacement)
    session.commit()
    assert (second.tangent(v) == at_trial).all()
    assert (second.cotangent(second.displacement) == weights).all()
    session.move(bulge(0.1))
    assert (second.tangent(v) == at_trial).all()
    assert (session.tangent(v, "committed") == at_trial).all()
    session.commit()
    with pytest.raises(SessionError, match="is not where the session is"):
        second.tangent(v)


def test_wrong_shapes_are_refused_here(session):
    with pytest.raises(InvalidInput, match=r"velocity: expected shape \(9, 2\) or \(c, 9, 2\), c ≥ 1, got \(8, 2\)"):
        session.tangent(np.ones((8, 2)))
    with pytest.raises(InvalidInput, match=r"velocity: .* c ≥ 1, got \(0, 9, 2\)"):
        session.tangent(np.ones((0, 9, 2)))
    with pytest.raises(InvalidInput, match=r"weights: expected shape \(81, 2\) or \(c, 81, 2\), c ≥ 1, got \(80, 2\)"):
        session.cotangent(np.ones((80, 2)))


@pytest.mark.parametrize(
    "wrong", [np.full((SIDE, 2), 1j), [["a", "b"]] * SIDE, np.ma.masked_less(np.zeros((SIDE, 2)), 1)]
)
def test_arguments_that_are_not_numbers_are_refused_by_name(session, wrong):
    with pytest.raises(InvalidInput, match="velocity must be numbers: "):
        session.tangent(wrong)
    with pytest.raises(InvalidInput, match="boundary_velocity must be numbers: "):
        session.move(bulge(0.1), velocity="tangent", boundary_velocity=wrong)
    with pytest.raises(InvalidInput, match="boundary_velocity of patch 'left' must be numbers: "):
        session.move(bulge(0.1), velocity="tangent", boundary_velocity={"left": wrong})
    for faces in ([[0.5, 1.0]], [[0, 1], [2]]):
        with pytest.raises(InvalidInput, match="swept_faces must be whole numbers"):
            session.move(bulge(0.1), report="swept", swept_faces=faces)


def test_a_gradient_found_with_it_is_that_of_the_objective(session):
    """An objective of the positions of all nodes and of the boundary, as from an adjoint solver."""
    rest = square().points
    target = rest + 0.05 * np.sin(3.0 * rest[:, ::-1])

    def objective(displacement):
        moved = session.move(displacement)
        return 0.5 * np.sum((rest + moved.displacement - target) ** 2), moved

    at, change, h = bulge(0.2), np.random.default_rng(4).standard_normal((SIDE, 2)), 2e-6
    _, moved = objective(at)
    gradient = moved.cotangent(rest + moved.displacement - target)
    difference = (objective(at + h * change)[0] - objective(at - h * change)[0]) / (2.0 * h)
    assert difference == pytest.approx(np.sum(gradient * change), rel=1e-6)
    session.rollback()
