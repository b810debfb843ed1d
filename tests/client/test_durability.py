"""Levels of durability for a user: a real server, a killed worker, and the client's messages."""

import os
import signal

import numpy as np
import pytest
from mesh_motion_client import InvalidInput, ResourceExhausted, StepsLost, connect

from mesh_motion_server.failpoints import VARIABLE
from tests.faults.failpoint_plan import PLAN
from tests.faults.waiting import wait_until

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


def test_a_state_folder_that_moves_away_takes_no_new_session_elsewhere(server_with, mesh):
    """An unmounted disk leaves an empty folder: sessions that are stored there are lost when it is mounted again."""
    server = server_with()
    with connect(server.endpoint, timeout=20, compute_timeout=30) as client, client.open(mesh) as session:
        step(session)
        away = server.state.rename(server.state.with_name("away"))
        for make in (lambda: None, lambda: server.state.mkdir(mode=0o700)):
            make()
            with pytest.raises(ResourceExhausted, match=r"moved or unmounted"):
                client.open(mesh)
            assert not server.state.exists() or not list(server.state.iterdir())
        assert step(session).step == 2
        server.state.rmdir()
        away.rename(server.state)
        with client.open(mesh) as other:
            assert step(other).step == 1
        kill_worker(server, session)
        assert step(session).step == 3


def test_steps_that_did_not_survive_are_said_and_can_be_done_again(server_with, mesh, tmp_path, monkeypatch):
    """Kill the worker after answers that came before the data was on the disk."""
    points = tmp_path / "points"
    points.mkdir(mode=0o700)
    monkeypatch.setenv(VARIABLE, str(points))
    server, unsynced = server_with(), "journal.commit.slot-unsynced"
    with connect(server.endpoint, timeout=20, compute_timeout=60) as client:
        session = client.open(mesh, durability="relaxed")
        step(session)
        wait_until(lambda: session.status().durable_step == 1, "the disk has it")
        (points / PLAN).write_text(f"{unsynced}=sleep:60@{(points / unsynced).stat().st_size + 1}", encoding="ascii")
        digests = {reply.step: reply.digest for reply in (step(session) for _ in range(12))}
        durable, last = session.durable_step, session.step
        kill_worker(server, session)
        (points / PLAN).unlink()
        with pytest.raises(StepsLost) as caught:
            session.move(UP)
        lost = caught.value
        assert lost.code == "ABORTED.STEPS_LOST"
        assert durable == 1
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
