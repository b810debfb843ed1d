"""Following a history: no event is missed or repeated, for any actions of the writer."""

import shutil
from pathlib import Path
from typing import Any

import pytest
from histories import made_up_events, put_events, write_history

from mesh_motion_server.session.history import History
from mesh_motion_server.session.history.events import line_of
from mesh_motion_server.watch.observation.follow import EventTail, last_event


def test_existing_events_come_first_and_then_new_ones(tmp_path: Path) -> None:
    tail = EventTail(tmp_path)
    assert tail.read() == []
    history = History(tmp_path, 1 << 20)
    for number in range(3):
        history.record("closed", step=number)
    assert [event["step"] for event in tail.read()] == [0, 1, 2]
    assert tail.read() == []
    history.record("closed", step=3)
    assert [event["step"] for event in tail.read()] == [3]


def test_little_at_a_time_is_everything_in_the_end(tmp_path: Path) -> None:
    events = write_history(tmp_path, 300, segments=4)
    tail, found = EventTail(tmp_path), []
    while some := tail.read(10_000):
        found += some
    assert found == events
    assert EventTail(tmp_path).read() == events


def test_a_torn_line_is_waited_for_and_passed_over_when_it_is_ended(tmp_path: Path) -> None:
    history = History(tmp_path, 1 << 20)
    history.record("closed", step=1)
    path = tmp_path / "history" / "events-00000000.jsonl"
    whole = path.read_bytes()
    tail = EventTail(tmp_path)
    path.write_bytes(whole + b'{"at":1.0,"eve')
    assert len(tail.read()) == 1
    assert tail.read() == []
    path.write_bytes(whole + b'{"at":1.0,"event":"closed","step":2}\n')
    assert [event["step"] for event in tail.read()] == [2]
    path.write_bytes(path.read_bytes() + b'{"at":1.0,"eve')
    assert tail.read() == []
    history = History(tmp_path, 1 << 20)  # the next process that holds the session
    history.record("closed", step=3)
    assert [event["step"] for event in tail.read()] == [3]


def test_rotation_and_removal_while_following(tmp_path: Path) -> None:
    history, tail = History(tmp_path, 40_000), EventTail(tmp_path)
    found = []
    for step in range(600):
        history.record("closed", step=step, filler="x" * 50)
        if step % 7 == 0 and step < 300:
            found += [event["step"] for event in tail.read()]
    assert found == list(range(295))
    rest = [event["step"] for event in tail.read()]
    assert rest == list(range(rest[0], 600))
    assert rest[0] > 295  # the reader was away for too long


def test_the_last_event(tmp_path: Path) -> None:
    assert last_event(tmp_path) is None
    events = write_history(tmp_path, 200, segments=3)
    assert last_event(tmp_path) == events[-1]
    assert last_event(tmp_path, ("built",)) == events[0]
    path = tmp_path / "history" / "events-00000002.jsonl"
    path.write_bytes(path.read_bytes() + b"torn")
    assert last_event(tmp_path) == events[-1]
    (tmp_path / "history" / "events-00000003.jsonl").write_bytes(b"")
    assert last_event(tmp_path) == events[-1]
    assert last_event(tmp_path, ("nothing",)) is None


@pytest.mark.parametrize("number", [0, 3])
def test_a_history_that_was_removed_and_begun_again_is_followed(number: int, tmp_path: Path) -> None:
    put_events(tmp_path, made_up_events(4), number=3)
    tail = EventTail(tmp_path)
    assert tail.read()
    shutil.rmtree(tmp_path / "history")
    assert tail.read() == []
    put_events(tmp_path, made_up_events(1), number=number)
    assert [event["event"] for event in tail.read()] == ["built", "moved", "moved", "committed"]
    assert tail.read() == []


@pytest.mark.parametrize("compact", [False, True])
def test_in_brief_only_the_latest_events_have_their_worst_cells(tmp_path: Path, compact: bool) -> None:
    events = write_history(tmp_path, 30)
    if compact:  # as the server writes them
        (segment,) = (tmp_path / "history").glob("events-*")
        segment.write_bytes(b"".join(line_of(**shaped(event)) for event in events))
    brief = EventTail(tmp_path).read(brief=True)
    tables = [len(part["worst"]) for event in brief for part in judged(event)]
    assert brief[-1] == events[-1]
    assert sum(tables) == 10 * sum(len(judged(event)) for event in events[-2:])
    for event in [*brief, *events]:
        for part in judged(event):
            part["worst"] = []
    assert brief == events


def shaped(event: dict[str, Any]) -> dict[str, Any]:
    """An event as the arguments of its writer."""
    values = {name: value for name, value in event.items() if name not in ("at", "event")}
    return {"at": event["at"], "event": event["event"], "values": values}


def judged(event: dict[str, Any]) -> list[dict[str, Any]]:
    quality = event.get("quality", {})
    return [part for part in (quality, quality.get("standard"), quality.get("corrected")) if part and "worst" in part]


def test_the_end_of_a_history_may_lie_in_several_segments(tmp_path: Path) -> None:
    events = write_history(tmp_path, 30, segments=10)
    sizes = [path.stat().st_size for path in sorted((tmp_path / "history").glob("events-*"))]
    tail = EventTail(tmp_path, last_bytes=sum(sizes[-3:]) - 1)
    assert sum(sizes[-3:]) > tail.behind() > sum(sizes[-2:])
    found = tail.read()
    assert events[-len(found) :] == found
    assert (tail.behind(), tail.read()) == (0, [])
    whole = EventTail(tmp_path, last_bytes=sum(sizes) + 1)
    assert whole.behind() == sum(sizes)
    assert whole.read() == events
