"""The benchmark of the history measures what it says, with few steps."""

from pathlib import Path

from benchmarks.history import measure
from mesh_motion_server.service.recorder import Recorder
from mesh_motion_server.watch.observation.follow import EventTail


def test_one_session_has_a_history_and_the_other_none(tmp_path: Path) -> None:
    before = Recorder.executed
    found = measure(tmp_path, 5, 4)
    assert Recorder.executed is before
    assert 0 < found["within"] < found["step"] * 1000
    recorded, nothing = (EventTail(tmp_path / "sessions" / (name * 32)).read() for name in "12")
    assert sum(event["event"] == "committed" for event in recorded) == 4
    assert nothing == []
