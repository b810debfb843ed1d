"""Faults for the server's own processes: each process imports this module at its start, and the module changes the
functions that SEEDED_FAULTS names.

The folder is put first on PYTHONPATH by the fixture ``seed``. A process started with ``-m`` has its own copy of the
main module, so faults are put into the modules that it imports.
"""

# ruff: noqa: PLC0415  (what no fault breaks is not loaded)

import os
import time
from collections.abc import Callable
from importlib import import_module
from typing import Any

Seed = Callable[[], None]


def put(path: str, value: Any) -> Seed:
    """Replace ``module:Class.attribute`` of the server by a wrong value."""
    return around(path, None, value)


def around(path: str, wrong: Any, value: Any = None) -> Seed:
    """As ``put``; the wrong function gets the right one as its first argument."""

    def seed() -> None:
        module, _, names = path.partition(":")
        owner: Any = import_module(f"mesh_motion_server.{module}")
        *owners, name = names.split(".")
        for part in owners:
            owner = getattr(owner, part)
        right = getattr(owner, name, None)
        setattr(owner, name, value if wrong is None else lambda *given, **named: wrong(right, *given, **named))

    return seed


def rights(role: str, request: str, verdict: str) -> Seed:
    """Give a role other rights, for its own sessions and those of others."""

    def seed() -> None:
        module = import_module("mesh_motion_server.security.authorisation")
        module.MATRIX[module.Role[role]][request] = (module.Verdict[verdict], module.Verdict[verdict])

    return seed


def reference_state(journal: Any, _model: Any, mesh: Any, *_: Any, **_named: Any) -> Any:
    return import_module("mesh_motion_server.session.state").CommittedState(journal.ledger.step, mesh.points)


GIVEN: list[Any] = []
KEPT: list[bytes] = []
FAULTS: dict[str, list[Seed]] = {
    "a monitor may close": [rights("MONITOR", "CLOSE", "OVERSEE")],
    "an owner may probe others sessions": [rights("OWNER", "PROBE", "USE")],
    "an admin may not list": [rights("ADMIN", "LIST", "DENIED")],
    "statuses show places": [put("service.status:without_places", lambda reply: reply)],
    "no delay of not found": [put("transport.late_replies:_SECONDS", 0.0)],
    "a lookup that takes its time after the delay began": [
        around("transport.registry:Registry.owner", lambda owner, self, session: (
            found := owner(self, session), time.sleep(0.03 * (found is not None)))[0]),
        around("transport.control:Control._reply_error", lambda reply, self, *given: (
            self._later.asked(), reply(self, *given))[1]),
    ],
    "an allow list that is read once": [
        around("security.allow_list:AllowList._look", lambda look, self: None if self._entries else look(self))],
    "a record without its reply": [
        around("session.journal.ledger:Commit.as_body", lambda as_body, self: as_body(self) | {"requests": []})],
    "a worker that is given away twice": [
        around("transport.supervisor:Supervisor._start_session", lambda start, *given: (
            GIVEN.append(GIVEN[0] if GIVEN else start(*given)), GIVEN[0])[1])],
    "a worker that hangs where it fails": [put("service.execution:known_error", lambda error: time.sleep(3600))],
    "requests that are executed twice": [put("session.journal.replies:ReplyTable.find", lambda *_: None)],
    "tokens that are not checked": [
        put("session.spec:StoredSpec.admits", lambda self, token: True),
        put("transport.registry:Registry.authorised", lambda self, session, token: self.live.get(session)),
    ],
    "workers that stay": [
        put("service.dispatch:SessionHost.closed", property(lambda self: False, lambda self, value: None))],
    "the reference mesh after a resume": [put("session.session:restore", reference_state)],
    "a list that grows with each commit": [
        around("session.session:Session.commit", lambda commit, *given, **further: (
            KEPT.append(os.urandom(int(os.environ["SEEDED_BYTES"]))), commit(*given, **further))[1])],
    "a descriptor kept for each join": [
        around("service.holders:Holders.join", lambda join, *given: (os.dup(0), join(*given))[1])],
    "replies that are never dropped": [put("session.journal.replies:ReplyTable._shrink", lambda self, newest: None)],
}  # fmt: skip


def fault(seed: Seed) -> Seed:
    FAULTS[seed.__name__.replace("_", " ")] = [seed]
    return seed


# --- authorisation ---


@fault
def another_hint_where_there_is_a_session() -> None:
    from mesh_motion_protocol.errors import SessionError

    from mesh_motion_server.transport import control

    request, not_found, control_of = control.Control.request, control.not_found, []

    def remember(self, *given):
        control_of[:] = [self]
        request(self, *given)

    def worded(session):
        known = control_of[0].registry.owner(session) is not None
        error = not_found(session)
        return SessionError(error.message, code="NOT_FOUND", hint="it is not yours") if known else error

    control.Control.request, control.not_found = remember, worded


