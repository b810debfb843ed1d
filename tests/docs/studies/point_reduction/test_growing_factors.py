"""Factors that grow with the points equal new ones; factors that lose all digits or are too large are refused."""

import numpy as np
import pytest
from mesh_motion_numerics.reduction import ReductionProblem
from mesh_motion_protocol.errors import InvalidInput, QualityRefused
from reduced_motions import problem

from docs.studies.thesis._point_reduction import REDUCTIONS, recurrence_cholesky
from docs.studies.thesis._point_reduction.incremental_lu import GrowingLU


def matrix(nodes: np.ndarray) -> np.ndarray:
    return problem("wing").columns(nodes, rows=nodes)


def test_bordered_factors_are_those_of_the_matrix_at_every_order() -> None:
    nodes = np.random.default_rng(2).permutation(1100)[:150]  # past the first allocation, twice
    a, values = matrix(nodes), problem("wing").displacement[nodes]
    growing = GrowingLU(3)
    for n in range(len(a)):
        growing.border(a[: n + 1, n], values[n])
        if n in {0, 1, 63, 64, 128, 149}:
            lower, upper = growing.factors()
            np.testing.assert_allclose(lower @ upper, a[: n + 1, : n + 1], atol=1e-14)
            np.testing.assert_array_equal(np.diag(lower), 1.0)
            np.testing.assert_array_equal(lower, np.tril(lower))
            np.testing.assert_array_equal(upper, np.triu(upper))
            np.testing.assert_allclose(a[: n + 1, : n + 1] @ growing.weights(), values[: n + 1], atol=1e-11)


@pytest.mark.parametrize("name", ["greedy", "incremental-lu", "recurrence-cholesky", "grouped-circular"])
def test_nodes_that_coincide_are_refused(name: str) -> None:
    points = np.array([[0.0, 0.0], [1e-9, 0.0], [1.0, 0.0]])
    of = ReductionProblem(points, np.array([[1.0], [2.0], [0.0]]), support_radius=2.0, tolerance=0.0)
    with pytest.raises(QualityRefused, match="singular to working precision"):
        REDUCTIONS[name](of)


def test_nothing_foreseen_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Looking ahead only saves time: with one point at a time, or on a single node, the choice is the same."""
    of = problem("wing", tolerance=1e-2)
    expected = recurrence_cholesky.reduce(of)
    monkeypatch.setattr(recurrence_cholesky, "_AHEAD", 1)
    alone = recurrence_cholesky.reduce(of)
    monkeypatch.setattr(recurrence_cholesky, "_AHEAD", 16)
    monkeypatch.setattr(recurrence_cholesky, "_SHARE", 0.0)
    blind = recurrence_cholesky.reduce(of)
    for other in (alone, blind):
        np.testing.assert_array_equal(other.selected, expected.selected)


def test_columns_that_would_not_fit_into_memory_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recurrence_cholesky, "_MEMORY", 8 * 1100 * 40)
    with pytest.raises(InvalidInput, match=r"more than 0 GiB from 40 points on.*'error-peaks'"):
        REDUCTIONS["recurrence-cholesky"](problem("wing", tolerance=1e-4))
    assert len(REDUCTIONS["recurrence-cholesky"](problem("wing", max_points=20)).selected) == 20
