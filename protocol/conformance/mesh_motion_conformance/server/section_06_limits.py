"""Section 6: every limit is announced, and holds."""

from __future__ import annotations

import numpy as np

from mesh_motion_conformance.case import Skip, require
from mesh_motion_conformance.checks import answered, refused
from mesh_motion_conformance.server.requests import Request
from mesh_motion_conformance.server.stage import Stage, suite
from mesh_motion_conformance.show import show
from mesh_motion_conformance.tables import tables
from mesh_motion_conformance.wire import HEADER_BYTES, pack


@suite("6", lambda: {f"{name}-in-WELCOME": (name,) for name in tables().limits})
def announced(stage: Stage, name: str) -> None:
    """WELCOME carries all limits, those of the protocol with its values."""
    limits, row = stage.limits(), tables().limits[name]
    require(name in limits, f"{name} in WELCOME's limits", ", ".join(sorted(limits)))
    fits = not row["protocol"] or limits[name] == row["value"]
    require(fits, f"{name} = {row['value']}, set by the protocol", str(limits[name]))
    require(limits[name] > 0, f"{name} above 0", str(limits[name]))


@suite("6")
def header_of_65536_bytes(stage: Stage) -> None:
    """Frame 0 may have max_header_bytes."""
    request = Request("OPEN", {"dimension": 2, "settings": {"a": b""}})
    line = stage.control
    room = HEADER_BYTES - len(request.frames(line.client, line.sequence + 1)[0]) - 1  # bin 8 becomes bin 16
    frames = request.having(settings={"a": bytes(room)}).frames(line.client, line.next())
    if len(frames[0]) != HEADER_BYTES:
        raise Skip(f"the case could not make a header of that size: {len(frames[0])}")
    stage.put(line, frames)
    refused(line.receive(), "INVALID_ARGUMENT.SETTINGS")


@suite("6")
def header_of_65537_bytes_at_data(stage: Stage) -> None:
    """A larger frame 0 is refused on a data endpoint, whose frames may be larger."""
    session = stage.session("READY")
    line = session.lines[0]
    stage.put(line, [session.request("STATUS").frames(line.client, line.next())[0] + bytes(HEADER_BYTES)])
    refused(line.receive(), "RESOURCE_EXHAUSTED.BYTES", "INVALID_ARGUMENT.HEADER")


@suite("6")
def label_longer_than_max_label_characters(stage: Stage) -> None:
    """OPEN's label has at most max_label_characters characters."""
    size = stage.limits()["max_label_characters"] + 1
    if size > 256:
        raise Skip("the label's own length in section 12 is the narrower bound")
    refused(stage.ask(Request("OPEN", {"dimension": 2, "label": "x" * size})), "INVALID_ARGUMENT.VALUE")


@suite("6")
def more_partitions_than_max_partitions(stage: Stage) -> None:
    """A session has at most max_partitions partitions."""
    count = stage.limits()["max_partitions"] + 1
    refused(stage.ask(Request("OPEN", {"dimension": 2, "partitions": count})), "INVALID_ARGUMENT.VALUE")


@suite("6")
def more_bytes_reserved_than_max_session_bytes(stage: Stage) -> None:
    """An upload of more than max_session_bytes is refused when its size is announced."""
    size = stage.limits()["max_session_bytes"] + 1
    refused(stage.ask(Request("OPEN", {"dimension": 2, "bytes_reserved": size})), "RESOURCE_EXHAUSTED.BYTES")


@suite("6")
def declared_arrays_larger_than_max_message_bytes(stage: Stage) -> None:
    """All arrays of one message have at most max_message_bytes."""
    session = stage.session("READY")
    rows = stage.limits()["max_message_bytes"] // 16 + 1
    header = session.request("MOVE").header(session.lines[0].client, session.lines[0].next())
    header["arrays"][0]["shape"] = [rows, 2]
    stage.put(session.lines[0], [pack(header), bytes(8)])
    refused(session.lines[0].receive(), "RESOURCE_EXHAUSTED.BYTES")


@suite("6")
def more_replies_than_stored(stage: Stage) -> None:
    """The newest stored_replies replies of a client are kept; the repeat of an older one is answered ABORTED.STALE."""
    kept = stage.limits()["stored_replies"]
    session = stage.session("OPENING")
    if kept > 64:
        raise Skip(f"this server keeps {kept} replies")
    line, request = session.lines[0], session.request("UPLOAD")
    numbers = [line.next() for _ in range(kept + 2)]
    replies = [answered(session.ask(request, sequence=number), "UPLOADED") for number in numbers]
    for reply in replies[2:]:
        again = session.ask(request, sequence=reply.sequence)
        require(again.frames == reply.frames, f"the stored reply to {reply.sequence} of {numbers}", show(again))
    refused(session.ask(request, sequence=numbers[0]), "ABORTED.STALE")


@suite("6")
def upload_larger_than_max_session_bytes(stage: Stage) -> None:
    """The parts of an upload together have at most max_session_bytes."""
    size = stage.limits()["max_session_bytes"]
    if size > 1 << 26:
        raise Skip(f"{size} bytes are more than this suite sends; start the server with a smaller max_session_bytes")
    session = stage.session("OPENING")
    rows = np.zeros((size // 8 + 1, 1), dtype="<i8")
    refused(session.ask(session.request("UPLOAD").carrying(rows=rows)), "RESOURCE_EXHAUSTED.BYTES", state="OPENING")