@fault
def users_who_name_themselves() -> None:
    import contextlib

    import zmq

    from mesh_motion_server.security.allow_list import Everybody
    from mesh_motion_server.transport import protection

    def user_of(frame, _protection):
        with contextlib.suppress(zmq.ZMQError):
            return str(frame.get("User-Id"))
        return ""

    protection.user_of = user_of
    Everybody.roles = lambda self, key: ("owner",)


# --- failpoints ---


@fault
def a_reply_before_its_record() -> None:
    import numpy as np

    from mesh_motion_server.service.dispatch import SessionHost
    from mesh_motion_server.session.journal.journal import Journal

    write, handle, late = Journal.store, SessionHost.handle, []

    def write_late_and_handle(self, envelope):
        while late:
            write(*late.pop())
        return handle(self, envelope)

    Journal.store = lambda self, entry, state: late.append((self, entry, np.array(state)))
    SessionHost.handle = write_late_and_handle


@fault
def an_epoch_in_memory() -> None:
    from dataclasses import replace

    from mesh_motion_server.session.journal.journal import Journal

    def raise_epoch(self):
        self.ledger = replace(self.ledger, epoch=self.ledger.epoch + 1)
        return self.ledger.epoch

    Journal.raise_epoch = raise_epoch


@fault
def an_error_that_is_answered_as_none() -> None:
    from mesh_motion_protocol.errors import DataLoss

    from mesh_motion_server.session.session import Session

    attempt = Session._write

    def careless(self, write, after):
        try:
            attempt(self, write, after)
        except DataLoss:
            self._now = after

    Session._write = careless


# --- network ---


@fault
def a_resume_at_an_older_step() -> None:
    """A session that is opened from its journal for the second time has the state of the first time."""
    import shutil

    from mesh_motion_server.session.store import SessionStore

    honest = SessionStore.open

    def older(self, session, token):
        folder, kept = self.root / "sessions" / session, self.root / f"kept {session}"
        if kept.exists():
            shutil.rmtree(folder)
            shutil.copytree(kept, folder)
        else:
            shutil.copytree(folder, kept)
        return honest(self, session, token)

    SessionStore.open = older


# --- isolation: what the row itself needs ---


@fault
def sessions_with_bad_manners() -> None:
    """Labels choose a fault in STATUS; FETCH is answered with 100 MB for any mesh.

    ``kill`` ends the process at once, ``abort`` as a failed assertion in native code does, ``memory`` takes memory
    until the worker's limit.
    """
    import signal

    import numpy as np
    from mesh_motion_protocol.messages import Fetched

    from mesh_motion_server.service.dispatch import SessionHost
    from mesh_motion_server.service.envelope import Envelope

    handle, ends = SessionHost.handle, {"kill": signal.SIGKILL, "abort": signal.SIGABRT}

    def take_memory(_envelope):
        taken = []
        while True:
            taken.append(np.ones(64 << 20, dtype=np.uint8))

    def ill_mannered(self, envelope):
        request = envelope.message
        if request.type == "FETCH":
            large = {"step": 0, "points": np.zeros((100_000_000 // 24, 3))}
            return [Envelope(envelope.peer, Fetched(client=request.client, sequence=request.sequence, **large))]
        if request.type == "STATUS" and self.label in ends:
            os.kill(os.getpid(), ends[self.label])
        if request.type == "STATUS" and self.label == "memory":
            return self._answered(envelope, take_memory)
        return handle(self, envelope)

    SessionHost.handle = ill_mannered


# --- many sessions ---


@fault
def one_reply_store_for_all_sessions() -> None:
    import os
    import pickle
    from pathlib import Path

    from mesh_motion_server.session.journal.replies import ReplyTable

    folder, find, store = Path(os.environ["SEEDED_FOLDER"]), ReplyTable.find, ReplyTable.store

    def path(request):
        return folder / f"{request.client.hex()}-{request.sequence}"

    def found(self, request):
        known = find(self, request)
        if known is None and path(request).exists():
            return pickle.loads(path(request).read_bytes())
        return known

    def stored(self, request, reply, nbytes=0):
        store(self, request, reply, nbytes)
        if reply is not None and reply.type == "MOVED":
            part = path(request).with_suffix(f".{os.getpid()}")
            part.write_bytes(pickle.dumps(reply))
            part.replace(path(request))

    ReplyTable.find, ReplyTable.store = found, stored


for name in filter(None, os.environ.get("SEEDED_FAULTS", "").split(",")):
    for seed in FAULTS[name]:
        seed()
