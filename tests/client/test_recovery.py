"""Every request is executed once under any fault, and the result is that of an undisturbed run."""

import os
import signal
import time
from contextlib import closing

import numpy as np
import pytest
import zmq
from mesh_motion_client import QualityRefused, SessionError, Unavailable, connect
from mesh_motion_client.connection import Connection, ConnectionLost
from mesh_motion_protocol.messages import Hello

from tests.faults.waiting import wait_until

UP = np.array([[0.0, 0.25]] * 4)


def kill_worker(server, session):
    os.kill(server.worker_of(session.credentials.session), signal.SIGKILL)


def listed(client, session):
    return next(entry for entry in client.sessions() if entry["session"] == session.credentials.session)


def test_a_trial_outlives_a_refused_move_that_a_worker_did_not(server, session, background):
    session.move(UP)
    with server.hold():
        moving = background(lambda: session.move(1000 * UP))
        wait_until(lambda: server.moves() == 2, "the move runs")
        kill_worker(server, session)
    with pytest.raises(QualityRefused):
        moving()
    assert session.commit().step == 1
    assert session.points()[0, 1] == 0.25


def test_kill_9_of_the_whole_server_and_restart(server, session, background, caplog):
    session.move(UP)
    session.commit()
    with server.hold():
        moving = background(lambda: session.move(2 * UP))
        wait_until(lambda: server.moves() == 2, "the move runs")
        server.kill()
    wait_until(lambda: "no server answers at" in caplog.text, "the client says that it waits")
    server.start()
    assert moving().displacement.tolist() == [[0.0, 0.5]] * 16
    session.commit()
    assert (session.step, session.points()[0, 1]) == (2, 0.5)


def test_a_trial_is_made_again_after_the_lease_ended(client, session):
    session.move(UP)
    session._courier.disconnect()
    wait_until(lambda: listed(client, session)["state"] == "SUSPENDED", "the lease ended")
    assert session.commit().step == 1
    assert session.points()[0, 1] == 0.25


def test_a_join_that_failed_leaves_no_connection_behind(server, session, monkeypatch):
    request, seeded = Connection.request, ["once"]

    def refused(self, message, *arguments):
        if message.type == "JOIN" and seeded:
            seeded.clear()
            raise SessionError("seeded", code="NOT_FOUND")
        return request(self, message, *arguments)

    monkeypatch.setattr(Connection, "request", refused)
    kill_worker(server, session)
    with pytest.raises(SessionError, match="seeded"):
        session.move(UP)
    assert session.move(UP).iteration == 1


def test_a_connection_that_ends_just_before_a_request_is_sent_does_not_hang(tmp_path):
    endpoint = f"ipc://{tmp_path}/no-server"  # never connected, so no event warns the check before the request
    with closing(Connection(endpoint)) as connection:
        connection._socket.disconnect(endpoint)
        wait_until(lambda: not connection._socket.poll(0, zmq.POLLOUT), "ZeroMQ gave the connection up")
        with pytest.raises(ConnectionLost):
            connection.request(Hello(client=b"a" * 16, sequence=1, agent="test", features=[]), time.monotonic() + 30.0)


def test_a_server_that_never_answers_is_said_to_be_silent_once(caplog):
    with pytest.raises(Unavailable):
        connect("ipc:///nowhere/control", timeout=3.3)
    (line,) = [record.getMessage() for record in caplog.records]
    assert line.startswith("no server answers at ipc:///nowhere/control; asking for ")
