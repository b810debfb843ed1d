"""A server with keys: admitted clients, facts that strangers learn, and endpoints that close on any fault."""

import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest
import zmq
import zmq.utils.monitor
from mesh_motion_protocol.key_files import SecretKey
from mesh_motion_protocol.limits import FRAME_BYTES
from mesh_motion_protocol.messages import Join, List, Move, Open, Ping, Resume, Status

from mesh_motion_server.security.key_folder import admit, make_server_keys
from tests.faults.waiting import PATIENCE, wait_until

REFUSALS = (zmq.EVENT_HANDSHAKE_FAILED_AUTH, zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL, zmq.EVENT_DISCONNECTED)


@pytest.fixture(scope="module")
def keyed(make_module_server, tmp_path_factory, make_keys):
    return with_keys(make_module_server, tmp_path_factory.mktemp("keys"), make_keys)


def with_keys(start, folder, make_keys, **settings):
    make_server_keys(folder)
    clients = {name: make_keys(name, folder) for name in ("alice", "bob")}
    for name, keys in clients.items():
        admit(keys.public, folder, name=name)
    server = start(keys_folder=str(folder), **settings)
    server.keys = folder
    vars(server).update(clients)
    return server


def outcome(wire, seconds=10.0):
    """Result of the handshake of a wire that is not connected yet; watched from its start, as some are not repeated.

    Nothing is sent: a socket whose handshake was already refused has no peer, and a send would wait.
    """
    events = wire.socket.get_monitor_socket(zmq.EVENT_ALL)
    wire.connect()
    try:
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            if events.poll(50):
                event = zmq.utils.monitor.recv_monitor_message(events)["event"]
                if event in REFUSALS:
                    return "refused"
                if event == zmq.EVENT_HANDSHAKE_SUCCEEDED:
                    return "admitted"
        return "no answer"
    finally:
        wire.socket.disable_monitor()
        events.close()


def opened_by(connect, server, keys, **fields):
    reply = connect(server.endpoint, keys).ask(Open, dimension=2, **fields)
    assert reply.type == "OPENED", reply
    return reply


