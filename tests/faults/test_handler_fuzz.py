"""The handlers' fuzz: it is repeatable and reaches every state and type, and handlers with bugs are found."""

import subprocess
import sys
from dataclasses import replace
from random import Random
from typing import Any

import pytest
from mesh_motion_protocol.errors import ERROR_CODES, InvalidInput, SessionError
from mesh_motion_protocol.messages import REPLIES

from mesh_motion_server.service import dispatch, execution, rollback
from mesh_motion_server.service.commands import Collective, Single
from mesh_motion_server.session.journal.replies import ReplyTable
from mesh_motion_server.session.partitions import uploads
from mesh_motion_server.session.session import Session
from mesh_motion_server.session.state import State
from mesh_motion_server.transport.protection import Protection
from tests.faults import handler_fuzz
from tests.faults.allowed_codes import allowed_codes
from tests.faults.check import BrokenPromise, Budget
from tests.faults.handler_fuzz import CHECK, STATES, Scene, Totals, play
from tests.faults.request_mutations import REQUEST_MUTATIONS, frames_of, gone_wrong
from tests.faults.valid_requests import CONTROL, DATA, Known, valid_request

Patch = pytest.MonkeyPatch
KNOWN = Known("0" * 32, b"t" * 32, 2, 2, step=3)


@pytest.mark.nightly
def test_a_few_thousand_requests() -> None:
    result = CHECK.run(4, Budget(4000))
    assert result.passed, result.got
    assert set(result.details["states"]) - {"none"} == set(STATES)
    outcomes = set(result.details["outcomes"])
    assert set(REPLIES.values()) - {"JUDGED", "CORRECTED"} <= outcomes  # the server has the cells of these sessions
    assert {
        "ABORTED.CONFLICT", "ABORTED.FENCED", "ABORTED.STALE", "FAILED_PRECONDITION.STATE", "FAILED_PRECONDITION.STEP",
        "INVALID_ARGUMENT.DTYPE", "INVALID_ARGUMENT.FRAMES", "INVALID_ARGUMENT.HEADER", "INVALID_ARGUMENT.MESH",
        "INVALID_ARGUMENT.NONFINITE", "INVALID_ARGUMENT.PARTITION",
        "INVALID_ARGUMENT.SHAPE", "INVALID_ARGUMENT.VALUE", "NOT_FOUND", "PERMISSION_DENIED",
        "RESOURCE_EXHAUSTED.BYTES", "RESOURCE_EXHAUSTED.DISK", "UNAUTHENTICATED",
        "UNIMPLEMENTED.MESSAGE",
        "UNIMPLEMENTED.VERSION",
    } <= outcomes  # fmt: skip


@pytest.mark.parametrize("state", STATES)
def test_valid_requests_lead_to_each_state(protection: Protection, state: str) -> None:
    scene = Scene.set(protection, state, Random(1))
    assert str(scene.server.host(scene.known.session).state) == state


def test_a_seed_repeats_every_message() -> None:
    def messages() -> list[list[bytes]]:
        random, known, found = Random(5), replace(KNOWN), []
        for kind in (*DATA, *CONTROL) * 20:
            request = valid_request(kind, known, 1, random)
            gone_wrong(request, known, random)
            found.append(frames_of(request, random))
        return found

    assert messages() == messages()


@pytest.mark.parametrize("name", REQUEST_MUTATIONS)
def test_each_mutation_changes_messages(name: str) -> None:
    change, _ = REQUEST_MUTATIONS[name]
    random, changed = Random(6), 0
    for kind in (*DATA, *CONTROL) * 10:
        request, again = (valid_request(kind, replace(KNOWN), 0, Random(7)) for _ in range(2))
        change(request, KNOWN, random)
        changed += frames_of(request, Random(1)) != frames_of(again, Random(1))
    assert changed >= 5


def test_each_request_has_its_codes() -> None:
    for kind in REPLIES:
        assert allowed_codes(kind) <= set(ERROR_CODES)
        assert "INTERNAL" not in allowed_codes(kind)
    assert "FAILED_PRECONDITION.QUALITY" in allowed_codes("MOVE")
    assert "FAILED_PRECONDITION.QUALITY" not in allowed_codes("COMMIT")


# --- tests of the test -----------------------------------------------------------------------------------------------


def campaign(protection: Protection, first: int = 1) -> Totals:
    """Twenty-eight scenes; the first one is chosen where the scenes before it do not show a fault."""
    totals = Totals()
    for number in range(first, first + 28):
        play(protection, 1, number, totals)
    return totals


