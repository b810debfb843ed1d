"""Benchmarks apart from the summary, each with a small case: a session's history, ranks that move their own nodes."""

from pathlib import Path

import pytest

from benchmarks.distributed.own_ranks import load, measured
from benchmarks.history import measure
from mesh_motion_server.service.recorder import Recorder
from mesh_motion_server.watch.observation.follow import EventTail


def test_one_session_has_a_history_and_the_other_none(tmp_path: Path) -> None:
    before = Recorder.executed
    found = measure(tmp_path, 5, 4)
    assert Recorder.executed is before
    assert 0 < found["within"] < found["step"] * 1000
    recorded, nothing = (EventTail(tmp_path / "sessions" / (name * 32)).read() for name in "12")
    assert sum(event["event"] == "committed" for event in recorded) == 4
    assert nothing == []


@pytest.mark.nightly
@pytest.mark.parametrize("volume", ["client", "dask"])
def test_ranks_that_evaluate_the_field_are_measured(tmp_path: Path, volume: str) -> None:
    if volume == "dask":
        pytest.importorskip("distributed")
    row = measured(load("M1", tmp_path), 2, volume)
    assert 10_000 < row["sent"] < 1_000_000
    assert 10_000 < row["received"] < 1_000_000
    assert row["work"] > 0.0
    assert 0.0 < row["step"] < 60.0
    assert row["memory"] > 1e7
