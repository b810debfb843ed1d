"""Peaks of the error, and the algorithm that takes them all (thesis Fig 2.7)."""

import numpy as np
from reduced_motions import problem

from docs.studies.thesis._point_reduction import REDUCTIONS
from docs.studies.thesis._point_reduction.error_peaks import reduce
from docs.studies.thesis._point_reduction.peaks import error_peaks, nearest_neighbours


def test_peaks_of_a_wave_on_a_curve() -> None:
    s = np.linspace(0.0, 1.0, 200)
    size = np.abs(np.sin(3.5 * np.pi * s)) * (1.0 + s)
    peaks = error_peaks(size, nearest_neighbours(s[:, None]))
    assert len(peaks) == 4
    np.testing.assert_allclose(np.sort(s[peaks]), [1 / 7, 3 / 7, 5 / 7, 1.0], atol=0.02)
    assert (np.diff(size[peaks]) <= 0.0).all()


def test_no_two_peaks_are_neighbours() -> None:
    of = problem("wing")
    neighbours = nearest_neighbours(of.points)
    peaks = error_peaks(np.random.default_rng(0).random(of.n_points), neighbours)
    assert not np.isin(neighbours[peaks], peaks).any()


def test_several_points_an_iteration_above_the_share() -> None:
    of = problem("wing", tolerance=1e-2)
    many, single = reduce(of), reduce(of, share=1.0)
    assert len(many.history) < 0.3 * len(single.history)
    greedy = REDUCTIONS["greedy"](of)
    np.testing.assert_array_equal(single.selected, greedy.selected)  # a share of 1 takes the largest alone
    assert len(many.selected) < 1.4 * len(greedy.selected)
