"""Real processes and sockets: sessions come and go, workers and servers die, and no other client notices."""

import json
import os
import signal
import time
from pathlib import Path

import msgpack
import numpy as np
import psutil
import pytest
from mesh_motion_protocol.messages import Close, Commit, Hello, List, Move, Open, Ping, Probe, Resume, Status

from tests.faults.attacks import endless_message
from tests.faults.processes import alive, descendants
from tests.faults.waiting import PATIENCE, wait_until

ONES = np.ones((2, 2))


def worker_pid(data, at):
    return data.ask(Status, **at).report["pid"]


@pytest.mark.parametrize("scheme", ["tcp", "ipc"])
def test_a_session_from_open_to_close(start, connect, open_session, scheme, tmp_path):
    folder = tmp_path / "s"
    folder.mkdir(mode=0o700)
    server = start(endpoint="tcp://127.0.0.1:0" if scheme == "tcp" else f"ipc://{folder}/c")
    assert server.output_path.read_text() == f"ready {server.endpoint}\n"
    opened, data, at = open_session(server, label="beam")
    assert opened.endpoint.startswith(scheme)
    assert data.ask(Ping).type == "PONG"
    moved = data.ask(Move, **at, step=1, frame="reference", displacement=ONES)
    assert (moved.displacement == 2).all()
    assert data.ask(Commit, **at, step=1).step == 1
    control = connect(server.endpoint)
    wait_until(lambda: control.ask(List).sessions[0]["step"] == 1, "the list shows the step")
    assert control.ask(List).sessions == [
        {"session": opened.session, "label": "beam", "state": "READY", "step": 1, "partitions": 1, "worker": "alive"}
    ]
    assert data.ask(Close, **at).type == "CLOSED"
    probe = {"session": opened.session, "token": opened.token}
    wait_until(lambda: control.ask(Probe, **probe).worker == "none", "the worker has ended")
    resumed = control.ask(Resume, **probe)
    assert (resumed.epoch, resumed.step) == (2, 1)


def test_a_session_that_cannot_be_opened_is_refused_with_the_reason(start, connect):
    server = start(
        max_sessions=1, max_session_bytes=1 << 20, durability=["full"], max_partitions=4, max_label_characters=40
    )
    control = connect(server.endpoint)
    assert control.ask(Open, dimension=2, settings={"radius": 1.0}).code.startswith("INVALID_ARGUMENT")
    assert control.ask(Open, dimension=2, durability="relaxed").code.startswith("INVALID_ARGUMENT")
    assert control.ask(Open, dimension=2, bytes_reserved=1 << 30).code == "RESOURCE_EXHAUSTED.BYTES"
    for field, value, most in (("partitions", 5, 4), ("label", "x" * 41, 40)):
        refused = control.ask(Open, dimension=2, **{field: value})
        assert (refused.code, refused.details["field"]) == ("INVALID_ARGUMENT.VALUE", field)
        assert f"at most {most}" in refused.message
    broken = control.ask(Open, dimension=2, label="broken")
    assert (broken.code, broken.message, broken.hint) == ("INVALID_ARGUMENT", "this one does not open", "it is a test")
    assert control.ask(Open, dimension=2).type == "OPENED"
    assert control.ask(Open, dimension=2).code == "RESOURCE_EXHAUSTED.SESSIONS"


@pytest.mark.nightly
def test_resume_does_not_wait_for_a_computation_of_a_lost_holder(start, connect, open_moving):
    server = start()
    opened, _ = open_moving(server)
    first, second = connect(server.endpoint), connect(server.endpoint)
    for control in (first, second):
        control.send(Resume, session=opened.session, token=opened.token)
    epochs = [first.receive().epoch, second.receive().epoch]
    assert sorted(epochs) == [2, 3]


def test_kill_9_of_the_server_leaves_no_process_and_no_lost_step(start, connect, open_session):
    server = start()
    opened, data, at = open_session(server, label="slow")
    data.ask(Commit, **at, step=5)
    data.send(Move, **at, step=6, frame="reference", displacement=ONES)
    wait_until((server.state / f"moving-{opened.session}").exists, "the move runs")
    children = server.children()
    assert len(children) == 3
    server.process.kill()
    wait_until(lambda: not any(map(alive, children)), "no orphan is left")
    server.stop()
    again = start(folder=server.folder)
    control = connect(again.endpoint)
    probe = {"session": opened.session, "token": opened.token}
    assert control.ask(Probe, **probe).worker == "none"
    resumed = control.ask(Resume, **probe)
    assert (resumed.epoch, resumed.step) == (2, 5)


def test_the_gateway_comes_back_on_the_same_endpoint(start, connect, open_session):
    server = start()
    opened, data, at = open_session(server)
    gateway = server.children()[0]
    os.kill(gateway, signal.SIGKILL)
    assert data.ask(Commit, **at, step=1).step == 1
    control = connect(server.endpoint)
    assert control.ask(Probe, session=opened.session, token=opened.token).worker == "alive"
    wait_until(lambda: server.events("gateway_ended"), "the log says so")


