"""Every role sends every request for an own session and for another user's, over real sockets with real keys; also
clients that must get no answer.

The expected answers are written by hand (:mod:`.expected_rights`), not read from the server's table. One user's roles
are changed again and again while the server runs and while this user's connections are open. In each round the requests
come in another order.
"""

import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from mesh_motion_client import Keys
from mesh_motion_protocol import messages as m
from mesh_motion_protocol.codec import encode
from mesh_motion_protocol.key_files import PublicKey

from mesh_motion_server.security.key_folder import admit, make_client_keys, make_server_keys, revoke
from tests.faults.attacks import forged_user
from tests.faults.check import Budget, Check, Result, require
from tests.faults.expected_rights import OUTSIDERS, REQUESTS, Cell, expected, role_cells
from tests.faults.hidden_sessions import require_alike, require_same_time, times
from tests.faults.holder import Holder
from tests.faults.stand_in import grid_mesh
from tests.faults.stand_in_server import StandInServer
from tests.faults.wire import Wire

#: Questions about time of each kind of session, in a round.
_TIMED = 40
_JUNK = b"x" * 32
#: Requests that a session which is built refuses by itself, which shows that they were taken.
_TOO_LATE = {"UPLOAD", "BUILD", "JUDGE", "CORRECT"}
_NEED_TOKEN = ("PROBE", "RESUME", "JOIN")


def address_of(held: Holder) -> dict[str, Any]:
    return {"session": held.session, "epoch": held.epoch, "token": held.token, "step": 1}


def known(held: Holder) -> tuple[str, bytes]:
    return held.session, held.token


class Stage:
    """A server with keys; a subject whose roles change, and another user."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.keys = folder, folder / "keys"
        make_server_keys(self.keys)
        self.subject, self.other, self.unknown = (self._make(name) for name in ("subject", "other", "unknown"))
        for name in ("subject", "other"):
            self.give(("owner",), name)
        self.server = StandInServer(folder, keys_folder=str(self.keys)).start()
        self._held: dict[bool, Holder] = {}

    def _make(self, name: str) -> Keys:
        make_client_keys(name, self.folder / "clients")
        return Keys.load(self.folder / "clients" / f"{name}.secret", self.keys / "server.public")

    def public(self, name: str) -> str:
        return PublicKey.load(self.folder / "clients" / f"{name}.public").key

    def give(self, roles: tuple[str, ...], name: str = "subject") -> None:
        """Change a user's roles while the server runs; without roles, remove the key from the list."""
        if roles:
            admit(self.public(name), self.keys, name=name, roles=list(roles))
        else:
            revoke(name, self.keys)

    def held(self, own: bool) -> Holder:
        """A built session of the subject or of the other user, with its lease kept; opened again after a CLOSE."""
        if own not in self._held:
            self._held[own] = Holder(self.server, [grid_mesh()], keys=self.subject if own else self.other, calm=True)
            self._held[own].open()
        return self._held[own]

    def suspended(self) -> tuple[str, bytes]:
        """A session of the other user that is only in the store."""
        held = self.held(False)
        held.begin()
        held.leave()
        self.forget(False)
        return known(held)

    def forget(self, own: bool) -> None:
        """The session was closed."""
        self._held.pop(own).disconnect()

    def close(self) -> None:
        for own in list(self._held):
            self.forget(own)
        self.server.stop()


# --- a cell ---


def outcome(stage: Stage, cell: Cell) -> str:
    """Send the request; return the reply's type, or the error's code."""
    stage.give(("owner",))
    held = stage.held(cell.own)
    at = address_of(held)
    verdict = expected(cell.roles, cell.request, own=cell.own)
    where = stage.server.endpoint if cell.endpoint == "control" else held.endpoint
    with Wire(where, stage.subject) as wire:
        wire.ask(m.Ping)  # the connection is there before the roles change
        if cell.own and cell.endpoint == "data" and verdict != "oversee":
            at["step"] = _join(wire, at, cell.request)
        stage.give(cell.roles)
        if verdict == "oversee":
            at["token"] = _JUNK
        reply = wire.ask(m.MESSAGES[cell.request], **_fields(cell.request, at))
        arrays = len(wire.frames) - 1
    if verdict == "oversee":
        require(not arrays and b"centre" not in b"".join(wire.frames), f"{cell} shows places")
    if reply.type == "CLOSED":
        stage.forget(cell.own)
    if reply.type == "RESUMED":
        held.endpoint, held.epoch = reply.endpoint, reply.epoch
    return _word(reply, held.session)