def test_the_largest_frames_pass(keyed, connect):
    opened = opened_by(connect, keyed, keyed.alice)
    data = connect(opened.endpoint, keyed.alice)
    at = {"session": opened.session, "epoch": 1}
    data.ask(Join, **at, token=opened.token)
    displacement = np.arange(FRAME_BYTES // 16 + 3, dtype=float).repeat(2).reshape(-1, 2)  # one whole chunk and a rest
    assert (
        data.ask(Move, **at, step=1, frame="reference", displacement=displacement).displacement == 2 * displacement
    ).all()


def test_at_a_foreign_worker_even_garbage_reveals_nothing(keyed, connect):
    opened = opened_by(connect, keyed, keyed.alice)
    mine, foreign = connect(opened.endpoint, keyed.alice), connect(opened.endpoint, keyed.bob)
    for wire, state in ((mine, "READY"), (foreign, "")):
        wire.send_frames(b"garbage")
        reply = wire.receive()
        assert (reply.code, reply.state) == ("INVALID_ARGUMENT.HEADER", state)
    assert foreign.ask(Status, session=opened.session, epoch=1).state == ""


def test_anothers_request_id_gets_ones_own_reply(keyed, connect):
    first = connect(keyed.endpoint, keyed.alice)
    opened = first.ask(Open, dimension=2)
    thief = connect(keyed.endpoint, keyed.bob)
    stolen = thief.ask(Open, dimension=2, client=first.client, sequence=first.sequence)
    assert stolen.session != opened.session


def test_anothers_routing_id_gives_no_rights(keyed, connect):
    opened = opened_by(connect, keyed, keyed.alice)
    at = {"session": opened.session, "epoch": 1}
    owner = connect(opened.endpoint, keyed.alice, routing_id=b"solver")
    assert owner.ask(Join, **at, token=opened.token).type == "JOINED"
    thief = connect(opened.endpoint, keyed.bob, routing_id=b"solver")
    thief.send(Status, **at)
    assert owner.ask(Status, **at).type == "STATUS_REPORT"
    assert not thief.socket.poll(200)  # the id is taken: no answer comes
    owner.socket.close()

    def late():
        """A connection that is made before the server sees the owner's end never gets an answer: each try is a new
        connection.
        """
        wire = connect(opened.endpoint, keyed.bob, routing_id=b"solver")
        wire.send(Status, **at)
        code = wire.receive().code if wire.socket.poll(2000) else None
        wire.socket.close()
        return code

    wait_until(lambda: late() == "NOT_FOUND", "the id is free, and of no use")


def test_the_secret_is_in_no_command_line_environment_or_log(keyed, connect):
    opened_by(connect, keyed, keyed.alice)
    secret = SecretKey.load(keyed.keys / "server.secret").key
    for pid in (keyed.process.pid, *keyed.children()):
        for name in ("cmdline", "environ"):
            assert secret.encode() not in Path(f"/proc/{pid}/{name}").read_bytes()
    log = keyed.log_path.read_text()
    assert "self_test_passed" in log
    assert not any(key.secret in log for key in (keyed.alice, keyed.bob))
    assert secret not in log


def test_without_the_handler_handshakes_fail_and_open_connections_go_on(start, connect, make_keys, tmp_path):
    server = with_keys(start, tmp_path, make_keys, handshake_seconds=0.5)
    opened = opened_by(connect, server, server.alice)
    data = connect(opened.endpoint, server.alice)
    at = {"session": opened.session, "epoch": 1}
    assert data.ask(Join, **at, token=opened.token).type == "JOINED"
    gateway = server.children()[0]
    os.kill(gateway, signal.SIGSTOP)
    assert outcome(connect(opened.endpoint, server.alice, at_once=False)) != "admitted"
    assert outcome(connect(opened.endpoint, at_once=False)) != "admitted"
    assert data.ask(Status, **at).type == "STATUS_REPORT"
    os.kill(gateway, signal.SIGKILL)  # the next one shows itself that it refuses before it is announced
    assert connect(opened.endpoint, server.alice).ask(Ping).type == "PONG"
    assert connect(server.endpoint, server.alice).ask(Ping).type == "PONG"
    assert outcome(connect(server.endpoint, at_once=False)) == "refused"
    assert len(server.events("self_test_passed")) == 2


def test_a_session_stays_its_owners_over_a_restart(start, connect, make_keys, tmp_path):
    server = with_keys(start, tmp_path / "keys", make_keys)
    opened = opened_by(connect, server, server.alice)
    server.stop()
    again = start(folder=server.folder, keys_folder=str(server.keys))
    ask = {"session": opened.session, "token": opened.token}
    assert connect(again.endpoint, server.bob).ask(Resume, **ask).code == "NOT_FOUND"
    assert connect(again.endpoint, server.alice).ask(Resume, **ask).epoch == 2
    again.stop()
    without = start(folder=server.folder)
    assert connect(without.endpoint).ask(Resume, **ask).code == "NOT_FOUND"
    assert connect(without.endpoint).ask(List).sessions == []


@pytest.mark.parametrize("endpoint", ["tcp://0.0.0.0:0", "ipc"])
def test_keys_protect_any_address(start, connect, make_keys, tmp_path, endpoint):
    folder = tmp_path / "s"
    folder.mkdir(mode=0o700)
    server = with_keys(
        start, tmp_path / "keys", make_keys, endpoint=f"ipc://{folder}/c" if endpoint == "ipc" else endpoint
    )
    reached = server.endpoint.replace("0.0.0.0", "127.0.0.1")
    opened = connect(reached, server.alice).ask(Open, dimension=2)
    data = connect(opened.endpoint.replace("0.0.0.0", "127.0.0.1"), server.alice)
    assert data.ask(Ping).type == "PONG"
    assert outcome(connect(reached, at_once=False)) == "refused"
    assert not server.events("insecure")


@pytest.mark.parametrize("wrong", ["no keys", "writable allow-list"])
def test_keys_that_do_not_protect_exit_78(start, tmp_path, wrong):
    if wrong != "no keys":
        make_server_keys(tmp_path)
    if wrong == "writable allow-list":
        (tmp_path / "allow.toml").chmod(0o664)
    server = start(keys_folder=str(tmp_path), endpoint="tcp://0.0.0.0:0", ready=False)
    assert server.process.wait(PATIENCE) == 78
    assert server.events("refused")[0]["hint"] or server.events("refused")[0]["reason"]
