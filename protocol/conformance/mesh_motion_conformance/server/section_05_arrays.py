"""Section 5: declarations, dtypes, shapes, chunks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from mesh_motion_conformance.case import Skip, require
from mesh_motion_conformance.checks import answered, refused
from mesh_motion_conformance.server.requests import Header, Request
from mesh_motion_conformance.server.session import Session
from mesh_motion_conformance.server.stage import Stage, suite
from mesh_motion_conformance.show import show
from mesh_motion_conformance.wire import CHUNK_BYTES, Message

_DTYPE, _SHAPE, _FRAMES, _HEADER, _NONFINITE = (
    f"INVALID_ARGUMENT.{name}" for name in ("DTYPE", "SHAPE", "FRAMES", "HEADER", "NONFINITE")
)
_STATE = {"MOVE": "READY", "UPLOAD": "OPENING"}


def _nodes(session: Session) -> Request:
    """An UPLOAD of two more nodes."""
    return session.uploading([[0.5, 0.5], [0.6, 0.5]], item="nodes")


def _request(session: Session, kind: str) -> Request:
    return _nodes(session) if kind == "UPLOAD" else session.request(kind)


def _declared(stage: Stage, kind: str, key: str, value: Any, *codes: str) -> None:
    """A request in whose only declaration one key is changed is refused."""
    session = stage.session(_STATE[kind])

    def changed(header: Header) -> Header:
        return header | {"arrays": [header["arrays"][0] | {key: value}]}

    refused(session.ask(_request(session, kind), change=changed), *codes, state=_STATE[kind])


@suite.family(_declared, "5")
def declarations() -> Iterator[tuple[Any, ...]]:
    """Exactly the keys name, dtype and shape, each of its type and among its values."""
    for kind in _STATE:
        for name, *rest in _wrong_declarations():
            yield f"{kind}-{name}", rest[0], kind, *rest[1:]
    for dtype in ("<i8", "<i4"):
        yield f"MOVE-dtype-{dtype}", "displacement is <f8 or <f4", "MOVE", "dtype", dtype, _DTYPE
    for columns in (0, 4, 100):
        yield f"MOVE-{columns}-columns", "dimension is 1, 2 or 3", "MOVE", "shape", [1, columns], _SHAPE


def _wrong_declarations() -> Iterator[tuple[Any, ...]]:
    """Name, demand, key, value and codes of a wrong declaration."""
    value: Any
    yield "fourth-key", "An entry of arrays has exactly the keys name, dtype, shape", "order", "C", _HEADER
    for value in (1, None, b"displacement", ["x"]):
        yield f"name-is-{type(value).__name__.lower()}", "name is str", "name", value, _HEADER
    yield "unknown-name", "name is a field of section 12", "name", "force", _HEADER
    for value in (8, None, b"<f8", ["<f8"]):
        yield f"dtype-is-{type(value).__name__.lower()}", "dtype is str", "dtype", value, _HEADER
    for value in ("", "f8", ">f8", "=f8", "|f8", "<f2", "<f16", "<c16", "<u8", "<i2", "|b1", "O", "|O", "V8", "S8",
                  "<U4", "<M8", "float64", "S2147483647", "<f8,<f8", "<f8 "):  # fmt: skip
        yield f"dtype-{value!r}", "dtype is one of four", "dtype", value, _DTYPE
    for value in ("2,2", 4, None, {}):
        yield f"shape-is-{type(value).__name__.lower()}", "shape is an array", "shape", value, _HEADER
    for name, value in (("float", 2.0), ("text", "2"), ("nil", None), ("true", True)):
        yield f"{name}-in-shape", "shape is an array of int", "shape", [value, 2], _SHAPE
    for items in ([], [8], [2, 2, 1], [-2, 2], [2, -2], [-2, -2]):
        demand = "As many lengths as section 12 names axes, none negative"
        yield f"shape-{items}".replace(" ", ""), demand, "shape", items, _SHAPE
    bytes_ = "RESOURCE_EXHAUSTED.BYTES"
    for items in ([2**62, 2], [2**32, 2**32], [2**63 - 1, 2]):
        demand = "Lengths whose product no machine holds are refused before memory is taken"
        yield f"shape-{items[0]:x}-{items[1]:x}", demand, "shape", items, _SHAPE, bytes_
    yield "shape-2-40-rows", "max_message_bytes bounds all arrays of a message", "shape", [2**40, 2], bytes_


# --- 5.1 to 5.6 ------------------------------------------------------------------------------------------------------


@suite("5.1")
def narrow_floats_are_widened(stage: Stage) -> None:
    """A field whose dtype is <f8 also admits <f4; the receiver widens them."""
    session = stage.session("READY")
    rows = session.rows().astype("<f4")
    narrow = answered(session.ask(session.request("MOVE").carrying(displacement=rows)), "MOVED")
    wide = answered(session.ask(session.request("MOVE").carrying(displacement=rows.astype("<f8"))), "MOVED")
    same = narrow.arrays["displacement"].tobytes() == wide.arrays["displacement"].tobytes()
    require(same, "the same displacement for <f4 and <f8 of the same values", show(narrow))


@suite("5.1")
def narrow_indices_are_widened(stage: Stage) -> None:
    """A field with <i8 also admits <i4."""
    session = stage.session("OPENING")
    request = session.request("UPLOAD")
    answered(session.ask(request.carrying(rows=request.arrays["rows"].astype("<i4"))), "UPLOADED")


def _same_content(request: Request, other: Request, session: Session) -> None:
    """The two forms under one request id are one request."""
    number = session.lines[0].next()
    first = session.ask(request, sequence=number)
    require(first.kind != "ERROR", "the request executed", show(first))
    again = session.ask(other, sequence=number)
    require(again.frames == first.frames, f"the stored reply {show(first)}", show(again))


@suite("5.1")
def narrow_and_wide_floats_are_one_content(stage: Stage) -> None:
    """The <f4 and the <f8 form of the same values are the same content: a repeat, not a conflict."""
    session = stage.session("READY")
    rows = session.rows().astype("<f4")
    move = session.request("MOVE")
    wide, narrow = move.carrying(displacement=rows.astype("<f8")), move.carrying(displacement=rows)
    _same_content(wide, narrow, session)


@suite("5.1")
def narrow_and_wide_indices_are_one_content(stage: Stage) -> None:
    """The <i4 and the <i8 form of the same values are the same content."""
    session = stage.session("OPENING")
    upload = session.request("UPLOAD")
    _same_content(upload, upload.carrying(rows=upload.arrays["rows"].astype("<i4")), session)


@suite("5.2")
def rows_before_columns(stage: Stage) -> None:
    """Items come row by row: FETCH of the reference mesh gives the coordinates that were uploaded."""
    session = stage.session("READY")
    points = session.do(session.about("FETCH", what="reference")).arrays["points"]
    same = points.tobytes() == session.parts[0].points.tobytes()
    require(same, "the uploaded coordinates, bitwise", f"{points[:3].tolist()} …")


_NUMBER, _SIZE = "The number of frames is exactly that of the chunks", "A chunk has exactly its bytes"
_FRAMED: dict[str, tuple[str, Callable[[list[bytes]], list[bytes]]]] = {
    "no-frame": (_NUMBER, lambda _: []),
    "a-frame-more": (_NUMBER, lambda body: [*body, b"x"]),
    "an-empty-frame-more": (_NUMBER, lambda body: [*body, b""]),
    "an-empty-frame-before": (_NUMBER, lambda body: [b"", *body]),
    "a-byte-less": (_SIZE, lambda body: [body[0][:-1]]),
    "a-byte-more": (_SIZE, lambda body: [body[0] + b"\0"]),
    "an-item-less": (_SIZE, lambda body: [body[0][:-8]]),
    "empty-frame": (_SIZE, lambda _: [b""]),
    "two-halves": (_NUMBER, lambda body: [body[0][:8], body[0][8:]]),
}


@suite("5.3", {f"{kind}-{name}": (*row, kind) for kind in _STATE for name, row in _FRAMED.items()})
def frames_of_arrays(stage: Stage, _: str, frames: Callable[[list[bytes]], list[bytes]], kind: str) -> None:
    """{0}"""
    session = stage.session(_STATE[kind])
    line = session.lines[0]
    header, *body = _request(session, kind).frames(line.client, line.next())
    stage.put(line, [header, *frames(body)])
    refused(line.receive(), _FRAMES, state=_STATE[kind])


@suite("5.3")
def array_without_bytes_has_no_frame(stage: Stage) -> None:
    """An array with an axis of length 0 has no frame."""
    session = stage.session("OPENING")
    before = session.do(_nodes(session)).fields["rows_total"]
    session.do(_nodes(session).carrying(rows=np.empty((0, 2))), rows_total=before)


@suite("5.3")
def array_without_bytes_and_a_frame(stage: Stage) -> None:
    """An empty frame for an array without bytes is one frame too many."""
    session = stage.session("OPENING")
    line = session.lines[0]
    request = _nodes(session).carrying(rows=np.empty((0, 2)))
    stage.put(line, [*request.frames(line.client, line.next()), b""])
    refused(line.receive(), _FRAMES, state="OPENING")


#: Two rows more than a chunk holds; the server needs no memory for them afterwards.
_LARGE = CHUNK_BYTES // 4 + 2


def _put_large(stage: Stage, cut: Callable[[bytes], list[bytes]]) -> Message:
    """The reply to an array of indices of more than one chunk, cut in the given way."""
    session = stage.session("OPENING")
    line, rows = session.lines[0], np.zeros((_LARGE, 1), dtype="<i4")
    request = session.uploading(rows, item="patch", name="large", role="fixed")
    stage.put(line, [request.frames(line.client, line.next())[0], *cut(rows.tobytes())])
    return line.receive()


@suite("5.3")
def two_chunks(stage: Stage) -> None:
    """Arrays are cut into chunks of exactly max_chunk_bytes, the last one shorter."""
    if stage.limits()["max_session_bytes"] < 1 << 26:
        raise Skip("this server takes no upload of more than a chunk")
    reply = _put_large(stage, lambda raw: [raw[:CHUNK_BYTES], raw[CHUNK_BYTES:]])
    answered(reply, "UPLOADED", rows_total=_LARGE)


@suite("5.3")
def two_chunks_cut_elsewhere(stage: Stage) -> None:
    """Chunks of other sizes are refused."""
    reply = _put_large(stage, lambda raw: [raw[: CHUNK_BYTES - 8], raw[CHUNK_BYTES - 8 :]])
    refused(reply, _FRAMES, state="OPENING")


@suite("5.3")
def two_chunks_in_three_frames(stage: Stage) -> None:
    """As many frames as chunks."""
    reply = _put_large(stage, lambda raw: [raw[:CHUNK_BYTES], raw[CHUNK_BYTES:], b""])
    refused(reply, _FRAMES, state="OPENING")


@suite("5")
def array_declared_twice(stage: Stage) -> None:
    """Each array at most once."""
    session = stage.session("READY")
    line = session.lines[0]
    header, body = session.request("MOVE").frames(line.client, line.next(), lambda h: h | {"arrays": h["arrays"] * 2})
    stage.put(line, [header, body, body])
    refused(line.receive(), _HEADER, state="READY")


@suite("5")
def required_array_left_out(stage: Stage) -> None:
    """MOVE without its array is refused."""
    session = stage.session("READY")
    request = Request("MOVE", session.request("MOVE").fields)
    refused(session.ask(request), _HEADER, state="READY")


@suite("5")
def rows_left_out(stage: Stage) -> None:
    """UPLOAD without its rows is refused."""
    session = stage.session("OPENING")
    refused(session.ask(Request("UPLOAD", _nodes(session).fields)), "INVALID_ARGUMENT", state="OPENING")


_WITHOUT_ARRAYS = ("PING", "JOIN", "BUILD", "COMMIT", "ROLLBACK", "FETCH", "STATUS", "CLOSE")


@suite("5", {f"{kind}-with-an-array": (kind,) for kind in _WITHOUT_ARRAYS})
def arrays_of_others(stage: Stage, kind: str) -> None:
    """A request has no arrays but those of section 12."""
    state = {"BUILD": "OPENING", "COMMIT": "TRIAL"}.get(kind, "READY")
    session = stage.session(state)
    refused(session.ask(session.request(kind).carrying(displacement=session.rows())), _HEADER, state=state)


def _misshapen(stage: Stage, rows: int, columns: int) -> None:
    session = stage.session("READY")
    move = session.request("MOVE").carrying(displacement=np.zeros((rows, columns)))
    refused(session.ask(move), _SHAPE, state="READY")


@suite("5.4", {f"{columns}-columns-in-2D": (columns,) for columns in (1, 3)})
def dimension(stage: Stage, columns: int) -> None:
    """Axes named dimension have the length of the session."""
    _misshapen(stage, 4, columns)


@suite("13.5", {f"{rows}-rows": (rows,) for rows in (0, 3, 5, 16)})
def moving_rows(stage: Stage, rows: int) -> None:
    """One row a moving node of the partition."""
    _misshapen(stage, rows, 2)


_NON_FINITE = {
    f"{kind}-{value}-{dtype}": (kind, value, dtype)
    for kind in _STATE
    for value in (float("nan"), float("inf"), float("-inf"))
    for dtype in ("<f8", "<f4")
}


@suite("5.6", _NON_FINITE)
def non_finite(stage: Stage, kind: str, value: float, dtype: str) -> None:
    """NaN and infinities in arrays of requests are refused."""
    session = stage.session(_STATE[kind])
    request = _request(session, kind)
    name, rows = next(iter(request.arrays.items()))
    bad = rows.astype(dtype)
    bad[1, 1] = value
    reply = refused(session.ask(request.carrying(**{name: bad})), _NONFINITE, state=_STATE[kind])
    require({"node", "row"} & set(reply.fields["details"]), "details that name the node or the row", show(reply))
