"""The predictors converge as they say on every cell type, and trial nodes predict exactly."""

from collections.abc import Callable
from itertools import permutations

import numpy as np
import pytest
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.interpolant import factorize
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.metrics import cell_quality, reference_sizes
from mesh_motion_protocol.errors import InvalidInput

from docs.studies.thesis._predictors import PREDICTORS, CallableField, InterpolantField, predict

Mesh = tuple[np.ndarray, CellTable]


def smooth_map(x: np.ndarray) -> np.ndarray:
    """A curved, graded unit cube: neighbouring cells differ, so nothing cancels by symmetry."""
    y = x.copy()
    y[:, 0] += 0.06 * np.sin(2 * np.pi * x[:, 0]) + (0.05 * x[:, -1] ** 2 if x.shape[1] > 1 else 0)
    y[:, -1] += 0.05 * np.sin(3 * x[:, 0])
    return y


def lattice(n: int, d: int) -> tuple[np.ndarray, list[np.ndarray]]:
    """Nodes of an n^d grid of boxes, and the 2^d corner nodes of each box in binary order."""
    points = np.stack(np.meshgrid(*[np.arange(n + 1.0) / n] * d, indexing="ij"), -1).reshape(-1, d)
    ids = np.arange((n + 1) ** d).reshape((n + 1,) * d)
    corners = [
        ids[tuple(slice((c >> (d - 1 - k)) & 1, n + ((c >> (d - 1 - k)) & 1)) for k in range(d))].ravel()
        for c in range(2**d)
    ]
    return smooth_map(points), corners


def lines(n: int) -> Mesh:
    points, (a, b) = lattice(n, 1)
    return points, CellTable.from_arrays({"line": np.c_[a, b]})


def quads(n: int) -> Mesh:
    points, (a, b, c, d) = lattice(n, 2)
    return points, CellTable.from_arrays({"quad": np.c_[a, c, d, b]})


def triangles(n: int) -> Mesh:
    points, (a, b, c, d) = lattice(n, 2)
    return points, CellTable.from_arrays({"triangle": np.concatenate([np.c_[a, c, d], np.c_[a, d, b]])})


def hexahedra(n: int) -> Mesh:
    points, c = lattice(n, 3)
    return points, CellTable.from_arrays({"hexahedron": np.stack([c[i] for i in (0, 4, 6, 2, 1, 5, 7, 3)], axis=1)})


def tetrahedra(n: int) -> Mesh:
    """Kuhn's six tetrahedra a box."""
    points, c = lattice(n, 3)
    cells = []
    for order in permutations((4, 2, 1)):
        path = [0, order[0], order[0] + order[1], 7]
        even = order in {(4, 2, 1), (2, 1, 4), (1, 4, 2)}
        cells.append(np.stack([c[i] for i in (path if even else [path[0], path[2], path[1], path[3]])], axis=1))
    return points, CellTable.from_arrays({"tetra": np.concatenate(cells)})


def wedges(n: int) -> Mesh:
    points, c = lattice(n, 3)
    halves = [np.stack([c[i] for i in (a, b, d, a + 1, b + 1, d + 1)], axis=1) for a, b, d in ((0, 4, 6), (0, 6, 2))]
    return points, CellTable.from_arrays({"wedge": np.concatenate(halves)})


def pyramids(n: int) -> Mesh:
    """Six pyramids a box, their tips in its middle."""
    points, c = lattice(n, 3)
    tip = len(points) + np.arange(n**3)
    faces = ((0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6))
    cells = [np.column_stack([*(c[i] for i in face), tip]) for face in faces]
    middles = np.mean([points[i] for i in c], axis=0)
    return np.concatenate([points, middles]), CellTable.from_arrays({"pyramid": np.concatenate(cells)})


def bump(d: int) -> CallableField:
    """S_i = 0.1 sin(2 x_i + 0.3 i) Π_k (1 + x_k²/4): smooth, no symmetry."""

    def displacement(x: np.ndarray) -> np.ndarray:
        return 0.1 * np.sin(2 * x + 0.3 * np.arange(d)) * np.prod(1 + x**2 / 4, axis=1, keepdims=True) * 2

    def gradient(x: np.ndarray) -> np.ndarray:
        product = np.prod(1 + x**2 / 4, axis=1)
        value = displacement(x)
        out = value[:, :, None] * (0.5 * x / (1 + x**2 / 4))[:, None, :]
        diagonal = np.arange(d)
        out[:, diagonal, diagonal] += 0.4 * np.cos(2 * x + 0.3 * diagonal) * product[:, None]
        return out

    return CallableField(displacement, gradient)


def errors(name: str, mesh: Mesh, field: CallableField) -> tuple[float, float]:
    """Thesis (3.13), (3.14): largest and root-mean-square error of the predicted size-skew."""
    points, cells = mesh
    sizes = reference_sizes(points, cells)
    predicted = predict(name, points, cells, sizes, field).metric("size-skew")
    actual = cell_quality(points + field.displacement(points), cells, sizes).metric("size-skew")
    return float(np.abs(predicted - actual).max()), float(np.sqrt(np.mean((predicted - actual) ** 2)))


