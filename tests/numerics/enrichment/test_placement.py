"""Points go to bad cells, the worst first, and spread over separate bad regions."""

import numpy as np
import pytest
from mesh_motion_numerics.correction.enrichment.placement import gap_middle, local_minima, spread_placement
from mesh_motion_numerics.mesh.cells import CellTable


@pytest.fixture
def strip() -> tuple[np.ndarray, CellTable]:
    """100 unit squares in a row; the centre of cell i is (i + ½, ½)."""
    points = np.array([[x, y] for x in range(101) for y in (0.0, 1.0)])
    first = 2 * np.arange(100)
    return points, CellTable.from_arrays({"quad": np.c_[first, first + 2, first + 3, first + 1]})


def test_two_bad_regions_each_get_points(strip):
    points, cells = strip
    quality = np.ones(100)
    quality[10:15] = [0.3, 0.1, -0.2, 0.1, 0.3]
    quality[80:83] = [0.2, 0.0, 0.2]
    found = spread_placement(points, cells, quality, count=3, radius=0.5)
    assert found.cells.tolist()[:2] == [12, 81]  # the worst, then the far and bad one
    np.testing.assert_array_equal(found.points, np.c_[found.cells + 0.5, np.full(3, 0.5)])
    np.testing.assert_array_equal(found.radii, [0.5, 0.25, 1.0])


def test_a_bad_cell_wins_over_a_slightly_farther_better_one(strip):
    points, cells = strip
    quality = np.full(100, 0.9)
    quality[[0, 40, 42]] = [-0.9, -0.5, 0.3]
    assert spread_placement(points, cells, quality, count=2, radius=1.0).cells.tolist() == [0, 40]


def test_only_bad_cells_are_candidates_unless_there_are_too_few(strip):
    points, cells = strip
    quality = np.linspace(0.5, 0.9, 100)  # none is bad
    found = spread_placement(points, cells, quality, count=5, radius=1.0)
    assert found.cells[0] == 0
    assert found.cells.max() < 20  # the 4K smallest
    assert len(np.unique(found.cells)) == 5


def test_no_more_points_than_cells(strip):
    points, cells = strip
    few = CellTable.from_arrays({"quad": cells.blocks[0].nodes[:3]})
    assert sorted(spread_placement(points, few, np.zeros(3), count=20, radius=1.0).cells.tolist()) == [0, 1, 2]
    assert len(spread_placement(points, few, np.zeros(3), count=0, radius=1.0).cells) == 0


def test_cells_at_one_place_are_one_place(strip):
    points, _ = strip
    twice = CellTable.from_arrays({"quad": np.array([[0, 2, 3, 1], [0, 2, 3, 1]])})
    assert spread_placement(points, twice, np.zeros(2), count=2, radius=1.0).cells.tolist() == [0]


def test_minima_are_no_better_than_their_neighbours(strip):
    cells = strip[1]
    quality = np.ones(100)
    quality[10:15] = [0.3, 0.1, -0.2, 0.1, 0.3]
    quality[80:84] = [0.15, 0.0, 0.0, 0.2]  # of equal neighbours the first
    quality[[40, 60]] = [0.19, 0.25]
    assert local_minima(cells, quality, 0.2).tolist() == [12, 81, 40]
    assert len(local_minima(cells, quality, -0.5)) == 0


def test_minima_are_found_across_blocks_of_cells():
    points = np.array([[0.0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1]])
    cells = CellTable.from_arrays({"quad": np.array([[0, 1, 4, 3]]), "triangle": np.array([[1, 2, 4], [2, 5, 4]])})
    assert local_minima(cells, np.array([0.1, 0.05, 0.0]), 0.2).tolist() == [2]
    assert len(points) == 6


def test_the_middle_of_the_gap_of_the_worst_cell():
    points = np.linspace(0, 1, 11)[:, None]
    n = np.arange(10)
    cells = CellTable.from_arrays({"line": np.column_stack([n, n + 1])})
    quality = np.ones(10)
    quality[4] = 0.1
    np.testing.assert_allclose(gap_middle(points, cells, quality, np.isin(np.arange(11), [0, 2, 7, 10])), [[0.45]])
