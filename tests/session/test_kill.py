"""SIGKILL of a process that commits: the row `kill-9` with a few kills; one process per session."""

from pathlib import Path
from random import Random

import pytest

from tests.faults import kill_nine
from tests.faults.check import BrokenPromise, Budget
from tests.faults.kill_nine import CHECK, Witness, kill_again_and_again, require_undisturbed


def test_a_few_kills() -> None:
    result = CHECK.run(7, Budget(6))
    assert result.passed
    assert result.details["kills"] >= 6  # more on a machine so slow that none of them resumes
    assert result.details["acknowledged"] >= 1
    assert result.details["asked_again"] <= result.details["recovered"]  # none where the kills come too early


def test_a_reply_that_is_asked_for_again_is_counted() -> None:
    witness = Witness()
    witness.check(["resumed 0 0.1", "reply 1 1 aa"])
    witness.check(["resumed 1 0.1", "reply 1 1 aa", "reply 2 2 bb"])
    assert (witness.repeats, witness.last, len(witness.recoveries)) == (1, 2, 1)


def test_a_session_that_answers_otherwise_is_found(tmp_path: Path) -> None:
    witness = kill_again_and_again(tmp_path, Random(3), Budget(3))
    require_undisturbed(tmp_path, witness)
    frame = bytearray(witness.replies[1])
    frame[-1] ^= 1
    witness.replies[1] = bytes(frame)
    with pytest.raises(BrokenPromise, match="the reply of step 1 differs"):
        require_undisturbed(tmp_path, witness)


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (["resumed 1 0.1"], "resumes at step 1, 2 was acknowledged"),
        (["resumed 4 0.1"], "resumes at step 4, 2 was acknowledged"),
        (["resumed 2 0.1", "reply 2 2 ee"], "repeated reply of step 2 differs"),
        (["resumed 2 0.1", "reply 3 2 ee"], "step 3 was acknowledged, 2 was durable"),
        (["ended by itself"], "ended by itself"),
    ],
)
def test_a_loss_is_found(lines: list[str], said: str) -> None:
    witness = Witness()
    witness.check(["resumed 0 0.1", "reply 1 1 aa", "reply 2 2 bb"])
    with pytest.raises(BrokenPromise, match=said):
        witness.check(lines)


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (["resumed 0 0.1"], "resumes at step 0, 3 was acknowledged, 1 was durable"),
        (["resumed 1 0.1", "reply 1 1 aa", "reply 2 1 ee"], "repeated reply of step 2 differs"),
        (["resumed 2 0.1", "reply 2 2 bb", "reply 3 2 cc"], ""),
    ],
)
def test_losses_that_a_relaxed_session_may_have_and_others(lines: list[str], said: str) -> None:
    witness = Witness(level="relaxed")
    witness.check(["resumed 0 0.1", "reply 1 0 aa", "reply 2 1 bb", "reply 3 1 cc"])
    if said:
        with pytest.raises(BrokenPromise, match=said):
            witness.check(lines)
    else:
        witness.check(lines)
        assert (witness.last, witness.durable, witness.lost) == (3, 2, 1)


def test_a_process_that_ends_by_itself_is_found(tmp_path: Path) -> None:
    (tmp_path / "sessions").write_text("in the way of the folder")
    with pytest.raises(BrokenPromise, match=r"failed .*sessions"):  # killed or not before it ends
        kill_again_and_again(tmp_path, Random(4), Budget(3))


def test_lives_that_commit_nothing_end_the_campaign(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kill_nine, "_MOST_IDLE", 3)
    monkeypatch.setattr(kill_nine, "_LONGEST", 1e-6)
    with pytest.raises(BrokenPromise, match="after step 0, 3 lives in a row have committed nothing"):
        kill_again_and_again(tmp_path, Random(5), Budget(100))
