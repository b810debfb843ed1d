"""Collective requests: all partitions together, bitwise the same for any number of them, and all kinds of
disagreement.
"""

from typing import Any

import numpy as np
import pytest
from mesh_motion_protocol.messages import Commit, Move, Status
from real_sessions import new_session

from mesh_motion_server.service.move import of_all
from mesh_motion_server.session.history.events import read_events
from mesh_motion_server.settings import ServerSettings
from tests.faults.driver import SESSION, make_driver, resume_driver
from tests.faults.stand_in import grid_mesh, split_mesh


class Clock:
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


def test_worst_cells_are_named_as_their_partition_knows_them(pair: Any) -> None:
    moved = pair.move(1)
    places = moved[0].quality["corrected"]["worst"]
    points = [m.points + r.displacement for m, r in zip(pair.meshes, moved, strict=True)]
    for place in places:
        corners = points[place["partition"]][pair.meshes[place["partition"]].cells["triangle"][place["cell"]]]
        a, b = corners[1] - corners[0], corners[2] - corners[0]
        assert place["size"] == pytest.approx(a[0] * b[1] - a[1] * b[0], rel=1e-12)


def test_a_partition_without_moving_nodes_takes_part(store: Any) -> None:
    meshes = split_mesh(grid_mesh(), 2, 1)
    meshes[1].patches.pop("left", None)
    driver = make_driver(store, meshes)
    driver.open()
    moved = driver.move(1)
    assert [reply.type for reply in moved] == ["MOVED", "MOVED"]
    assert moved[1].displacement.shape == meshes[1].points.shape


def test_partitions_that_name_other_times_are_refused(pair: Any) -> None:
    rows = pair.displacement(1)
    for kind, fields in ((Move, [{"displacement": own} for own in rows]), (Commit, [{}, {}])):
        assert pair.send(pair.request(kind, 0, step=1, time=1.0, **fields[0])) == []
        refused = pair.send(pair.request(kind, 1, step=1, time=2.0, **fields[1]))
        assert [reply.code for reply in refused] == 2 * ["INVALID_ARGUMENT.PARTITION"]
        assert "time 1.0" in refused[0].message
        assert "time 2.0" in refused[0].message
        pair.move(1)


def test_the_headroom_of_all_partitions_is_that_in_steps(store: Any) -> None:
    """Alerts use it; each partition may ask for another one."""
    pair = new_session(store, split_mesh(grid_mesh(), 2, 3))
    pair.open()
    replies = []
    for partition, along in enumerate(("displacement", "step")):
        rows = np.full((len(pair.moving[partition]), 2), 0.01)
        fields = {"step": 1, "displacement": rows, "report": "headroom", "headroom_along": along}
        replies += pair.send(pair.request(Move, partition, **fields))
    assert [reply.headroom["along"] for reply in replies] == ["displacement", "step"]
    assert of_all(replies).headroom == replies[1].headroom
    pair.host.close()


def test_the_end_of_the_run_is_shown_until_another_one_is(pair: Any, store: Any) -> None:
    """The largest value of all partitions counts, because each of them may estimate it separately."""
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