def test_sigterm_drains_a_server_that_has_just_said_that_it_is_ready(start):
    server = start("stopped-at-once", ready=False)
    assert server.process.wait(PATIENCE) == 0
    assert [event["reason"] for event in server.events("draining")] == ["signal"]


def test_sigterm_lets_the_request_finish_and_closes_the_journal(start, connect, open_moving):
    server = start()
    opened, data = open_moving(server)
    server.process.send_signal(signal.SIGTERM)
    wait_until(lambda: server.events("draining"), "draining")
    refused = connect(server.endpoint).ask(Open, dimension=2)
    assert (refused.code, refused.retryable) == ("UNAVAILABLE.DRAINING", True)
    (server.state / "go").touch()
    assert data.receive().type == "MOVED"
    assert server.process.wait(PATIENCE) == 0
    assert (server.state / f"closed-{opened.session}").exists()
    assert not server.ready_file.exists()


def test_the_end_of_a_terminal_is_one_drain_of_all_its_processes(start, open_moving):
    """A shell and the kernel both send SIGHUP, to workers too."""
    server = start()
    opened, data = open_moving(server)
    for _ in range(2):
        for process in {server.process.pid, *descendants(server.process.pid)}:
            os.kill(process, signal.SIGHUP)
        wait_until(lambda: server.events("draining"), "draining")
    (server.state / "go").touch()
    assert data.receive().type == "MOVED"
    assert server.process.wait(PATIENCE) == 0
    assert not server.events("killed")
    assert (server.state / f"closed-{opened.session}").exists()


def test_a_server_that_ignores_the_end_of_its_terminal_serves_on(start, connect):
    """As ``nohup`` starts it."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        server = start()
    finally:
        signal.signal(signal.SIGHUP, before)
    server.process.send_signal(signal.SIGHUP)
    assert connect(server.endpoint).ask(Open, dimension=2).type == "OPENED"
    assert not server.events("draining")


@pytest.mark.parametrize("ended_by", ["its limit", "a second signal"])
def test_a_drain_is_bounded(start, open_moving, ended_by):
    server = start(**({"drain_seconds": 0.5} if ended_by == "its limit" else {}))
    open_moving(server)
    server.process.send_signal(signal.SIGTERM)
    if ended_by == "a second signal":
        wait_until(lambda: server.events("draining"), "draining")
        server.process.send_signal(signal.SIGTERM)
    assert server.process.wait(PATIENCE) == 0  # the move itself waits for ever
    assert server.events("killed")


def test_a_signal_and_the_end_of_the_lifeline_are_one_drain(start, open_session):
    reader, writer = os.pipe()
    server = start(environment={"MESH_MOTION_LIFELINE_FD": str(reader)}, pass_fds=[reader])
    os.close(reader)
    opened, _, _ = open_session(server)
    os.close(writer)
    server.process.send_signal(signal.SIGTERM)
    assert server.process.wait(PATIENCE) == 0
    assert not server.events("killed")
    assert (server.state / f"closed-{opened.session}").exists()


def test_a_session_without_connections_is_suspended_and_then_put_away(start, connect):
    server = start(lease_seconds=0.2, idle_seconds=1.0)
    control = connect(server.endpoint)
    opened = control.ask(Open, dimension=2)
    wait_until(lambda: control.ask(List).sessions[0]["state"] == "SUSPENDED", "suspended")
    wait_until(lambda: control.ask(List).sessions[0]["worker"] == "none", "put away")
    assert control.ask(Resume, session=opened.session, token=opened.token).epoch == 2


def test_insecure_listens_says_so_and_counts_greetings(start, connect):
    server = start("insecure", endpoint="tcp://0.0.0.0:0", metrics="0.0.0.0:0")
    port = server.endpoint.rpartition(":")[2]
    control = connect(f"tcp://127.0.0.1:{port}")
    assert control.ask(Open, dimension=2).endpoint.startswith("tcp://0.0.0.0:")
    for _ in range(2):
        control.ask(Hello)
    address, pages = server.events("insecure")
    assert ("metrics" in address, pages["metrics"]) == (False, "0.0.0.0:0")
    assert [line["count"] for line in server.events("insecure_hello")] == [1, 2]


def test_an_ipc_endpoint_is_not_stolen(start, connect, tmp_path):
    folder = tmp_path / "s"
    folder.mkdir(mode=0o700)
    server = start(endpoint=f"ipc://{folder}/c")
    thief = start(endpoint=f"ipc://{folder}/c", ready=False)
    assert thief.process.wait(PATIENCE) == 78
    assert connect(server.endpoint).ask(Ping).type == "PONG"


def test_no_socket_file_is_left_by_a_killed_worker(start, connect, open_session, tmp_path):
    folder = tmp_path / "s"
    folder.mkdir(mode=0o700)
    server = start(endpoint=f"ipc://{folder}/c")
    opened, data, at = open_session(server)
    path = Path(opened.endpoint.removeprefix("ipc://"))
    assert path.exists()
    os.kill(worker_pid(data, at), signal.SIGKILL)
    wait_until(lambda: not path.exists(), "the file is gone")


def test_an_endless_message_meets_the_memory_limit_and_ends_its_connection_only(start, connect, open_session):
    server = start(worker_memory_bytes=256 << 20)
    opened, data, at = open_session(server)
    pid = worker_pid(data, at)
    assert endless_message(opened.endpoint, 8 << 20, 1 << 30) < 300 << 20
    assert worker_pid(data, at) == pid
    gateway = server.children()[0]
    # glibc keeps these blocks and their addresses if the thread has a separate heap
    assert endless_message(server.endpoint, 60_000, 1 << 30) < 600 << 20
    control = connect(server.endpoint)
    control.send_frames(msgpack.packb({"lists": [[[]] * 240] * 250}))  # of 5 MB: Python must map memory for it
    assert control.receive().code == "UNIMPLEMENTED.VERSION"  # it was read
    assert control.ask(Probe, session=opened.session, token=opened.token).worker == "alive"
    assert server.children()[0] == gateway
    # with the message the worker had some 380 MiB; idle it has 150 to 200, depending on its loaded modules
    for process, most in ((pid, 256 << 20), (gateway, 80 << 20)):
        wait_until(
            lambda process=process, most=most: psutil.Process(process).memory_info().rss < most, "memory is back"
        )


def test_a_server_whose_workers_cannot_start_ends_with_70(start):
    """The server ends instead of letting every client wait for a session that no worker can serve."""
    server = start("no-numerics", ready=False)
    assert server.process.wait(PATIENCE) == 70
    assert len(server.events("template_ended")) == 3
    assert server.events("workers_cannot_start")[0]["attempts"] == 3
    assert "not_installed" in server.log_path.read_text()


def test_a_range_of_data_ports_behind_another_host(start, connect):
    """Like behind a container's port mapping: the client uses the host by which it reached the control endpoint."""
    own = f"127.1.{os.getpid() // 250 % 250}.{os.getpid() % 250 + 1}"  # no other process has ports there
    server = start(endpoint=f"tcp://{own}:0", data_ports="21000-21000", advertised_host="0.0.0.0")
    control = connect(server.endpoint)
    opened = control.ask(Open, dimension=2)
    assert opened.endpoint == "tcp://0.0.0.0:21000"
    data = connect(opened.endpoint.replace("0.0.0.0", own))
    assert data.ask(Ping).type == "PONG"
    refused = control.ask(Open, dimension=2)
    assert (refused.code, refused.retryable) == ("RESOURCE_EXHAUSTED.SESSIONS", True)
    assert f"no data port is free: tcp://{own}:21000" in refused.message
    assert data.ask(Ping).type == "PONG"


