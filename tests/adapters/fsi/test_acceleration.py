"""Accelerations: exact on linear problems, and against the published limits of an added-mass problem."""

import numpy as np
import pytest
from mesh_motion_fsi import ACCELERATIONS, Aitken, ConstantRelaxation, QuasiNewton, SetupError


class AddedMass:
    """One time step of a string over an inviscid fluid, in the string's sine modes.

    Causin, Gerbeau and Nobile, Added-mass effect in the design of partitioned algorithms for fluid-structure problems,
    Computer Methods in Applied Mechanics and Engineering 194 (2005) 4506-4527: the fluid of a channel of length L and
    height R acts on mode i of its wall as the added mass rho_f mu_i, mu_i = L / (i pi tanh(i pi R / L)). In the
    Dirichlet-Neumann iterations of an implicit step with a relaxation factor omega, the error of mode i changes by
    1 - omega (m + a dt^2 + rho_f mu_i) / (m + a dt^2), m = rho_s h_s: they converge if and only if

        0 < omega < 2 (m + a dt^2) / (m + rho_f mu_max + a dt^2).
    """

    LENGTH, HEIGHT, FLUID, WALL, STIFFNESS, DT = 6.0, 0.5, 1.0, 0.11, 400.0, 1e-3

    def __init__(self, modes):
        i = np.arange(1, modes + 1)
        added = self.FLUID * self.LENGTH / (i * np.pi * np.tanh(i * np.pi * self.HEIGHT / self.LENGTH))
        self.structure = self.WALL + self.STIFFNESS * self.DT**2
        self.factor = -added / self.structure
        self.push = np.cos(i)
        self.solution = self.push / (1.0 - self.factor)
        self.limit = 2.0 * self.structure / (self.structure + added.max())

    def answer(self, x):
        return self.factor * x + self.push

    def iterate(self, acceleration, iterations):
        x = np.zeros_like(self.push)
        norms = []
        for _ in range(iterations):
            answer = self.answer(x)
            norms.append(np.linalg.norm(answer - x))
            if not 1e-14 < norms[-1] < 1e100:
                break
            x = acceleration.next(x, answer)
        return np.array(norms), x


@pytest.fixture
def string():
    return AddedMass(8)


def test_plain_relaxation_has_the_published_limit(string):
    assert string.limit < 0.03  # the added mass is seventy times the wall's
    below, _ = string.iterate(ConstantRelaxation(0.99 * string.limit), 3000)
    above, _ = string.iterate(ConstantRelaxation(1.01 * string.limit), 3000)
    assert below[-1] < 1e-6 * below[0]
    assert above[-1] > 1e6 * above[0]


@pytest.mark.parametrize(("name", "most"), [("iqn-ils", 11), ("aitken", 200)])
def test_accelerations_converge_where_plain_iteration_diverges(string, name, most):
    plain, _ = string.iterate(ConstantRelaxation(1.0), 10)
    assert plain[-1] > 1e6 * plain[0]
    options = {"filter_limit": 1e-14} if name == "iqn-ils" else {}
    norms, x = string.iterate(ACCELERATIONS[name](0.1, **options), most)
    assert norms[-1] < 1e-8 * norms[0]
    np.testing.assert_allclose(x, string.solution, rtol=1e-6)


def test_aitken_is_the_secant_method_of_one_unknown():
    acceleration, x = Aitken(0.5), np.array([3.0])
    for _ in range(2):
        x = acceleration.next(x, -4.0 * x + 1.0)
    np.testing.assert_allclose(x, 0.2, rtol=1e-14)


@pytest.mark.parametrize("n", [1, 2, 5, 9])
def test_iqn_is_exact_after_as_many_differences_as_unknowns(n):
    rng = np.random.default_rng(n)
    matrix, b = 3.0 * rng.normal(size=(n, n)), rng.normal(size=n)
    solution = np.linalg.solve(np.eye(n) - matrix, b)
    acceleration, x = QuasiNewton(0.3, filter_limit=1e-12), np.zeros(n)
    for _ in range(n + 1):  # the first makes no difference
        assert np.linalg.norm(x - solution) > 1e-6
        x = acceleration.next(x, matrix @ x + b)
    np.testing.assert_allclose(x, solution, rtol=1e-8, atol=1e-8)


def test_differences_of_windows_before_make_the_next_window_newtons(string):
    acceleration = QuasiNewton(0.1, filter_limit=1e-14)
    string.iterate(acceleration, 10)
    acceleration.end_window()
    string.push = 2.0 * string.push[::-1]
    norms, _ = string.iterate(acceleration, 3)
    assert norms[1] < 1e-8 * norms[0]


def test_differences_are_forgotten_after_the_windows_asked_for(string):
    acceleration = QuasiNewton(0.1, windows=1)
    for _ in range(3):
        string.iterate(acceleration, 4)
        acceleration.end_window()
    assert list(acceleration.state()["counts"]) == [0.0, 3.0]


def test_columns_that_are_noise_are_dropped():
    """Two iterations that differ by rounding would give a step without bounds."""
    rng = np.random.default_rng(0)
    acceleration, x = QuasiNewton(0.5), np.ones(6)
    for k in range(4):
        answer = 0.5 * x + 1e-9 * rng.normal(size=6) + (1.0 if k == 0 else 0.0)
        x = acceleration.next(x, answer)
    assert np.abs(x).max() < 10.0


@pytest.mark.parametrize("name", sorted(ACCELERATIONS))
def test_a_state_that_is_restored_goes_on_alike(string, name):
    first, second = ACCELERATIONS[name](0.01), ACCELERATIONS[name](0.01)
    string.iterate(first, 5)
    first.end_window()
    second.restore(first.state())
    one, _ = string.iterate(first, 5)
    other, _ = string.iterate(second, 5)
    np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("omega", [0.0, -1.0, 1.5, np.nan])
def test_a_factor_out_of_range(omega):
    with pytest.raises(SetupError, match="above 0 and at most 1"):
        QuasiNewton(omega)