def change_command(patch: Patch, kind: str, **parts: Any) -> None:
    command: Single | Collective = execution.COMMANDS[kind]
    patch.setitem(execution.COMMANDS, kind, replace(command, **parts))


def test_a_handler_that_misses_an_optional_field_is_found(protection: Protection, monkeypatch: Patch) -> None:
    honest = execution.COMMANDS["UPLOAD"]

    def careless(session: Session, request: Any) -> Any:
        {"nodes": 1, "cells": 1, "patch": 1}[request.item]
        return honest.answer(session, request)  # type: ignore[union-attr]

    change_command(monkeypatch, "UPLOAD", answer=careless)
    with pytest.raises(BrokenPromise, match="UPLOAD was answered INTERNAL") as caught:
        campaign(protection)
    notes = " ".join(caught.value.__notes__)
    assert "scene " in notes
    assert "in state OPENING" in notes or "in state NEW" in notes


def test_a_state_that_changes_before_the_check_is_found(protection: Protection, monkeypatch: Patch) -> None:
    honest = Session.add_part

    def hasty(self: Session, partition: int, part: Any) -> int:
        if self.state is State.NEW:
            self._swap(state=State.OPENING)
        return honest(self, partition, part)

    monkeypatch.setattr(Session, "add_part", hasty)
    with pytest.raises(BrokenPromise, match="changed where the session stands"):
        campaign(protection, 14)


def test_a_number_that_is_none_is_found(protection: Protection, monkeypatch: Patch) -> None:
    monkeypatch.setattr(uploads, "_check_finite", lambda *_: None)
    with pytest.raises(BrokenPromise, match="UPLOAD with a number that is none is taken"):
        campaign(protection, 8)


def test_a_code_that_the_request_may_not_have_is_found(protection: Protection, monkeypatch: Patch) -> None:
    def confused(session: Session, request: Any) -> None:
        rollback.check(session, request)
        raise InvalidInput("no", code="INVALID_ARGUMENT.MESH")

    change_command(monkeypatch, "ROLLBACK", check=confused)
    with pytest.raises(BrokenPromise, match="does not have for it"):
        campaign(protection)


def test_a_detail_that_no_header_holds_is_found(protection: Protection, monkeypatch: Patch) -> None:
    """As it was once: behind the largest number there is none."""

    def find(self: Any, request: Any) -> Any:
        client = self._clients.get(request.client)
        if client is not None and request.sequence <= client.floor:
            raise SessionError("too old", code="ABORTED.STALE", details={"oldest": client.floor + 1})
        return None

    monkeypatch.setattr(ReplyTable, "find", find)
    with pytest.raises(BrokenPromise, match="INTERNAL"):
        campaign(protection, 3)


def test_no_reply_is_found(protection: Protection, monkeypatch: Patch) -> None:
    honest = dispatch.SessionHost.handle

    def silent(self: Any, envelope: Any) -> Any:
        return [] if envelope.message.type == "FETCH" else honest(self, envelope)

    monkeypatch.setattr(dispatch.SessionHost, "handle", silent)
    with pytest.raises(BrokenPromise, match="FETCH was answered"):
        campaign(protection)


def test_a_message_that_takes_long_is_found(protection: Protection, monkeypatch: Patch) -> None:
    monkeypatch.setattr(handler_fuzz, "_MOST_SECONDS", 0.0)
    with pytest.raises(BrokenPromise, match="a message took"):
        campaign(protection)


#: In its own process: one that has run other tests holds pages that may go meanwhile.
_HOARDS = """
from tests.faults.check import Budget
from tests.faults.handler_fuzz import CHECK
from mesh_motion_server.transport import worker

honest, kept = worker.encoded, []

def hoarding(message, **options):
    if message.type == "ERROR":
        kept.append(bytearray(b"x") * {kept})
    return honest(message, **options)

worker.encoded = hoarding
result = CHECK.run(1, Budget(3000))
assert kept
print(result.passed, result.got)
"""


@pytest.mark.nightly
@pytest.mark.parametrize(("size", "verdict"), [(8192, "False"), (1, "True")])
def test_memory_that_is_kept_of_refused_requests_is_found(size: int, verdict: str) -> None:
    run = subprocess.run([sys.executable, "-c", _HOARDS.format(kept=size)], capture_output=True, text=True, check=True)
    assert run.stdout.split()[0] == verdict, run.stdout
