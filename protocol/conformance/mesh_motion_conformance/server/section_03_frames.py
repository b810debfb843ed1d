"""Section 3: which frames a message has."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from mesh_motion_conformance.case import Case, Suite
from mesh_motion_conformance.checks import refused
from mesh_motion_conformance.server.requests import Request
from mesh_motion_conformance.server.stage import Stage
from mesh_motion_conformance.tables import tables

__all__ = ["suite"]

suite = Suite()


@suite.family
def frame_behind_control_requests() -> Iterator[Case]:
    """A message on the control endpoint has frame 0 only."""

    def behind(kind: str, frame: bytes) -> Callable[[Stage], None]:
        def run(stage: Stage) -> None:
            fields = {"dimension": 2} if kind == "OPEN" else {}
            request = stage.session("READY").request(kind) if kind in ("RESUME", "PROBE") else Request(kind, fields)
            line = stage.control
            stage.put(line, [*request.frames(line.client, line.next()), frame])
            refused(line.receive(), "INVALID_ARGUMENT.FRAMES", state="")

        return run

    for kind in tables().control:
        for name, frame in (("empty", b""), ("8-bytes", bytes(8))):
            yield Case("3", f"{kind}-and-{name}-frame", "A control message has frame 0 only", behind(kind, frame))


@suite.family
def frame_behind_data_requests() -> Iterator[Case]:
    """After frame 0 come the frames of the declared arrays, and no others."""

    def behind(kind: str) -> Callable[[Stage], None]:
        def run(stage: Stage) -> None:
            state = {"UPLOAD": "OPENING", "BUILD": "OPENING", "COMMIT": "TRIAL"}.get(kind, "READY")
            session = stage.session(state)
            line = session.lines[0]
            stage.put(line, [*session.request(kind).frames(line.client, line.next()), bytes(8)])
            refused(line.receive(), "INVALID_ARGUMENT.FRAMES", state=state)

        return run

    for kind in tables().data:
        yield Case("3", f"{kind}-and-a-further-frame", "No frames but those of the declared arrays", behind(kind))
