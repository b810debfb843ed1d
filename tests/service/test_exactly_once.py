"""A request executes once, however often it is sent: also over a kill and a resume."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from mesh_motion_protocol.codec import encode
from mesh_motion_protocol.messages import Build, Commit, Join, Move, Rollback, Upload

from mesh_motion_server.service.dispatch import Envelope
from mesh_motion_server.settings import ServerSettings
from proofs.driver import TOKEN, make_driver, resume_driver
from proofs.stand_in import grid_mesh, split_mesh


def same(a: Any, b: Any) -> bool:
    """Bitwise the same frames."""
    return [bytes(frame) for frame in encode(a)] == [bytes(frame) for frame in encode(b)]


def test_a_repeat_gets_the_same_bytes(driver: Any) -> None:
    driver.join()
    upload = driver.request(Upload, item="nodes", rows=np.zeros((2, 2)))
    assert driver.send(upload)[0].rows_total == 2
    assert driver.send(upload)[0].rows_total == 2
    assert driver.ask(Upload, item="nodes", rows=np.zeros((2, 2))).rows_total == 4


def test_a_commit_is_executed_once(ready: Any) -> None:
    ready.move(1)
    commit = ready.request(Commit, step=1)
    first = ready.send(commit)[0]
    assert first.type == "COMMITTED"
    for _ in range(3):
        assert same(ready.send(commit)[0], first)
    assert ready.host.step == 1


def test_a_move_is_executed_once(ready: Any) -> None:
    move = ready.request(Move, step=1, displacement=ready.displacement(1)[0])
    first = ready.send(move)[0]
    assert same(ready.send(move)[0], first)
    assert ready.host.iteration == 1


def test_other_content_conflicts(ready: Any) -> None:
    move = ready.request(Move, step=1, displacement=ready.displacement(1)[0])
    ready.send(move)
    for other in (
        replace(move, displacement=ready.displacement(2)[0]),
        replace(move, frame="reference"),
        ready.request(Rollback, step=1, sequence=move.sequence),
    ):
        assert ready.send(other)[0].code == "ABORTED.CONFLICT"
    assert ready.host.iteration == 1


def test_a_request_that_failed_is_executed_when_it_is_repeated(ready: Any) -> None:
    commit = ready.request(Commit, step=1)
    assert ready.send(commit)[0].code == "FAILED_PRECONDITION.STATE"
    ready.move(1)
    assert ready.send(commit)[0].type == "COMMITTED"
    assert ready.send(replace(commit, step=2))[0].code == "ABORTED.CONFLICT"


@pytest.mark.parametrize("point", ["session.upload.taken", "request.unstored"])
def test_a_part_that_was_taken_and_refused_is_not_there_twice(driver: Any, plan_fault: Any, point: str) -> None:
    driver.join()
    driver.ask(Upload, item="nodes", rows=np.zeros((1, 2)))
    plan_fault(f"{point}=raise:MemoryError@2")
    assert driver.ask(Upload, item="nodes", rows=np.ones((2, 2))).code == "RESOURCE_EXHAUSTED.MEMORY"
    assert driver.ask(Upload, item="nodes", rows=np.ones((2, 2))).rows_total == 3


def test_an_old_request_is_stale(ready: Any) -> None:
    first = ready.request(Move, step=1, displacement=ready.displacement(1)[0])
    ready.send(first)
    for _ in range(ServerSettings().stored_replies):
        ready.move(1)
    assert ready.send(first)[0].code == "ABORTED.STALE"


def test_a_commit_survives_a_kill(ready: Any, store: Any) -> None:
    """The reply was lost with the process: the repeat, under the new epoch, gets it from the journal."""
    ready.advance(1)
    ready.move(2)
    commit = ready.request(Commit, step=2)
    first = ready.send(commit)[0]
    ready.host._session._folder.release()  # as the kernel does for a killed process; nothing is closed
    again = resume_driver(ready, store)
    repeated = again.send(replace(commit, epoch=again.host.epoch))[0]
    assert same(repeated, first)
    assert again.host.step == 2
    assert again.send(replace(commit, epoch=again.host.epoch, step=3))[0].code == "ABORTED.CONFLICT"
    again.host.close()


def test_a_reply_cannot_be_changed_by_its_receiver(ready: Any) -> None:
    (moved,) = ready.move(1)
    assert not moved.displacement.flags.writeable


def test_collectives_are_executed_once_per_partition(store: Any) -> None:
    driver = make_driver(store, split_mesh(grid_mesh(), 2))
    driver.open()
    moves = [driver.request(Move, p, step=1, displacement=driver.displacement(1)[p]) for p in (0, 1)]
    assert driver.send(moves[0]) == []
    assert driver.send(moves[0]) == []  # a repeat while it waits is no second request
    replies = driver.send(moves[1])
    assert [r.client for r in replies] == [m.client for m in moves]
    for move, reply in zip(moves, replies, strict=True):
        assert same(driver.send(move)[0], reply)
    assert driver.host.iteration == 1
    commits = [driver.request(Commit, p, step=1) for p in (0, 1)]
    driver.send(commits[1])
    committed = driver.send(commits[0])
    driver.host._session._folder.release()
    again = resume_driver(driver, store)
    for commit, reply in zip(commits, committed, strict=True):
        assert same(again.send(replace(commit, epoch=2))[0], reply)


def test_the_repeat_is_answered_where_it_came_from_last(store: Any) -> None:
    driver = make_driver(store, split_mesh(grid_mesh(), 2))
    driver.join()
    driver.upload()
    builds = [driver.request(Build, p) for p in (0, 1)]
    assert driver.send(builds[0]) == []
    driver.send(driver.request(Join, 0, token=TOKEN), peer=b"reconnected")
    assert driver.send(builds[0], peer=b"reconnected") == []
    envelopes = driver.host.handle(Envelope(b"peer 1", builds[1]))
    assert [e.peer for e in envelopes] == [b"reconnected", b"peer 1"]


def test_what_was_executed_is_known_even_if_counting_it_fails(ready: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: Any) -> None:
        raise KeyError("metric")

    move = ready.request(Move, step=1, displacement=ready.displacement(1)[0])
    monkeypatch.setattr("mesh_motion_server.service.execution.count_executed", fail)
    ready.send(move)
    assert ready.send(move)[0].type == "MOVED"
    assert ready.host.iteration == 1