def _join(wire: Wire, at: dict[str, Any], request: str) -> int:
    """Become the holder, with a trial if the request ends one; return the next step."""
    joined = wire.ask(m.Join, **_fields("JOIN", at))
    step: int = joined.step + 1
    if request in ("COMMIT", "ROLLBACK"):
        wire.ask(m.Move, **_fields("MOVE", at | {"step": step}))
    return step


def _fields(request: str, at: dict[str, Any]) -> dict[str, Any]:
    """Fields of a correct request: its endpoint, and the other required fields."""
    rows = np.full((5, 2), 1e-4)
    known = at | {"dimension": 2, "item": "nodes", "frame": "committed", "rows": rows, "displacement": rows}
    known |= {"velocity": "" if request == "MOVE" else rows, "weights": np.full((25, 2), 1.0)}
    known |= {"part": {}, "questions": [], "bins": np.zeros((0, 3), dtype=np.int64), "values": rows, "worst": rows}
    corners = np.arange(3)[:, None]
    known |= {"nodes": np.zeros((5, 2), dtype=np.int64), "points": rows, "positions": rows, "corners": corners}
    names = m.MESSAGES[request].__dataclass_fields__
    fields = {name: value for name, value in known.items() if name in names}
    return fields | ({"outcome": "keep"} if request == "CLOSE" else {})


def _word(reply: Any, session: str) -> str:
    if reply.type == "LISTED":
        return "LISTED" if session in [entry["session"] for entry in reply.sessions] else "NOT_FOUND"
    return str(reply.code if reply.type == "ERROR" else reply.type)


def judge(cell: Cell, got: str) -> None:
    """Raise unless the answer is the expected one."""
    wanted = expected(cell.roles, cell.request, own=cell.own)
    if wanted in ("use", "oversee"):
        wanted = m.REPLIES[cell.request]
        if cell.request in _TOO_LATE and got == "FAILED_PRECONDITION.STATE":
            return
    require(got == wanted, f"{cell}: expected {wanted}, got {got}")


# --- what the table does not have ---


def _owner_without(stage: Stage) -> Iterator[tuple[str, str, str]]:
    """Requests of the owner with a wrong token, and without a JOIN; yields request, expected answer, answer."""
    stage.give(("owner",))
    held = stage.held(True)
    at = address_of(held) | {"token": _JUNK}
    for request in _NEED_TOKEN:
        with Wire(held.endpoint if request == "JOIN" else stage.server.endpoint, stage.subject) as wire:
            reply = wire.ask(m.MESSAGES[request], **_fields(request, at))
        yield f"owner: {request} with a wrong token", "NOT_FOUND", _word(reply, held.session)
    with Wire(held.endpoint, stage.subject) as wire:
        for request, endpoint in REQUESTS:
            if endpoint == "data" and request not in ("PING", "JOIN"):
                reply = wire.ask(m.MESSAGES[request], **_fields(request, at))
                yield f"owner: {request} without JOIN", "UNAUTHENTICATED", _word(reply, held.session)


def _unusable_list(stage: Stage) -> Iterator[tuple[str, str, str]]:
    """While other users can write the allow-list, no user is served, with or without an open session."""
    stage.give(("owner", "monitor", "admin"))
    held = stage.held(True)
    at = address_of(held)
    allow_list = stage.keys / "allow.toml"
    with Wire(stage.server.endpoint, stage.subject) as control, Wire(held.endpoint, stage.subject) as data:
        control.ask(m.Ping)
        at["step"] = _join(data, at, "COMMIT")
        allow_list.chmod(0o666)
        try:
            for request, endpoint in REQUESTS:
                wire = control if endpoint == "control" else data
                reply = wire.ask(m.MESSAGES[request], **_fields(request, at))
                yield f"owner: {request} at {endpoint} with an unusable list", "UNAVAILABLE", _word(reply, held.session)
        finally:
            allow_list.chmod(0o644)


