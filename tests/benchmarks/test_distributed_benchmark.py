"""The benchmark of ranks that move their own nodes: a small case is measured end to end."""

from pathlib import Path

import pytest

from benchmarks.distributed.own_ranks import load, measured


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
