"""A session's life through requests and replies: one partition, no socket."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from mesh_motion_protocol.messages import Close, Commit, Move, Status, Upload
from raising import raising

from mesh_motion_server.service import move
from mesh_motion_server.session.history.events import read_events
from tests.faults.driver import SESSION, TOKEN, make_driver, resume_driver
from tests.faults.stand_in import grid_mesh, split_mesh


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
    moved = ready.move(2)[0]
    report = ready.ask(Status)
    assert (report.state, report.step, report.iteration, report.waiting_for) == ("TRIAL", 1, 1, [])
    assert report.report["replies"]["MOVED"] == 2
    assert report.report["caches"]["factorization"]["made"] == 2
    assert 0 < moved.caches["bytes"]["factorization"] == report.report["caches"]["factorization"]["bytes"]
    assert report.report["quality"]["cells"] == 32
    assert report.report["peak_memory_bytes"] > 1e6


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


def test_a_lost_trial_is_named_also_after_the_lease_has_ended(ready: Any, store: Any) -> None:
    ready.move(1)
    ready.host.reclaim(TOKEN)
    ready.host.suspend()
    ready.join()
    (refused,) = ready.all(Commit, step=1)
    assert refused.code == "ABORTED.TRIAL_LOST"
    assert [reply.type for reply in ready.advance(1)] == ["COMMITTED"]
    events = [event["event"] for event in read_events(store.root / "sessions" / SESSION)]
    assert events.count("joined") == 1  # a JOIN of a session that was not suspended is no event


def test_steps_are_lost_only_where_the_worker_was_restarted(store: Any) -> None:
    driver = make_driver(store, [grid_mesh()], spec={"durability": "relaxed"})
    driver.open()
    driver.advance(1)
    (reply,) = driver.move(5)
    assert (reply.code, reply.details) == ("FAILED_PRECONDITION.STEP", {"expected": 2, "got": 5})
    driver.host.close()
    (reply,) = resume_driver(driver, store).move(5)
    assert reply.code == "ABORTED.STEPS_LOST"


def test_a_failed_request_may_be_repeated_with_the_same_content_only(ready: Any) -> None:
    request = ready.request(Move, step=5, displacement=ready.displacement(1)[0])
    codes = [ready.send(one)[0].code for one in (request, replace(request, step=1), request)]
    assert codes == ["FAILED_PRECONDITION.STEP", "ABORTED.CONFLICT", "FAILED_PRECONDITION.STEP"]


def test_a_commit_that_is_durable_is_answered_whatever_fails_after_it(
    ready: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    ready.move(1)
    monkeypatch.setattr(ready.host._session.factors, "next_step", raising(ZeroDivisionError("a defect")))
    request = ready.request(Commit, step=1)
    (first,), (again,) = ready.send(request), ready.send(request)
    assert (first.type, first.step, again.digest) == ("COMMITTED", 1, first.digest)
    assert ready.ask(Status).step == 1


def test_a_new_holder_does_not_inherit_a_discard(store: Any) -> None:
    pair = make_driver(store, split_mesh(grid_mesh(), 2, 3))
    pair.open()
    assert pair.ask(Close, 0, outcome="discard").type == "CLOSED"
    pair.host.reclaim(TOKEN)
    pair.join()
    assert [pair.ask(Close, p).type for p in (0, 1)] == ["CLOSED", "CLOSED"]
    assert resume_driver(pair, store).advance(1)[0].type == "COMMITTED"


def test_a_session_without_a_mesh_leaves_nothing_behind(driver: Any, store: Any) -> None:
    driver.join()
    driver.host.close()
    assert list((store.root / "sessions").iterdir()) == []


@pytest.mark.parametrize("extent", [1.0, 100.0])
def test_the_largest_displacement_is_a_multiple_of_the_extent(
    store: Any, monkeypatch: pytest.MonkeyPatch, extent: float
) -> None:
    monkeypatch.setattr(move, "_FARTHEST", 0.09)
    driver = make_driver(store, [replace(grid_mesh(), points=extent * grid_mesh().points)])
    driver.open()
    inside, beyond = (driver.all(Move, [np.full((5, 2), share * extent)], step=1)[0] for share in (0.08, 0.1))
    assert (inside.type, beyond.code) == ("MOVED", "INVALID_ARGUMENT.VALUE")
