"""The benchmark of partitions: the model finds the constants it is given, a small case is measured end to end."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.distributed.cases import load
from benchmarks.distributed.figures import Results, Row
from benchmarks.distributed.model import ASSUMED_BANDWIDTH, CostModel
from benchmarks.distributed.own_ranks import measured as measured_on_ranks
from benchmarks.distributed.picture import write_picture
from benchmarks.distributed.report import tables

A, B, C, K, BETA, GAMMA, ROUNDS = 0.02, 4e-6, 5e-7, 1.5, 60.0, 3e5, 3


def row(case: str, nodes: int, boundary: int, workers: int) -> Row:
    """A step that costs what the constants say."""
    halo = K * (nodes / workers) ** (-1 / 3)
    volume = C * nodes * (1 + halo)
    return Row(
        case=case,
        way="partitions",
        nodes=nodes,
        boundary=boundary,
        workers=workers,
        halo=halo,
        wall=1.0,
        here=0.1,
        longest=volume / workers,
        all_workers=volume,
        solve=A + B * boundary,
        pack=0.001,
        sent={"coefficients": int(BETA * boundary + GAMMA * workers)},
        received={"summaries": 40_000 * workers},
        rounds=ROUNDS,
        setup=1.0,
        difference=0.0,
    )


@pytest.fixture
def results() -> Results:
    found = Results("a machine.", round_trip=0.01, per_task=0.001, bandwidth=1e9)
    for workers in (1, 2, 4):
        found.rows += [row("M3", 50_000, 6000, workers), row("M4", 500_000, 18_000, workers)]
    found.rows += [replace(found.rows[0], way="session"), replace(found.rows[0], way="one machine", workers=0)]
    found.rows.append(row("4 × M3", 200_000, 24_000, 4))
    return found


def test_the_model_finds_the_constants(results: Results) -> None:
    model = CostModel.of(results)
    found = (model.solve_fixed, model.solve_per_node, model.volume_per_node, model.halo)
    assert found == pytest.approx((A, B, C, K), rel=1e-6)
    assert (model.bytes_per_node, model.bytes_per_partition) == pytest.approx((BETA, GAMMA), rel=1e-3)


def test_the_terms_add_up_and_scale_as_they_should(results: Results) -> None:
    model = CostModel.of(results)
    few, many = model.terms(1e9, 3e6, 100), model.terms(1e9, 3e6, 1000)
    assert few.total == few.solve + few.messages + few.wire + few.volume
    assert many.solve == few.solve == pytest.approx(A + B * 3e6, rel=1e-6)
    assert many.volume == pytest.approx(C * 1e6 * (1 + K / 100), rel=1e-6)
    assert many.messages == pytest.approx(ROUNDS * (0.01 + 1.0))
    assert many.wire == pytest.approx((BETA * 3e6 + GAMMA * 1000) / ASSUMED_BANDWIDTH, rel=1e-3)


def test_tables_and_picture(results: Results, tmp_path: Path) -> None:
    text = tables(results)
    assert "| 4 × M3 | 4 | summaries |" in text["distributed-steps"]
    assert text["distributed-steps"].count("\n| M3 |") == 5
    assert "| one machine" not in text["distributed-wire"]
    assert "| 1e+09 | 3e+06 | 1000 | 12 s |" in text["distributed-prediction"]
    results.save(tmp_path / "results.json")
    assert tables(Results.load(tmp_path / "results.json")) == text
    write_picture(results, tmp_path / "picture.png")
    assert (tmp_path / "picture.png").stat().st_size > 10_000


def test_copies_stand_side_by_side(tmp_path: Path) -> None:
    one, three = load("M1", tmp_path), load("M1", tmp_path, copies=3)
    assert len(three.points) == 3 * len(one.points)
    assert len(three.cells) == 3 * len(one.cells)
    assert len(np.unique(three.points, axis=0)) == len(three.points)
    second = three.points[len(one.points) : 2 * len(one.points)]
    np.testing.assert_array_equal(second, one.points + np.array([1.1, 0.0]))
    assert three.boundary.max() < len(three.points)


@pytest.mark.nightly  # worker processes
def test_a_small_case_is_measured(tmp_path: Path) -> None:
    measure = pytest.importorskip("benchmarks.distributed.measure")
    found = list(measure.measured(load("M1", tmp_path), [1, 2], tmp_path, 1))
    assert [(r.way, r.workers) for r in found] == [
        ("one machine", 0),
        ("session", 1),
        ("partitions", 1),
        ("session", 2),
        ("partitions", 2),
    ]
    assert all(r.difference == 0.0 for r in found)
    assert all(r.longest <= r.all_workers for r in found)
    assert all(("displacements" in r.received) == (r.way == "session") for r in found)
    round_trip, per_task, bandwidth = measure.measure_messages(load("M1", tmp_path, copies=4))
    assert round_trip > 0
    assert bandwidth > 1e6
    assert per_task < 0.1


@pytest.mark.slow
def test_ranks_that_evaluate_the_field_are_measured(tmp_path: Path) -> None:
    row = measured_on_ranks(load("M1", tmp_path), 2, "client")
    assert 10_000 < row["sent"] < 1_000_000
    assert 10_000 < row["received"] < 1_000_000
    assert 0.0 < row["step"] < 60.0
    assert row["memory"] > 1e7