MESHES: dict[str, tuple[Callable[[int], Mesh], int, int]] = {
    "line": (lines, 1, 160),
    "triangle": (triangles, 2, 64),
    "quad": (quads, 2, 64),
    "tetra": (tetrahedra, 3, 16),
    "hexahedron": (hexahedra, 3, 16),
    "wedge": (wedges, 3, 16),
    "pyramid": (pyramids, 3, 12),
}


@pytest.mark.parametrize("cell", MESHES)
@pytest.mark.parametrize("name", ["centre-gradient", "edge-midpoint-gradient"])
def test_order_of_convergence(name, cell):
    """Where a cell's centre is that of its opposite edges' midpoints too, the gradient there is of second order."""
    order = 1.0 if name == "centre-gradient" and cell in ("triangle", "tetra", "wedge", "pyramid") else 2.0
    build, d, n = MESHES[cell]
    coarse, fine = errors(name, build(n), bump(d)), errors(name, build(2 * n), bump(d))
    largest, mean = (np.log2(c / f) for c, f in zip(coarse, fine, strict=True))
    assert mean == pytest.approx(order, abs=0.2)
    assert largest == pytest.approx(order, abs=0.45)  # a kink of min(τ, 1/τ) may hit the worst cell


@pytest.mark.parametrize("cell", MESHES)
@pytest.mark.parametrize("name", PREDICTORS)
def test_an_affine_displacement_is_predicted_exactly(name, cell):
    build, d, _ = MESHES[cell]
    points, cells = build(3)
    rng = np.random.default_rng(d)
    matrix, shift = 0.3 * rng.normal(size=(d, d)), rng.normal(size=d)
    field = CallableField(lambda x: x @ matrix.T + shift, lambda x: np.broadcast_to(matrix, (len(x), d, d)))
    sizes = reference_sizes(points, cells)
    predicted, actual = (
        predict(name, points, cells, sizes, field),
        cell_quality(points + field.displacement(points), cells, sizes),
    )
    np.testing.assert_allclose(predicted.size, actual.size, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(predicted.skew, actual.skew, rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(predicted.inverted, actual.inverted)


def test_trial_nodes_are_exact_for_an_interpolant():
    points, cells = tetrahedra(6)
    control = points[::7]
    interpolant = factorize(control, support_radius=2.0).solve(0.1 * np.sin(4 * control[:, ::-1]))
    field = InterpolantField(interpolant)
    sizes = reference_sizes(points, cells)
    predicted = predict("trial-nodes", points, cells, sizes, field)
    actual = cell_quality(points + evaluation.displacement(interpolant, points), cells, sizes)
    np.testing.assert_array_equal(predicted.metric("size-skew"), actual.metric("size-skew"))
    edge, centre = (
        np.abs(predict(name, points, cells, sizes, field).size - actual.size).mean()
        for name in ("edge-midpoint-gradient", "centre-gradient")
    )
    assert edge < 0.3 * centre < 0.01


@pytest.mark.parametrize(
    ("radius", "predicted", "actual"), [(0.2, -0.37329, -0.33594), (0.3, -0.05661, -0.03021), (0.4, 0.21845, 0.22697)]
)
def test_table_4_1_the_standard_method_in_1d(radius, predicted, actual):
    """Thesis Table 4.1: its standard column is the prediction at the cell centres."""
    points = np.linspace(0, 1, 21)[:, None]
    cells = CellTable.from_arrays({"line": np.c_[np.arange(20), np.arange(1, 21)]})
    interpolant = factorize(points[[0, 4, 16, 20]], support_radius=radius).solve(
        np.array([[0], [0.15], [-0.15], [0.0]])
    )
    field = InterpolantField(interpolant)
    sizes = reference_sizes(points, cells)
    assert predict("centre-gradient", points, cells, sizes, field).size.min() == pytest.approx(predicted, abs=5e-6)
    assert predict("trial-nodes", points, cells, sizes, field).size.min() == pytest.approx(actual, abs=5e-6)


def test_a_mesh_larger_than_one_batch(monkeypatch):
    points, cells = triangles(24)
    sizes, field = reference_sizes(points, cells), bump(2)
    for name in PREDICTORS:
        whole = predict(name, points, cells, sizes, field)
        monkeypatch.setattr("docs.studies.thesis._predictors._BATCH", 100)
        parts = predict(name, points, cells, sizes, field)
        monkeypatch.undo()
        np.testing.assert_array_equal(whole.size, parts.size)
        np.testing.assert_array_equal(whole.skew, parts.skew)


def test_an_unknown_predictor_is_refused():
    points, cells = triangles(2)
    with pytest.raises(InvalidInput, match="unknown predictor 'oracle'; known are trial-nodes, edge-midpoint-gradient"):
        predict("oracle", points, cells, reference_sizes(points, cells), bump(2))