def _outsiders(stage: Stage) -> int:
    """Requests with a wrong key or without a key: none of them is answered; return their number."""
    stage.give(())
    held = stage.held(False)
    at = address_of(held)
    wrong = replace(stage.other, server=stage.public("unknown"))
    keys = dict(zip(OUTSIDERS, (None, stage.unknown, wrong, stage.subject), strict=True))
    asked = 0
    for who, key in keys.items():
        for endpoint, where in (("control", stage.server.endpoint), ("data", held.endpoint)):
            with Wire(where, key) as wire:
                requests = [wire.request(m.MESSAGES[r], **_fields(r, at)) for r, end in REQUESTS if end == endpoint]
                require(wire.is_refused(requests), f"{who}: the {endpoint} endpoint admits it")
            asked += len(requests)
    stage.give(("owner",))
    return asked


def _without_keys(stage: Stage) -> Iterator[tuple[str, str, str]]:
    """A server without keys on the same folder: for all its users, sessions with an owner do not exist."""
    held = stage.held(False)
    session, at = held.session, address_of(held)
    stage.close()
    with StandInServer(stage.folder) as server, Wire(server.endpoint) as wire:
        for request in ("LIST", "PROBE", "RESUME"):
            kind, fields = m.MESSAGES[request], _fields(request, at)
            yield f"{request} without keys", "NOT_FOUND", _word(wire.ask(kind, **fields), session)
            frame = bytes(encode(wire.request(kind, **fields))[0])
            back = forged_user(server.endpoint, stage.public("other").encode(), frame)
            got = "LISTED" if session.encode() in back and request == "LIST" else "NOT_FOUND"
            if request != "LIST" or b"LISTED" not in back:
                got = "NOT_FOUND" if b"NOT_FOUND" in back else "something else"
            yield f"{request} without keys, under a name from ZMTP metadata", "NOT_FOUND", got


# --- the row ---


def one_round(stage: Stage, random: Random, *, timed: int = _TIMED) -> dict[str, Any]:
    """Send all requests once, in random order, and those of the stranger.

    Raises BrokenPromise at the first unexpected answer.
    """
    cells = list(role_cells())
    random.shuffle(cells)
    for cell in cells:
        judge(cell, outcome(stage, cell))
    asked = len(cells)
    for what, wanted, got in (*_owner_without(stage), *_unusable_list(stage)):
        require(got == wanted, f"{what}: expected {wanted}, got {got}")
        asked += 1
    asked += _outsiders(stage)
    stored = stage.suspended()
    existing = {"open": known(stage.held(False)), "stored": stored}
    with Wire(stage.server.endpoint, stage.subject) as control:
        alike = require_alike(control, existing)
        times_apart = require_same_time(times(control, existing, random, timed)) if timed else {}
    return {"cells": asked, "compared": alike, "seconds": times_apart}


def run(seed: int, budget: Budget) -> Result:
    random, cells, compared, seconds = Random(f"authorisation {seed}"), 0, 0, {}
    with tempfile.TemporaryDirectory(prefix="mesh-motion-prove-") as folder:
        stage = Stage(Path(folder))
        try:
            while not cells or budget.admits(cells):
                found = one_round(stage, random)
                cells, compared, seconds = cells + found["cells"], compared + found["compared"], found["seconds"]
            for what, wanted, got in _without_keys(stage):
                require(got == wanted, f"{what}: expected {wanted}, got {got}")
                cells += 1
        finally:
            stage.close()
    details = {"cells": cells, "compared": compared, "not_found_seconds": seconds}
    got = f"{cells} as written down, {compared} strangers' answers alike, ≥ {1000 * seconds['least']:.0f} ms"
    return Result(got, True, details)


CHECK = Check(
    "authorisation",
    "{count} questions by every role; strangers see no session",
    short=441,
    full=4410,
    seconds=40,
    run=run,
)
