"""A spline on nested boxes: exact for cubics, smooth across rims, of fourth order."""

import numpy as np
import pytest
from mesh_motion_numerics.interpolation.two_scale.boxes import MARGIN, nested_boxes
from mesh_motion_numerics.interpolation.two_scale.nested_grid import NestedGrid
from mesh_motion_numerics.mesh.neighbours import local_spacing
from numpy.typing import NDArray
from thread_counts import on_threads

Floats = NDArray[np.float64]


def _grid(d: int) -> NestedGrid:
    """Boxes around a tight bundle of coarse points next to a loose one."""
    rng = np.random.default_rng(d)
    coarse = np.zeros((60, 3))
    coarse[:30, :d] = 0.37 + 0.02 * rng.random((30, d))
    coarse[30:, :d] = rng.random((30, d))
    high = np.zeros(3)
    high[:d] = 1.0
    return NestedGrid(nested_boxes(coarse, local_spacing(coarse), np.zeros(3), high), np.zeros(3), d)


def _places(d: int, count: int = 2000) -> Floats:
    rng = np.random.default_rng(9)
    x = rng.random((count, d))
    x[: count // 2] = np.clip(0.38 + 0.08 * rng.normal(size=(count // 2, d)), 0.0, 1.0)
    return np.hstack([x, np.zeros((count, 3 - d))])


def _values(grid: NestedGrid, field: NDArray[np.float64], x: Floats) -> tuple[Floats, Floats]:
    spline = grid.spline(field)
    return spline.values(x), spline.gradients(x)


def _cubic(x: Floats) -> Floats:
    return np.stack([x[:, 0] ** 3 - x[:, -1], x[:, -1] ** 3 + x[:, 0] ** 2 * x[:, -1], x.sum(axis=1)], axis=1)


@pytest.mark.parametrize("d", [1, 2, 3])
def test_cubics_are_reproduced_on_all_levels(d: int) -> None:
    grid, x = _grid(d), _places(d)
    assert max(box.level for box in grid.boxes) >= 3
    values, gradients = _values(grid, _cubic(grid.points()), x)
    np.testing.assert_allclose(values, _cubic(x[:, :d]), atol=1e-13)
    np.testing.assert_allclose(gradients[:, 2], np.ones((len(x), d)), atol=1e-11)


@pytest.mark.parametrize("d", [2, 3])
def test_any_number_of_components_is_summed_alike(d: int) -> None:
    grid, x = _grid(d), _places(d, 300)
    field = np.random.default_rng(1).normal(size=(len(grid.points()), 4))
    together, _ = _values(grid, field, x)
    for k in (1, 2, 3):  # two and three have loops of their own
        few, _ = _values(grid, np.ascontiguousarray(field[:, :k]), x)
        np.testing.assert_allclose(together[:, :k], few, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("d", [1, 2, 3])
def test_gradients_are_those_of_the_values(d: int) -> None:
    grid, x = _grid(d), _places(d, 400)
    spline = grid.spline(np.sin(5.0 * grid.points()))
    gradients, h = spline.gradients(x), 1e-6
    for m in range(d):
        inside = (x[:, m] > h) & (x[:, m] < 1.0 - h)
        step = np.zeros(3)
        step[m] = h
        change = spline.values(x + step) - spline.values(x - step)
        np.testing.assert_allclose(gradients[inside, :, m], change[inside] / (2 * h), atol=2e-8)


@pytest.mark.parametrize("d", [1, 2, 3])
def test_values_and_slopes_pass_through_every_rim(d: int) -> None:
    """On a field that no level resolves, so that the levels differ as much as possible."""
    grid = _grid(d)
    rough = np.random.default_rng(2).normal(size=(len(grid.points()), 1))
    rng = np.random.default_rng(3)
    for box in grid.boxes[1:]:
        x = np.zeros((200, 3))
        x[:, :d] = (box.first[:d] + rng.random((200, d)) * box.cells[:d]) * box.spacing
        x[:, 0] = box.first[0] * box.spacing
        if not 0.0 < x[0, 0] < 1.0:
            continue
        step = np.array([1e-9 * box.spacing, 0.0, 0.0])
        (before, slope_before), (after, slope_after) = _values(grid, rough, x - step), _values(grid, rough, x + step)
        np.testing.assert_allclose(before, after, atol=1e-7)
        np.testing.assert_allclose(slope_before * box.spacing, slope_after * box.spacing, atol=1e-7)


def test_the_error_falls_with_the_fourth_power_of_the_spacing() -> None:
    errors = []
    for factor in (1.0, 2.0):  # a domain twice as wide has twice the spacing
        grid = NestedGrid(
            nested_boxes(np.zeros((1, 3)), np.full(1, np.inf), np.zeros(3), np.array([factor, factor, 0.0])),
            np.zeros(3),
            2,
        )
        x = _places(2)
        values, _ = _values(grid, np.sin(4.0 * grid.points()), x)
        errors.append(np.abs(values - np.sin(4.0 * x[:, :2])).max())
    assert np.log2(errors[1] / errors[0]) == pytest.approx(4.0, abs=0.3)


def test_boxes_lie_in_their_parents_and_hold_their_points() -> None:
    for d in (1, 2, 3):
        boxes = _grid(d).boxes
        for box in boxes[1:]:
            parent = boxes[box.parent]
            assert box.level == parent.level + 1
            assert np.all(box.first >= 2 * parent.first)
            assert np.all(box.first + box.cells <= 2 * (parent.first + parent.cells))
            assert np.all(box.cells[:d] >= MARGIN)


def test_a_place_outside_takes_the_value_at_the_rim() -> None:
    grid = _grid(2)
    values, _ = _values(grid, _cubic(grid.points()), np.array([[1.5, 0.25, 0.0], [1.0, 0.25, 0.0]]))
    np.testing.assert_array_equal(values[0], values[1])


@pytest.mark.parametrize("components", [1, 2, 3, 4])
@pytest.mark.parametrize("d", [1, 2, 3])
def test_the_transpose_of_a_spline(d: int, components: int) -> None:
    grid, numbers = _grid(d), np.random.default_rng(d)
    x = np.ascontiguousarray(_places(d)[:, :d])
    field, weights = (numbers.standard_normal((len(rows), components)) for rows in (grid.points(), x))
    forth, back = _values(grid, field, x)[0], grid.spline_transposed((x, weights))
    assert len(grid.boxes) > 2
    assert abs(np.sum(weights * forth) - np.sum(back * field)) < 1e-12 * np.abs(weights * forth).sum()
    with on_threads(1):
        assert (grid.spline_transposed((x, weights)) == back).all()
    apart = grid.spline_transposed((x[:700], weights[:700]), (x[700:], weights[700:]))
    np.testing.assert_allclose(apart, back, atol=1e-13 * np.abs(back).max())
