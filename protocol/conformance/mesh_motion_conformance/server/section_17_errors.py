"""Sections 17 to 19: errors as a whole, versions, the literal bytes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mesh_motion_conformance.case import Rows, require
from mesh_motion_conformance.checks import answered, check_identity, refused
from mesh_motion_conformance.line import Line
from mesh_motion_conformance.server.requests import Request
from mesh_motion_conformance.server.session import Session
from mesh_motion_conformance.server.stage import Stage, suite
from mesh_motion_conformance.show import show
from mesh_motion_conformance.tables import tables
from mesh_motion_conformance.wire import Message

#: One request for each code that a single request can cause.
_CODES: dict[str, Callable[[Session], Request]] = {
    "INVALID_ARGUMENT.HEADER": lambda s: s.request("STATUS").having(x=1),
    "INVALID_ARGUMENT.VALUE": lambda s: s.request("FETCH").having(what="trial"),
    "INVALID_ARGUMENT.DTYPE": lambda s: s.request("MOVE").carrying(displacement=s.rows().astype("<i8")),
    "INVALID_ARGUMENT.SHAPE": lambda s: s.request("MOVE").carrying(displacement=s.rows()[:2]),
    "INVALID_ARGUMENT.NONFINITE": lambda s: s.request("MOVE").carrying(displacement=s.rows() * float("nan")),
    "FAILED_PRECONDITION.STATE": lambda s: s.request("BUILD"),
    "FAILED_PRECONDITION.STEP": lambda s: s.request("MOVE").having(step=s.step),
    "FAILED_PRECONDITION.QUALITY": lambda s: s.request("MOVE").carrying(displacement=s.rows(size=50.0)),
    "ABORTED.FENCED": lambda s: s.request("STATUS").having(epoch=0),
    "NOT_FOUND": lambda s: s.request("STATUS").having(session="0" * 32),
    "UNIMPLEMENTED.MESSAGE": lambda _: Request("LIST"),
}


@suite("17", {code: (code, make) for code, make in _CODES.items()})
def codes(stage: Stage, code: str, make: Callable[[Session], Request]) -> None:
    """code, message, hint, retryable, state and details."""
    session = stage.session("READY")
    reply = refused(session.ask(make(session)), code, state="READY")
    answered(reply, "ERROR", code=code, retryable=tables().errors[code]["retryable"])


def _line(stage: Stage, place: str) -> Line:
    """A connection to the data endpoint or to the control endpoint."""
    return stage.session("READY").lines[0] if place == "data" else stage.control


def _replies() -> Rows:
    kinds = [kind for kind in tables().messages if kind not in tables().requests]
    return {f"{kind}-at-{place}": (kind, place) for kind in kinds for place in ("control", "data")}


@suite("12", _replies)
def replies_as_requests(stage: Stage, kind: str, place: str) -> None:
    """A reply is not a request, and is refused."""
    reply = stage.ask(Request(kind, {}), _line(stage, place))
    refused(reply, "UNIMPLEMENTED.MESSAGE", "INVALID_ARGUMENT.HEADER")


# --- 18 --------------------------------------------------------------------------------------------------------------


def _names_ours(reply: Message) -> None:
    details = refused(reply, "UNIMPLEMENTED.VERSION").fields["details"]
    require([1, 0] in details.get("versions", []), "our versions in details.versions", show(reply))


_OFFERS: dict[str, tuple[Any, list[int] | None]] = {
    "no-versions-named": (None, [1, 0]),
    "ours": ([[1, 0]], [1, 0]),
    "a-later-minor": ([[1, 7]], [1, 0]),
    "later-and-ours": ([[1, 7], [1, 0]], [1, 0]),
    "another-major-first": ([[2, 0], [1, 0]], [1, 0]),
    "another-major-last": ([[1, 0], [2, 3]], [1, 0]),
    "only-another-major": ([[2, 0]], None),
    "major-0": ([[0, 9]], None),
    "an-empty-list": ([], None),
    "an-empty-version": ([[]], None),
    "a-major-alone": ([[1]], None),
    "three-numbers": ([[1, 0, 0]], None),
}


@suite("18.1", _OFFERS)
def choice_of_a_version(stage: Stage, versions: Any, wanted: list[int] | None) -> None:
    """WELCOME chooses the same major version and the lower minor; else UNIMPLEMENTED.VERSION names ours."""
    reply = stage.ask(Request("HELLO", {} if versions is None else {"versions": versions}))
    if wanted is None:
        _names_ours(reply)
    else:
        answered(reply, "WELCOME", version=wanted)


@suite("18.1", {f"header-of-version-2-at-{place}": (place,) for place in ("control", "data")})
def other_headers(stage: Stage, place: str) -> None:
    """A header of another version, whatever its keys, is answered with our versions."""
    change = {"v": 2, "more": 1}
    _names_ours(stage.ask(Request("PING"), _line(stage, place), change=lambda header: header | change))


@suite("18.3")
def HELLO_is_not_needed(stage: Stage) -> None:
    """Other requests are taken without a HELLO."""
    answered(stage.ask(Request("LIST"), stage.line()), "LISTED")


@suite("18.3")
def HELLO_at_any_time(stage: Stage) -> None:
    """The server keeps nothing of a HELLO: a second one, even refused, changes nothing."""
    line = stage.line()
    answered(stage.ask(Request("HELLO"), line), "WELCOME")
    refused(stage.ask(Request("HELLO", {"versions": [[9, 0]]}), line), "UNIMPLEMENTED.VERSION")
    answered(stage.ask(Request("LIST"), line), "LISTED")
    answered(stage.ask(Request("HELLO"), line), "WELCOME")


@suite("18.4")
def boot_is_one(stage: Stage) -> None:
    """boot is the same until the server is started again."""
    boots = {answered(stage.ask(Request("HELLO"), stage.line()), "WELCOME").fields["boot"] for _ in range(3)}
    require(len(boots) == 1 and len(min(boots)) == 16, "one boot id of 16 bytes", str([boot.hex() for boot in boots]))


@suite("18.5")
def no_features(stage: Stage) -> None:
    """features of WELCOME are those that both sides have: none for a client that names none or unknown ones."""
    for offered in ([], ["no-such-feature"]):
        answered(stage.ask(Request("HELLO", {"features": offered})), "WELCOME", features=[])


@suite("12")
def WELCOME_durability(stage: Stage) -> None:
    """WELCOME names the durability levels offered; one that is not offered is refused by OPEN."""
    offered = answered(stage.ask(Request("HELLO")), "WELCOME").fields["durability"]
    levels = {"full", "replay", "relaxed"}
    require(offered and set(offered) <= levels, f"some of {sorted(levels)}", str(offered))
    for level in sorted(levels - set(offered)):
        request = Request("OPEN", {"dimension": 2, "durability": level})
        refused(stage.ask(request), "INVALID_ARGUMENT.VALUE", "UNIMPLEMENTED")


# --- 19 --------------------------------------------------------------------------------------------------------------

_PING = bytes.fromhex(
    "86 a176 01 a474797065 a450494e47 a6636c69656e74 c410 000102030405060708090a0b0c0d0e0f"
    "a873657175656e6365 07 a66669656c6473 80 a6617272617973 90".replace(" ", "")
)


@suite("19", {f"PING-byte-by-byte-at-{place}": (place,) for place in ("control", "data")})
def literal_bytes(stage: Stage, place: str) -> None:
    """The 65 bytes of PING are answered by PONG."""
    line = stage.session("READY").lines[0] if place == "data" else stage.line()
    stage.put(line, [_PING])
    check_identity(answered(line.receive(), "PONG"), bytes(range(16)), 7)
