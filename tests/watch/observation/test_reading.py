"""A long history is read piece by piece, and its end is known at once."""

from pathlib import Path
from typing import Any

import pytest
from histories import write_history

from mesh_motion_server.watch.observation import reading
from mesh_motion_server.watch.observation.reading import Reading

STEPS = 400


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(reading, "_LATEST", 200 << 10)
    monkeypatch.setattr(reading, "_PIECE", 100 << 10)
    write_history(tmp_path, STEPS, segments=3)
    return tmp_path


def at_once(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Reading:
    with monkeypatch.context() as patched:
        patched.setattr(reading, "_LATEST", 1 << 40)
        whole = Reading(folder)
        whole.catch_up()
    return whole


def steps(known: Reading) -> list[Any]:
    found: list[Any] = known.series(None, 5000)["columns"]["step"]
    return found


def test_the_end_is_shown_while_the_rest_is_read(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reading, "_SECONDS", 0.0)
    known, shares, stamps = Reading(folder), [], set()
    while not shares or shares[-1] < 1.0:
        known.catch_up()
        shares.append(known.detail()["read"])
        stamps.add(known.stamp)
        assert (steps(known)[-1], known.detail()["built"]["nodes"]) == (STEPS, 400)
        assert (steps(known)[0] == 1) == (shares[-1] == 1.0)
    assert len(stamps) == len(shares) > 10
    assert shares == sorted(shares)
    whole = at_once(folder, monkeypatch)
    assert known.detail() == whole.detail()
    assert known.series(None, 100) == whole.series(None, 100)


def test_news_are_shown_while_the_rest_is_read(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reading, "_SECONDS", 0.0)
    known = Reading(folder)
    known.catch_up()
    segment = max((folder / "history").glob("events-*"))
    last = segment.read_text(encoding="utf-8").splitlines()[-1]
    with segment.open("a", encoding="utf-8") as file:
        file.write(last.replace(f'"step": {STEPS}', f'"step": {STEPS + 1}') + "\n")
    known.catch_up()
    assert known.detail()["read"] < 1.0
    assert steps(known)[-1] == STEPS + 1


def test_a_short_history_is_read_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reading, "_SECONDS", 0.0)
    write_history(tmp_path, STEPS, segments=3)
    known = Reading(tmp_path)
    known.catch_up()
    assert known.detail()["read"] == 1.0
    assert len(steps(known)) == STEPS
