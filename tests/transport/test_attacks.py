"""The attacks of the threat model on a server, and on a careless one, where each attack succeeds."""

import contextlib
import resource
import time
from pathlib import Path

import msgpack
import numpy as np
import psutil
import pytest
import zmq
from mesh_motion_protocol.codec import decode, encode
from mesh_motion_protocol.messages import Commit, Hello, Join, Open, Ping, Status

from mesh_motion_server.security.key_folder import admit, make_server_keys
from mesh_motion_server.transport.protection import Protection, user_of
from mesh_motion_server.transport.self_test import ProtectionError, check_admits, check_refuses
from tests.faults.attacks import forged_user, half_open, ready, storm
from tests.faults.limited_context import limited_context
from tests.faults.waiting import wait_until

MIB = 1 << 20
ONES = np.ones((2, 2))


@contextlib.contextmanager
def careless(**options):
    """A ROUTER without the protections of docs/security.md, and its context."""
    context = limited_context()
    socket = context.socket(zmq.ROUTER)
    for name, value in options.items():
        socket.setsockopt(getattr(zmq, name), value)
    port = socket.bind_to_random_port("tcp://127.0.0.1")
    try:
        yield socket, f"tcp://127.0.0.1:{port}"
    finally:
        socket.close()
        context.destroy(linger=0)


@pytest.fixture(scope="module", params=["without keys", "with keys"])
def target(request, make_module_server, tmp_path_factory, make_keys):
    """A server with a limit of half a second for handshakes, with and without keys."""
    settings, keys = {"handshake_seconds": 0.5, "worker_memory_bytes": 256 * MIB}, None
    if request.param == "with keys":
        folder = tmp_path_factory.mktemp("keys")
        make_server_keys(folder)
        keys = make_keys("alice", folder)
        admit(keys.public, folder, name="alice")
        settings["keys_folder"] = str(folder)
    server = make_module_server(**settings)
    server.client_keys = keys
    return server


@pytest.fixture
def victim(target, connect):
    """A session on the target and the pids of the attacked processes."""
    opened = connect(target.endpoint, target.client_keys).ask(Open, dimension=2)
    data = connect(opened.endpoint, target.client_keys)
    at = {"session": opened.session, "epoch": 1}
    assert data.ask(Join, **at, token=opened.token).type == "JOINED"
    worker = data.ask(Status, **at).report["pid"]
    yield {
        "control": (target.endpoint, target.children()[0]),
        "data": (opened.endpoint, worker),
        "at": at,
        "wire": data,
    }
    assert data.ask(Status, **at).report["pid"] == worker
    assert connect(target.endpoint, target.client_keys).ask(Ping).type == "PONG"


def open_files(pid):
    return len(list(Path(f"/proc/{pid}/fd").iterdir()))


def memory(pid):
    return psutil.Process(pid).memory_info().rss


def test_strangers_at_the_data_endpoint_do_not_end_the_lease(start, open_session):
    server = start(lease_seconds=1.0, idle_seconds=2.0, handshake_seconds=0.2)
    opened, data, at = open_session(server)
    storm(opened.endpoint, seed=5, count=60)
    time.sleep(2.5)  # longer than the lease and the idle time
    assert data.ask(Status, **at).state == "READY"


def test_more_connections_than_descriptors_are_survived(target, victim, connect):
    endpoint, pid = victim["control"]
    files = open_files(pid)
    former = resource.prlimit(pid, resource.RLIMIT_NOFILE)
    resource.prlimit(pid, resource.RLIMIT_NOFILE, (files + 10, former[1]))
    try:
        with half_open(endpoint, seed=4, count=120):
            wait_until(lambda: open_files(pid) >= files + 8, "hardly a descriptor is left")
            assert victim["wire"].ask(Commit, **victim["at"], step=1).step == 1
        wait_until(lambda: open_files(pid) <= files + 2, "the descriptors are back")
        assert connect(endpoint, target.client_keys).ask(Ping).type == "PONG"
    finally:
        resource.prlimit(pid, resource.RLIMIT_NOFILE, former)


def test_the_gateway_and_the_workers_have_bounds(victim):
    for _, pid in (victim["control"], victim["data"]):
        assert 0 < resource.prlimit(pid, resource.RLIMIT_NOFILE)[0] <= 4096
        assert 0 < resource.prlimit(pid, resource.RLIMIT_AS)[0] < 64 << 30


def test_a_second_client_with_the_same_routing_id_does_not_get_the_firsts_replies(target, victim, connect):
    endpoint, _ = victim["data"]
    first = connect(endpoint, target.client_keys, routing_id=b"solver")
    assert first.ask(Ping).type == "PONG"  # its handshake is over; otherwise the second client might be the first
    second = connect(endpoint, target.client_keys, routing_id=b"solver")
    second.send(Ping)
    assert first.ask(Ping).type == "PONG"
    assert not second.socket.poll(100)


EMPTY_MAPS = msgpack.packb([{}] * 60_000)


