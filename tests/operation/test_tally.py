"""Counts are sent as differences, and totals never decrease."""

import re
import sys
import threading

import msgpack
import pytest

from mesh_motion_server.operation.exposition import exposition
from mesh_motion_server.operation.metrics import METRICS
from mesh_motion_server.operation.tally import Tally


def test_differences_add_up() -> None:
    worker, supervisor = Tally(), Tally()
    assert not worker
    for value in (0.0005, 0.001, 5.0, 1000.0):
        worker.observe("move_seconds", value)
    worker.count("refused", label="NOT_FOUND")
    assert worker
    supervisor.add(msgpack.unpackb(msgpack.packb(worker.take())))
    assert not worker
    worker.observe("move_seconds", 5.0)
    worker.count("refused", 2, label="NOT_FOUND")
    supervisor.add(worker.take())
    supervisor.add(None)
    assert supervisor.counts == {("refused", "NOT_FOUND"): 3}
    assert supervisor.spreads["move_seconds"] == [2, 0, 0, 0, 0, 0, 0, 0, 2, 0, 0, 1, pytest.approx(1010.0015)]


def test_a_block_is_timed_however_it_ends() -> None:
    tally = Tally()
    with pytest.raises(OSError, match="full"), tally.timed("fsync_seconds"):
        raise OSError("full")
    assert sum(tally.spreads["fsync_seconds"][:-1]) == 1


def test_buckets_are_cumulative_and_every_metric_is_shown() -> None:
    tally = Tally()
    for value in (0.01, 0.05, 0.07, 5.0):
        tally.observe("move_min_quality", value)
    text = exposition(tally.values(), [("disk_free_bytes", "", 5.0)], {"version": "1"}).decode()
    assert 'mesh_motion_move_min_quality_bucket{le="0.0"} 0.0' in text
    assert 'mesh_motion_move_min_quality_bucket{le="0.05"} 2.0' in text
    assert 'mesh_motion_move_min_quality_bucket{le="+Inf"} 4.0' in text
    assert "mesh_motion_move_min_quality_count 4.0" in text
    assert "mesh_motion_disk_free_bytes 5.0" in text
    assert "\nmesh_motion_ready " not in text  # not known is not zero
    assert all(f"# HELP mesh_motion_{name}" in text for name in METRICS)


def test_bounds_ascend() -> None:
    for metric in METRICS.values():
        assert list(metric.bounds) == sorted(set(metric.bounds))
        assert bool(metric.bounds) == (metric.kind == "histogram")


def test_two_threads_count_and_nothing_is_lost() -> None:
    """With durability "relaxed" a thread counts its writes while the worker sends its counts."""
    tally, total, rounds = Tally(), Tally(), 50_000

    def count() -> None:
        for number in range(rounds):
            tally.count("refused", label=str(number % 97))
            tally.observe("fsync_seconds", 0.5)

    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        counting = threading.Thread(target=count)
        counting.start()
        while counting.is_alive():
            total.add(tally.take())
        counting.join()
    finally:
        sys.setswitchinterval(interval)
    total.add(tally.take())
    assert sum(total.counts.values()) == rounds
    assert (sum(total.spreads["fsync_seconds"][:-1]), total.spreads["fsync_seconds"][-1]) == (rounds, 0.5 * rounds)


def test_counts_that_alarms_look_at_are_shown_before_the_first() -> None:
    """Prometheus sees no increase between nothing and one."""
    text = exposition(Tally().values(), [], {"version": "1"}).decode()
    assert 'mesh_motion_refused_total{code="INTERNAL"} 0.0' in text
    assert 'mesh_motion_worker_ends_total{how="signal"} 0.0' in text
    assert "mesh_motion_gateway_falls_total 0.0" in text
    tally = Tally()
    tally.count("refused", label="INTERNAL")
    tally.count("refused", label="NOT_FOUND")
    text = exposition(tally.values(), [], {"version": "1"}).decode()
    assert re.findall(r'^mesh_motion_refused_total\{code="(.*)"\} (.*)$', text, re.MULTILINE) == [
        ("INTERNAL", "1.0"),
        ("NOT_FOUND", "1.0"),
    ]
