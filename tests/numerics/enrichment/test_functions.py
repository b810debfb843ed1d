import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mesh_motion_numerics.correction.enrichment.functions import ENRICHMENT_FUNCTIONS, gradients, slope_at_point, values
from mesh_motion_numerics.interpolation.kernels import BASES
from mesh_motion_numerics.interpolation.kernels import values as phi_values

KINDS = sorted(ENRICHMENT_FUNCTIONS)


def cloud(d, seed=0):
    return np.random.default_rng(seed).uniform(-1.2, 1.2, (200, d))


@pytest.mark.parametrize("d", [1, 2, 3])
def test_the_thesis_forms(d):
    x, radius = cloud(d), 1.0
    r = np.linalg.norm(x, axis=1)
    phi = phi_values(BASES["wendland-c2"], r / radius)
    slope = np.where(r <= radius, -20 * (radius - r) ** 3 / radius**5, 0.0)  # (4.6)
    centre = np.zeros(d)
    assert np.allclose(values("H1", x, centre, radius), x * phi[:, None], rtol=0, atol=1e-15)
    assert np.allclose(values("H2", x, centre, radius), x * slope[:, None], rtol=0, atol=1e-14)
    assert np.allclose(values("H3", x, centre, radius), x * (slope * phi)[:, None], rtol=0, atol=1e-14)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("d", [1, 2, 3])
def test_gradients_are_the_derivatives(kind, d):
    x, centre, radius, h = cloud(d), np.full(d, 0.1), 0.8, 1e-6
    exact = gradients(kind, x, centre, radius)
    for j in range(d):
        step = h * np.eye(d)[j]
        difference = (values(kind, x + step, centre, radius) - values(kind, x - step, centre, radius)) / (2 * h)
        # H2's second derivative is bounded but kinks at its point: the difference is first order there
        assert np.allclose(exact[:, :, j], difference, rtol=0, atol=2e-4 if kind != "H1" else 1e-7)


@given(
    kind=st.sampled_from(KINDS), radius=st.floats(1e-3, 1e3), place=st.lists(st.floats(-5, 5), min_size=3, max_size=3)
)
def test_odd_compact_and_scaled(kind, radius, place):
    x, centre = np.array([place]) * radius, np.zeros(3)
    h = values(kind, x, centre, radius)
    assert np.array_equal(values(kind, -x, centre, radius), -h)
    if np.linalg.norm(place) > 1 + 1e-9:
        assert (h == 0).all()
        assert (gradients(kind, x, centre, radius) == 0).all()
    power = {"H1": 1, "H2": -1, "H3": -1}[kind]
    scaled = values(kind, np.array([place]), centre, 1.0) * radius**power
    assert np.allclose(h, scaled, rtol=1e-9, atol=1e-12 * radius**power)


@pytest.mark.parametrize("kind", ["H1", "H2", "H3"])
@pytest.mark.parametrize("d", [1, 2, 3])
def test_the_gradient_at_the_point_is_c_times_the_identity(kind, d):
    centre = np.full(d, 0.3)
    c = {"H1": 1.0, "H2": -20 / 0.7**2, "H3": -20 / 0.7**2}[kind]
    assert slope_at_point(kind, 0.7) == pytest.approx(c)
    assert (values(kind, centre[None], centre, 0.7) == 0).all()
    np.testing.assert_allclose(gradients(kind, centre[None], centre, 0.7)[0], c * np.eye(d), atol=1e-15)
