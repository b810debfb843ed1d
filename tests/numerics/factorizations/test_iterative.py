import numpy as np
import pytest
from mesh_motion_numerics.interpolation.centres import CentreLayout
from mesh_motion_numerics.interpolation.factorizations import iterative
from mesh_motion_numerics.interpolation.factorizations.iterative import ConjugateGradients
from mesh_motion_numerics.interpolation.factorizations.preconditioner import SparseInverse
from mesh_motion_numerics.interpolation.kernels import BASES, values
from mesh_motion_protocol.errors import QualityRefused

C2 = BASES["wendland-c2"]


def sphere(n):
    k = np.arange(n) + 0.5
    z, turn = 1 - 2 * k / n, np.pi * (1 + 5**0.5) * k
    return np.column_stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z])


def matrix(points, radius):
    return values(C2, np.linalg.norm(points[:, None] - points, axis=2) / radius)


@pytest.mark.parametrize("radius", [0.3, 5.0])
def test_with_all_preceding_points_the_preconditioner_is_the_inverse(radius):
    points = sphere(30)
    inverse = SparseInverse(points, C2, radius, 30)
    assert np.allclose(inverse(matrix(points, radius)), np.eye(30), rtol=0, atol=1e-9)


def test_the_preconditioner_is_symmetric_and_definite():
    points = sphere(300)
    m = SparseInverse(points, C2, 2.0, 16)(np.eye(300))
    assert np.allclose(m, m.T, rtol=1e-12, atol=0)
    assert np.linalg.eigvalsh(m)[0] > 0


@pytest.mark.parametrize("radius", [0.2, 0.5, 2.0, 6.0])
def test_iterations_stay_few_for_any_radius(radius):
    points = sphere(2000)
    solver = ConjugateGradients(CentreLayout.build(points, C2, radius), C2, radius)
    x = np.random.default_rng(0).standard_normal((2000, 3))
    rhs = matrix(points, radius) @ x
    solution = solver.solve(rhs)
    assert np.max(np.abs(matrix(points, radius) @ solution - rhs)) <= 1e-11 * np.abs(rhs).max()
    assert solver.iterations <= 40


def test_columns_of_different_size_are_solved_alike():
    points, radius = sphere(500), 1.0
    solver = ConjugateGradients(CentreLayout.build(points, C2, radius), C2, radius)
    rhs = np.sin(3 * points) * [1.0, 1e-8, 0.0]
    residual = np.linalg.norm(matrix(points, radius) @ solver.solve(rhs) - rhs, axis=0)
    assert residual[0] <= 1e-11 * np.linalg.norm(rhs[:, 0])
    assert residual[1] <= 1e-11 * np.linalg.norm(rhs[:, 1])
    assert residual[2] == 0


def test_a_solution_that_does_not_come_is_an_error(monkeypatch):
    monkeypatch.setattr(iterative, "_MAX_ITERATIONS", 2)
    points = sphere(500)
    solver = ConjugateGradients(CentreLayout.build(points, C2, 3.0), C2, 3.0)
    with pytest.raises(QualityRefused, match="stopped at a relative residual of"):
        solver.solve(np.sin(3 * points))


def test_the_residual_of_the_recurrences_is_solved_for_again(monkeypatch):
    exact = ConjugateGradients._conjugate_gradients
    drifted = lambda self, rhs, scale: exact(self, rhs, scale) * (1 + 1e-6)  # noqa: E731
    monkeypatch.setattr(ConjugateGradients, "_conjugate_gradients", drifted)
    points = sphere(500)
    rhs = np.sin(3 * points)
    solver = ConjugateGradients(CentreLayout.build(points, C2, 2.0), C2, 2.0)
    residual = matrix(points, 2.0) @ solver.solve(rhs) - rhs
    assert np.max(np.linalg.norm(residual, axis=0) / np.linalg.norm(rhs, axis=0)) < 1e-10
