"""Section 5: declarations, dtypes, shapes, chunks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from mesh_motion_conformance.case import Case, Skip, Suite, Unmet, require
from mesh_motion_conformance.checks import answered, refused
from mesh_motion_conformance.server.requests import Header, Request
from mesh_motion_conformance.server.session import Session
from mesh_motion_conformance.server.stage import Stage
from mesh_motion_conformance.show import show
from mesh_motion_conformance.wire import CHUNK_BYTES, Message

__all__ = ["suite"]

suite = Suite()

_DTYPE, _SHAPE, _FRAMES, _HEADER, _NONFINITE = (
    f"INVALID_ARGUMENT.{name}" for name in ("DTYPE", "SHAPE", "FRAMES", "HEADER", "NONFINITE")
)
_STATE = {"MOVE": "READY", "UPLOAD": "OPENING"}


def _nodes(session: Session) -> Request:
    """An UPLOAD of two more nodes."""
    return Request("UPLOAD", session.address() | {"item": "nodes"}, {"rows": np.array([[0.5, 0.5], [0.6, 0.5]])})


def _request(session: Session, kind: str) -> Request:
    return _nodes(session) if kind == "UPLOAD" else session.request(kind)


def _declared(kind: str, name: str, demand: str, change: Callable[[dict[str, Any]], Any], *codes: str) -> Case:
    """A request whose only declaration is changed, and must be refused."""

    def run(stage: Stage) -> None:
        session = stage.session(_STATE[kind])

        def changed(header: Header) -> Header:
            return header | {"arrays": [header["arrays"][0] | change(header["arrays"][0])]}

        refused(session.ask(_request(session, kind), change=changed), *codes, state=_STATE[kind])

    return Case("5", f"{kind}-{name}", demand, run)


@suite.family
def declarations() -> Iterator[Case]:
    """Exactly the keys name, dtype and shape, each of its type and among its values."""
    keys = "An entry of arrays has exactly the keys name, dtype, shape"
    value: Any
    for kind in _STATE:
        yield _declared(kind, "fourth-key", keys, lambda _: {"order": "C"}, _HEADER)
        for value in (1, None, b"displacement", ["x"]):
            yield _declared(
                kind, f"name-is-{type(value).__name__.lower()}", "name is str", _value("name", value), _HEADER
            )
        yield _declared(kind, "unknown-name", "name is a field of section 12", _value("name", "force"), _HEADER)
        for value in (8, None, b"<f8", ["<f8"]):
            yield _declared(
                kind, f"dtype-is-{type(value).__name__.lower()}", "dtype is str", _value("dtype", value), _HEADER
            )
        for value in ("", "f8", ">f8", "=f8", "|f8", "<f2", "<f16", "<c16", "<u8", "<i2", "|b1", "O", "|O", "V8", "S8",
                      "<U4", "<M8", "float64", "S2147483647", "<f8,<f8", "<f8 "):  # fmt: skip
            yield _declared(kind, f"dtype-{value!r}", "dtype is one of four", _value("dtype", value), _DTYPE)
        for value in ("2,2", 4, None, {}):
            yield _declared(
                kind, f"shape-is-{type(value).__name__.lower()}", "shape is an array", _value("shape", value), _HEADER
            )
        for name, items in (("float", [2.0, 2]), ("text", ["2", 2]), ("nil", [None, 2]), ("true", [True, 2])):
            yield _declared(kind, f"{name}-in-shape", "shape is an array of int", _value("shape", items), _SHAPE)
        for items in ([], [8], [2, 2, 1], [-2, 2], [2, -2], [-2, -2]):
            demand = "As many lengths as section 12 names axes, none negative"
            yield _declared(kind, f"shape-{items}".replace(" ", ""), demand, _value("shape", items), _SHAPE)
        large = "Lengths whose product no machine holds are refused before memory is taken"
        for items in ([2**62, 2], [2**32, 2**32], [2**63 - 1, 2]):
            yield _declared(
                kind,
                f"shape-{items[0]:x}-{items[1]:x}",
                large,
                _value("shape", items),
                _SHAPE,
                "RESOURCE_EXHAUSTED.BYTES",
            )
        yield _declared(
            kind,
            "shape-2-40-rows",
            "max_message_bytes bounds all arrays of a message",
            _value("shape", [2**40, 2]),
            "RESOURCE_EXHAUSTED.BYTES",
        )
    for dtype in ("<i8", "<i4"):
        yield _declared("MOVE", f"dtype-{dtype}", "displacement is <f8 or <f4", _value("dtype", dtype), _DTYPE)
    for columns in (0, 4, 100):
        yield _declared("MOVE", f"{columns}-columns", "dimension is 1, 2 or 3", _value("shape", [1, columns]), _SHAPE)


def _value(key: str, value: Any) -> Callable[[dict[str, Any]], Any]:
    return lambda _: {key: value}


# --- 5.1 to 5.6 ------------------------------------------------------------------------------------------------------


@suite("5.1")
def narrow_floats_are_widened(stage: Stage) -> None:
    """A field whose dtype is <f8 also admits <f4; the receiver widens them."""
    session = stage.session("READY")
    rows = session.rows().astype("<f4")
    narrow = answered(session.ask(session.request("MOVE").carrying(displacement=rows)), "MOVED")
    wide = answered(session.ask(session.request("MOVE").carrying(displacement=rows.astype("<f8"))), "MOVED")
    if narrow.arrays["displacement"].tobytes() != wide.arrays["displacement"].tobytes():
        raise Unmet("the same displacement for <f4 and <f8 of the same values", show(narrow))


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
    fetched = answered(session.ask(session.request("FETCH").having(what="reference")), "FETCHED")
    if fetched.arrays["points"].tobytes() != session.parts[0].points.tobytes():
        raise Unmet("the uploaded coordinates, bitwise", f"{fetched.arrays['points'][:3].tolist()} …")


def _framed(name: str, demand: str, frames: Callable[[list[bytes]], list[bytes]], kind: str = "MOVE") -> Case:
    """A correct header, and wrong frames after it: INVALID_ARGUMENT.FRAMES."""

    def run(stage: Stage) -> None:
        session = stage.session(_STATE[kind])
        line = session.lines[0]
        header, *body = _request(session, kind).frames(line.client, line.next())
        stage.put(line, [header, *frames(body)])
        refused(line.receive(), _FRAMES, state=_STATE[kind])

    return Case("5.3", f"{kind}-{name}", demand, run)


@suite.family
def frames_of_arrays() -> Iterator[Case]:
    """5.3"""
    number, size = "The number of frames is exactly that of the chunks", "A chunk has exactly its bytes"
    for kind in _STATE:
        yield _framed("no-frame", number, lambda _: [], kind)
        yield _framed("a-frame-more", number, lambda body: [*body, b"x"], kind)
        yield _framed("an-empty-frame-more", number, lambda body: [*body, b""], kind)
        yield _framed("an-empty-frame-before", number, lambda body: [b"", *body], kind)
        yield _framed("a-byte-less", size, lambda body: [body[0][:-1]], kind)
        yield _framed("a-byte-more", size, lambda body: [body[0] + b"\0"], kind)
        yield _framed("an-item-less", size, lambda body: [body[0][:-8]], kind)
        yield _framed("empty-frame", size, lambda _: [b""], kind)
        yield _framed("two-halves", number, lambda body: [body[0][:8], body[0][8:]], kind)


@suite("5.3")
def array_without_bytes_has_no_frame(stage: Stage) -> None:
    """An array with an axis of length 0 has no frame."""
    session = stage.session("OPENING")
    before = answered(session.ask(_nodes(session)), "UPLOADED").fields["rows_total"]
    reply = answered(session.ask(_nodes(session).carrying(rows=np.empty((0, 2)))), "UPLOADED")
    require(reply.fields["rows_total"] == before, f"rows_total {before}, as before", show(reply))


@suite("5.3")
def array_without_bytes_and_a_frame(stage: Stage) -> None:
    """An empty frame for an array without bytes is one frame too many."""
    session = stage.session("OPENING")
    line = session.lines[0]
    request = _nodes(session).carrying(rows=np.empty((0, 2)))
    stage.put(line, [*request.frames(line.client, line.next()), b""])
    refused(line.receive(), _FRAMES, state="OPENING")


def _large(session: Session) -> Request:
    """An UPLOAD of indices with two rows more than a chunk holds; the server needs no memory for them afterwards."""
    rows = np.zeros((CHUNK_BYTES // 4 + 2, 1), dtype="<i4")
    fields = {"item": "patch", "name": "large", "role": "fixed"}
    return Request("UPLOAD", session.address() | fields, {"rows": rows})


def _put_large(stage: Stage, cut: Callable[[bytes], list[bytes]]) -> tuple[Message, int]:
    """The reply to an array of more than one chunk, cut in the given way."""
    session = stage.session("OPENING")
    line = session.lines[0]
    request = _large(session)
    stage.put(line, [request.frames(line.client, line.next())[0], *cut(request.arrays["rows"].tobytes())])
    return line.receive(), len(request.arrays["rows"])


@suite("5.3")
def two_chunks(stage: Stage) -> None:
    """Arrays are cut into chunks of exactly max_chunk_bytes, the last one shorter."""
    if stage.limits()["max_session_bytes"] < 1 << 26:
        raise Skip("this server takes no upload of more than a chunk")
    reply, rows = _put_large(stage, lambda raw: [raw[:CHUNK_BYTES], raw[CHUNK_BYTES:]])
    require(answered(reply, "UPLOADED").fields["rows_total"] == rows, f"rows_total {rows}", show(reply))


@suite("5.3")
def two_chunks_cut_elsewhere(stage: Stage) -> None:
    """Chunks of other sizes are refused."""
    reply, _ = _put_large(stage, lambda raw: [raw[: CHUNK_BYTES - 8], raw[CHUNK_BYTES - 8 :]])
    refused(reply, _FRAMES, state="OPENING")


@suite("5.3")
def two_chunks_in_three_frames(stage: Stage) -> None:
    """As many frames as chunks."""
    reply, _ = _put_large(stage, lambda raw: [raw[:CHUNK_BYTES], raw[CHUNK_BYTES:], b""])
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
