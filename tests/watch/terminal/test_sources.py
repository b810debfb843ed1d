"""Sessions read by a monitor from their folders."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from histories import go_on
from rich.console import Console

from mesh_motion_server.watch.terminal.sources import FolderSource, Unreadable
from mesh_motion_server.watch.terminal.table import look_at, rendered

MakeSession = Callable[..., Path]


def test_live_ones_first_then_by_label(make_session: MakeSession, tmp_path: Path) -> None:
    make_session("b")
    make_session("c", live=False)
    make_session("a", steps=7)
    make_session("")
    source = FolderSource(tmp_path / "state")
    lines = source.sessions()
    assert [line["label"] for line in lines] == ["a", "b", "", "c"]
    assert [line["worker"] for line in lines] == ["alive", "alive", "alive", "none"]
    assert (lines[0]["state"], lines[0]["step"], lines[3]["verdict"]["kind"]) == ("READY", 7, "at rest")
    assert lines[0]["minimum"] == pytest.approx(0.75, abs=0.01)


def test_details_have_the_whole_history(make_session: MakeSession, tmp_path: Path) -> None:
    folder = make_session(steps=300, segments=3)
    source = FolderSource(tmp_path / "state")
    details = source.details(folder.name)
    assert details is not None
    assert (details["read"], details["last"]["step"]) == (1.0, 300)
    assert details["built"]["settings"]["quality_metric"] == "size-skew"
    assert len(details["worst"]["cells"]) == 10
    kinds = [message["event"] for message in details["notable"]]
    assert (kinds.count("refused"), kinds.count("warning"), kinds.count("rolled back")) == (3, 3, 0)


def test_a_long_history_is_read_from_its_end(
    make_session: MakeSession, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mesh_motion_server.watch.observation.reading._LATEST", 100_000)
    monkeypatch.setattr("mesh_motion_server.watch.observation.reading._PIECE", 100_000)
    monkeypatch.setattr("mesh_motion_server.watch.observation.reading._SECONDS", 0.0)
    folder = make_session(steps=900, segments=3)
    details = FolderSource(tmp_path / "state").details(folder.name)
    assert details is not None
    assert details["last"]["step"] == 900
    assert details["read"] < 1.0


def test_new_steps_are_shown(make_session: MakeSession, tmp_path: Path) -> None:
    folder = make_session(steps=20)
    source = FolderSource(tmp_path / "state")
    assert source.details(folder.name) is not None
    go_on(folder, 20, 5)
    details = source.details(folder.name)
    assert details is not None
    assert (details["last"]["step"], details["read"]) == (25, 1.0)
    assert source.sessions()[0]["step"] == 25


def test_a_trial_is_shown_until_it_is_committed(make_session: MakeSession, tmp_path: Path) -> None:
    folder = make_session(steps=3)
    segment = folder / "history" / "events-00000000.jsonl"
    segment.write_text("".join(segment.read_text().splitlines(keepends=True)[:-1]))
    console = Console(width=120, no_color=True)
    with console.capture() as capture:
        console.print(rendered("state", look_at(FolderSource(tmp_path / "state"), None)))
    assert "step 3, iteration 2: minimum 0.750 predicted" in capture.get()


def test_a_session_of_its_own_folder(make_session: MakeSession, tmp_path: Path) -> None:
    make_session("other")
    folder = make_session("mine")
    assert [line["label"] for line in FolderSource(folder).sessions()] == ["mine"]


def test_a_session_that_goes_and_a_folder_that_goes(make_session: MakeSession, tmp_path: Path) -> None:
    folder = make_session(live=False)
    source = FolderSource(tmp_path / "state")
    assert source.details(folder.name) is not None
    shutil.rmtree(folder)
    assert source.sessions() == []
    assert source.details(folder.name) is None
    (tmp_path / "state").rename(tmp_path / "old")  # it exists, so that the next folder is surely another one
    with pytest.raises(Unreadable, match="is not there"):
        source.sessions()
    make_session("again")
    assert [line["label"] for line in source.sessions()] == ["again"]
