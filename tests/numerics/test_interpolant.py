import mesh_motion_kernels as kernels
import numpy as np
import pytest
from frame_meshes import cloud
from hypothesis import given
from hypothesis import strategies as st
from mesh_motion_numerics.arrays import bytes_of
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.interpolant import factorize
from mesh_motion_numerics.interpolation.kernels import BASES, values
from mesh_motion_protocol.errors import InvalidInput, QualityRefused
from python_runs import said_by_python
from scipy.interpolate import RBFInterpolator

USABLE = sorted(name for name, basis in BASES.items() if not basis.unusable)
SOLVERS = ("dense", "sparse", "iterative")


def radius_of(name, d):
    if BASES[name].compact:
        return 0.5
    return {1: 0.02, 2: 0.15, 3: 0.3}[d]


def evaluate(interpolant, points):
    return evaluation.displacement(interpolant, points)


@pytest.mark.parametrize("d", [1, 2, 3])
@pytest.mark.parametrize("name", USABLE)
def test_every_basis_interpolates(name, d):
    points = cloud(60, d)
    data = np.random.default_rng(1).standard_normal((len(points), d))
    interpolant = factorize(points, basis=name, support_radius=radius_of(name, d)).solve(data)
    distance = np.linalg.norm(points[:, None] - points, axis=2)
    phi = values(BASES[name], distance / interpolant.support_radius)
    terms = np.max(np.abs(phi) @ np.abs(interpolant.weights)) + 1.0  # what the sums at the points round
    assert np.max(np.abs(evaluate(interpolant, points) - data)) <= 1e-14 * terms


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("d", [1, 2, 3])
def test_boundary_values_are_met_by_every_solver(solver, d):
    points = cloud(300, d)
    data = np.sin(3 * points) + 0.1
    interpolant = factorize(points, support_radius=0.04 if d == 1 else 0.4, solver=solver).solve(data)
    assert np.max(np.abs(evaluate(interpolant, points) - data)) <= 1e-12 * np.abs(data).max()


@pytest.mark.parametrize("radius", [0.15, 1.0])
def test_the_solvers_agree(radius):
    points, places = cloud(700, 3), np.random.default_rng(5).random((200, 3))
    data = np.random.default_rng(1).standard_normal((len(points), 3))
    results = []
    for solver in SOLVERS:
        made = factorize(points, support_radius=radius, solver=solver)
        assert made.solver == solver
        assert bytes_of(made) > 0
        results.append(evaluate(made.solve(data), places))
    assert np.allclose(results[0], results[1], rtol=0, atol=1e-11)
    assert np.allclose(results[0], results[2], rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", ["tps", "mqb"])
@pytest.mark.parametrize("d", [1, 2, 3])
def test_linear_motion_is_reproduced_by_conditionally_definite_bases(name, d):
    points, places = cloud(40, d), np.random.default_rng(1).uniform(-1, 2, (50, d))
    matrix, shift = np.random.default_rng(2).standard_normal((d, d)), np.arange(d) - 0.5
    made = factorize(points, basis=name, support_radius=radius_of(name, d))
    interpolant = made.solve(points @ matrix.T + shift)
    assert np.max(np.abs(evaluate(interpolant, places) - (places @ matrix.T + shift))) < 1e-10
    assert np.max(np.abs(interpolant.weights)) < 1e-9


@pytest.mark.parametrize("d", [1, 2, 3])
def test_thin_plate_spline_equals_scipy(d):
    points, places = cloud(150, d), np.random.default_rng(1).random((80, d))
    data = np.random.default_rng(2).standard_normal((len(points), d))
    peer = RBFInterpolator(points, data, kernel="thin_plate_spline")(places)
    # the support radius is only a unit of length: the interpolant does not depend on it
    for radius in (None, 0.3, 5.0):
        got = evaluate(factorize(points, basis="tps", support_radius=radius).solve(data), places)
        assert np.allclose(got, peer, rtol=0, atol=1e-9 if d == 1 else 1e-10)


@pytest.mark.parametrize(
    ("name", "kernel"),
    [("mqb", "multiquadric"), ("imqb", "inverse_multiquadric"), ("iqb", "inverse_quadratic"), ("gauss", "gaussian")],
)
def test_other_global_bases_equal_scipy(name, kernel):
    points, places, radius = cloud(150, 2), np.random.default_rng(1).random((80, 2)), 0.1
    data = np.random.default_rng(2).standard_normal((len(points), 2))
    degree = 1 if name == "mqb" else -1
    peer = RBFInterpolator(points, data, kernel=kernel, epsilon=1 / radius, degree=degree)(places)
    got = evaluate(factorize(points, basis=name, support_radius=radius).solve(data), places)
    assert np.allclose(got, peer, rtol=0, atol=1e-9)


@pytest.mark.parametrize(("name", "order"), [("wendland-c2", 2.0), ("wendland-c4", 3.0), ("tps", 1.9)])
def test_a_smooth_function_is_approached_at_the_basis_order(name, order):
    """Interior error over spacing with a fixed radius; Wendland's native order 2k + 1 appears reduced by the boundary's
    loss.
    """

    def error(n):
        axis = np.linspace(0, 1, n)
        points = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
        places = np.random.default_rng(0).uniform(0.3, 0.7, (400, 2))
        function = lambda x: np.sin(4 * x[:, :1]) * np.cos(3 * x[:, 1:])  # noqa: E731
        interpolant = factorize(points, basis=name, support_radius=1.5).solve(function(points))
        return np.sqrt(np.mean((evaluate(interpolant, places) - function(places)) ** 2))

    assert np.log2(error(9) / error(17)) > order
    assert np.log2(error(17) / error(33)) > order


@given(
    shift=st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3)), scale=st.floats(1e-4, 1e4), seed=st.integers(0, 100)
)
def test_the_interpolant_goes_with_the_mesh(shift, scale, seed):
    """Moving and scaling points and radius together changes nothing."""
    points, places = cloud(40, 2, seed), np.random.default_rng(seed).random((20, 2))
    data = np.random.default_rng(seed + 1).standard_normal((len(points), 2))
    here = evaluate(factorize(points, support_radius=0.4).solve(data), places)
    moved = factorize(points * scale + shift, support_radius=0.4 * scale).solve(data)
    lost = 1e-16 * (np.max(np.abs(shift)) / scale + 1)  # digits that the offset takes from the coordinates
    assert np.allclose(evaluate(moved, places * scale + shift), here, rtol=0, atol=max(1e-10, 1e7 * lost))


