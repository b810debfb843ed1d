"""Levels of durability as a user meets them: a real server, its worker killed, and what the client says of it."""

import os
import signal

import numpy as np
import pytest
from mesh_motion_client import InvalidInput, StepsLost, connect

from mesh_motion_server.prove.waiting import wait_until

UP = np.array([[0.0, 1 / 64]] * 4)


def kill_worker(server, session):
    os.kill(server.worker_of(session.credentials.session), signal.SIGKILL)


def step(session):
    session.move(UP)
    return session.commit()


@pytest.mark.parametrize("level", ["full", "replay", "relaxed"])
def test_every_level_from_open_to_resume(server, mesh, level):
    with connect(server.endpoint, timeout=20, compute_timeout=30, durability=level) as client:
        assert level in client.welcome.durability
        with client.open(mesh) as session:
            digests = [step(session).digest for _ in range(4)]
            assert (session.step, session.status().report["durability"]) == (4, level)
            assert session.durable_step == 4 if level != "relaxed" else session.durable_step <= 4
            wait_until(lambda: session.status().durable_step == 4, "the disk has it")
            kill_worker(server, session)
            digests.append(step(session).digest)
            points = session.points()
            credentials = session.credentials
        with client.resume(credentials) as again:
            assert (again.step, again.durable_step) == (5, 5)
            np.testing.assert_array_equal(again.points(), points)
            assert len(set(digests)) == 5


def test_steps_that_did_not_survive_are_said_and_can_be_done_again(server, mesh):
    """Kill the worker right behind an answer until that was quicker than the disk."""
    with connect(server.endpoint, timeout=20, compute_timeout=60) as client:
        session = client.open(mesh, durability="relaxed")
        lost = None
        for _ in range(20):
            replies = [step(session) for _ in range(12)]
            digests = {reply.step: reply.digest for reply in replies}
            durable, last = session.durable_step, session.step
            kill_worker(server, session)
            try:
                session.move(UP)
            except StepsLost as error:
                lost = error
                break
            session.rollback()
        assert lost is not None
        assert lost.code == "ABORTED.STEPS_LOST"
        assert durable <= lost.step == session.step < last
        assert lost.lost == last - lost.step
        assert session.iteration == 0
        while session.step < last:
            found = step(session)
            assert found.digest == digests.get(found.step, found.digest)
        session.close()


def test_a_level_that_the_server_does_not_offer(server_with, mesh):
    with connect(server_with(durability=["replay", "full"]).endpoint) as client:
        assert client.welcome.durability == ["replay", "full"]
        with pytest.raises(InvalidInput, match="'relaxed' is not offered; offered are replay, full"):
            client.open(mesh, durability="relaxed")
        session = client.open(mesh)
        assert session.status().report["durability"] == "replay"
        session.close("discard")


def test_a_planned_stop_loses_nothing(server, client, mesh):
    session = client.open(mesh, durability="relaxed")
    for _ in range(10):
        step(session)
    server.stop()
    server.start()
    assert step(session).step == 11
    session.close()
