"""A request executes once, however often it is sent: also over a kill and a resume."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from mesh_motion_protocol.codec import encode
from mesh_motion_protocol.messages import Commit, Move, Upload
from raising import raising

from tests.faults.driver import make_driver, resume_driver
from tests.faults.stand_in import grid_mesh, split_mesh


def same(a: Any, b: Any) -> bool:
    """Bitwise the same frames."""
    return [bytes(frame) for frame in encode(a)] == [bytes(frame) for frame in encode(b)]


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
        assert again.send(replace(commit, epoch=2, step=3))[0].code == "ABORTED.CONFLICT"


def test_what_was_executed_is_known_even_if_counting_it_fails(ready: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    move = ready.request(Move, step=1, displacement=ready.displacement(1)[0])
    monkeypatch.setattr("mesh_motion_server.service.execution.count_executed", raising(KeyError("metric")))
    ready.send(move)
    assert ready.send(move)[0].type == "MOVED"
    assert ready.host.iteration == 1
