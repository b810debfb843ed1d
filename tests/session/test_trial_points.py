"""A Move's answer, made block by block, is what whole arrays would give."""

from __future__ import annotations

import numpy as np
import pytest

from mesh_motion_server.session.trial_points import answer, same_bits


def test_same_bits_tells_what_comparison_does_not() -> None:
    rows = np.random.default_rng(1).normal(size=(40_000, 3))
    other = rows.copy()
    assert same_bits(rows, other)
    other[-1, 2] = np.nextafter(other[-1, 2], 2.0)
    assert not same_bits(rows, other)
    assert same_bits(np.full((2, 3), np.nan), np.full((2, 3), np.nan))
    assert not same_bits(np.zeros((2, 3)), np.negative(np.zeros((2, 3))))
    assert not same_bits(rows, rows[:-1])


@pytest.mark.parametrize("count", [1, 1 << 14, 40_001])
@pytest.mark.parametrize("offset", [0.0, 100.0])
def test_blocks_answer_as_whole_arrays_do(count: int, offset: float) -> None:
    random = np.random.default_rng(count)
    base = offset + random.normal(size=(count, 3))
    moving = np.unique(random.integers(0, count, 1 + count // 9))
    told = random.normal(size=(len(moving), 3))
    moved = base + 0.3 * random.normal(size=base.shape)
    moved[moving] = base[moving] + told
    displacement = moved - base
    displacement[moving] = told
    found = answer(moved, base, moving, told)
    assert same_bits(found.displacement, displacement)
    assert same_bits(found.points, base + displacement)
    assert found.exact == same_bits(base + displacement, moved)
    assert not found.points.flags.writeable
    np.testing.assert_array_equal(found.points[moving], moved[moving])
