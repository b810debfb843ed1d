"""Cells are sorted by their node tuples, also if many begin with the same node, and keep their origin."""

import numpy as np
import pytest
from thread_counts import on_one_and_on_all_threads

from mesh_motion_server.session.partitions.merging import sorted_cells


@pytest.mark.parametrize("count", [3, 40, 5000])
@pytest.mark.parametrize("columns", [2, 4, 8])
def test_cells_are_sorted_by_their_node_tuples(count: int, columns: int) -> None:
    random = np.random.default_rng(count)
    rows = random.integers(0, count, (500, columns))
    rows[::5, 0] = rows[0, 0]  # more than are sorted by insertion
    rows[::7, :-1] = rows[0, :-1]
    found, order, _ = sorted_cells([(np.arange(count), rows)], count)
    assert found.tolist() == sorted(rows.tolist())
    np.testing.assert_array_equal(rows[order], found)
    same = np.all(found[1:] == found[:-1], axis=1)
    assert (np.diff(order)[same] > 0).all()  # equal cells stay in the order they came


def test_each_piece_is_renumbered_by_its_own_map() -> None:
    first, second = np.array([4, 0, 2]), np.array([3, 1])
    pieces = [(first, np.array([[0, 1], [2, 0]])), (second, np.array([[1, 0]]))]
    found, order, _ = sorted_cells(pieces, 5)
    assert found.tolist() == [[1, 3], [2, 4], [4, 0]]
    assert order.tolist() == [2, 1, 0]


@pytest.mark.parametrize("width", [np.int32, np.int64])
def test_many_cells_of_pieces_in_any_width(width: type) -> None:
    rows = np.random.default_rng(4).integers(0, 800, (6000, 4)).astype(width)
    found, order, _ = sorted_cells([(np.arange(800), rows[:2500]), (np.arange(800), rows[2500:])], 800)
    assert found.tolist() == sorted(rows.tolist())
    np.testing.assert_array_equal(rows[order], found)


def test_numbers_that_no_node_has_are_refused() -> None:
    for new, cells in (([0, 5], [[0, 1]]), ([0, -1], [[0, 1]]), ([0, 1], [[0, 2]]), ([0, 1], [[-1, 0]])):
        with pytest.raises(ValueError, match="pieces"):
            sorted_cells([(np.array(new), np.array(cells))], 5)


@pytest.mark.parametrize("rows", [[[0, 1], [0, 2]], [[3, 0], [0, 2], [2, 0], [0, 2], [2, 0]], [[4, 4]] * 3])
def test_the_first_repeated_cell_is_found(rows: list[list[int]]) -> None:
    found, _, again = sorted_cells([(np.arange(3000), np.array(rows) * 600)], 3000)
    same = np.flatnonzero((found[1:] == found[:-1]).all(axis=1)) + 1
    assert again == (same[0] if len(same) else -1)


def test_the_number_of_threads_changes_nothing() -> None:
    rows = np.random.default_rng(2).integers(0, 900, (60_000, 3))
    one, all_of_them = on_one_and_on_all_threads(lambda: sorted_cells([(np.arange(900), rows)], 900))
    for part, same in zip(one, all_of_them, strict=True):
        np.testing.assert_array_equal(part, same)
