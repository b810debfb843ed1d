import numpy as np
import pytest
from mesh_motion_numerics.interpolation.polynomial import LinearBasis, Polynomial
from mesh_motion_protocol.errors import InvalidInput


@pytest.mark.parametrize("d", [1, 2, 3])
def test_values_and_gradient_are_those_of_the_linear_function(d):
    rng = np.random.default_rng(d)
    points = rng.random((20, d)) + 1e3
    a, b = rng.standard_normal((2, d)), rng.standard_normal(2)
    basis = LinearBasis.around(points)
    coefficients = np.linalg.lstsq(basis.matrix(points), points @ a.T + b, rcond=None)[0]
    polynomial = Polynomial(basis, coefficients)
    elsewhere = rng.random((7, d)) * 3 + 999
    assert np.allclose(polynomial(elsewhere), elsewhere @ a.T + b, rtol=1e-12)
    assert np.allclose(polynomial.gradient, a, rtol=1e-9)


def test_a_value_depends_on_its_own_point_alone():
    points = np.random.default_rng(0).random((50, 3))
    polynomial = Polynomial(LinearBasis.around(points), np.random.default_rng(1).random((4, 3)))
    whole = polynomial(points)
    assert all(np.array_equal(polynomial(points[i : i + 1])[0], whole[i]) for i in range(50))


@pytest.mark.parametrize(
    ("points", "spanned"),
    [
        (np.zeros((1, 2)), "0 of 2"),
        (np.linspace(0, 1, 9)[:, None] * [1.0, 2.0], "1 of 2"),
        (np.random.default_rng(0).random((9, 2)) @ np.array([[1.0, 0.0, 2.0], [0.0, 1.0, 3.0]]), "2 of 3"),
    ],
)
def test_points_that_leave_it_undetermined_are_refused(points, spanned):
    with pytest.raises(InvalidInput, match=f"they span {spanned} dimensions"):
        LinearBasis.around(points)
