"""The page's process with a real server: its address, its resistance to attacks, and its end with the server.

Test of ``serve --monitor``, the beginning of docs/monitor.md.
"""

import contextlib
import http.client
import json
import os
import signal
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("uvicorn", reason="the extra monitor is not installed")

from mesh_motion_server.watch.page import connections
from tests.faults.processes import alive, children_of, name_of
from tests.faults.server_process import ServerProcess
from tests.faults.waiting import wait_until


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    served = ServerProcess(tmp_path_factory.mktemp("server"), monitor="127.0.0.1:0")
    served.start()
    yield served
    served.stop()


def address(server: ServerProcess) -> tuple[str, int]:
    host, _, port = server.announced["monitor"].removeprefix("tcp://").rpartition(":")
    return host, int(port)


def raw(server: ServerProcess, request: bytes = b"") -> socket.socket:
    line = socket.create_connection(address(server), timeout=60)
    line.sendall(request)
    return line


def get(server: ServerProcess, path: str) -> tuple[int, bytes]:
    def ask() -> tuple[int, bytes] | None:
        asked = http.client.HTTPConnection(*address(server), timeout=60)
        with contextlib.closing(asked), contextlib.suppress(OSError, http.client.HTTPException):
            asked.request("GET", path)
            reply = asked.getresponse()
            return reply.status, reply.read()
        return None

    return wait_until(ask, f"{path} is answered")


def page_process(server: ServerProcess) -> int:
    (pid,) = [pid for pid in children_of(server.process.pid) if name_of(pid) == "mesh-page"]
    return pid


def test_it_is_announced_and_shows_the_list(server: ServerProcess) -> None:
    status, body = get(server, "/api/sessions")
    assert (status, json.loads(body)["sessions"]) == (200, [])
    assert os.getpriority(os.PRIO_PROCESS, page_process(server)) == 10


def test_a_crashed_page_comes_back_at_the_same_address(server: ServerProcess) -> None:
    fallen = page_process(server)
    os.kill(fallen, signal.SIGKILL)
    wait_until(lambda: server.events("monitor_ended"), "the log says so")
    assert get(server, "/api/sessions")[0] == 200
    assert page_process(server) != fallen
    assert server.events("monitor_ended")[0]["of"] == "monitor"


@pytest.mark.nightly
def test_slow_silent_and_many_connections_close_no_client_out(server: ServerProcess) -> None:
    with contextlib.ExitStack() as lines:
        slow = [lines.enter_context(raw(server, b"GET / HT")) for _ in range(2 * connections.MOST)]
        assert get(server, "/")[0] == 200
        with contextlib.suppress(ConnectionResetError):
            assert slow[0].recv(1) == b""  # the oldest were closed
    with raw(server, b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: ") as late:
        began = time.monotonic()
        with contextlib.suppress(ConnectionResetError):
            assert late.recv(1) == b""
        assert time.monotonic() - began > connections.REQUEST_SECONDS / 2
    folder = Path(f"/proc/{page_process(server)}/fd")
    wait_until(lambda: len(list(folder.iterdir())) < 40, "no descriptor is left behind")


@pytest.mark.parametrize(
    ("noise", "answer"),
    [
        (b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03\r\n\r\n", b"HTTP/1.1 400"),
        (b"GET / HTTP/1.1\r\n\r\n", b"HTTP/1.1 400"),
        (b"GET / HTTP/1.1\r\nHost: a\r\nHost: 127.0.0.1\r\n\r\n", b"HTTP/1.1 400"),
        (b"GET / HTTP/1.1\r\nHost: rebound.example\r\n\r\n", b"HTTP/1.1 421"),
        (b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 0\r\n\r\n", b"HTTP/1.1 405"),
        (b"GET /static/../../app.py HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n", b"HTTP/1.1 404"),
        (b"GET http://evil.example/ HTTP/1.1\r\nHost: evil.example\r\n\r\n", b"HTTP/1.1 421"),
    ],
)
def test_noise_is_answered_and_ends(server: ServerProcess, noise: bytes, answer: bytes) -> None:
    with raw(server, noise) as line:
        assert line.recv(12) == answer


def test_a_flood_of_header_bytes_ends(server: ServerProcess) -> None:
    with raw(server, b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n") as line, contextlib.suppress(OSError):
        for _ in range(100):
            line.sendall(b"X: " + b"y" * 10_000)
        assert line.recv(12) in (b"HTTP/1.1 400", b"HTTP/1.1 431", b"")
    assert get(server, "/")[0] == 200


def test_an_address_that_others_reach_exits_78(tmp_path: Path) -> None:
    served = ServerProcess(tmp_path, monitor="0.0.0.0:0")
    try:
        served.launch()
        assert served.process.wait(60) == 78
        assert "keys do not protect it" in served.events("refused")[0]["reason"]
    finally:
        served.stop()


def test_the_page_ends_with_a_server_that_is_killed(server: ServerProcess) -> None:
    """The last test of this module, because it ends the server."""
    pid = page_process(server)
    os.kill(server.process.pid, signal.SIGKILL)
    wait_until(lambda: not alive(pid), "the page has ended")
