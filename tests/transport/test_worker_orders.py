"""Replies of a worker to the supervisor's orders."""

from functools import partial
from types import SimpleNamespace
from typing import Any

import zmq

from mesh_motion_server.settings import ServerSettings
from mesh_motion_server.transport.template import _host, _report_progress
from mesh_motion_server.transport.worker import Worker
from tests.faults.limited_context import limited_context


class Line:
    """The channel with one order; replies and actions go into one list."""

    def __init__(self, order: dict[str, Any]) -> None:
        self.order, self.events = order, list[str]()

    def receive(self) -> dict[str, Any]:
        return self.order

    def send(self, message: dict[str, Any]) -> None:
        self.events.append(message["event"])


class Host:
    state, step = "READY", 3

    def __init__(self, line: Line) -> None:
        self.line = line

    def reclaim(self, token: bytes) -> int:
        assert token == b"t"
        self.line.events.append("written")
        return 2


def test_a_new_holder_is_known_before_anything_is_written_for_him() -> None:
    line = Line({"order": "reclaim", "token": b"t"})
    context = limited_context()
    socket = context.socket(zmq.ROUTER)
    worker = Worker(line, socket, Host(line), ServerSettings(), None)  # type: ignore[arg-type]
    try:
        worker._obey()
    finally:
        worker.disconnect()
        socket.close()
        context.term()
    assert line.events == ["reclaiming", "written", "reclaimed"]


def test_a_worker_reports_each_step_that_it_computes_again() -> None:
    events: list[dict[str, Any]] = []

    class Hosts:
        @staticmethod
        def resume(session: str, token: bytes, store: None, *, limits: ServerSettings, progress: Any) -> str:
            progress(7)
            return session

    channel: Any = SimpleNamespace(offer=events.append)
    order = {"order": "resume", "session": "s", "token": b"t"}
    found = _host(order, Hosts, None, ServerSettings(), partial(_report_progress, channel))
    assert (found, events) == ("s", [{"event": "recomputed", "step": 7}])
