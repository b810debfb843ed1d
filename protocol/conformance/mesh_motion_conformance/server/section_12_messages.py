"""Section 12: every field of every request: its type, its range, missing, left out, unknown."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from mesh_motion_conformance.case import Rows, require
from mesh_motion_conformance.checks import answered, refused
from mesh_motion_conformance.server.requests import Request
from mesh_motion_conformance.server.stage import Stage, suite
from mesh_motion_conformance.show import show
from mesh_motion_conformance.tables import Field, tables

_HEADER, _VALUE = "INVALID_ARGUMENT.HEADER", "INVALID_ARGUMENT.VALUE"
#: A value of each msgpack type, by its name.
_TYPES: dict[str, Any] = {
    "str": "x", "bin": b"x", "int": 1, "float": 1.0, "bool": True, "nil": None, "array": [], "map": {},
}  # fmt: skip
_STATE = {"UPLOAD": "OPENING", "BUILD": "OPENING", "COMMIT": "TRIAL"}


def _request(stage: Stage, kind: str) -> tuple[Request, Any]:
    """A correct request, and its connection; a refused request changes nothing."""
    if kind == "OPEN":
        return Request("OPEN", {"dimension": 2}), stage.control
    if kind in tables().control:
        fields: dict[str, dict[str, Any]] = {"PING": {}, "HELLO": {"versions": [[1, 0]]}, "LIST": {"after": ""}}
        if kind in fields:
            return Request(kind, fields[kind]), stage.control
        return stage.session("READY").request(kind), stage.control
    session = stage.judging() if kind in ("JUDGE", "CORRECT") else stage.session(_STATE.get(kind, "READY"))
    return session.request(kind), session.lines[0]


#: Name, demand, and the arguments of :func:`_wrong`.
Wrong = Iterator[tuple[Any, ...]]


def _wrong(stage: Stage, kind: str, field: str, value: Any, code: str = _HEADER) -> None:
    """A request with this value in a field is refused."""
    request, line = _request(stage, kind)
    refused(stage.ask(request.having(**{field: value}), line), code)


@suite.family(_wrong, "12")
def types() -> Wrong:
    """A field takes values of its type and of no other."""
    for kind in tables().requests:
        for field in tables().fields(kind):
            for name, value in _TYPES.items():
                if name != field.kind and not (field.kind == "float" and name == "int"):
                    demand = f"{kind}.{field.name} is {field.kind}"
                    yield f"{kind}-{field.name}-is-{name}", demand, kind, field.name, value


@suite.family(_wrong, "12")
def items() -> Wrong:
    """Arrays hold items of their type."""
    wrong = {
        "versions": {"int": [1, 0], "str": ["1.0"], "map": [{}], "array-of-str": [["1", "0"]], "nil": [None]},
        "features": {"int": [1], "bin": [b"x"], "nil": [None], "array": [[]], "map": [{}]},
    }
    for field, values in wrong.items():
        for name, value in values.items():
            yield f"HELLO-{field}-with-{name}", f"the items of HELLO.{field}", "HELLO", field, value


@suite.family(_wrong, "12")
def values() -> Wrong:
    """Choices, ranges and lengths."""
    for kind in tables().requests:
        for field in tables().fields(kind):
            for name, value, code in _outside(field):
                demand = f"{kind}.{field.name} is {_bounds(field)}"
                yield f"{kind}-{field.name}-{name}", demand, kind, field.name, value, code


def _outside(field: Field) -> Iterator[tuple[str, Any, str]]:
    """Values just outside the limits in the field's row."""
    says = field.says
    if "choices" in says:
        yield "no-choice", "no-such-choice", _VALUE
        yield "choice-in-capitals", says["choices"][-1].upper(), _VALUE
        yield "choice-and-blank", says["choices"][-1] + " ", _VALUE
        if "" not in says["choices"]:
            yield "empty-choice", "", _VALUE
    if "low" in says:
        yield "below", says["low"] - 1, _VALUE
        yield "far-below", -(2**63), _VALUE
        yield "above", says["high"] + 1, _VALUE if says["high"] < 2**63 - 1 else _HEADER
    if "exactly" in says:
        for size in (0, says["exactly"] - 1, says["exactly"] + 1):
            yield f"of-{size}-bytes", bytes(size), _VALUE
    if "at_most" in says:
        yield f"of-{says['at_most'] + 1}-bytes", "x" * (says["at_most"] + 1), _VALUE
        yield "of-too-many-bytes-in-fewer-characters", "é" * (says["at_most"] // 2 + 1), _VALUE


def _bounds(field: Field) -> str:
    says = field.says
    if "choices" in says:
        return f"one of {says['choices']}"
    if "low" in says:
        return f"{says['low']} … {says['high']}"
    return f"{says['exactly']} bytes" if "exactly" in says else f"at most {says['at_most']} bytes"


def _required() -> Rows:
    fields = ((kind, field.name) for kind in tables().requests for field in tables().fields(kind) if field.required)
    return {f"{kind}-without-{name}": (kind, name) for kind, name in fields}


@suite("12", _required)
def missing(stage: Stage, kind: str, name: str) -> None:
    """{0}.{1} has no default"""
    request, line = _request(stage, kind)
    refused(stage.ask(request.without(name), line), _HEADER)


_UNKNOWN = {"unknown-field": "from_a_later_version", "empty-field": "", "field-of-the-header": "v"}


@suite.family(_wrong, "12")
def unknown() -> Wrong:
    """A request has only the fields of section 12."""
    for kind in tables().requests:
        for name, field in _UNKNOWN.items():
            yield f"{kind}-{name}", "A request has no other fields", kind, field, 1


def _defaults() -> Rows:
    """The fields with a default, left out and sent as their default."""
    return {
        f"{kind}-{field.name}-{'as-its-default' if written else 'left-out'}": (kind, field.name, field, written)
        for kind in tables().requests
        for field in tables().fields(kind)
        if not field.required and kind not in ("OPEN", "BUILD", "CLOSE")
        for written in ((False, True) if "default" in field.says else (False,))
    }


@suite("12", _defaults)
def left_out(stage: Stage, kind: str, name: str, field: Field, written: bool) -> None:
    """{0}.{1} has a default."""
    request, line = _request(stage, kind)
    request = request.having(**{name: field.says["default"]}) if written else request.without(name)
    reply = stage.ask(request, line)
    if kind == "UPLOAD" and name in ("name", "role"):  # a patch has both
        refused(reply, "INVALID_ARGUMENT.VALUE", state="OPENING")
    else:
        answered(reply, tables().requests[kind]["reply"])


def _replies() -> Rows:
    once = {kind: row["reply"] for kind, row in tables().requests.items() if kind not in ("OPEN", "BUILD", "CLOSE")}
    return {reply: (kind, reply) for kind, reply in once.items()}


@suite("12", _replies)
def replies(stage: Stage, kind: str, reply: str) -> None:
    """{0} is answered by {1} with all its fields."""
    request, line = _request(stage, kind)
    answered(stage.ask(request, line), reply)


@suite("12")
def OPENED(stage: Stage) -> None:
    """OPENED has a session id of 32 hex digits, a token, the data endpoint and epoch 1."""
    opened = answered(stage.session("READY").opened, "OPENED", epoch=1)
    require(re.fullmatch("[0-9a-f]{32}", opened.fields["session"]), "32 hex digits", show(opened))


@suite("12")
def JOINED_before_BUILT(stage: Stage) -> None:
    """JOINED of a session that is not built has no moving_nodes and no nodes."""
    session = stage.session("OPENING")
    joined = session.do("JOIN")
    bare = "moving_nodes" not in joined.arrays and joined.fields.get("nodes", 0) == 0
    require(bare, "no moving_nodes, nodes 0", show(joined))
    counts = joined.fields.get("dimension", 2), joined.fields.get("partitions", 1)
    require(counts[0] in (0, 2) and counts[1] in (0, 1), "dimension 2 and partitions 1, or 0", show(joined))


@suite("12")
def LISTED_in_the_order_of_ids(stage: Stage) -> None:
    """Sessions come in the order of their ids, only those after ``after``."""
    stage.session("READY"), stage.session("OPENING")
    ids, more = _listed(stage, "")
    while more:
        page, more = _listed(stage, ids[-1])
        ids += page
    own = stage.session("READY").id
    require(ids == sorted(set(ids)) and own in ids, "each session once, in the order of ids", str(ids))
    behind, _ = _listed(stage, ids[0])
    require(ids[0] not in behind and len(behind) < len(ids), f"the sessions after {ids[0]}", str(behind))
    last, _ = _listed(stage, "g")
    require(not last, "no sessions after the last id", str(last))


def _listed(stage: Stage, after: str) -> tuple[list[str], bool]:
    """Ids of the sessions on LIST's page after this one; whether there are more."""
    page = answered(stage.ask(Request("LIST", {"after": after})), "LISTED").fields
    return [entry["session"] for entry in page["sessions"]], page.get("more", False)


@suite("2.3")
def data_endpoint_is_reached(stage: Stage) -> None:
    """The data endpoint of OPENED is one that a client can connect to."""
    session = stage.session("READY")
    answered(stage.ask(Request("PING"), session.connect()), "PONG")
