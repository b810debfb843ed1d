"""The farthest-first order: separation, covering, nestedness."""

import numpy as np
import pytest

from docs.studies.thesis._point_reduction.farthest_first import farthest_first

POINTS = np.random.default_rng(5).random((300, 3))


def distances(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.linalg.norm(a[:, None] - b, axis=2)


@pytest.mark.parametrize("given", [[0], [7], [3, 250, 11, 12]])
def test_each_next_one_is_the_farthest_from_all_before(given: list[int]) -> None:
    found = farthest_first(POINTS, np.array(given))
    assert sorted(found.order) == list(range(300))
    assert list(found.order[: len(given)]) == given
    for rank in range(1, 300):
        nearest = distances(POINTS, POINTS[found.order[:rank]]).min(axis=1)
        assert found.separation[rank] == pytest.approx(nearest[found.order[rank]], rel=1e-14)
        if rank >= len(given):
            assert found.separation[rank] == pytest.approx(nearest.max(), rel=1e-14)


def test_ties_go_to_the_lower_number() -> None:
    square = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [0.5, 0.5]])
    assert list(farthest_first(square, np.array([4])).order) == [4, 0, 1, 2, 3]
