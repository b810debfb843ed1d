"""Section 3: which frames a message has."""

from __future__ import annotations

from mesh_motion_conformance.case import Rows
from mesh_motion_conformance.checks import refused
from mesh_motion_conformance.server.requests import Request
from mesh_motion_conformance.server.stage import Stage, suite
from mesh_motion_conformance.tables import tables


def _control_and_frames() -> Rows:
    frames = {"empty": b"", "8-bytes": bytes(8)}
    return {f"{kind}-and-{name}-frame": (kind, frames[name]) for kind in tables().control for name in frames}


@suite("3", _control_and_frames)
def frame_behind_control_requests(stage: Stage, kind: str, frame: bytes) -> None:
    """A control message has frame 0 only."""
    fields = {"dimension": 2} if kind == "OPEN" else {}
    request = stage.session("READY").request(kind) if kind in ("RESUME", "PROBE") else Request(kind, fields)
    line = stage.control
    stage.put(line, [*request.frames(line.client, line.next()), frame])
    refused(line.receive(), "INVALID_ARGUMENT.FRAMES", state="")


@suite("3", lambda: {f"{kind}-and-a-further-frame": (kind,) for kind in tables().data})
def frame_behind_data_requests(stage: Stage, kind: str) -> None:
    """No frames but those of the declared arrays."""
    state = {"UPLOAD": "OPENING", "BUILD": "OPENING", "COMMIT": "TRIAL"}.get(kind, "READY")
    session = stage.session(state)
    line = session.lines[0]
    stage.put(line, [*session.request(kind).frames(line.client, line.next()), bytes(8)])
    refused(line.receive(), "INVALID_ARGUMENT.FRAMES", state=state)
