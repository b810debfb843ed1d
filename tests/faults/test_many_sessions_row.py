"""The row of many sessions: a few sessions, and detection of servers that mix them up or keep data of them."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random

import pytest

from tests.faults import many_sessions as row
from tests.faults.check import BrokenPromise
from tests.faults.many_sessions import Fleet

Seed = Callable[..., None]


@contextmanager
def fleet(folder: Path, live: int, resting: int) -> Iterator[Fleet]:
    made = Fleet(folder, live, resting)
    try:
        made.open()
        yield made
    finally:
        made.close()


@pytest.mark.nightly
def test_sessions_that_are_mixed_up_are_found(seed: Seed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "seeded").mkdir()
    monkeypatch.setenv("SEEDED_FOLDER", str(tmp_path / "seeded"))
    seed("one reply store for all sessions", "tokens that are not checked", "the reference mesh after a resume")
    with fleet(tmp_path, 2, 2) as made:
        one, other = made.live
        row.advance(one, Random(1))
        with pytest.raises(BrokenPromise, match="MOVED is not that of an undisturbed run"):
            row.advance(other, Random(1))
        with pytest.raises(BrokenPromise, match="PROBE of a session with another one's token is answered PROBED"):
            row.require_own_tokens(made.server.endpoint, one, other)
        with pytest.raises(BrokenPromise, match="FETCHED is not that of an undisturbed run"):
            row.swap(made, 0, Polite())


class Polite(Random):
    def random(self) -> float:
        return 0.0

    def randrange(self, *bounds: int) -> int:  # type: ignore[override]
        return 0


@pytest.mark.nightly
def test_workers_that_stay_are_found(seed: Seed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(row, "_PATIENCE", 2.0)
    monkeypatch.setattr("tests.faults.holder.PATIENCE", 2.0)
    seed("workers that stay")
    with fleet(tmp_path, 1, 1) as made:
        row.swap(made, 0, Polite())  # the place of the closed session is free, whether its worker ends or not
        with pytest.raises(BrokenPromise, match=r"[12] workers and \d+ open files"):
            row.require_calm(made)


@pytest.mark.nightly
def test_lists_and_limits_that_are_wrong_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with fleet(tmp_path, 1, 1) as made:
        row.require_full(made)
        row.require_listed(made)
        monkeypatch.setattr(row, "_PATIENCE", 0.0)
        made.live[0].holder.step += 1
        with pytest.raises(BrokenPromise, match="of a session that is"):
            row.require_listed(made)
        made.live[0].holder.step -= 1
        left = made.resting.pop()
        with pytest.raises(BrokenPromise, match="LIST has 2 sessions of 1"):
            row.require_listed(made)
        made.put_to_rest(made.live[0], politely=True)
        made.live[0] = left
        left.holder.come_back()  # as soon as there is room
        made.put_to_rest(left, politely=True)
        with pytest.raises(BrokenPromise, match="a server that is full is answered"):
            _ask_until_answered(made)


def _ask_until_answered(made: Fleet) -> None:
    """Send a request to a server with room, right after its worker has ended."""
    while True:
        row.require_full(made)
