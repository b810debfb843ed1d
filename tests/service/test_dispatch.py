"""A session's life through requests and replies: one partition, no socket."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mesh_motion_protocol.codec import encode
from mesh_motion_protocol.digests import state_digest
from mesh_motion_protocol.errors import SessionError
from mesh_motion_protocol.messages import Build, Close, Commit, Fetch, Hello, Join, Move, Ping, Rollback, Status, Upload
from raising import raising

from mesh_motion_server.service.dispatch import Envelope
from mesh_motion_server.session.state import State
from mesh_motion_server.session.store import SessionStore
from proofs.driver import TOKEN, make_driver, resume
from proofs.model_files import FailingFiles, ModelFiles
from proofs.stand_in import grid_mesh


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
        # a client that adds up the answers has the server's coordinates bitwise, and can prove it
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


def test_a_new_epoch_fences_the_old_holder(ready: Any) -> None:
    ready.move(1)
    old = ready.request(Move, step=1, displacement=ready.displacement(1)[0])
    with pytest.raises(SessionError, match="for this token"):
        ready.host.reclaim(bytes(32))
    assert ready.host.reclaim(TOKEN) == 2
    assert ready.host.state is State.READY
    fenced = ready.send(old)[0]
    assert fenced.code == "ABORTED.FENCED"
    assert ready.ask(Status).code == "UNAUTHENTICATED"
    ready.join()
    assert ready.all(Commit, step=1)[0].code == "ABORTED.TRIAL_LOST"
    future = ready.ask(Join, epoch=3, token=TOKEN)
    assert (future.code, "never given out" in future.message) == ("ABORTED.FENCED", True)


def test_status(ready: Any) -> None:
    ready.advance(1)
    ready.move(2)
    report = ready.ask(Status)
    assert (report.state, report.step, report.iteration, report.waiting_for) == ("TRIAL", 1, 1, [])
    assert report.report["replies"]["MOVED"] == 2
    assert report.report["caches"]["factorization"]["made"] == 2
    assert report.report["quality"]["cells"] == 32
    assert report.report["peak_memory_bytes"] > 1e6


def test_unknown_words_are_refused_and_change_nothing(driver: Any) -> None:
    """At a socket the table of bad inputs asks with many more of them."""
    driver.join()
    assert driver.ask(Upload, item="edges", rows=np.zeros((1, 2))).code == "INVALID_ARGUMENT.VALUE"
    driver.upload()
    driver.all(Build)
    assert driver.all(Move, driver.displacement(1), step=1, frame="other")[0].code == "INVALID_ARGUMENT.VALUE"
    assert driver.ask(Close, outcome="maybe").code == "INVALID_ARGUMENT.VALUE"
    for kind, answer in ((Ping, "PONG"), (Hello, "ERROR")):
        assert driver.host.handle(Envelope(b"any", kind()))[0].message.type == answer
    assert driver.move(1)[0].iteration == 1


def test_an_upload_of_another_type_is_named_as_it_was_sent(driver: Any) -> None:
    driver.join()
    refused = driver.ask(Upload, item="nodes", rows=np.zeros((1, 2), np.int32))
    assert (refused.code, "got int32" in refused.message) == ("INVALID_ARGUMENT.DTYPE", True)


def test_a_close_that_the_disk_refuses_changes_nothing() -> None:
    """Found by the state machine: the session was closed all the same, and its worker stayed."""
    failing = FailingFiles(ModelFiles(), for_ever=False)
    driver = make_driver(SessionStore(Path("/model"), files=failing), [grid_mesh()])
    driver.open()
    driver.move(1)
    failing.fail_at = failing.count + 1
    refused = driver.ask(Close, outcome="discard")
    assert (refused.code, refused.state, driver.host.closed) == ("RESOURCE_EXHAUSTED.DISK", "TRIAL", False)
    assert driver.all(Commit, step=1)[0].type == "COMMITTED"
    assert driver.ask(Close, outcome="discard").type == "CLOSED"
    assert driver.host.closed


def test_a_session_resumed_before_it_is_built_keeps_its_epoch(driver: Any, store: Any) -> None:
    """Found by the state machine: the journal began at epoch 1 again, and later fenced no holder of epoch 2."""
    assert driver.host.reclaim(TOKEN) == 2
    driver.open()
    driver.host.close()
    assert resume(store).epoch == 3


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


def test_something_unforeseen_while_committing_fails_the_session(ready: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    ready.move(1)
    monkeypatch.setattr(type(ready.host._session._built.keeper), "commit", raising(ZeroDivisionError("a defect")))
    (reply,) = ready.all(Commit, step=1)
    assert (reply.code, reply.state) == ("INTERNAL", "FAILED")


def test_no_memory_is_a_typed_error(ready: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(type(ready.host._session.model), "move", raising(MemoryError()))
    assert ready.move(1)[0].code == "RESOURCE_EXHAUSTED.MEMORY"


def test_every_reply_fits_the_wire(ready: Any) -> None:
    """The codec takes all of them: plain values within the header's limits."""
    built = ready.host.handle(Envelope(b"peer 0", ready.request(Status)))[0].message
    replies = [built, *ready.move(1), ready.ask(Fetch), *ready.all(Commit, step=1), ready.ask(Status), ready.join()]
    replies += ready.all(Move, [np.full((5, 2), [1.5, 0.0])], step=2)
    replies += ready.all(Rollback, step=2)
    replies += [ready.ask(Fetch, what="x"), ready.ask(Close)]
    for reply in replies:
        assert encode(reply), reply


def test_a_wrong_token_and_another_session_are_refused_in_the_same_words(driver: Any) -> None:
    wrong = driver.ask(Join, token=bytes(32))
    other = driver.ask(Join, token=bytes(32), session="f" * 32)
    for reply in (wrong, other):
        assert reply.code == "NOT_FOUND"
    assert wrong.message.replace(driver.host.session, "ID") == other.message.replace("f" * 32, "ID")
    assert (wrong.hint, wrong.details) == (other.hint, other.details)


@pytest.mark.parametrize("passage", ["request.committed=raise:MemoryError@1", "request.unstored=raise:MemoryError@2"])
def test_a_commit_is_answered_once_it_is_durable_whatever_fails_then(ready: Any, plan_fault: Any, passage: str) -> None:
    ready.move(1)
    plan_fault(passage)
    commit = ready.request(Commit, step=1)
    (committed,) = ready.send(commit)
    (again,) = ready.send(commit)
    assert committed.type == "COMMITTED"
    assert encode(again) == encode(committed)
    assert ready.host.state is State.READY
