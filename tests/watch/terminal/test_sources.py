"""Sessions as a monitor is told of them from their folders."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from histories import go_on
from mesh_motion_client import Mesh, Patch, connect

from mesh_motion_server.watch.terminal.sources import EndpointSource, FolderSource, Unreadable
from proofs.waiting import wait_until

MakeSession = Callable[..., Path]
SQUARE = Mesh(
    np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.5, 0.5]]),
    {"triangle": np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])},
    {"low": Patch("moving", np.array([0, 1])), "high": Patch("fixed", np.array([2, 3]))},
)


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


def test_details_have_the_whole_history(make_session: MakeSession, tmp_path: Path) -> None:
    folder = make_session(steps=300, segments=3)
    source = FolderSource(tmp_path / "state")
    details = source.details(folder.name)
    assert details is not None
    assert (details.steps, details.last["step"]) == (300, 300)
    assert (details.metric, details.threshold) == ("size-skew", 0.2)
    assert len(details.worst) == 10
    kinds = [message["kind"] for message in details.messages]
    assert (kinds.count("refused"), kinds.count("warning"), kinds.count("rolled back")) == (3, 3, 0)
    assert details.trial == ""


def test_a_long_history_is_read_from_its_end(
    make_session: MakeSession, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mesh_motion_server.watch.terminal.sources._LATEST_BYTES", 100_000)
    folder = make_session(steps=900, segments=3)
    details = FolderSource(tmp_path / "state").details(folder.name)
    assert details is not None
    assert details.last["step"] == 900
    assert 1 < details.steps < 800


def test_what_is_added_comes(make_session: MakeSession, tmp_path: Path) -> None:
    folder = make_session(steps=20)
    source = FolderSource(tmp_path / "state")
    assert source.details(folder.name) is not None
    go_on(folder, 20, 5)
    details = source.details(folder.name)
    assert details is not None
    assert (details.last["step"], details.steps) == (25, 25)
    assert source.sessions()[0].step == 25


def test_a_trial_is_told_until_it_is_committed(make_session: MakeSession, tmp_path: Path) -> None:
    folder = make_session(steps=3)
    segment = folder / "history" / "events-00000000.jsonl"
    segment.write_text("".join(segment.read_text().splitlines(keepends=True)[:-1]))
    details = FolderSource(tmp_path / "state").details(folder.name)
    assert details is not None
    assert details.trial == "step 3, iteration 2: minimum 0.750 predicted"


def test_a_session_of_its_own_folder(make_session: MakeSession, tmp_path: Path) -> None:
    make_session("other")
    folder = make_session("mine")
    assert [line.label for line in FolderSource(folder).sessions()] == ["mine"]


def test_a_session_that_goes_and_a_folder_that_goes(make_session: MakeSession, tmp_path: Path) -> None:
    folder = make_session(live=False)
    source = FolderSource(tmp_path / "state")
    assert source.details(folder.name) is not None
    shutil.rmtree(folder)
    assert source.sessions() == []
    assert source.details(folder.name) is None
    shutil.rmtree(tmp_path / "state")
    with pytest.raises(Unreadable, match="is not there"):
        source.sessions()
    make_session("again")
    assert [line.label for line in source.sessions()] == ["again"]


@pytest.mark.nightly
def test_a_server_lists_its_sessions_until_it_goes(tmp_path: Path) -> None:
    with connect(state=tmp_path) as server:
        source = EndpointSource(server.endpoint, timeout=10.0)
        assert source.sessions() == []
        with server.open(SQUARE, label="square") as session:
            session.move(np.full((2, 2), 0.01))
            session.commit()
            # LIST has what the session's worker sent last: that may come after the reply to the holder
            wait_until(lambda: [line.step for line in source.sessions()] == [1], "the commit in the list")
            (line,) = source.sessions()
            assert (line.label, line.state, line.is_live, line.minimum) == ("square", "READY", True, None)
            assert source.details(line.session) is None
        server.close()
        with pytest.raises(Unreadable) as gone:
            source.sessions()
        assert gone.value.code in ("UNAVAILABLE", "DEADLINE_EXCEEDED")
        source.close()
