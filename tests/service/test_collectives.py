"""Collective requests: all partitions together, bitwise the same for any number of them, and every way to disagree."""

from typing import Any

import numpy as np
import pytest
from mesh_motion_protocol.messages import Build, Close, Commit, Move, Status, Upload

from mesh_motion_server.session.history.events import read_events
from mesh_motion_server.session.state import State
from mesh_motion_server.settings import ServerSettings
from tests.faults.driver import SESSION, TOKEN, make_driver, resume_driver
from tests.faults.stand_in import grid_mesh, split_mesh


class Clock:
    """Seconds that the test decides about."""

    now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def pair(store: Any) -> Any:
    """Two partitions, READY, with a clock and 10 s of patience."""
    clock = Clock()
    limits = ServerSettings(collective_timeout_seconds=10.0)
    driver = make_driver(store, split_mesh(grid_mesh(), 2, 3), limits=limits, clock=clock)
    driver.open()
    driver.clock = clock
    return driver


def move(driver: Any, partition: int, **fields: Any) -> Any:
    return driver.request(Move, partition, **{"step": 1, "displacement": driver.displacement(1)[partition]} | fields)


def test_worst_cells_are_named_as_their_partition_knows_them(pair: Any) -> None:
    moved = pair.move(1)
    places = moved[0].quality["corrected"]["worst"]
    points = [m.points + r.displacement for m, r in zip(pair.meshes, moved, strict=True)]
    for place in places:
        corners = points[place["partition"]][pair.meshes[place["partition"]].cells["triangle"][place["cell"]]]
        a, b = corners[1] - corners[0], corners[2] - corners[0]
        assert place["size"] == pytest.approx(a[0] * b[1] - a[1] * b[0], rel=1e-12)


def test_a_partition_that_does_not_come_is_named(pair: Any) -> None:
    assert pair.host.next_deadline is None
    first = move(pair, 0)
    pair.send(first)
    assert pair.host.next_deadline == 110.0
    assert pair.host.expire(109.9) == []
    (late,) = pair.host.expire(110.0)
    assert late.peer == b"peer 0"
    assert (late.message.code, late.message.details) == ("DEADLINE_EXCEEDED", {"missing": [1]})
    assert late.message.retryable
    assert "partitions 1 did not make the request within 10 s" in late.message.message
    assert pair.host.next_deadline is None
    assert pair.host.state is State.READY
    assert pair.send(first) == []  # the same request again, now with the other one
    assert len(pair.send(move(pair, 1))) == 2


def test_building_waits_for_all_partitions_and_none_uploads_meanwhile(store: Any) -> None:
    driver = make_driver(store, split_mesh(grid_mesh(), 2))
    driver.join()
    driver.upload()
    assert driver.send(driver.request(Build, 0)) == []
    refused = driver.ask(Upload, 0, item="nodes", rows=np.zeros((1, 2)))
    assert refused.code == "FAILED_PRECONDITION.STATE"
    assert driver.ask(Upload, 1, item="nodes", rows=np.zeros((0, 2))).type == "UPLOADED"
    built = driver.send(driver.request(Build, 1))
    for p, reply in enumerate(built):
        np.testing.assert_array_equal(reply.moving_nodes, driver.moving[p])


def test_an_inverted_cell_is_named_by_partition(store: Any) -> None:
    meshes = split_mesh(grid_mesh(), 2)
    meshes[1].cells["triangle"][4] = meshes[1].cells["triangle"][4][::-1]
    driver = make_driver(store, meshes)
    driver.join()
    driver.upload()
    replies = driver.all(Build)
    assert replies[0].details["partition"] == 1
    assert (replies[0].details["type"], replies[0].details["cell"]) == ("triangle", 4)


def test_the_last_to_leave_closes_the_session(pair: Any, store: Any) -> None:
    pair.send(move(pair, 0))
    replies = pair.send(pair.request(Close, 1))
    assert [reply.type for reply in replies] == ["ERROR", "CLOSED"]
    assert replies[0].code == "ABORTED"
    assert not pair.host.closed
    assert pair.ask(Close, 0).type == "CLOSED"
    assert pair.host.closed
    assert len(store.sessions()) == 1


def test_discarding_is_done_when_all_have_left(pair: Any, store: Any) -> None:
    pair.ask(Close, 0, outcome="discard")
    assert len(store.sessions()) == 1
    pair.ask(Close, 1)
    assert store.sessions() == []


def test_a_waiting_partition_gets_an_error_when_the_lease_ends(pair: Any) -> None:
    pair.send(move(pair, 0))
    (answer,) = pair.host.suspend()
    assert answer.message.code == "ABORTED"
    assert pair.host.state is State.SUSPENDED


def test_who_waits_when_the_session_is_reclaimed_is_fenced(pair: Any) -> None:
    first = move(pair, 0)
    pair.send(first)
    pair.host.reclaim(TOKEN)
    assert pair.host.next_deadline is None
    assert pair.send(first)[0].code == "ABORTED.FENCED"


def test_a_partition_without_moving_nodes_takes_part(store: Any) -> None:
    meshes = split_mesh(grid_mesh(), 2, 1)
    meshes[1].patches.pop("left", None)
    driver = make_driver(store, meshes)
    driver.open()
    moved = driver.move(1)
    assert [reply.type for reply in moved] == ["MOVED", "MOVED"]
    assert moved[1].displacement.shape == meshes[1].points.shape


def test_the_end_of_the_run_is_shown_until_another_one_is(pair: Any, store: Any) -> None:
    """With several partitions the largest counts: each may estimate it by itself."""
    pair.move(1)
    replies = pair.send(pair.request(Commit, 0, step=1, final_step=40))
    replies += pair.send(pair.request(Commit, 1, step=1, final_step=50))
    assert {reply.type for reply in replies} == {"COMMITTED"}
    assert pair.ask(Status).report["final_step"] == 50
    pair.host.close()
    again = resume_driver(pair, store)
    assert again.ask(Status).report["final_step"] == 50
    again.advance(2)  # names none
    assert "final_step" not in again.ask(Status).report
    committed = [e for e in read_events(store.root / "sessions" / SESSION) if e["event"] == "committed"]
    assert [event.get("final_step") for event in committed] == [50, None]
