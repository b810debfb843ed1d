"""A session's life through requests and replies: one partition, no socket."""

from typing import Any

import numpy as np
import pytest
from mesh_motion_protocol.digests import state_digest
from mesh_motion_protocol.errors import SessionError
from mesh_motion_protocol.messages import Build, Close, Commit, Fetch, Hello, Move, Ping, Status, Upload
from raising import raising

from mesh_motion_server.service.dispatch import Envelope
from mesh_motion_server.session.state import State
from tests.faults.stand_in import grid_mesh


def test_a_life(driver: Any, store: Any) -> None:
    assert driver.join().state == "NEW"
    driver.upload()
    assert driver.host.state is State.OPENING
    (built,) = driver.all(Build)
    assert built.settings["correction"] == "smooth"
    assert built.settings["support_radius"] == 1.0
    assert built.mesh["nodes"] == 25
    assert built.mesh["cells"] == {"triangle": 32}
    assert built.mesh["patches"] == {"left": {"role": "moving", "nodes": 5}, "right": {"role": "fixed", "nodes": 5}}
    assert built.mesh["box"] == [[0.0, 0.0], [1.0, 1.0]]
    assert built.quality["cells"] == 32
    np.testing.assert_array_equal(built.moving_nodes, [0, 5, 10, 15, 20])
    x = grid_mesh().points
    for step in (1, 2, 3):
        rows = driver.displacement(step)[0]
        moved = driver.move(step)[0]
        assert (moved.step, moved.iteration) == (step, 1)
        assert moved.displacement[built.moving_nodes].tobytes() == rows.tobytes()
        x = x + moved.displacement
        (committed,) = driver.all(Commit, step=step)
        assert (committed.step, committed.durable_step) == (step, step)
        # a client that adds the answers has the server's coordinates bitwise, and can prove it
        assert committed.digest == state_digest(step, x)
        fetched = driver.ask(Fetch)
        assert fetched.points.tobytes() == x.tobytes()
    reference = driver.ask(Fetch, what="reference")
    assert reference.points.tobytes() == grid_mesh().points.tobytes()
    assert reference.step == fetched.step  # the last committed step, whichever coordinates are asked for
    assert driver.ask(Close).step == 3
    assert driver.host.closed
    assert [s.step for s in store.sessions()] == [3]


def test_iterations_start_from_the_committed_state_and_share_a_factorization(ready: Any) -> None:
    first = ready.move(1)[0]
    ready.all(Move, [2 * ready.displacement(1)[0]], step=1)
    third = ready.move(1)[0]
    assert [first.iteration, third.iteration] == [1, 3]
    assert [moved.caches["factorization"] for moved in (first, third)] == ["made", "reused"]
    assert first.displacement.tobytes() == third.displacement.tobytes()
    assert (first.quality, first.correction, first.warnings) == (third.quality, third.correction, third.warnings)


def test_status(ready: Any) -> None:
    ready.advance(1)
    ready.move(2)
    report = ready.ask(Status)
    assert (report.state, report.step, report.iteration, report.waiting_for) == ("TRIAL", 1, 1, [])
    assert report.report["replies"]["MOVED"] == 2
    assert report.report["caches"]["factorization"]["made"] == 2
    assert report.report["quality"]["cells"] == 32
    assert report.report["peak_memory_bytes"] > 1e6


def test_unknown_words_and_tokens_are_refused_and_change_nothing(driver: Any) -> None:
    """The decoder refuses these at a socket; the table of bad inputs has many more of them."""
    driver.join()
    assert driver.ask(Upload, item="edges", rows=np.zeros((1, 2))).code == "INVALID_ARGUMENT.VALUE"
    driver.upload()
    driver.all(Build)
    assert driver.all(Move, driver.displacement(1), step=1, frame="other")[0].code == "INVALID_ARGUMENT.VALUE"
    assert driver.ask(Close, outcome="maybe").code == "INVALID_ARGUMENT.VALUE"
    assert driver.ask(Fetch, what="x").code == "INVALID_ARGUMENT.VALUE"
    for kind, answer in ((Ping, "PONG"), (Hello, "ERROR")):
        assert driver.host.handle(Envelope(b"any", kind()))[0].message.type == answer
    with pytest.raises(SessionError, match="for this token"):
        driver.host.reclaim(bytes(32))
    assert driver.move(1)[0].iteration == 1


def test_something_unforeseen_is_internal_and_changes_nothing(
    ready: Any, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(type(ready.host._session.model), "move", raising(ZeroDivisionError("a defect")))
    (reply,) = ready.move(1)
    assert (reply.code, reply.state) == ("INTERNAL", "READY")
    assert "ZeroDivisionError: a defect" in reply.message
    assert "a request failed unexpectedly" in caplog.text
    monkeypatch.undo()
    assert ready.move(1)[0].type == "MOVED"


def test_no_memory_is_a_typed_error(ready: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(type(ready.host._session.model), "move", raising(MemoryError()))
    assert ready.move(1)[0].code == "RESOURCE_EXHAUSTED.MEMORY"


@pytest.mark.parametrize("point", ["session.upload.taken", "request.unstored"])
def test_a_part_that_was_taken_and_refused_is_not_there_twice(driver: Any, plan_fault: Any, point: str) -> None:
    driver.join()
    driver.ask(Upload, item="nodes", rows=np.zeros((1, 2)))
    plan_fault(f"{point}=raise:MemoryError@2")
    assert driver.ask(Upload, item="nodes", rows=np.ones((2, 2))).code == "RESOURCE_EXHAUSTED.MEMORY"
    assert driver.ask(Upload, item="nodes", rows=np.ones((2, 2))).rows_total == 3


def test_a_reply_cannot_be_changed_by_its_receiver(ready: Any) -> None:
    (moved,) = ready.move(1)
    assert not moved.displacement.flags.writeable


def test_an_executed_request_is_known_even_if_its_count_fails(ready: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    move = ready.request(Move, step=1, displacement=ready.displacement(1)[0])
    monkeypatch.setattr("mesh_motion_server.service.recorder._count", raising(KeyError("metric")))
    ready.send(move)
    assert ready.send(move)[0].type == "MOVED"
    assert ready.host.iteration == 1
