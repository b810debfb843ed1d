"""Sums at grid points by blocks: close to direct sums, and computed directly where blocks do not fit."""

import numpy as np
import pytest
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.interpolant import Interpolant, factorize
from mesh_motion_numerics.interpolation.kernels import BASES
from mesh_motion_numerics.interpolation.two_scale.boxes import nested_boxes
from mesh_motion_numerics.interpolation.two_scale.grid_sums import grid_sums, on_grid, on_grid_transposed
from mesh_motion_numerics.interpolation.two_scale.nested_grid import NestedGrid
from mesh_motion_numerics.mesh.neighbours import local_spacing
from two_scale_boundaries import sphere, walls

POINTS = np.vstack([sphere(120, 0.15), walls(5)])
COUNTS, LOW, SPACING = (37, 30, 37), np.full(3, -2.0 / 32.0), 1.0 / 32.0


def _interpolant(name: str, radius: float, k: int = 3) -> tuple[Interpolant, float]:
    """Displacement of a body's turn with a smooth bend, and its largest value."""
    x = POINTS - 0.5
    values = np.where(np.arange(len(POINTS))[:, None] < 120, np.stack([x[:, 1], -x[:, 0], x[:, 2] ** 2], axis=1), 0.0)
    values = np.tile(values, (1, 2))[:, :k]
    found = factorize(POINTS, basis=name, support_radius=radius).solve(values)
    assert isinstance(found, Interpolant)
    return found, float(np.abs(values).max())


def _by_blocks(
    interpolant: Interpolant, low: np.ndarray = LOW, spacing: float = SPACING, counts: tuple[int, ...] = COUNTS
) -> np.ndarray:
    out = np.empty((np.prod(counts), interpolant.components))
    assert grid_sums(interpolant, low, spacing, counts, out)
    return out


def _directly(interpolant: Interpolant) -> np.ndarray:
    axes = [LOW[a] + SPACING * np.arange(COUNTS[a]) for a in range(3)]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    out = evaluation.displacement(interpolant, places)
    return out if interpolant.polynomial is None else out - interpolant.polynomial(places)


#: Of those left out the matrix is singular to working precision at this radius.
SUITING = [name for name in BASES if name not in ("mqb", "imqb", "qb", "iqb", "gauss")]


#: The last ones: no polynomial crosses the end of a support.
KINDS = [*((name, 2.5, 3) for name in SUITING), *(("wendland-c2", 2.5, k) for k in (1, 2, 4))]
KINDS += [("wendland-c2", radius, 3) for radius in (0.7, 1.0, 1.4)]


@pytest.mark.parametrize(("name", "radius", "k"), KINDS)
def test_blocks_are_near_the_direct_sum(name: str, radius: float, k: int) -> None:
    interpolant, largest = _interpolant(name, radius, k)
    assert np.abs(_by_blocks(interpolant) - _directly(interpolant)).max() <= 5e-5 * largest


def test_a_short_radius_few_points_and_a_plane_are_left_to_the_direct_sum() -> None:
    long, _ = _interpolant("wendland-c2", 2.5)
    others = (_interpolant("wendland-c2", 0.5)[0], COUNTS), (_interpolant("tps", 1.0)[0], COUNTS)
    for interpolant, counts in (*others, (long, (9, 9, 9)), (long, COUNTS[:2])):
        out = np.full((np.prod(counts), 3), 7.0)
        assert not grid_sums(interpolant, LOW, SPACING, counts, out)
        assert (out == 7.0).all()


def test_a_whole_nest_with_a_polynomial_is_near_the_direct_sum() -> None:
    interpolant, largest = _interpolant("tps", 2.5)
    grid = NestedGrid(nested_boxes(POINTS, local_spacing(POINTS), np.zeros(3), np.ones(3)), np.zeros(3), 3)
    direct = evaluation.displacement(interpolant, grid.points())
    assert np.abs(on_grid(interpolant, grid) - direct).max() <= 5e-5 * largest


def test_blocks_far_from_all_centres_are_as_near_the_direct_sum() -> None:
    """Around a body that is small compared with the grid's box; it is many block widths away from most blocks."""
    interpolant, largest = _interpolant("wendland-c2", 2.5)
    for low, spacing in ((np.full(3, 0.3), 0.4 / 28), (np.array([0.9, 0.4, 0.4]), 0.004)):
        found = _by_blocks(interpolant, low, spacing, (29, 29, 29))
        axes = [low[a] + spacing * np.arange(29) for a in range(3)]
        places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        direct = evaluation.displacement(interpolant, places)
        if interpolant.polynomial is not None:
            direct -= interpolant.polynomial(places)
        assert np.abs(found - direct).max() <= 5e-5 * largest


@pytest.mark.parametrize(("name", "radius"), [("wendland-c2", 2.0), ("wendland-c4", 2.0), ("wendland-c2", 0.4)])
def test_the_transpose_of_sums_on_grids(name: str, radius: float) -> None:
    """By blocks, and directly where blocks do not fit."""
    interpolant, _ = _interpolant(name, radius)
    grid = NestedGrid(nested_boxes(POINTS, local_spacing(POINTS), np.zeros(3), np.ones(3)), np.zeros(3), 3)
    forth = on_grid(interpolant, grid)
    values = np.random.default_rng(1).standard_normal(forth.shape)
    back = on_grid_transposed(interpolant, grid, values)
    assert abs(np.sum(values * forth) - np.sum(back * interpolant.weights)) < 1e-12 * np.abs(values * forth).sum()
