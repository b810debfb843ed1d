"""The pages for Prometheus and probes: their answers when a process does not respond, and clients that cannot harm
them.
"""

import contextlib
import json
import os
import signal
import socket

import pytest
from mesh_motion_protocol.errors import ResourceExhausted, error_code
from mesh_motion_protocol.messages import List, Open, Ping
from status_page import address_of, get

from mesh_motion_server.operation.disk_watch import DiskWatch
from mesh_motion_server.settings import ServerSettings
from mesh_motion_server.transport import monitor
from mesh_motion_server.transport.monitor import Pages
from mesh_motion_server.transport.opening import check_room
from tests.faults.waiting import PATIENCE, wait_until


def start_watched(start, **settings):
    return start(metrics="127.0.0.1:0", **settings)


def raw_connection(server):
    host, _, port = address_of(server).removeprefix("http://").rpartition(":")
    return socket.create_connection((host, int(port)), timeout=60)


@contextlib.contextmanager
def stopped(pid):
    os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(pid, signal.SIGCONT)


def test_ready_comes_and_goes_with_the_drain(start, open_moving):
    server = start_watched(start)
    wait_until(lambda: get(server, "/readyz") == (200, "ok\n"), "ready")
    assert get(server, "/healthz") == (200, "ok\n")
    open_moving(server)
    server.process.send_signal(signal.SIGTERM)
    wait_until(lambda: get(server, "/readyz") == (503, "draining: the server is stopping\n"), "not ready")
    assert get(server, "/healthz")[0] == 200
    (server.state / "go").touch()
    assert server.process.wait(PATIENCE) == 0


@pytest.mark.nightly
def test_a_loop_that_stands_still_is_unhealthy(start, connect):
    server = start_watched(start, stuck_seconds=2.0)
    for name, pid in (("supervisor", server.process.pid), ("gateway", server.children()[0])):
        with stopped(pid):

            def shows(name=name):
                status, text = get(server, "/healthz")
                return status == 503 and text.startswith(f"{name}: silent for ")

            wait_until(shows, f"the {name} is shown")
            assert get(server, "/readyz")[0] == 503
        wait_until(lambda: get(server, "/healthz")[0] == 200, "healthy again")
    assert connect(server.endpoint).ask(Ping).type == "PONG"


@pytest.mark.nightly
def test_a_gateway_that_is_stopped_holds_no_request_up(start, connect):
    """The supervisor has more replies for it than fit into the line."""
    server = start_watched(start, stuck_seconds=3.0)
    entry = {"label": "\N{GREEK SMALL LETTER PI}" * 200, "owner": "", "state": "READY", "step": 0, "partitions": 1}
    for number in range(150):
        name = f"{number:032x}"
        (server.state / f"{name}.json").write_text(json.dumps({"session": name} | entry))
    control, gateway = connect(server.endpoint), server.children()[0]
    with contextlib.ExitStack() as still:
        with stopped(server.process.pid):
            for _ in range(60):
                control.send(List)
            assert control.ask(Ping).type == "PONG"  # it has handed on the messages before
            still.enter_context(stopped(gateway))
        reason = wait_until(lambda: unwell(server), "a loop stands still")
        assert reason.startswith("gateway: ")
    wait_until(lambda: get(server, "/healthz")[0] == 200, "healthy again")
    assert server.children()[0] == gateway
    assert control.receive().type == "LISTED"
    assert connect(server.endpoint).ask(List).type == "LISTED"


def unwell(server):
    status, text = get(server, "/healthz")
    return text if status == 503 else ""


@pytest.fixture(scope="module")
def watched(make_module_server):
    return start_watched(make_module_server)


def test_a_monitor_that_falls_comes_back_and_no_client_notices(watched, connect, open_session):
    server = watched
    _, data, _ = open_session(server)
    fallen = server.children()[1]
    os.kill(fallen, signal.SIGKILL)
    wait_until(lambda: server.events("monitor_ended"), "the log says so")

    assert get(server, "/healthz")[0] == 200  # the pages are back at the same address
    assert data.ask(Ping).type == "PONG"


def test_other_pages_methods_and_noise(watched):
    server = watched
    assert get(server, "/")[0] == 404
    assert get(server, "/metrics/../../etc/passwd")[0] == 404
    assert get(server, "/metrics?name=x")[0] == 200
    assert get(server, "/metrics", "POST")[0] == 405
    assert get(server, "/healthz", "HEAD") == (200, "")
    for noise in (b"\r\n\r\n", b"GET /healthz\r\n\r\n", b"\x00" * 100 + b"\r\n\r\n", b"A" * 20_000):
        with raw_connection(server) as line:
            line.sendall(noise)
            assert line.recv(100).startswith(b"HTTP/1.1 400 ")


