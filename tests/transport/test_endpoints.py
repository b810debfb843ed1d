"""The endpoints at which a server may listen."""

import os
import socket
import stat

import pytest
import zmq

from mesh_motion_server.transport.endpoints import Endpoint, EndpointError, bind_first, lock_folder
from tests.faults.limited_context import limited_context


@pytest.mark.parametrize(
    ("text", "address", "local"),
    [
        ("tcp://127.0.0.1:7440", "tcp://127.0.0.1:7440", True),
        ("tcp://127.0.0.1:0", "tcp://127.0.0.1:*", True),
        ("tcp://localhost:1", "tcp://127.0.0.1:1", True),
        ("tcp://[::1]:7440", "tcp://[::1]:7440", True),
        ("tcp://0.0.0.0:7440", "tcp://0.0.0.0:7440", False),
        ("tcp://192.0.2.1:7440", "tcp://192.0.2.1:7440", False),
        ("tcp://example.org:7440", "tcp://example.org:7440", False),
        ("ipc:///run/mm/control", "ipc:///run/mm/control", True),
    ],
)
def test_endpoints(text, address, local):
    endpoint = Endpoint.parse(text)
    assert (endpoint.address, endpoint.is_local) == (address, local)


@pytest.mark.parametrize(
    "text",
    ["", "7440", "127.0.0.1:7440", "tcp://", "tcp://127.0.0.1", "tcp://127.0.0.1:x", "tcp://127.0.0.1:65536",
     "tcp://127.0.0.1:²", "tcp://127.0.0.1:" + "9" * 5000, "udp://127.0.0.1:1", "ipc://relative", "ipc://@abstract", "inproc://a"],
)  # fmt: skip
def test_wrong_endpoints_are_refused(text):
    with pytest.raises(EndpointError, match="endpoint must be"):
        Endpoint.parse(text)


def test_a_path_that_leaves_no_room_for_the_workers():
    with pytest.raises(EndpointError, match="must fit into 107 bytes"):
        Endpoint.parse("ipc:///" + "x" * 100 + "/c")


def test_workers_listen_next_to_the_control_endpoint():
    assert Endpoint.parse("ipc:///run/mm/control").worker_address == f"ipc:///run/mm/w{os.getpid()}.ipc"
    assert Endpoint.parse("tcp://127.0.0.1:7440").worker_address == "tcp://127.0.0.1:*"


def test_the_folder_is_made_private_and_locked(tmp_path):
    endpoint = Endpoint.parse(f"ipc://{tmp_path}/s/c")
    with lock_folder(endpoint):
        assert stat.S_IMODE((tmp_path / "s").stat().st_mode) == 0o700
        with pytest.raises(EndpointError, match="a live server listens"):
            lock_folder(endpoint)
    lock_folder(endpoint).close()


def test_files_of_workers_that_were_killed_with_their_server_go(tmp_path):
    tmp_path.chmod(0o700)
    with socket.socket(socket.AF_UNIX) as killed, socket.socket(socket.AF_UNIX) as other:
        killed.bind(str(tmp_path / "w17.ipc"))
        other.bind(str(tmp_path / "w18.ipc"))
        other.listen()
        killed.close()
        (tmp_path / "w19.ipc").write_text("a user's file")
        lock_folder(Endpoint.parse(f"ipc://{tmp_path}/c")).close()
        assert {path.name for path in tmp_path.glob("w*")} == {"w18.ipc", "w19.ipc"}


def test_a_folder_that_others_may_enter_is_refused(tmp_path):
    (tmp_path / "s").mkdir()
    (tmp_path / "s").chmod(0o750)
    with pytest.raises(EndpointError, match="mode 0750"):
        lock_folder(Endpoint.parse(f"ipc://{tmp_path}/s/c"))


def test_tcp_needs_no_lock():
    assert lock_folder(Endpoint.parse("tcp://127.0.0.1:0")) is None


def test_data_endpoints_take_a_port_of_their_range_and_are_given_under_another_host():
    control = Endpoint.parse("tcp://127.0.0.1:7440")
    assert control.worker_addresses("7441-7443") == [f"tcp://127.0.0.1:{port}" for port in (7441, 7442, 7443)]
    assert control.worker_addresses(None) == ["tcp://127.0.0.1:*"]
    assert control.advertised_as("example.org") == "tcp://example.org:7440"
    assert control.advertised_as(None) == "tcp://127.0.0.1:7440"
    local = Endpoint.parse("ipc:///run/mm/control")
    assert local.worker_addresses("1-2") == [local.worker_address]
    assert local.advertised_as("example.org") == "ipc:///run/mm/control"


def test_the_first_free_address_is_taken():
    with limited_context() as context, context.socket(zmq.ROUTER) as one, context.socket(zmq.ROUTER) as other:
        taken = bind_first(one, ["tcp://127.0.0.1:*"])
        free = bind_first(other, [taken, "tcp://127.0.0.1:*"])
        assert free != taken
        with pytest.raises(EndpointError, match="no data port is free") as caught:
            bind_first(other, [taken, free])
        assert caught.value.code == "RESOURCE_EXHAUSTED.SESSIONS"
        with pytest.raises(EndpointError, match="empty range"):
            bind_first(other, [])
        with pytest.raises(zmq.ZMQError):
            bind_first(other, ["tcp://192.0.2.1:1"])