def test_sessions_with_long_labels_are_listed_in_pages_that_fit(start, connect):
    server = start()
    entry = {"label": "\N{GREEK SMALL LETTER PI}" * 200, "owner": "", "state": "READY", "step": 0, "partitions": 1}
    names = [f"{number:032x}" for number in range(300)]
    for name in names:
        (server.state / f"{name}.json").write_text(json.dumps({"session": name} | entry))
    control, found, more = connect(server.endpoint), [], True
    while more:
        page = control.ask(List, after=found[-1] if found else "")
        assert page.sessions
        found += [session["session"] for session in page.sessions]
        more = page.more
    assert found == names


@pytest.mark.nightly
def test_a_worker_that_is_slow_to_end_holds_no_request_up(start, connect, open_session):
    server = start()
    opened, data, at = open_session(server, label="lingers")
    pid = worker_pid(data, at)
    assert data.ask(Close, **at).type == "CLOSED"
    wait_until((server.state / f"lingers-{opened.session}").exists, "it has closed its line")
    control = connect(server.endpoint)
    assert control.ask(List).sessions[0]["session"] == opened.session
    assert alive(pid)
    wait_until(lambda: not alive(pid), "it is killed")
    wait_until(lambda: server.events("worker_ended"), "the log says so")


def test_a_close_that_was_answered_while_the_supervisor_was_busy_shows_in_the_list(start, connect, open_session):
    server = start()
    control = connect(server.endpoint)
    for _ in range(5):
        _, data, at = open_session(server)
        os.kill(server.process.pid, signal.SIGSTOP)
        try:
            data.ask(Move, **at, step=1, frame="reference", displacement=ONES)
            data.ask(Commit, **at, step=1)  # the worker's report of this step waits before its report of the end
            assert data.ask(Close, **at, outcome="discard").type == "CLOSED"
            control.send(List)
            time.sleep(0.1)  # the gateway has passed it on
        finally:
            os.kill(server.process.pid, signal.SIGCONT)
        assert control.receive().sessions == []


def test_the_place_of_a_closed_session_is_free_at_once(start, connect, open_session):
    server = start(max_sessions=1)
    for _ in range(8):
        _, data, at = open_session(server)
        assert data.ask(Close, **at, outcome="discard").type == "CLOSED"
        assert connect(server.endpoint).ask(List).sessions == []
