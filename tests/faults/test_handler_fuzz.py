"""The handlers' fuzz: it reaches every state and type, and detects handlers with bugs."""

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from random import Random
from typing import Any

import pytest
from mesh_motion_protocol.errors import ERROR_CODES, InvalidInput, SessionError
from mesh_motion_protocol.messages import REPLIES

from mesh_motion_server.service import dispatch, execution, rollback
from mesh_motion_server.session.journal.replies import ReplyTable
from mesh_motion_server.session.partitions import uploads
from mesh_motion_server.session.session import Session
from mesh_motion_server.session.state import State
from mesh_motion_server.transport.protection import Protection
from tests.faults import handler_fuzz
from tests.faults.allowed_codes import allowed_codes
from tests.faults.check import BrokenPromise, Budget
from tests.faults.decoder_fuzz import Totals
from tests.faults.handler_fuzz import CHECK, STATES, Scene, play

Patch = pytest.MonkeyPatch


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
        "INVALID_ARGUMENT.NONFINITE", "INVALID_ARGUMENT.PARTITION", "INVALID_ARGUMENT.SHAPE", "INVALID_ARGUMENT.VALUE",
        "NOT_FOUND", "PERMISSION_DENIED", "RESOURCE_EXHAUSTED.BYTES", "RESOURCE_EXHAUSTED.DISK", "UNAUTHENTICATED",
        "UNIMPLEMENTED.MESSAGE", "UNIMPLEMENTED.VERSION",
    } <= outcomes  # fmt: skip


@pytest.mark.parametrize("state", STATES)
def test_valid_requests_lead_to_each_state(protection: Protection, state: str) -> None:
    scene = Scene.set(protection, state, Random(1), Totals())
    assert scene._state() == state


def test_each_request_has_its_codes() -> None:
    for kind in REPLIES:
        assert allowed_codes(kind) <= set(ERROR_CODES) - {"INTERNAL"}
    assert "FAILED_PRECONDITION.QUALITY" in allowed_codes("MOVE") - allowed_codes("COMMIT")


# --- tests of the test -----------------------------------------------------------------------------------------------


def misses_an_optional_field(patch: Patch) -> None:
    honest: Any = execution.COMMANDS["UPLOAD"]

    def careless(session: Session, request: Any) -> Any:
        {"nodes": 1, "cells": 1, "patch": 1}[request.item]
        return honest.answer(session, request)

    patch.setitem(execution.COMMANDS, "UPLOAD", replace(honest, answer=careless))


def changes_the_state_before_the_check(patch: Patch) -> None:
    honest = Session.add_part

    def hasty(self: Session, partition: int, part: Any) -> int:
        if self.state is State.NEW:
            self._swap(state=State.OPENING)
        return honest(self, partition, part)

    patch.setattr(Session, "add_part", hasty)


def takes_a_number_that_is_none(patch: Patch) -> None:
    patch.setattr(uploads, "_check_finite", lambda *_: None)


def gives_a_code_that_the_request_may_not_have(patch: Patch) -> None:
    def confused(session: Session, request: Any) -> None:
        rollback.check(session, request)
        raise InvalidInput("no", code="INVALID_ARGUMENT.MESH")

    patch.setitem(execution.COMMANDS, "ROLLBACK", replace(execution.COMMANDS["ROLLBACK"], check=confused))


def gives_a_detail_that_no_header_holds(patch: Patch) -> None:
    """A former fault: no number follows the largest one."""

    def find(self: Any, request: Any) -> Any:
        client = self._clients.get(request.client)
        if client is not None and request.sequence <= client.floor:
            raise SessionError("too old", code="ABORTED.STALE", details={"oldest": client.floor + 1})
        return None

    patch.setattr(ReplyTable, "find", find)


def does_not_reply(patch: Patch) -> None:
    honest = dispatch.SessionHost.handle

    def silent(self: Any, envelope: Any) -> Any:
        return [] if envelope.message.type == "FETCH" else honest(self, envelope)

    patch.setattr(dispatch.SessionHost, "handle", silent)


def takes_long(patch: Patch) -> None:
    patch.setattr(handler_fuzz, "_MOST_SECONDS", 0.0)


@pytest.mark.parametrize(
    ("bug", "said"),
    [
        (misses_an_optional_field, "UPLOAD was answered INTERNAL"),
        (changes_the_state_before_the_check, "changed where the session stands"),
        (takes_a_number_that_is_none, "UPLOAD with a number that is none is taken"),
        (gives_a_code_that_the_request_may_not_have, "does not have for it"),
        (gives_a_detail_that_no_header_holds, "INTERNAL"),
        (does_not_reply, "FETCH was answered"),
        (takes_long, "a message took"),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_a_handler_with_a_bug_is_found(
    protection: Protection, monkeypatch: Patch, bug: Callable[[Patch], None], said: str
) -> None:
    def campaign() -> None:
        for number in range(500):
            if bug is not takes_a_number_that_is_none or STATES[number % len(STATES)] in ("NEW", "OPENING"):
                play(protection, 1, number, Totals())

    bug(monkeypatch)
    with pytest.raises(BrokenPromise, match=said) as caught:
        campaign()
    notes = " ".join(caught.value.__notes__)
    assert "scene " in notes
    assert "in state " in notes


#: In its own process: one that has run other tests holds pages that may go meanwhile.
_HOARDS = """
from tests.faults.check import Budget
from tests.faults.handler_fuzz import CHECK
from mesh_motion_server.transport import worker

honest, kept = worker.encoded, []

def hoarding(message, **options):
    if message.type == "ERROR":
        kept.append(bytearray(b"x") * 8192)
    return honest(message, **options)

worker.encoded = hoarding
result = CHECK.run(1, Budget(3000))
assert kept
print(result.passed, result.got)
"""


@pytest.mark.nightly
def test_memory_that_is_kept_of_refused_requests_is_found() -> None:
    run = subprocess.run([sys.executable, "-c", _HOARDS], capture_output=True, text=True, check=True)
    assert run.stdout.split()[0] == "False", run.stdout
