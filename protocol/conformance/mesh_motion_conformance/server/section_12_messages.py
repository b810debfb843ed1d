"""Section 12: every field of every request: its type, its range, missing, left out, unknown."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from mesh_motion_conformance.case import Case, Rows, Suite, Unmet, require
from mesh_motion_conformance.checks import answered, refused
from mesh_motion_conformance.server.requests import Request
from mesh_motion_conformance.server.stage import Stage
from mesh_motion_conformance.show import show
from mesh_motion_conformance.tables import Field, tables

__all__ = ["suite"]

suite = Suite()

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


def _wrong(kind: str, name: str, demand: str, change: Callable[[Request], Request], *codes: str) -> Case:
    """A request with one thing wrong."""

    def run(stage: Stage) -> None:
        request, line = _request(stage, kind)
        refused(stage.ask(change(request), line), *codes)

    return Case("12", f"{kind}-{name}", demand, run)


def _with(field: str, value: Any) -> Callable[[Request], Request]:
    return lambda request: request.having(**{field: value})


@suite.family
def types() -> Iterator[Case]:
    """A field takes values of its type and of no other."""
    for kind in tables().requests:
        for field in tables().fields(kind):
            for name, value in _TYPES.items():
                if name != field.kind and not (field.kind == "float" and name == "int"):
                    demand = f"{kind}.{field.name} is {field.kind}"
                    yield _wrong(kind, f"{field.name}-is-{name}", demand, _with(field.name, value), _HEADER)


@suite.family
def items() -> Iterator[Case]:
    """Arrays hold items of their type."""
    wrong = {
        ("HELLO", "versions"): {
            "int": [1, 0],
            "str": ["1.0"],
            "map": [{}],
            "array-of-str": [["1", "0"]],
            "nil": [None],
        },
        ("HELLO", "features"): {"int": [1], "bin": [b"x"], "nil": [None], "array": [[]], "map": [{}]},
    }
    for (kind, field), values in wrong.items():
        for name, value in values.items():
            demand = f"the items of {kind}.{field}"
            yield _wrong(kind, f"{field}-with-{name}", demand, _with(field, value), _HEADER)


@suite.family
def values() -> Iterator[Case]:
    """Choices, ranges and lengths."""
    for kind in tables().requests:
        for field in tables().fields(kind):
            for name, value, code in _outside(field):
                demand = f"{kind}.{field.name} is {_bounds(field)}"
                yield _wrong(kind, f"{field.name}-{name}", demand, _with(field.name, value), code)


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


@suite.family
def missing() -> Iterator[Case]:
    """A field without default is present."""
    for kind in tables().requests:
        for field in tables().fields(kind):
            if field.required:
                demand = f"{kind}.{field.name} has no default"
                yield _wrong(kind, f"without-{field.name}", demand, lambda r, n=field.name: r.without(n), _HEADER)  # type: ignore[misc]


@suite.family
def unknown() -> Iterator[Case]:
    """A request has only the fields of section 12."""
    for kind in tables().requests:
        for name, field in (
            ("unknown-field", "from_a_later_version"),
            ("empty-field", ""),
            ("field-of-the-header", "v"),
        ):
            yield _wrong(kind, name, "A request has no other fields", _with(field, 1), _HEADER)


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
    session, fields = stage.session("READY").id, stage.session("READY").opened.fields
    if len(session) != 32 or not set(session) <= set("0123456789abcdef") or fields["epoch"] != 1:
        raise Unmet("32 hex digits and epoch 1", str({name: fields[name] for name in ("session", "epoch")}))


@suite("12")
def JOINED_before_BUILT(stage: Stage) -> None:
    """JOINED of a session that is not built has no moving_nodes and no nodes."""
    session = stage.session("OPENING")
    joined = session.do("JOIN")
    if "moving_nodes" in joined.arrays or joined.fields.get("nodes", 0) != 0:
        raise Unmet("no moving_nodes, nodes 0", show(joined))
    if joined.fields.get("dimension", 2) not in (0, 2) or joined.fields.get("partitions", 1) not in (0, 1):
        raise Unmet("dimension 2 and partitions 1, or 0", show(joined))


@suite("12")
def LISTED_in_the_order_of_ids(stage: Stage) -> None:
    """Sessions come in the order of their ids, only those after ``after``."""
    stage.session("READY"), stage.session("OPENING")
    ids: list[str] = []
    more = True
    while more:
        page = answered(stage.ask(Request("LIST", {"after": ids[-1] if ids else ""})), "LISTED").fields
        ids += [entry["session"] for entry in page["sessions"]]
        more = page.get("more", False)
    if ids != sorted(set(ids)) or stage.session("READY").id not in ids:
        raise Unmet("each session once, in the order of ids", str(ids))
    behind = answered(stage.ask(Request("LIST", {"after": ids[0]})), "LISTED").fields["sessions"]
    if ids[0] in [entry["session"] for entry in behind] or len(behind) != min(len(ids) - 1, len(behind)):
        raise Unmet(f"the sessions behind {ids[0]}", str(behind))
    last = answered(stage.ask(Request("LIST", {"after": "g"})), "LISTED").fields["sessions"]
    require(not last, "no sessions behind the last id", str(last))


@suite("2.3")
def data_endpoint_is_reached(stage: Stage) -> None:
    """The data endpoint of OPENED is one that a client can connect to."""
    session = stage.session("READY")
    answered(stage.ask(Request("PING"), session.connect()), "PONG")