def test_a_page_of_another_site_reads_nothing(watched):
    """A browser sends the site's own name, which resolves to this machine (DNS rebinding)."""
    for host, status in (("evil.example", 421), ("localhost:9464", 200), ("127.0.0.1", 200), ("192.0.2.1:80", 421)):
        with raw_connection(watched) as line:
            line.sendall(f"GET /metrics HTTP/1.1\r\nhost : {host}\r\n\r\n".encode())
            assert line.recv(100).startswith(f"HTTP/1.1 {status} ".encode()), host


def test_slow_and_silent_connections_close_no_client_out(watched, connect):
    server = watched
    with contextlib.ExitStack() as lines:
        slow = [lines.enter_context(raw_connection(server)) for _ in range(3 * monitor._CONNECTIONS)]
        for line in slow:
            with contextlib.suppress(OSError):
                line.sendall(b"GET /metr")
        assert get(server, "/healthz")[0] == 200
        assert connect(server.endpoint).ask(Ping).type == "PONG"
        slow[0].settimeout(30)
        with contextlib.suppress(ConnectionResetError):
            assert slow[0].recv(1) == b""  # the oldest have been closed
    pid = server.children()[1]
    wait_until(lambda: len(os.listdir(f"/proc/{pid}/fd")) < monitor._CONNECTIONS, "no descriptor is left behind")


@pytest.mark.parametrize("address", ["0.0.0.0:0", "192.0.2.1:9464"])
def test_an_address_that_others_reach_exits_78(start, address):
    server = start(metrics=address, ready=False)
    assert server.process.wait(PATIENCE) == 78
    assert "metrics" in server.events("refused")[0]["reason"]


def test_an_occupied_port_exits_69_and_leaves_nothing(start):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        server = start(metrics=f"127.0.0.1:{taken.getsockname()[1]}", ready=False)
        assert server.process.wait(PATIENCE) == 69
    assert "metrics" in server.events("refused")[0]["reason"]


def test_no_room_on_the_disk_refuses_new_sessions_only(start, connect):
    server = start_watched(start, reserve_disk_bytes=1 << 60)
    wait_until(lambda: get(server, "/readyz")[1].startswith("disk: "), "not ready")
    assert get(server, "/healthz")[0] == 200
    refused = connect(server.endpoint).ask(Open, dimension=2)
    assert (refused.code, refused.retryable) == ("RESOURCE_EXHAUSTED.DISK", True)
    assert server.events("disk_low")
    assert refused.details["expected"] == 1 << 60


def test_the_memory_is_looked_at_behind_the_disk(tmp_path):
    disk = DiskWatch(tmp_path)
    limits = ServerSettings(reserve_disk_bytes=0, reserve_memory_bytes=1 << 60)
    request = Open(client=bytes(16), sequence=1, dimension=2, bytes_reserved=5)
    with pytest.raises(ResourceExhausted) as refused:
        check_room(request, limits, disk)
    assert (refused.value.code, refused.value.details["expected"]) == ("RESOURCE_EXHAUSTED.SESSIONS", (1 << 60) + 5)
    assert error_code(refused.value.code).retryable
    check_room(request, ServerSettings(reserve_disk_bytes=0, reserve_memory_bytes=0), disk)


def test_before_the_first_news_nothing_is_ready_and_then_silence_is_reported(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(monitor.time, "monotonic", lambda: now[0])
    pages = Pages({"version": "1"}, stuck_seconds=5.0)
    assert pages.answer("/readyz")[::2] == (503, b"starting\n")
    assert pages.answer("/healthz")[0] == 200
    pages.update({"at": 100.0, "gateway_at": 90.0, "missing": "", "totals": {"counts": [], "spreads": {}}})
    assert pages.answer("/healthz")[::2] == (503, b"gateway: silent for 10 s\n")
    now[0] = 106.0
    assert pages.answer("/healthz")[::2] == (503, b"supervisor: silent for 6 s\n")


def test_the_metrics_of_a_stuck_server_do_not_say_that_it_is_ready(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(monitor.time, "monotonic", lambda: now[0])
    pages = Pages({"version": "1"}, stuck_seconds=5.0)
    totals = {"counts": [], "spreads": {}}
    pages.update({"at": 100.0, "gateway_at": 100.0, "missing": "", "totals": totals, "gauges": [["ready", "", 1.0]]})
    assert b"\nmesh_motion_ready 1.0\n" in pages.answer("/metrics")[2]
    now[0] = 106.0  # and the supervisor says nothing more
    assert b"\nmesh_motion_ready 0.0\n" in pages.answer("/metrics")[2]
