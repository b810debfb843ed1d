"""The judge of a run: its measures for known motions, and its detection of a run that drifts."""

from dataclasses import replace

import numpy as np
import pytest
from mesh_motion_numerics.mesh.cells import CellTable

from docs.studies.run import judged_runs
from docs.studies.run.judged_runs import BOUNDS, RUNS, Walk, failures, judged, least_shape, phases

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
QUAD = CellTable.from_arrays({"quad": np.array([[0, 1, 2, 3]])})


@pytest.mark.parametrize(
    ("matrix", "shape"),
    [(np.eye(2), 1.0), (np.diag([3.0, 3.0]), 1.0), (np.diag([9.0, 1.0]), 18.0 / 82.0), (np.diag([1.0, -1.0]), 0.0)],
)
def test_the_shape_sees_squeezed_and_inverted_cells(matrix: np.ndarray, shape: float) -> None:
    assert least_shape(SQUARE, SQUARE @ matrix, QUAD) == pytest.approx(shape)


def test_speed_and_jolt_are_those_of_the_worst_node() -> None:
    """The boundary node moves on by 1; the other node stays and then jumps by 3."""
    places = [np.array([[float(k), 0.0], [0.0, 3.0 * (k == 2)]]) for k in range(3)]
    walk = Walk(np.array([0]), places, 0.0)
    assert walk.speed == 3.0
    assert walk.jolts == [3.0]


def test_a_period_returns_exactly() -> None:
    assert [phases(32)[k] for k in (7, 15, 31)] == [1.0, 0.0, 0.0]
    assert phases(256, 0.25) == pytest.approx(phases(256)[:64])


def test_figures_outside_their_bounds_are_named() -> None:
    within = {name: low or high for name, (low, high) in BOUNDS.items()}
    assert failures(within) == []
    assert failures(within | {"resumed": np.nan}) == []
    assert failures(within | {"rest": 0.1, "shape / plain": 0.9}) == ["rest", "shape / plain"]


def test_a_motion_that_depends_on_the_way_is_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(judged_runs, "DEFAULT", {"displacement": "relative"})
    columns, _ = judged(replace(RUNS["slab, ± 40°"](), periods=2, share=0.25))
    assert {"rest", "repeat", "8 steps"} <= set(failures(columns))
