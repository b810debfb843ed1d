"""One server, its control endpoint and its workers: requests over real sockets, right and wrong ones."""

import socket

import numpy as np
import pytest
from mesh_motion_protocol.messages import Commit, Move, Ping, Probe, Status

from tests.faults.waiting import wait_until

ONES = np.ones((2, 2))


@pytest.fixture
def server(lasting_server):
    (lasting_server.state / "go").unlink(missing_ok=True)
    return lasting_server


def worker_pid(data, at):
    return data.ask(Status, **at).report["pid"]


def test_probe_answers_while_the_worker_computes(server, connect, open_session):
    opened, data, at = open_session(server, label="slow")
    data.send(Move, **at, step=1, frame="reference", displacement=ONES)
    control = connect(server.endpoint)
    wait_until((server.state / f"moving-{opened.session}").exists, "the move runs")
    probed = control.ask(Probe, session=opened.session, token=opened.token)
    assert (probed.worker, probed.epoch, probed.endpoint) == ("alive", 1, opened.endpoint)
    (server.state / "go").touch()
    assert data.receive().type == "MOVED"


def test_a_reply_that_cannot_be_encoded_is_an_error_and_not_the_end(server, open_session):
    _, data, at = open_session(server, label="bad-reply")
    assert data.ask(Move, **at, step=1, frame="reference", displacement=ONES).code == "INTERNAL"
    assert data.ask(Commit, **at, step=1).type == "COMMITTED"


def test_a_crash_in_the_middle_of_a_move_hurts_one_session(server, connect, open_session):
    opened, crashing, at = open_session(server, label="crash")
    _, other, other_at = open_session(server)
    crashing.send(Move, **at, step=1, frame="reference", displacement=ONES)
    control = connect(server.endpoint)
    probe = {"session": opened.session, "token": opened.token}
    wait_until(lambda: control.ask(Probe, **probe).worker == "dead", "PROBE says so")
    assert (other.ask(Move, **other_at, step=1, frame="reference", displacement=ONES).displacement == 2).all()


def test_garbage_on_the_wire_below_zeromq_is_survived(server, connect):
    host, _, port = server.endpoint.removeprefix("tcp://").rpartition(":")
    rng = np.random.default_rng(5)
    for size in (0, 1, 10, 64, 1000, 100_000):
        with socket.create_connection((host, int(port)), timeout=60) as raw:
            try:
                raw.sendall(rng.bytes(size))
            except OSError:
                continue
    assert connect(server.endpoint).ask(Ping).type == "PONG"
