"""One server, its control endpoint and its workers: requests over real sockets, right and wrong ones."""

import os
import signal
import socket

import msgpack
import numpy as np
import pytest
import zmq
from mesh_motion_protocol.codec import encode
from mesh_motion_protocol.limits import FRAME_BYTES, HEADER_BYTES
from mesh_motion_protocol.messages import Commit, Hello, Join, Move, Open, Ping, Probe, Resume, Status, Welcome
from mesh_motion_protocol.vectors import load

from proofs.waiting import wait_until

ONES = np.ones((2, 2))
INVALID = load("invalid")


@pytest.fixture
def server(lasting_server):
    (lasting_server.state / "go").unlink(missing_ok=True)
    return lasting_server


def worker_pid(data, at):
    return data.ask(Status, **at).report["pid"]


def test_hello_tells_version_limits_and_boot(server, connect):
    welcome = connect(server.endpoint).ask(Hello, agent="test")
    assert (welcome.type, welcome.version) == ("WELCOME", [1, 0])
    assert welcome.limits["max_header_bytes"] == 65536
    assert len(welcome.boot) == 16
    assert welcome.durability[0] == "full"


def test_hello_of_another_major_version_is_told_ours(server, connect):
    for versions in ([[2, 0]], [[1, -1]], [[1]]):
        refused = connect(server.endpoint).ask(Hello, versions=versions)
        assert refused.code == "UNIMPLEMENTED.VERSION"
        assert refused.details == {"versions": [[1, 0]]}


def test_a_stranger_learns_nothing(server, connect, open_session):
    opened, _, _ = open_session(server)
    control = connect(server.endpoint)
    for session in (opened.session, "0" * 32):
        for kind in (Probe, Resume):
            assert control.ask(kind, session=session, token=b"x" * 32).code == "NOT_FOUND"


def test_probe_answers_while_the_worker_computes(server, connect, open_session):
    opened, data, at = open_session(server, label="slow")
    data.send(Move, **at, step=1, frame="reference", displacement=ONES)
    control = connect(server.endpoint)
    wait_until((server.state / f"moving-{opened.session}").exists, "the move runs")
    probed = control.ask(Probe, session=opened.session, token=opened.token)
    assert (probed.worker, probed.epoch, probed.endpoint) == ("alive", 1, opened.endpoint)
    (server.state / "go").touch()
    assert data.receive().type == "MOVED"


def test_resume_of_a_live_session_fences_the_old_holder(server, connect, open_session):
    opened, old, at = open_session(server)
    pid = worker_pid(old, at)
    resumed = connect(server.endpoint).ask(Resume, session=opened.session, token=opened.token)
    assert (resumed.epoch, resumed.endpoint) == (2, opened.endpoint)
    assert old.ask(Commit, **at, step=1).code == "ABORTED.FENCED"
    new = connect(resumed.endpoint)
    assert worker_pid(new, at | {"epoch": 2}) == pid


def test_a_reply_that_cannot_be_encoded_is_an_error_and_not_the_end(server, open_session):
    _, data, at = open_session(server, label="bad-reply")
    assert data.ask(Move, **at, step=1, frame="reference", displacement=ONES).code == "INTERNAL"
    assert data.ask(Commit, **at, step=1).type == "COMMITTED"


def test_a_killed_worker_shows_at_once_and_resumes(server, connect, open_session):
    opened, data, at = open_session(server)
    data.ask(Commit, **at, step=3)
    os.kill(worker_pid(data, at), signal.SIGKILL)
    control, probe = connect(server.endpoint), {"session": opened.session, "token": opened.token}
    wait_until(lambda: control.ask(Probe, **probe).worker == "dead", "PROBE tells", seconds=5)
    resumed = control.ask(Resume, **probe)
    assert (resumed.epoch, resumed.step) == (2, 3)
    again = connect(resumed.endpoint)
    assert again.ask(Join, session=opened.session, epoch=2, token=opened.token).step == 3


def test_a_crash_in_the_middle_of_a_move_hurts_one_session(server, connect, open_session):
    opened, crashing, at = open_session(server, label="crash")
    _, other, other_at = open_session(server)
    crashing.send(Move, **at, step=1, frame="reference", displacement=ONES)
    control = connect(server.endpoint)
    probe = {"session": opened.session, "token": opened.token}
    wait_until(lambda: control.ask(Probe, **probe).worker == "dead", "PROBE tells", seconds=5)
    assert (other.ask(Move, **other_at, step=1, frame="reference", displacement=ONES).displacement == 2).all()


@pytest.mark.parametrize("endpoint", ["control", "data"])
def test_every_invalid_vector_is_answered_by_its_code(server, connect, open_session, endpoint):
    _, data, _ = open_session(server)
    wire = connect(server.endpoint) if endpoint == "control" else data
    for case in INVALID:
        wire.send_frames(*(bytes.fromhex(frame) for frame in case["frames"]))
        assert wire.receive().code == case["error"], case["name"]
    assert wire.ask(Ping).type == "PONG"


def test_an_error_names_the_request_that_it_answers(server, connect):
    wire = connect(server.endpoint)
    header = msgpack.unpackb(encode(Ping(client=b"c" * 16, sequence=11))[0])
    wire.send_frames(msgpack.packb(header | {"type": "PUNG"}))
    reply = wire.receive()
    assert (reply.client, reply.sequence, reply.code) == (b"c" * 16, 11, "UNIMPLEMENTED.MESSAGE")


def test_each_endpoint_refuses_what_belongs_to_the_other(server, connect, open_session):
    _, data, at = open_session(server)
    control = connect(server.endpoint)
    assert control.ask(Status, **at).code == "UNIMPLEMENTED.MESSAGE"
    assert data.ask(Open, dimension=2).code == "UNIMPLEMENTED.MESSAGE"
    reply = Welcome(
        client=b"c" * 16, sequence=1, version=[1, 0], features=[], server="", boot=b"b" * 16, limits={}, durability=[]
    )
    for wire in (control, data):
        wire.socket.send_multipart(encode(reply))
        assert wire.receive().code == "UNIMPLEMENTED.MESSAGE"


@pytest.mark.parametrize(("endpoint", "size"), [("control", HEADER_BYTES + 1), ("data", FRAME_BYTES + 1)])
def test_a_frame_beyond_the_limit_ends_the_connection_and_nothing_else(server, connect, open_session, endpoint, size):
    opened, data, at = open_session(server)
    where = server.endpoint if endpoint == "control" else opened.endpoint
    wire = connect(where)
    events = wire.socket.get_monitor_socket(zmq.EVENT_DISCONNECTED)
    try:
        wire.send_frames(b"x" * size)
        assert events.poll(20_000)
    finally:
        wire.socket.disable_monitor()
        events.close()
    assert connect(where).ask(Ping).type == "PONG"
    assert data.ask(Status, **at).type == "STATUS_REPORT"


def test_garbage_on_the_wire_below_zeromq_is_survived(server, connect):
    host, _, port = server.endpoint.removeprefix("tcp://").rpartition(":")
    rng = np.random.default_rng(5)
    for size in (0, 1, 10, 64, 1000, 100_000):
        with socket.create_connection((host, int(port))) as raw:
            try:
                raw.sendall(rng.bytes(size))
            except OSError:
                continue
    assert connect(server.endpoint).ask(Ping).type == "PONG"
