"""Canonical order: the Morton curve, independent of the input order of the nodes."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mesh_motion_numerics.mesh.morton import morton_codes

from mesh_motion_server.session.partitions.merging import canonical_order


def slow_code(cell: list[int], bits: int) -> int:
    """Bits of the coordinates interleaved one by one."""
    return sum(((c >> b) & 1) << (b * len(cell) + axis) for axis, c in enumerate(cell) for b in range(bits))


@pytest.mark.parametrize(("dimension", "bits"), [(1, 52), (2, 31), (3, 21)])
def test_codes_are_interleaved_bits(dimension: int, bits: int) -> None:
    random = np.random.default_rng(1)
    points = random.random((200, dimension))
    points[0], points[1] = 0.0, 1.0  # the box is [0, 1]
    top = float(2**bits - 1)
    cells = np.minimum(points * top, top).astype(np.uint64)
    expected = [slow_code([int(c) for c in cell], bits) for cell in cells]
    assert morton_codes(points).tolist() == expected


def test_four_quadrants_in_z_order() -> None:
    points = np.array([[1.0, 1.0], [0.0, 1.0], [1.0, 0.0], [0.0, 0.0]])
    assert canonical_order(points, np.arange(4)).tolist() == [3, 2, 1, 0]


@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 60), dimension=st.integers(1, 3))
def test_the_order_does_not_depend_on_the_input_order(seed: int, count: int, dimension: int) -> None:
    random = np.random.default_rng(seed)
    points = np.round(random.random((count, dimension)), 1)  # many coincide: ties by id
    ids = random.permutation(10 * count)[:count]
    shuffle = random.permutation(count)
    first = ids[canonical_order(points, ids)]
    second = ids[shuffle][canonical_order(points[shuffle], ids[shuffle])]
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("points", [np.zeros((5, 2)), np.full((3, 1), 1e300), np.array([[-1.7e308], [1.7e308]])])
def test_degenerate_boxes(points: Any) -> None:
    assert sorted(canonical_order(points, np.arange(len(points)))) == list(range(len(points)))


def test_neighbours_in_order_are_neighbours_in_space() -> None:
    x, y = np.meshgrid(np.arange(32.0), np.arange(32.0))
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    shuffled = points[np.random.default_rng(0).permutation(len(points))]
    ordered = shuffled[canonical_order(shuffled, np.arange(len(points)))]
    steps = np.abs(np.diff(ordered, axis=0)).sum(axis=1)
    assert steps.mean() < 2.1  # a Z-curve on a grid takes 2 (1 − 1/n) on average; random order would take 21
