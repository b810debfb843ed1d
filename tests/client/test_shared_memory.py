"""Replies in memory shared by client and worker over an ipc endpoint: the same bits as over any connection."""

from dataclasses import replace

import numpy as np
import pytest
from mesh_motion_client import Mesh, Patch, connect
from mesh_motion_client.reply_memory import ReplyMemory
from mesh_motion_protocol.shared_memory import SUPPORTED

pytestmark = pytest.mark.skipif(not SUPPORTED, reason="needs anonymous files of Linux")


@pytest.fixture
def large_mesh():
    count = 40_000
    points = np.stack(np.meshgrid(np.arange(count) / 64, np.arange(2) / 64), axis=-1).reshape(-1, 2)
    i = np.arange(count - 1)
    quads = np.stack([i, i + 1, i + 1 + count, i + count], axis=1)
    return Mesh(points, {"quad": quads}, {"low": Patch("moving", [0, 1, 2]), "far": Patch("fixed", [count - 1])})


@pytest.fixture
def taken(monkeypatch):
    offered, take = [], ReplyMemory.take

    def refuse(self):
        offered.append(take(self))
        return offered[-1]

    monkeypatch.setattr(ReplyMemory, "take", refuse)
    return offered


def rows(number):
    return np.tile([number / 8, number / 16], (3, 1))


def in_shared_memory(array):
    while isinstance(array, np.ndarray):
        array = array.base
    return "mmap" in type(getattr(array, "obj", array)).__name__


def moves(session, count=4):
    return [session.move(rows(number)).displacement for number in range(1, count + 1)]


@pytest.fixture(scope="module")
def server(tmp_path_factory, server_with):
    return server_with(endpoint=f"ipc://{tmp_path_factory.mktemp('ipc')}/control")


@pytest.fixture
def client(server):
    with connect(server.endpoint) as client:
        yield client


@pytest.fixture
def session(client, large_mesh):
    with client.open(large_mesh, {"support_radius": 1.0}) as session:
        yield session


def test_the_values_are_those_of_a_socket(client, session, large_mesh):
    shared = moves(session)
    client.welcome = replace(client.welcome, features=[])
    with client.open(large_mesh, {"support_radius": 1.0}) as other:
        sent = moves(other)
    assert [in_shared_memory(array) for array in shared] == [False, True, True, True]
    assert not any(map(in_shared_memory, sent))
    for one, other in zip(shared, sent, strict=True):
        assert one.tobytes() == other.tobytes()
        assert one.flags.writeable


def test_a_server_that_others_reach_does_not_offer_it(lasting_server):
    with connect(lasting_server.endpoint) as client:
        assert client.welcome.features == []


def test_memory_in_use_is_not_overwritten(session, taken):
    kept = moves(session, 8)
    before = [array.copy() for array in kept]
    assert [in_shared_memory(array) for array in kept] == [False] + 4 * [True] + 3 * [False]
    moves(session, 2)
    assert all(one.tobytes() == other.tobytes() for one, other in zip(kept, before, strict=True))
    del kept
    assert in_shared_memory(moves(session, 1)[0])
    assert len({id(memory) for memory in taken if memory is not None}) == 4


def test_memory_is_used_again(session, taken):
    for number in range(1, 7):
        session.move(rows(number))
    assert len({id(memory) for memory in taken if memory is not None}) == 1


def test_a_worker_that_is_killed_loses_nothing(server, session):
    session.move(rows(1))
    first = session.move(rows(2)).displacement
    expected = first.copy()
    server.kill_worker(session.credentials.session)
    again = session.move(rows(2)).displacement  # it was offered to a worker that is gone, then to the next one
    assert in_shared_memory(again)
    assert first.tobytes() == again.tobytes() == expected.tobytes()
    session.commit()


def test_changes_by_the_user_do_not_reach_the_server(session):
    session.move(rows(1))
    moved = session.move(rows(2)).displacement
    expected = session.points("reference") + moved
    moved[:] = 7.0
    session.commit()
    assert session.points().tobytes() == expected.tobytes()
