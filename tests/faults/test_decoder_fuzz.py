"""The decoder's fuzz: it is repeatable, reaches many cases, and detects a decoder with a bug."""

from random import Random
from typing import Any

import pytest
from mesh_motion_protocol.errors import ProtocolError
from mesh_motion_protocol.messages import MESSAGES

from tests.faults import decoder_fuzz
from tests.faults.check import BrokenPromise, Budget
from tests.faults.decoder_fuzz import CHECK, outcome_of
from tests.faults.mutations import CHANGES, Draft, golden_frames, gone_wrong


def test_a_few_thousand_messages() -> None:
    assert {outcome_of(frames) for frames in golden_frames()} == set(MESSAGES)
    result, again = (CHECK.run(5, Budget(4000)) for _ in range(2))
    assert result.passed
    assert result.details["outcomes"] == again.details["outcomes"]
    outcomes = set(result.details["outcomes"])
    assert {
        *(f"INVALID_ARGUMENT.{what}" for what in ("HEADER", "VALUE", "DTYPE", "SHAPE", "FRAMES", "NONFINITE")),
        "RESOURCE_EXHAUSTED.BYTES", "UNIMPLEMENTED.VERSION", "UNIMPLEMENTED.MESSAGE",
    } <= outcomes  # fmt: skip
    assert len(outcomes & set(MESSAGES)) > 20


def test_each_change_changes_messages() -> None:
    random = Random(6)
    for change in CHANGES:
        changed = [gone_wrong(Draft.of(frames), random, {change: 1}, 0.0) != frames for frames in golden_frames()]
        assert sum(changed) > len(changed) / 4


# --- tests of the test -----------------------------------------------------------------------------------------------


def seed_bug(patch: pytest.MonkeyPatch, bug: Any) -> None:
    honest = decoder_fuzz.decode
    patch.setattr(decoder_fuzz, "decode", lambda frames: bug(frames) or honest(frames))


def test_an_unexpected_exception_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    seed_bug(monkeypatch, lambda frames: None if len(frames[0]) % 7 else {}["seeded"])  # type: ignore[typeddict-item]
    with pytest.raises(KeyError) as caught:
        CHECK.run(1, Budget(3000))
    assert "message " in caught.value.__notes__[0]


@pytest.mark.parametrize("code", ["INTERNAL", "NO.SUCH"])
def test_an_error_that_is_none_of_the_specs_is_found(monkeypatch: pytest.MonkeyPatch, code: str) -> None:
    def refuse(_frames: Any) -> None:
        raise ProtocolError("oh", code=code)

    seed_bug(monkeypatch, refuse)
    with pytest.raises(BrokenPromise, match=f"the code {code}"):
        CHECK.run(1, Budget(3000))


def test_an_error_too_long_for_its_reply_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mesh_motion_protocol.errors.brief", lambda text, most=0: text)
    with pytest.raises((BrokenPromise, ProtocolError), match=r"takes \d+ bytes|must be at most 65536 bytes"):
        CHECK.run(1, Budget(3000))


def test_memory_that_is_kept_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    kept: list[bytearray] = []
    seed_bug(monkeypatch, lambda _: kept.append(bytearray(b"x") * 8192))
    assert not CHECK.run(1, Budget(4000)).passed
