"""Sessions as a monitor is told of them from their folders."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from histories import go_on

from mesh_motion_server.watch.terminal.folder_source import FolderSource
from mesh_motion_server.watch.terminal.sources import Unreadable

MakeSession = Callable[..., Path]


def test_live_ones_first_then_by_label(make_session: MakeSession, tmp_path: Path) -> None:
    make_session("b")
    make_session("c", live=False)
    make_session("a", steps=7)
    make_session("")
    source = FolderSource(tmp_path / "state")
    lines = source.sessions()
    assert [line.label for line in lines] == ["a", "b", "", "c"]
    assert [line.is_live for line in lines] == [True, True, True, False]
    assert (lines[0].state, lines[0].step, lines[3].state) == ("READY", 7, "at rest")
    assert lines[0].minimum == pytest.approx(0.75, abs=0.01)
    assert source.verdict(lines) == ""


def test_a_dead_server_is_said_to_be_files(make_session: MakeSession, tmp_path: Path) -> None:
    make_session(live=False)
    source = FolderSource(tmp_path / "state")
    assert source.verdict(source.sessions()).startswith("no process holds a session: these are files")


def test_details_have_the_whole_history(make_session: MakeSession, tmp_path: Path) -> None:
    folder = make_session(steps=300, segments=3)
    source = FolderSource(tmp_path / "state")
    details = source.details(folder.name, float("inf"))
    assert details is not None
    assert details.share_read == 1.0
    assert list(details.columns["step"]) == list(range(1, 301))
    assert (details.metric, details.threshold, details.mesh) == ("size-skew", 0.2, "400 nodes, 722 triangle")
    assert len(details.worst) == 10
    kinds = [message.kind for message in details.messages]
    assert (kinds.count("refused"), kinds.count("warning"), kinds.count("rolled back")) == (3, 3, 0)
    assert details.trial == ""


def test_the_latest_part_is_there_before_the_whole(make_session: MakeSession, tmp_path: Path) -> None:
    folder = make_session(steps=900, segments=3)
    source = FolderSource(tmp_path / "state")
    first = source.details(folder.name, 0.0)
    assert first is not None
    assert first.share_read < 1.0
    assert first.columns["step"][-1] == 900
    assert first.columns["step"][0] > 100
    for _ in range(100):
        last = source.details(folder.name, 0.0)
        assert last is not None
        if last.share_read == 1.0:
            break
    assert list(last.columns["step"][[0, -1]]) == [1, 900]


def test_what_is_added_comes(make_session: MakeSession, tmp_path: Path) -> None:
    folder = make_session(steps=20)
    source = FolderSource(tmp_path / "state")
    assert source.details(folder.name, 5.0) is not None
    go_on(folder, 20, 5)
    deadline = time.monotonic() + 30
    while (details := source.details(folder.name, 5.0)) is None or details.columns["step"][-1] < 25:
        assert time.monotonic() < deadline  # between two looks at long columns there is a rest
    assert details.columns["step"][-1] == 25
    assert source.sessions()[0].step == 25


def test_a_trial_is_told_until_it_is_committed(make_session: MakeSession, tmp_path: Path) -> None:
    folder = make_session(steps=3)
    segment = folder / "history" / "events-00000000.jsonl"
    segment.write_text("".join(segment.read_text().splitlines(keepends=True)[:-1]))
    details = FolderSource(tmp_path / "state").details(folder.name, 5.0)
    assert details is not None
    assert details.trial == "step 3, iteration 2: minimum 0.750 predicted"


def test_a_session_of_its_own_folder(make_session: MakeSession, tmp_path: Path) -> None:
    make_session("other")
    folder = make_session("mine")
    assert [line.label for line in FolderSource(folder).sessions()] == ["mine"]


def test_a_session_that_goes_and_a_folder_that_goes(make_session: MakeSession, tmp_path: Path) -> None:
    folder = make_session(live=False)
    source = FolderSource(tmp_path / "state")
    assert source.details(folder.name, 5.0) is not None
    shutil.rmtree(folder)
    assert source.sessions() == []
    assert source.details(folder.name, 5.0) is None
    shutil.rmtree(tmp_path / "state")
    with pytest.raises(Unreadable, match="is not there"):
        source.sessions()
    make_session("again")
    assert [line.label for line in source.sessions()] == ["again"]


def test_events_of_another_version_are_passed_over(make_session: MakeSession, tmp_path: Path) -> None:
    folder = make_session(steps=3)
    with (folder / "history" / "events-00000000.jsonl").open("a") as file:
        file.write(json.dumps({"at": 1.0, "event": "moved", "step": 4}) + "\n")
        file.write(json.dumps({"at": 1.0, "event": "dreamt", "step": 4}) + "\n")
        file.write('{"at": 1.0, "event": "comm')
    details = FolderSource(tmp_path / "state").details(folder.name, 5.0)
    assert details is not None
    assert details.columns["step"][-1] == 3
