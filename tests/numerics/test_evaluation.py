import mesh_motion_kernels as kernels
import numpy as np
import pytest
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.interpolant import factorize
from mesh_motion_numerics.interpolation.kernels import BASES, slopes, values
from mesh_motion_protocol.errors import InvalidInput
from thread_counts import on_threads

SMOOTH = sorted(name for name, basis in BASES.items() if basis.gradient_at_centre and not basis.unusable)


def radius_of(name):
    return 0.4 if BASES[name].compact else 0.15


def made(name, d, *, n=60, k=None, radius=None, seed=0):
    """An interpolant of random data on a jittered grid, dense enough to be well posed."""
    rng = np.random.default_rng(seed)
    side = int(np.ceil(n ** (1 / d)))
    grid = np.stack(np.meshgrid(*[np.linspace(0, 1, side)] * d, indexing="ij"), axis=-1).reshape(-1, d)
    points = grid + rng.uniform(-0.2, 0.2, grid.shape) / side
    data = rng.standard_normal((len(points), k or d))
    return factorize(points, basis=name, support_radius=radius or radius_of(name)).solve(data)


def brute(interpolant, points):
    """Values and gradients from the formulas, with whole matrices."""
    rho = points[:, None] - interpolant.control_points
    xi = np.linalg.norm(rho, axis=2) / interpolant.support_radius
    s = values(interpolant.basis, xi) @ interpolant.weights
    g = np.einsum("nc,ncm,ck->nkm", slopes(interpolant.basis, xi), rho, interpolant.weights)
    g /= interpolant.support_radius**2
    if interpolant.polynomial is not None:
        s += interpolant.polynomial(points)
        g += interpolant.polynomial.gradient
    return s, g


@pytest.mark.parametrize("d", [1, 2, 3])
@pytest.mark.parametrize("name", SMOOTH)
def test_sums_are_the_formulas(name, d):
    radius = 0.02 if d == 1 and not BASES[name].compact else None
    interpolant = made(name, d, n=30 if d == 1 else 60, radius=radius)
    points = np.concatenate([np.random.default_rng(1).uniform(-0.3, 1.3, (100, d)), interpolant.control_points])
    s, g = brute(interpolant, points)
    # rounding is relative to the terms: CTPS adds some of size 60 for φ itself, TPS reaches 2 · 10⁴ at ξ = 65
    scale = (2e4 if name == "tps" else 100) * np.abs(interpolant.weights).sum()
    assert np.allclose(evaluation.displacement(interpolant, points), s, rtol=0, atol=1e-15 * scale)
    assert np.allclose(evaluation.gradient(interpolant, points), g, rtol=0, atol=1e-12 * np.abs(g).max())


@pytest.mark.parametrize("k", [1, 2, 5, 60, 180])
def test_any_number_of_columns(k):
    interpolant = made("wendland-c2", 3, k=k)
    points = np.random.default_rng(1).random((70, 3))
    s, g = brute(interpolant, points)
    assert evaluation.displacement(interpolant, points).shape == (70, k)
    assert np.allclose(evaluation.displacement(interpolant, points), s, atol=1e-13 * np.abs(interpolant.weights).max())
    assert np.allclose(evaluation.gradient(interpolant, points), g, atol=1e-12 * np.abs(g).max())


@pytest.mark.parametrize("radius", [0.08, 0.5])
def test_one_and_two_threads_and_any_split_give_the_same_bytes(radius):
    interpolant = made("wendland-c2", 3, n=1000, radius=radius)
    points = np.random.default_rng(1).random((1001, 3))
    with on_threads(1):
        whole = evaluation.displacement(interpolant, points)
        gradient = evaluation.gradient(interpolant, points)
        split = np.array_split(points[::-1], 7)
        parts = np.concatenate([evaluation.displacement(interpolant, part) for part in split])[::-1]
    assert parts.tobytes() == whole.tobytes()
    if kernels.available_threads() < 2:
        pytest.skip("one core")
    with on_threads(2):
        assert evaluation.displacement(interpolant, points).tobytes() == whole.tobytes()
        assert evaluation.gradient(interpolant, points).tobytes() == gradient.tobytes()


def test_no_point_is_no_problem():
    interpolant = made("wendland-c2", 2)
    assert evaluation.displacement(interpolant, np.empty((0, 2))).shape == (0, 2)
    assert evaluation.gradient(interpolant, np.empty((0, 2))).shape == (0, 2, 2)


def test_wrong_dimension_is_refused():
    with pytest.raises(InvalidInput, match=r"expected points of shape \(n, 2\), got \(4, 3\)"):
        evaluation.displacement(made("wendland-c2", 2), np.zeros((4, 3)))


@pytest.mark.parametrize("name", ["wendland-c0", "ctps-c0"])
def test_a_basis_with_a_cusp_has_values_but_no_gradient(name):
    interpolant = made(name, 2)
    evaluation.displacement(interpolant, np.zeros((1, 2)))
    with pytest.raises(InvalidInput, match="no gradient at a control point"):
        evaluation.gradient(interpolant, np.zeros((1, 2)))
