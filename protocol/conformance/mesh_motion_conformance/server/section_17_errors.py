"""Sections 17 to 19: errors as a whole, versions, the literal bytes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from mesh_motion_conformance.case import Case, Suite, Unmet
from mesh_motion_conformance.checks import answered, check_identity, refused
from mesh_motion_conformance.server.requests import Request
from mesh_motion_conformance.server.session import Session
from mesh_motion_conformance.server.stage import Stage
from mesh_motion_conformance.show import show
from mesh_motion_conformance.tables import tables

__all__ = ["suite"]

suite = Suite()


@suite.family
def codes() -> Iterator[Case]:
    """17: one request for each code that a single request can cause, and all required fields of its ERROR."""

    def at_session(state: str, make: Callable[[Session], Request], code: str) -> Callable[[Stage], None]:
        def run(stage: Stage) -> None:
            session = stage.session(state)
            reply = refused(session.ask(make(session)), code, state=state)
            given = {key: value for key, value in reply.fields.items() if key in ("code", "retryable", "state")}
            if given != {"code": code, "retryable": tables().errors[code]["retryable"], "state": state}:
                raise Unmet(f"code {code}, retryable and state as in the table", show(reply))

        return run

    ways: dict[str, tuple[str, Callable[[Session], Request]]] = {
        "INVALID_ARGUMENT.HEADER": ("READY", lambda s: s.request("STATUS").having(x=1)),
        "INVALID_ARGUMENT.VALUE": ("READY", lambda s: s.request("FETCH").having(what="trial")),
        "INVALID_ARGUMENT.DTYPE": ("READY", lambda s: s.request("MOVE").carrying(displacement=s.rows().astype("<i8"))),
        "INVALID_ARGUMENT.SHAPE": ("READY", lambda s: s.request("MOVE").carrying(displacement=s.rows()[:2])),
        "INVALID_ARGUMENT.NONFINITE": (
            "READY",
            lambda s: s.request("MOVE").carrying(displacement=s.rows() * float("nan")),
        ),
        "FAILED_PRECONDITION.STATE": ("READY", lambda s: s.request("BUILD")),
        "FAILED_PRECONDITION.STEP": ("READY", lambda s: s.request("MOVE").having(step=s.step)),
        "FAILED_PRECONDITION.QUALITY": ("READY", lambda s: s.request("MOVE").carrying(displacement=s.rows(size=50.0))),
        "ABORTED.FENCED": ("READY", lambda s: s.request("STATUS").having(epoch=0)),
        "NOT_FOUND": ("READY", lambda s: s.request("STATUS").having(session="0" * 32)),
        "UNIMPLEMENTED.MESSAGE": ("READY", lambda _: Request("LIST")),
    }
    for code, (state, make) in ways.items():
        yield Case("17", code, "code, message, hint, retryable, state and details", at_session(state, make, code))


@suite.family
def replies_as_requests() -> Iterator[Case]:
    """12: replies are no requests"""

    def run(kind: str, at_data: bool) -> Callable[[Stage], None]:
        def answered_by_error(stage: Stage) -> None:
            line = stage.session("READY").lines[0] if at_data else stage.control
            refused(stage.ask(Request(kind, {}), line), "UNIMPLEMENTED.MESSAGE", "INVALID_ARGUMENT.HEADER")

        return answered_by_error

    for kind in tables().messages:
        if kind not in tables().requests:
            for at_data in (False, True):
                place = "data" if at_data else "control"
                yield Case("12", f"{kind}-at-{place}", "A reply is no request, and is refused", run(kind, at_data))


# --- 18 --------------------------------------------------------------------------------------------------------------


@suite.family
def choice_of_a_version() -> Iterator[Case]:
    """18.1"""

    def run(versions: Any, wanted: list[int] | None) -> Callable[[Stage], None]:
        def chosen(stage: Stage) -> None:
            reply = stage.ask(Request("HELLO", {} if versions is None else {"versions": versions}))
            if wanted is None:
                details = refused(reply, "UNIMPLEMENTED.VERSION").fields["details"]
                if [1, 0] not in details.get("versions", []):
                    raise Unmet("our versions in details.versions", show(reply))
            elif answered(reply, "WELCOME").fields["version"] != wanted:
                raise Unmet(f"version {wanted}", show(reply))

        return chosen

    ways: dict[str, tuple[Any, list[int] | None]] = {
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
    demand = "WELCOME chooses the same major version and the lower minor; else UNIMPLEMENTED.VERSION names ours"
    for name, (versions, wanted) in ways.items():
        yield Case("18.1", name, demand, run(versions, wanted))


@suite.family
def other_headers() -> Iterator[Case]:
    """18.1: the version in the header"""

    def run(at_data: bool) -> Callable[[Stage], None]:
        def later(stage: Stage) -> None:
            line = stage.session("READY").lines[0] if at_data else stage.control
            reply = stage.ask(Request("PING"), line, change=lambda header: header | {"v": 2, "more": 1})
            details = refused(reply, "UNIMPLEMENTED.VERSION").fields["details"]
            if [1, 0] not in details.get("versions", []):
                raise Unmet("our versions in details.versions", show(reply))

        return later

    for at_data in (False, True):
        yield Case(
            "18.1",
            f"header-of-version-2-at-{'data' if at_data else 'control'}",
            "A header of another version, whatever its keys, is answered with our versions",
            run(at_data),
        )


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
    if len(boots) != 1 or len(min(boots)) != 16:
        raise Unmet("one boot id of 16 bytes", str([boot.hex() for boot in boots]))


@suite("18.5")
def no_features(stage: Stage) -> None:
    """features of WELCOME are those that both sides have: none for a client that names none or unknown ones."""
    for offered in ([], ["no-such-feature"]):
        found = answered(stage.ask(Request("HELLO", {"features": offered})), "WELCOME").fields["features"]
        if found:
            raise Unmet("features []", str(found))


@suite("12")
def WELCOME_durability(stage: Stage) -> None:
    """WELCOME names the durability levels offered; one that is not offered is refused by OPEN."""
    offered = answered(stage.ask(Request("HELLO")), "WELCOME").fields["durability"]
    levels = {"full", "replay", "relaxed"}
    if not offered or not set(offered) <= levels:
        raise Unmet(f"some of {sorted(levels)}", str(offered))
    for level in sorted(levels - set(offered)):
        refused(
            stage.ask(Request("OPEN", {"dimension": 2, "durability": level})), "INVALID_ARGUMENT.VALUE", "UNIMPLEMENTED"
        )


# --- 19 --------------------------------------------------------------------------------------------------------------

_PING = bytes.fromhex(
    "86 a176 01 a474797065 a450494e47 a6636c69656e74 c410 000102030405060708090a0b0c0d0e0f"
    "a873657175656e6365 07 a66669656c6473 80 a6617272617973 90".replace(" ", "")
)


@suite.family
def literal_bytes() -> Iterator[Case]:
    """19"""

    def run(at_data: bool) -> Callable[[Stage], None]:
        def ping(stage: Stage) -> None:
            line = stage.session("READY").lines[0] if at_data else stage.line()
            stage.put(line, [_PING])
            reply = answered(line.receive(), "PONG")
            check_identity(reply, bytes(range(16)), 7)

        return ping

    for at_data in (False, True):
        yield Case(
            "19",
            f"PING-byte-by-byte-at-{'data' if at_data else 'control'}",
            "The 65 bytes of PING are answered by PONG",
            run(at_data),
        )
