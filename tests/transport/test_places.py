"""Choice of the session that loses its place when all are taken."""

import socket
import time
from types import SimpleNamespace
from typing import Any

import pytest
from mesh_motion_protocol.errors import ResourceExhausted
from mesh_motion_protocol.messages import Close, List, Open, Resume

from mesh_motion_server.settings import ServerSettings
from mesh_motion_server.transport.opening import check_place, gives_way
from mesh_motion_server.transport.registry import Live, Registry
from tests.faults.waiting import wait_until

SHORTAGE = ResourceExhausted("no memory", code="RESOURCE_EXHAUSTED.SESSIONS")


def registry(**sessions: dict[str, Any]) -> Registry:
    """Sessions by name: their owner, and since when they are suspended."""
    made = Registry(None)
    for name, values in sessions.items():
        live = made.live[name] = Live(name, b"", values.pop("owner", ""), child=None)  # type: ignore[arg-type]
        live.status = "alive"
        vars(live).update(values)
    return made


def refusal(sessions: Registry, user: str, **settings: Any) -> ResourceExhausted:
    with pytest.raises(ResourceExhausted) as refused:
        check_place(sessions, ServerSettings(**settings), user)
    assert refused.value.code == "RESOURCE_EXHAUSTED.SESSIONS"
    return refused.value


def test_the_session_that_is_suspended_for_longest_gives_way_and_each_only_once() -> None:
    sessions = registry(new={"suspended_at": 8.0}, working={}, old={"suspended_at": 3.0})
    error = refusal(sessions, "", max_sessions=3)
    given = [gives_way(sessions, error) for _ in range(3)]
    assert [live and live.session for live in given] == ["old", "new", None]


def test_sessions_without_a_worker_or_starting_one_do_not_give_way() -> None:
    sessions = registry(
        dead={"suspended_at": 1.0, "status": "dead"},
        closed={"suspended_at": 1.0, "state": "CLOSED"},
        resumed={"suspended_at": 1.0, "asked": SimpleNamespace()},
    )
    assert gives_way(sessions, SHORTAGE) is None
    sessions.live["resumed"].asked = None
    assert gives_way(sessions, ResourceExhausted("the disk is full", code="RESOURCE_EXHAUSTED.DISK")) is None
    assert gives_way(sessions, SHORTAGE) is sessions.live["resumed"]


def test_one_key_has_no_more_than_its_quota_and_only_its_own_sessions_give_way() -> None:
    sessions = registry(a={"owner": "anna"}, b={"owner": "bert", "suspended_at": 1.0}, c={"owner": "anna"})
    error = refusal(sessions, "anna", max_sessions_per_key=2)
    assert error.message == "2 sessions of this key are open, which is the limit of each key on this server"
    assert gives_way(sessions, error) is None
    check_place(sessions, ServerSettings(max_sessions_per_key=2), "bert")
    check_place(registry(a={}, b={}), ServerSettings(max_sessions_per_key=2), "")  # a server without keys
    sessions.live["c"].suspended_at = 9.0
    assert gives_way(sessions, error) is sessions.live["c"]


def test_a_suspended_session_gives_way_and_resume_brings_it_back(start, connect, open_session):
    server = start(max_sessions=1, lease_seconds=0.2)
    opened, data, _at = open_session(server)
    control = connect(server.endpoint)
    assert control.ask(Open, dimension=2).code == "RESOURCE_EXHAUSTED.SESSIONS"  # a client holds it
    data.socket.close()
    wait_until(lambda: [s["state"] for s in control.ask(List).sessions] == ["SUSPENDED"], "its lease has ended")
    second, data, at = open_session(server)
    workers = {entry["session"]: entry["worker"] for entry in control.ask(List).sessions}
    assert workers == {opened.session: "none", second.session: "alive"}
    assert data.ask(Close, **at).type == "CLOSED"
    resumed = control.ask(Resume, session=opened.session, token=opened.token)
    assert (resumed.type, resumed.epoch) == ("RESUMED", 2)


def test_a_data_port_is_a_place_too(start, connect, open_session):
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    server = start(lease_seconds=0.2, data_ports=f"{port}-{port}")
    opened, data, _at = open_session(server)
    control = connect(server.endpoint)
    assert control.ask(Open, dimension=2).code == "RESOURCE_EXHAUSTED.SESSIONS"
    data.socket.close()
    deadline = time.monotonic() + 30
    while (reply := control.ask(Open, dimension=2)).type != "OPENED":
        assert time.monotonic() < deadline, reply
        time.sleep(0.05)
    assert reply.endpoint == opened.endpoint
