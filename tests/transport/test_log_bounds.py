"""The log is bounded, contains no data of clients, and counts its omitted lines."""

import io
import json
import logging

import pytest
from mesh_motion_protocol.messages import Hello, Ping

from mesh_motion_server.transport import telemetry
from mesh_motion_server.transport.telemetry import (
    Throttle,
    configure,
    log,
    log_suppressed,
    places_of_exception,
    shortened,
)
from tests.faults.waiting import wait_until


def test_a_burst_then_a_rate_then_a_count():
    now = [0.0]
    throttle = Throttle(lambda: now[0])
    assert sum(throttle.admits("refused") for _ in range(100_000)) == 100
    assert throttle.admits("another")
    assert throttle.take() == {"refused": 99_900}
    assert throttle.take() == {}
    now[0] = 10.0
    assert sum(throttle.admits("refused") for _ in range(100)) == 10
    assert throttle.take() == {"refused": 90}


def test_events_without_end_share_one_bucket():
    throttle = Throttle(lambda: 0.0)
    assert sum(throttle.admits(f"event {i}") for i in range(100_000)) == 500 + 100
    assert len(throttle.take()) == 1


def test_values_are_cut():
    values = shortened({"agent": "x" * 10_000, "count": 3})
    assert len(values["agent"]) < 400
    assert values["agent"].endswith("(10000 characters)")
    assert values["count"] == 3


def test_an_exception_is_logged_by_type_and_places_only():
    try:
        raise ValueError("coordinates 0.123456789 1.5 are wrong")
    except ValueError as error:
        logged = places_of_exception(error)
    assert logged["exception"] == "ValueError"
    assert "test_log_bounds.py" in logged["trace"][-1]
    assert "0.123" not in json.dumps(logged)


@pytest.fixture
def lines(monkeypatch):
    stream = io.StringIO()
    monkeypatch.setattr("sys.stderr", stream)
    root = logging.getLogger()
    monkeypatch.setattr(root, "handlers", [])
    level = root.level
    monkeypatch.setattr(telemetry, "_THROTTLE", Throttle())
    configure("tester", "debug")
    yield lambda: [json.loads(line) for line in stream.getvalue().splitlines()]
    telemetry._NAMES.clear()
    logging.captureWarnings(False)
    root.setLevel(level)


def test_both_ways_to_log_give_the_same_bounded_lines(lines):
    secret = "0.123456789"
    for say in (log().exception, logging.getLogger("below").exception):
        try:
            raise ValueError(secret)
        except ValueError:
            say("failed")
    found = lines()
    assert len(found) == 2
    for line in found:
        assert (line["event"], line["role"], line["level"], line["exception"]) == (
            "failed",
            "tester",
            "error",
            "ValueError",
        )
        assert line["timestamp"]
        assert secret not in json.dumps(line)
    for _ in range(300):
        log().debug("served")  # not bounded
        logging.getLogger("below").warning("again and again")
        log().warning("over and over")
    log_suppressed()
    logged = {line["of"]: line["lines"] for line in lines() if line["event"] == "suppressed"}
    assert sum(line["event"] == "served" for line in lines()) == 300
    assert logged == {"again and again": 200, "over and over": 200}


def test_an_attacker_does_not_fill_the_disk_with_logs(start, connect):
    server = start()
    wire = connect(server.endpoint)
    for _ in range(2_500):
        wire.send_frames(b"no header")
        wire.send_frames(b"\xc1" * 100, b"frames", b"behind")
        wire.send(Hello, versions=[[1, 0]], agent="\x1b[31m" + "A" * 250)
        wire.send_frames(b"")
    assert wire.ask(Ping).type  # the answers to the noise come first; all of it was taken
    wait_until(
        lambda: sum(line["lines"] for line in server.events("suppressed")) > 1_000, "what was left out is logged"
    )
    assert server.log_path.stat().st_size < 300_000
    assert len(server.events("refused")) < 500