@pytest.mark.parametrize("where", ["control", "data"])
def test_a_header_of_empty_maps_is_refused_before_it_is_built(target, victim, connect, where):
    endpoint, pid = victim[where]
    wire = connect(endpoint, target.client_keys)
    wire.ask(Ping)
    before = memory(pid)
    wire.send_frames(EMPTY_MAPS)
    assert wire.receive().code == "INVALID_ARGUMENT.HEADER"
    assert memory(pid) - before < 4 * MIB


@pytest.mark.parametrize("where", ["control", "data"])
@pytest.mark.parametrize("at", ["header", "fields", "arrays"])
def test_a_name_too_long_for_the_answer_is_not_repeated_in_it(target, victim, connect, where, at):
    """A header of 40 kB is within the limits; an answer that repeats it twice would not be."""
    endpoint, pid = victim[where]
    wire = connect(endpoint, target.client_keys)
    header = msgpack.unpackb(encode(Ping(client=wire.client, sequence=1))[0])
    key = "k" * 40_000
    changes = {"header": {key: 1}, "fields": {"fields": {key: 1}}, "arrays": {"arrays": [{key: object}]}}
    wire.send_frames(msgpack.packb(header | changes[at], default=str))
    reply = wire.receive()
    assert reply.code == "INVALID_ARGUMENT.HEADER"
    assert len(reply.message) < 2000
    assert open_files(pid)


def test_the_user_that_libzmq_reports_could_be_forged():
    request = bytes(encode(Hello(client=b"c" * 16, sequence=1))[0])
    with careless() as (server, endpoint):
        back = forged_user(endpoint, b"root", request)
        assert b"READY" in back
        *_, frame = server.recv_multipart(copy=False)
        assert decode([frame.bytes]).type == "HELLO"
        assert frame.get("User-Id") == "root"
        assert user_of(frame, None) == ""
    assert b"User-Id" in ready(User_Id=b"root")


# --- the self-test ---------------------------------------------------------------------------------------------------


@contextlib.contextmanager
def handler(context, status):
    """A ZAP handler that always gives this answer; None does not answer at all."""
    socket = context.socket(zmq.ROUTER)
    socket.bind("inproc://zeromq.zap.01")

    def turn():
        while socket.poll(0):
            frames = socket.recv_multipart()
            at = frames.index(b"") + 1
            if status:
                socket.send_multipart([*frames[:at], b"1.0", frames[at + 1], status, b"", b"user", b""])

    try:
        yield turn
    finally:
        socket.close(linger=0)


@contextlib.contextmanager
def protected(status, *, enforce=True, handled=True):
    """A CURVE endpoint whose handler is right or wrong."""
    protection = Protection(zmq.curve_keypair()[1].decode(), "")
    context = limited_context()
    with contextlib.ExitStack() as stack:
        stack.callback(context.term)
        turn = stack.enter_context(handler(context, status)) if handled else lambda: None
        socket = context.socket(zmq.ROUTER)
        stack.callback(socket.close, linger=0)
        socket.setsockopt(zmq.MAXMSGSIZE, 1 << 16)
        protection.protect(socket)
        socket.setsockopt(zmq.ZAP_ENFORCE_DOMAIN, int(enforce))
        # a connection without an answer ends by this time, all others before it, on a busy machine too
        socket.setsockopt(zmq.HANDSHAKE_IVL, 300 if status is None and enforce else 30_000)
        port = socket.bind_to_random_port("tcp://127.0.0.1")
        yield f"tcp://127.0.0.1:{port}", protection, turn


SECRET = zmq.curve_keypair()[1]


def test_the_self_test_passes_where_the_handler_decides():
    with protected(b"200") as (endpoint, protection, turn):
        check_admits(endpoint, protection, SECRET, turn)
    with protected(b"400") as (endpoint, protection, turn):
        check_refuses(endpoint, protection, turn)


@pytest.mark.parametrize("status", [b"400", b"300", b"500", None])
def test_the_self_test_sees_a_handler_that_admits_no_key(status):
    with protected(status) as (endpoint, protection, turn), pytest.raises(ProtectionError, match="does not admit"):
        check_admits(endpoint, protection, SECRET, turn)


def test_the_self_test_sees_a_handler_that_admits_everybody():
    with (
        protected(b"200") as (endpoint, protection, turn),
        pytest.raises(ProtectionError, match="admits an unknown key"),
    ):
        check_refuses(endpoint, protection, turn)


def test_libzmq_takes_no_handler_for_everybodys_leave_and_the_self_test_sees_it():
    seeded = protected(None, handled=False, enforce=False)
    with seeded as (endpoint, protection, turn), pytest.raises(ProtectionError, match="admits an unknown key"):
        check_refuses(endpoint, protection, turn)


def test_as_we_set_it_no_connection_is_let_in_without_a_handler():
    with protected(None, handled=False) as (endpoint, protection, turn):
        check_refuses(endpoint, protection, turn)
        with pytest.raises(ProtectionError, match="does not admit"):
            check_admits(endpoint, protection, SECRET, turn)
