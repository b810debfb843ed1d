"""The decoder's fuzz: it is repeatable and reaches far, and a decoder with a bug is found."""

from collections import Counter
from collections.abc import Sequence
from random import Random
from typing import Any

import pytest
from mesh_motion_protocol.errors import ProtocolError
from mesh_motion_protocol.messages import MESSAGES

from tests.faults import decoder_fuzz
from tests.faults.check import BrokenPromise, Budget
from tests.faults.decoder_fuzz import CHECK, outcome_of
from tests.faults.mutations import MUTATIONS, golden_frames, mutated


def test_the_golden_vectors_are_all_taken() -> None:
    assert {outcome_of(frames) for frames in golden_frames()} == set(MESSAGES)


def test_a_few_thousand_messages() -> None:
    result = CHECK.run(5, Budget(4000))
    assert result.passed
    assert result.details["messages"] == 4000
    codes = set(result.details["outcomes"]) - set(MESSAGES)
    assert {
        "INVALID_ARGUMENT.HEADER",
        "INVALID_ARGUMENT.VALUE",
        "INVALID_ARGUMENT.DTYPE",
        "INVALID_ARGUMENT.SHAPE",
        "INVALID_ARGUMENT.FRAMES",
        "INVALID_ARGUMENT.NONFINITE",
        "RESOURCE_EXHAUSTED.BYTES",
        "UNIMPLEMENTED.VERSION",
        "UNIMPLEMENTED.MESSAGE",
    } <= codes
    assert len(set(result.details["outcomes"]) & set(MESSAGES)) > 20


def test_a_seed_repeats_every_message() -> None:
    golden = golden_frames()
    first, again = ([mutated(random.choice(golden), random) for _ in range(300)] for random in (Random(5), Random(5)))
    assert first == again


@pytest.mark.parametrize("name", MUTATIONS)
def test_each_mutation_changes_most_messages(name: str) -> None:
    random, golden = Random(6), golden_frames()
    assert sum(MUTATIONS[name](frames, random) != frames for frames in golden) > len(golden) / 2


# --- tests of the test -----------------------------------------------------------------------------------------------


def campaign() -> Counter[str]:
    return Counter(CHECK.run(1, Budget(3000)).details["outcomes"])


def test_an_unexpected_exception_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    honest = decoder_fuzz.decode

    def careless(frames: Sequence[bytes]) -> Any:
        message = honest(frames)
        return message if len(frames[0]) % 7 else {}["seeded"]  # type: ignore[typeddict-item]

    monkeypatch.setattr(decoder_fuzz, "decode", careless)
    with pytest.raises(KeyError) as caught:
        campaign()
    assert "message " in caught.value.__notes__[0]


@pytest.mark.parametrize("code", ["INTERNAL", "NO.SUCH"])
def test_an_error_that_is_none_of_the_specs_is_found(monkeypatch: pytest.MonkeyPatch, code: str) -> None:
    def refusing(frames: Sequence[bytes]) -> Any:
        raise ProtocolError("oh", code=code)

    monkeypatch.setattr(decoder_fuzz, "decode", refusing)
    with pytest.raises(BrokenPromise, match=f"the code {code}"):
        campaign()


def test_an_error_too_long_for_its_reply_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mesh_motion_protocol.errors.brief", lambda text, most=0: text)
    with pytest.raises((BrokenPromise, ProtocolError), match=r"takes \d+ bytes|must be at most 65536 bytes"):
        campaign()


def test_memory_that_is_kept_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    kept: list[bytearray] = []
    honest = decoder_fuzz.decode

    def hoarding(frames: Sequence[bytes]) -> Any:
        kept.append(bytearray(b"x") * 8192)
        return honest(frames)

    monkeypatch.setattr(decoder_fuzz, "decode", hoarding)
    assert not CHECK.run(1, Budget(4000)).passed
