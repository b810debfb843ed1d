"""The multi-step interpolation: nested, well separated subsets, and the residual of every level."""

from itertools import pairwise

import numpy as np
import pytest
from mesh_motion_numerics.interpolation.interpolant import factorize
from reduced_motions import problem

from docs.studies.thesis._point_reduction.multi_step import SPACINGS, reduce

OF = problem("wing", tolerance=1e-6)
REDUCED = reduce(OF)


def nodes_of(level: object) -> np.ndarray:
    place = {tuple(x): i for i, x in enumerate(OF.points)}
    return np.array([place[tuple(x)] for x in level.control_points])  # type: ignore[attr-defined]


def test_radii_halve_and_subsets_are_nested() -> None:
    assert len(REDUCED.levels) >= 3
    radii = np.array([level.support_radius for level in REDUCED.levels])
    halvings = np.log2(OF.support_radius / radii)
    np.testing.assert_array_equal(halvings, np.round(halvings))
    assert (np.diff(halvings) > 0).all()
    subsets = [set(nodes_of(level)) for level in REDUCED.levels]
    assert all(coarse < fine for coarse, fine in pairwise(subsets))


def test_a_level_is_separated_by_its_radius_over_the_spacings() -> None:
    for level in REDUCED.levels:
        x = level.control_points
        apart = np.linalg.norm(x[:, None] - x, axis=2) + np.diag(np.full(len(x), np.inf))
        assert apart.min() >= level.support_radius / SPACINGS * (1 - 1e-14)


def test_every_level_interpolates_what_those_before_it_left() -> None:
    left = OF.displacement.copy()
    for number, level in enumerate(REDUCED.levels):
        nodes = nodes_of(level)
        expected = factorize(OF.points[nodes], support_radius=level.support_radius).solve(left[nodes])
        np.testing.assert_allclose(level.weights, expected.weights, atol=1e-12)
        left -= OF.values(level)
        assert np.abs(left[nodes]).max() <= 1e-12
        assert np.linalg.norm(left, axis=1).max() == pytest.approx(REDUCED.history[number].max_error, abs=1e-13)
