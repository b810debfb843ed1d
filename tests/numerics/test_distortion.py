"""The distortion: its values, where it is infinite, and its gradient compared with differences."""

import math

import numpy as np
import pytest
from box_meshes import CELL_KINDS, box_mesh
from mesh_motion_numerics.correction.distortion import (
    PNorm,
    corner_simplices,
    determinants,
    distortion_gradient,
    mean_distortion,
)
from mesh_motion_numerics.mesh.cells import CELL_TYPES, CellTable
from mesh_motion_numerics.quality.metrics import cell_quality
from thread_counts import on_one_and_on_all_threads

SIMPLICES = ("line", "triangle", "tetra")
NORMS = (PNorm(1, 1), PNorm(8, 2), PNorm(60, 8), PNorm(2, 1, 0.3))


def one_cell(name: str) -> tuple[np.ndarray, CellTable, np.ndarray]:
    """The ideal simplex, its table and its size."""
    ideal = CELL_TYPES[name].ideal_array
    points = np.vstack([np.zeros(len(ideal)), ideal.T])
    return points, CellTable.from_arrays({name: np.arange(len(points))[None]}), np.array([np.linalg.det(ideal)])


@pytest.mark.parametrize("name", SIMPLICES)
def test_it_is_the_logarithm_of_one_over_size_skew(name: str) -> None:
    points, cells, sizes = one_cell(name)
    rng = np.random.default_rng(1)
    for _ in range(20):
        moved = points + 0.2 * rng.normal(size=points.shape)
        quality = cell_quality(moved, cells, sizes)
        if quality.inverted[0]:
            continue
        energy, weights = mean_distortion(moved, corner_simplices(points, cells, sizes), PNorm(1, 1e4))
        # rounding |log τ| costs at most log 2 / 2m
        assert energy == pytest.approx(-math.log(quality.metric("size-skew")[0]), abs=math.log(2) / 1e4)
        assert weights.tolist() == [1.0]


@pytest.mark.parametrize("kind", ["quad", "hexahedron"])
def test_boxes_are_compared_with_their_own_corners(kind: str) -> None:
    mesh = box_mesh(kind)
    stretched = mesh.points * np.arange(1, mesh.points.shape[1] + 1)  # a boundary layer's flat cells are meant
    sizes = mesh.sizes * math.factorial(mesh.points.shape[1])
    energy, _ = mean_distortion(stretched, corner_simplices(stretched, mesh.cells, sizes), PNorm(8, 2))
    assert energy == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("kind", CELL_KINDS)
def test_rotation_and_translation_do_not_matter(kind: str) -> None:
    mesh = box_mesh(kind)
    simplices = corner_simplices(mesh.points, mesh.cells, mesh.sizes)
    d = mesh.points.shape[1]
    turn, _ = np.linalg.qr(np.random.default_rng(2).normal(size=(d, d)))
    turn[:, 0] *= np.sign(np.linalg.det(turn))
    before, _ = mean_distortion(mesh.points, simplices, PNorm(8, 2))
    after, _ = mean_distortion(mesh.points @ turn.T + 3.0, simplices, PNorm(8, 2))
    assert after == pytest.approx(before, abs=1e-12)
    np.testing.assert_allclose(determinants(mesh.points @ turn.T, simplices), 1.0, rtol=1e-12)


def test_the_barrier_is_infinite_where_a_cell_is_inverted_or_no_number() -> None:
    points, cells, sizes = one_cell("triangle")
    simplices = corner_simplices(points, cells, sizes)
    for bad in (points * [1, -1], points * 0.0, points * np.nan):
        assert mean_distortion(bad, simplices, PNorm(2, 1))[0] == math.inf
    untangling, _ = mean_distortion(points * [1, -1], simplices, PNorm(2, 1, 0.1))
    assert math.isfinite(untangling)


def test_a_degenerate_reference_corner_takes_the_ideal_of_its_type() -> None:
    points = np.array([[0.0, 0], [1, 0], [2, 0], [1, 1]])  # a flat corner at node 1
    cells = CellTable.from_arrays({"quad": np.array([[0, 1, 2, 3]])})
    simplices = corner_simplices(points, cells, np.array([4.0]))
    assert np.isfinite(simplices.ideal).all()
    np.testing.assert_allclose(simplices.ideal[1], np.eye(2))


@pytest.mark.parametrize("norm", NORMS, ids=str)
@pytest.mark.parametrize("kind", CELL_KINDS)
def test_the_gradient_is_the_derivative(kind: str, norm: PNorm) -> None:
    mesh = box_mesh(kind, 5)
    rng = np.random.default_rng(3)
    points = mesh.points + 0.02 * rng.normal(size=mesh.points.shape)
    simplices = corner_simplices(mesh.points, mesh.cells, mesh.sizes)
    _, weights = mean_distortion(points, simplices, norm)
    gradient = np.zeros_like(points)
    np.add.at(gradient, simplices.nodes, distortion_gradient(points, simplices, weights, norm))
    for direction in rng.normal(size=(3, *points.shape)):
        h = 3e-6
        ahead, _ = mean_distortion(points + h * direction, simplices, norm)
        behind, _ = mean_distortion(points - h * direction, simplices, norm)
        # central differences: error h² times a third derivative, p³ at most for the sharpest norm
        assert np.vdot(gradient, direction) == pytest.approx((ahead - behind) / (2 * h), rel=1e-4, abs=1e-6)


def test_the_p_mean_lies_between_mean_and_maximum() -> None:
    mesh = box_mesh("tetra", 5)
    points = mesh.points + 0.02 * np.random.default_rng(5).normal(size=mesh.points.shape)
    simplices = corner_simplices(mesh.points, mesh.cells, mesh.sizes)
    values = [mean_distortion(points, simplices, PNorm(p, 2))[0] for p in (1e-9, 1, 8, 60, 1e6)]
    assert values == sorted(values)
    energy, weights = mean_distortion(points, simplices, PNorm(1e6, 2))
    assert weights.sum() == pytest.approx(1.0)
    assert energy == pytest.approx(values[-1])


def test_threads_change_no_bit() -> None:
    mesh = box_mesh("tetra")
    points = mesh.points + 0.005 * np.random.default_rng(6).normal(size=mesh.points.shape)
    simplices, norm = corner_simplices(mesh.points, mesh.cells, mesh.sizes), PNorm(8, 2)

    def judged() -> tuple[float, bytes, bytes]:
        energy, weights = mean_distortion(points, simplices, norm)
        return energy, weights.tobytes(), distortion_gradient(points, simplices, weights, norm).tobytes()

    one, all_of_them = on_one_and_on_all_threads(judged)
    assert one == all_of_them