@given(seed=st.integers(0, 1000))
def test_solutions_are_linear_in_the_data(seed):
    rng = np.random.default_rng(seed)
    made = factorize(cloud(40, 3, seed), support_radius=0.6)
    a, b = rng.standard_normal((2, len(made.control_points), 3))
    combined = made.solve(2 * a - 3 * b).weights
    separate = 2 * made.solve(a).weights - 3 * made.solve(b).weights
    assert np.allclose(combined, separate, rtol=0, atol=1e-11 * np.abs(separate).max())


@pytest.mark.parametrize("solver", SOLVERS)
def test_no_motion_gives_exact_zero(solver):
    made = factorize(cloud(100, 3), support_radius=0.3, solver=solver)
    interpolant = made.solve(np.zeros((len(made.control_points), 3)))
    assert (evaluate(interpolant, np.random.default_rng(0).random((10, 3))) == 0).all()


def test_a_single_control_point():
    interpolant = factorize([[0.5, 0.5]], support_radius=1.0).solve(np.array([[1.0, 2.0]]))
    assert np.allclose(evaluate(interpolant, np.array([[0.5, 0.5]])), [[1.0, 2.0]], atol=1e-15)


class TestRefusals:
    @pytest.mark.parametrize(
        ("options", "message"),
        [
            ({"basis": "spline"}, "unknown basis 'spline'"),
            ({"support_radius": -1.0}, r"finite support radius > 0, got -1\.0"),
            ({"basis": "gauss", "support_radius": 0.05, "solver": "sparse"}, "no compact support"),
        ],
    )
    def test_options(self, options, message):
        with pytest.raises(InvalidInput, match=message):
            factorize(cloud(20, 2), **{"support_radius": 0.5, **options})

    @pytest.mark.parametrize("name", ["gauss", "mqb", "imqb"])
    def test_a_matrix_without_digits_left(self, name):
        with pytest.raises(QualityRefused, match="singular to working precision"):
            factorize(cloud(200, 2), basis=name, support_radius=5.0)


REPEAT = """
import hashlib, sys
import mesh_motion_kernels, numpy as np
mesh_motion_kernels.set_threads(int(sys.argv[1]))
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.interpolant import factorize
points = np.random.default_rng(0).random((900, 3))
data, places = np.sin(5 * points), np.random.default_rng(1).random((500, 3))
digest = hashlib.sha256()
for solver, radius, basis in (("dense", 1.0, "wendland-c2"), ("sparse", 0.1, "wendland-c2"), ("iterative", 1.0,
        "wendland-c2"), ("iterative", 0.1, "wendland-c2"), ("dense", 1.0, "tps")):
    interpolant = factorize(points, basis=basis, support_radius=radius, solver=solver).solve(data)
    digest.update(interpolant.weights.tobytes())
    digest.update(evaluation.displacement(interpolant, places).tobytes())
    digest.update(evaluation.gradient(interpolant, places).tobytes())
print(digest.hexdigest())
"""


def test_processes_and_threads_give_the_same_bytes():
    threads = [1, 1, 2] if kernels.available_threads() > 1 else [1, 1]
    digests = [said_by_python("-c", REPEAT, n) for n in threads]
    assert len(digests[0]) == 65
    assert len(set(digests)) == 1
