"""A session's history: it has all answers, and its faults never affect the session."""

import errno
import json
import logging
import math
import os
import re
import shutil
import tracemalloc
from pathlib import Path
from random import Random
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mesh_motion_protocol.errors import DataLoss
from mesh_motion_protocol.messages import Build, Close, Commit, Move, Rollback
from raising import raising

from mesh_motion_server.session.history import History
from mesh_motion_server.session.history.boundary import BoundaryLog, pack_input, pack_outcome
from mesh_motion_server.session.history.events import last_committed, line_of, lines_backwards, parse_line, read_events
from mesh_motion_server.session.history.segments import list_segments
from mesh_motion_server.session.journal.ledger import BoundaryInput
from mesh_motion_server.session.store import SessionStore
from mesh_motion_server.settings import DURABILITY_LEVELS, ServerSettings
from mesh_motion_server.watch.observation.fold import StepFold
from mesh_motion_server.watch.observation.followed import Followed
from mesh_motion_server.watch.observation.steps import digest_of_history
from tests.faults import kill_nine
from tests.faults.check import Budget
from tests.faults.driver import SESSION, TOKEN, make_driver, resume_driver
from tests.faults.kill_nine import kill_again_and_again
from tests.faults.stand_in import grid_mesh, split_mesh

LIMITS = ServerSettings(reserve_disk_bytes=0)


@pytest.fixture
def store(tmp_path: Path) -> SessionStore:
    return SessionStore(tmp_path / "state")


def new(store: SessionStore, parts: int = 1, **options: Any) -> Any:
    whole = grid_mesh()
    meshes = [whole] if parts == 1 else split_mesh(whole, parts)
    driver = make_driver(store, meshes, **{"limits": LIMITS} | options)
    driver.open()
    return driver


def folder_of(store: SessionStore) -> Path:
    return store.root / "sessions" / SESSION


def events_of(store: SessionStore) -> list[str]:
    return [event["event"] for event in read_events(folder_of(store))]


def advance(driver: Any, step: int) -> None:
    driver.move(step, frame="reference")
    assert driver.all(Commit, step=step)[-1].type == "COMMITTED"


def digests(driver: Any, steps: range) -> list[bytes]:
    return [driver.advance(step)[-1].digest for step in steps]


# --- the events ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("parts", [1, 3])
@pytest.mark.parametrize("level", DURABILITY_LEVELS)
def test_every_request_that_took_effect_has_one_event(store: SessionStore, level: str, parts: int) -> None:
    driver = new(store, parts, spec={"durability": level})
    moved = driver.move(1)[-1]
    driver.move(1)
    driver.all(Rollback, step=1)
    driver.move(1)
    committed = driver.all(Commit, step=1)[-1]
    for p in range(parts):
        driver.ask(Close, p, outcome="keep")
    events = list(read_events(folder_of(store)))
    assert [e["event"] for e in events] == ["built", "moved", "moved", "rolled_back", "moved", "committed", "closed"]
    built, first = events[:2]
    assert (built["nodes"], built["cells"], built["patches"]["left"]["role"]) == (25, {"triangle": 32}, "moving")
    assert built["settings"]["correction"] == "smooth"
    assert built["version"]
    for name in ("step", "iteration", "quality", "correction", "caches", "seconds", "warnings"):
        assert first[name] == json.loads(json.dumps(getattr(moved, name))), name
    assert first["enrichment_points"] == moved.enrichment_points.tolist()
    assert (events[3]["step"], events[3]["iteration"]) == (1, 2)
    assert events[5]["digest"] == committed.digest.hex()
    assert events[5]["quality"] == json.loads(json.dumps(committed.quality))
    assert all(e["seconds_total"] >= 0 for e in events if e["event"] in ("built", "moved", "committed"))
    assert [e["at"] for e in events] == sorted(e["at"] for e in events)


def test_a_repeat_has_no_event(store: SessionStore) -> None:
    driver = new(store)
    driver.move(1)
    request = driver.request(Commit, step=1)
    assert driver.send(request)[0].digest == driver.send(request)[0].digest
    assert events_of(store) == ["built", "moved", "committed"]


def test_a_refusal_is_written_with_its_reasons(store: SessionStore) -> None:
    driver = new(store)
    reply = driver.move(7)[-1]
    far = driver.all(Move, [np.full((5, 2), 1e200)], step=1)[-1]
    events = [e for e in read_events(folder_of(store)) if e["event"] == "refused"]
    assert [(e["request"], e["step"], e["code"]) for e in events] == [("MOVE", 7, reply.code), ("MOVE", 1, far.code)]
    assert (events[0]["message"], events[0]["hint"]) == (reply.message, reply.hint)


def test_a_client_that_is_refused_for_ever_does_not_fill_it(store: SessionStore) -> None:
    driver = new(store)
    for _ in range(130):
        driver.move(7)
    driver.move(1)
    events = list(read_events(folder_of(store)))
    assert sum(e["event"] == "refused" for e in events) == 100
    assert (events[-1]["event"], events[-1]["untold"]) == ("moved", 30)


def test_strangers_do_not_write_into_it(store: SessionStore) -> None:
    driver = new(store)
    for fields in ({}, {"epoch": 9}):
        (reply,) = driver.send(driver.request(Commit, **{"step": 1} | fields), peer=b"somebody")
        assert reply.type == "ERROR"
    assert events_of(store) == ["built"]


def test_a_fenced_holder_uses_no_other_holders_refusals_up(store: SessionStore) -> None:
    driver = new(store)
    stale = driver.request(Commit, step=1)
    driver.host.reclaim(TOKEN)
    driver.join()
    for _ in range(120):
        assert driver.send(stale, peer=b"zombie")[0].code == "ABORTED.FENCED"
        driver.move(7)
    driver.all(Commit, step=1)
    events = [e for e in read_events(folder_of(store)) if e["event"] == "refused"]
    assert [e["request"] for e in events] == ["MOVE"] * 100 + ["COMMIT"]


def test_a_refusal_without_a_step_belongs_to_the_one_being_made(store: SessionStore) -> None:
    driver = new(store)
    driver.advance(1)
    driver.send(driver.request(Build))
    events = [e for e in read_events(folder_of(store)) if e["event"] == "refused"]
    assert [(e["request"], e["step"]) for e in events] == [("BUILD", 2)]


def test_a_discarded_session_takes_its_history_away(store: SessionStore, caplog: Any) -> None:
    driver = new(store)
    driver.advance(1)
    driver.ask(Close, outcome="discard")
    assert list((store.root / "sessions").iterdir()) == []
    assert not caplog.records


# --- resumed ---------------------------------------------------------------------------------------------------------


def lost(driver: Any) -> None:
    """End the process: its locks and files are released, and nothing is written any more."""
    driver.host._session._built.keeper.close()
    driver.host._session._folder.release()


@pytest.mark.parametrize("level", DURABILITY_LEVELS)
def test_events_that_a_kill_prevented_are_written_at_the_resume(
    store: SessionStore, level: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The commit is durable, its line is not written; the repeated COMMIT is answered from the journal."""
    driver = new(store, spec={"durability": level})
    driver.advance(1)
    driver.move(2)
    request = driver.request(Commit, step=2)
    with monkeypatch.context() as patch:
        patch.setattr(History, "record", lambda *_, **__: None)
        patch.setattr(History, "record_outcome", lambda *_: None)
        (reply,) = driver.send(request)
    driver.host._session.catch_up()
    lost(driver)
    assert events_of(store) == ["built", "moved", "committed", "moved"]
    again = resume_driver(driver, store, limits=LIMITS)
    events = list(read_events(folder_of(store)))
    assert [e["event"] for e in events[4:]] == ["committed", "resumed"]
    assert events[4]["recovered"] is True
    assert events[4]["digest"] == reply.digest.hex()
    assert (events[5]["step"], events[5]["epoch"]) == (2, 2)
    log = BoundaryLog(folder_of(store))
    assert [log.read(step).digest for step in (1, 2)] == [
        bytes.fromhex(e["digest"]) for e in events if e["event"] == "committed"
    ]
    again.advance(3)
    assert BoundaryLog(folder_of(store)).steps == 3


def test_a_session_without_history_gets_one_when_it_is_resumed(store: SessionStore) -> None:
    driver = new(store, limits=ServerSettings(history_bytes=0))
    driver.advance(1)
    assert not (folder_of(store) / "history").exists()
    driver.host.close()
    again = resume_driver(driver, store, limits=LIMITS)
    again.advance(2)
    events = list(read_events(folder_of(store)))
    names = ["built", "committed", "resumed", "boundary_ended"]
    assert [e["event"] for e in events if e["event"] != "moved"] == [*names, "committed"]
    assert "steps before it are missing" in next(e for e in events if e["event"] == "boundary_ended")["message"]
    assert BoundaryLog(folder_of(store)).steps == 0


def test_a_new_holder_and_a_lost_lease_are_events(store: SessionStore) -> None:
    driver = new(store)
    driver.host.reclaim(TOKEN)
    driver.join()
    driver.host.suspend()
    assert events_of(store) == ["built", "resumed", "suspended"]


def test_of_a_step_made_twice_the_second_counts(tmp_path: Path) -> None:
    """With ``relaxed`` a crash loses steps of the session; they are repeated, perhaps with other results."""
    history = History(tmp_path, 1 << 20)
    for step, value in ((1, 1.0), (2, 2.0), (3, 3.0), (2, 9.0)):
        rows = np.full((2, 2), value)
        boundary = BoundaryInput("committed", rows.tobytes(), "")
        history.record_input(step, lambda boundary=boundary: boundary, 2)
        history.record_outcome(step, b"%d" % value)
    log = BoundaryLog(tmp_path)
    assert log.steps == 2
    assert log.read(2).rows.tolist() == [[9.0, 9.0]] * 2
    assert [log.read(step).digest for step in (1, 2)] == [b"1", b"9"]


def test_steps_that_were_made_without_a_history_end_the_boundary(store: SessionStore) -> None:
    """The history has four steps; after a return to step two, another third step was made while no history was kept."""
    driver = new(store, spec={"durability": "relaxed"})
    driver.advance(1)
    driver.advance(2)
    driver.host._session.catch_up()
    folder = folder_of(store)
    shutil.copytree(folder, store.root / "before")
    driver.advance(3)
    driver.advance(4)
    lost(driver)
    for path in folder.iterdir():
        if path.is_file() and path.name != "lock":
            path.unlink()
    for path in (store.root / "before").iterdir():
        if path.is_file() and path.name != "lock":
            shutil.copy2(path, folder / path.name)
    without = resume_driver(driver, store, limits=ServerSettings(history_bytes=0))
    assert without.host.step == 2
    without.all(Move, [0.5 * rows for rows in without.displacement(3)], step=3)
    without.all(Commit, step=3)
    without.host.close()
    again = resume_driver(without, store, limits=LIMITS)
    assert again.host.step == 3
    again.advance(4)
    ended = [e for e in read_events(folder) if e["event"] == "boundary_ended"]
    assert [e["step"] for e in ended] == [4]
    assert "not those of the session" in ended[0]["message"]
    assert BoundaryLog(folder).read(3).digest != again.host._session.commits[-2].digest


def test_a_log_says_what_computed_each_step_and_where_a_life_was_cut(tmp_path: Path) -> None:
    for life, steps in (("one", (1, 2, 3, 4)), ("two", (3,))):
        history = History(tmp_path, 1 << 20)
        history.take_up(steps[0] - 1, b"%d" % (steps[0] - 1) if steps[0] > 1 else b"")
        if life == "two":
            assert BoundaryLog(tmp_path).steps == 2  # before anything is made again
        for step in steps:
            history.record_input(step, lambda life=life: BoundaryInput("committed", bytes(32), life), 2)
            history.record_outcome(step, b"%d" % step)
        history.close()
    log = BoundaryLog(tmp_path)
    assert (log.steps, log.makers) == (3, [(1, "one"), (3, "two")])


def test_a_log_does_not_go_on_behind_a_life_that_was_cut(tmp_path: Path) -> None:
    """The third step was lost, and then repeated to the same bits while no history was kept."""
    for taken_up, step in ((0, 1), (1, 2), (2, 3), (2, 0), (3, 4)):
        history = History(tmp_path, 1 << 20)
        history.take_up(taken_up, b"%d" % taken_up)
        if step:
            history.record_input(step, lambda: BoundaryInput("committed", bytes(32), "one"), 2)
            history.record_outcome(step, b"%d" % step)
        history.close()
    assert BoundaryLog(tmp_path).steps == 2
    ended = [event for event in read_events(tmp_path) if event["event"] == "boundary_ended"]
    assert [(event["step"], "steps before it are missing" in event["message"]) for event in ended] == [(4, True)]


def test_a_commit_that_was_lost_and_made_again_is_written(tmp_path: Path) -> None:
    history = History(tmp_path, 1 << 20)
    for event, step in (("committed", 12), ("resumed", 4)):
        history.record(event, step=step)
    assert history.last_step() == (True, 4)


def test_taking_up_a_long_log_takes_no_memory(tmp_path: Path) -> None:
    """A former version made a list of the records' heads: 3 MB here, 17 MB for a whole segment, in a worker at each
    RESUME.
    """
    (tmp_path / "history").mkdir()
    steps = range(1, 10_001)
    records = (pack_input(step, "committed", bytes(32), 16) + pack_outcome(step, b"%d" % step) for step in steps)
    (tmp_path / "history" / "boundary-00000000.bin").write_bytes(b"".join(records))
    history = History(tmp_path, 1 << 24)
    tracemalloc.start()
    try:
        history.take_up(10_000, b"10000")
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    history.record_input(10_001, lambda: BoundaryInput("committed", bytes(32), "one"), 2)
    history.close()
    assert BoundaryLog(tmp_path).steps == 10_001
    assert peak < 100_000


@pytest.mark.parametrize("bit", [6, 22, 62])
def test_a_step_number_that_is_damaged_costs_no_time(bit: int, tmp_path: Path) -> None:
    (tmp_path / "history").mkdir()
    first = bytearray(pack_input(1, "committed", bytes(32), 16))
    first[16 + bit // 8] ^= 1 << bit % 8
    (tmp_path / "history" / "boundary-00000000.bin").write_bytes(first + pack_input(2, "committed", bytes(32), 16))
    assert BoundaryLog(tmp_path).steps == 0


def test_a_log_that_is_removed_while_it_is_read_has_no_steps(tmp_path: Path) -> None:
    (tmp_path / "history").mkdir()
    path = tmp_path / "history" / "boundary-00000000.bin"
    path.write_bytes(pack_input(1, "committed", bytes(32), 16) + pack_outcome(1, b"digest"))
    log = BoundaryLog(tmp_path)
    assert (log.read(1).digest, log.verified()) == (b"digest", 1)
    path.unlink()
    assert (log.digest(1), log.verified()) == (b"", 0)
    with pytest.raises(DataLoss, match="step 1 has a wrong checksum"):
        log.read(1)


def test_a_damaged_digest_is_none_and_a_damaged_input_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "history").mkdir()
    path, given, outcome = (
        tmp_path / "history" / "boundary-00000000.bin",
        bytes(32),
        bytearray(pack_outcome(1, b"digest")),
    )
    outcome[-1] ^= 1
    data = bytearray(pack_input(1, "committed", given, 16))
    path.write_bytes(data + outcome)
    log = BoundaryLog(tmp_path)
    assert (log.digest(1), log.steps, log.committed) == (b"", 1, 0)
    data[-1] ^= 1
    path.write_bytes(data)
    with pytest.raises(DataLoss, match="has a wrong checksum"):
        BoundaryLog(tmp_path).read(1)


def test_a_history_that_a_full_disk_ended_goes_on_when_the_session_is_resumed(
    store: SessionStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    driver = new(store)
    driver.advance(1)
    with monkeypatch.context() as patch:
        Failing(patch, errno.ENOSPC, 1, for_ever=True)
        driver.advance(2)
    driver.advance(3)
    driver.host.reclaim(TOKEN)
    driver.join()
    assert events_of(store) == ["built", "moved", "committed", "committed", "committed", "resumed"]
    driver.advance(4)
    assert events_of(store)[6:] == ["moved", "boundary_ended", "committed"]
    assert BoundaryLog(folder_of(store)).steps == 1


# --- torn, rotated, full ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["events", "boundary"])
@pytest.mark.parametrize("foreign", ["pipe", "folder", "link to a pipe", "link to nothing"])
def test_a_segment_that_is_no_file_is_passed_over(store: SessionStore, kind: str, foreign: str, tmp_path: Path) -> None:
    """Opening a pipe would take for ever: at RESUME, on the page, in a terminal."""
    driver = new(store)
    driver.advance(1)
    lost(driver)
    (segment,) = list_segments(folder_of(store) / "history", kind)
    segment.unlink()
    if foreign == "pipe":
        os.mkfifo(segment)
    elif foreign == "folder":
        segment.mkdir()
    else:
        if foreign == "link to a pipe":
            os.mkfifo(tmp_path / "pipe")
        segment.symlink_to(tmp_path / "pipe")
    again = resume_driver(driver, store, limits=LIMITS)
    assert again.advance(2)[-1].type == "COMMITTED"
    assert segment not in list_segments(folder_of(store) / "history", kind)
    assert BoundaryLog(folder_of(store)).steps in (0, 1)


def test_torn_lines_are_passed_over_and_gone_on_behind(store: SessionStore) -> None:
    driver = new(store)
    driver.advance(1)
    lost(driver)
    folder = folder_of(store)
    (events,) = list_segments(folder / "history", "events")
    (boundary,) = list_segments(folder / "history", "boundary")
    events.write_bytes(events.read_bytes() + b'{"at":1.0,"event":"moved","st')
    whole = boundary.read_bytes()
    boundary.write_bytes(whole + pack_input(2, "committed", bytes(80), 16)[:-1])
    assert events_of(store) == ["built", "moved", "committed"]
    again = resume_driver(driver, store, limits=LIMITS)
    again.advance(2)
    assert events_of(store) == ["built", "moved", "committed", "resumed", "moved", "committed"]
    assert boundary.read_bytes().startswith(whole)
    assert BoundaryLog(folder).steps == 2


def test_any_tail_of_a_boundary_log_is_read_as_far_as_it_goes(tmp_path: Path) -> None:
    history = History(tmp_path, 1 << 20)
    rows = np.arange(6.0).reshape(3, 2)
    for step in (1, 2):
        history.record_input(step, lambda: BoundaryInput("reference", rows.tobytes(), ""), 2)
        history.record_outcome(step, b"digest")
    history.close()
    (path,) = list_segments(tmp_path / "history", "boundary")
    data = path.read_bytes()
    ends = [len(pack_input(1, "reference", rows.tobytes(), 16))]
    ends.append(ends[0] + len(pack_outcome(1, b"digest")))
    ends.append(ends[1] + ends[0])
    for size in range(len(data) + 1):
        path.write_bytes(data[:size])
        log = BoundaryLog(tmp_path)
        assert log.steps == (size >= ends[0]) + (size >= ends[2])
        if log.steps:
            step = log.read(1)
            assert (step.frame, step.rows.tolist()) == ("reference", rows.tolist())
            assert step.digest == (b"digest" if size >= ends[1] else b"")


def test_the_oldest_segments_go_and_the_newest_events_stay(store: SessionStore) -> None:
    driver = new(store, limits=ServerSettings(reserve_disk_bytes=0, history_bytes=64 << 10))
    for step in range(1, 41):
        advance(driver, step)
    history = folder_of(store) / "history"
    segments = list_segments(history, "events")
    assert 2 <= len(segments) <= 8
    assert segments[1].name != "events-00000001.jsonl"
    assert sum(path.stat().st_size for path in history.iterdir()) <= 64 << 10
    events = list(read_events(folder_of(store)))
    steps = [e["step"] for e in events if e["event"] == "committed"]
    assert steps == list(range(steps[0], 41))
    assert last_committed(folder_of(store)) == (True, 40)


def test_the_built_event_stays_when_its_segment_is_removed(store: SessionStore) -> None:
    """Also if the session is resumed in between; it counts once."""
    limits = ServerSettings(reserve_disk_bytes=0, history_bytes=64 << 10)
    driver, folder = new(store, limits=limits), folder_of(store)
    (built,) = read_events(folder)
    for step in range(1, 21):
        advance(driver, step)
    lost(driver)
    again = resume_driver(driver, store, limits=limits)
    for step in range(21, 61):
        advance(again, step)
    (head, *_) = list_segments(folder / "history", "events")
    assert [json.loads(line) for line in head.read_bytes().splitlines()] == [built | {"kept": True}]
    assert sorted(path.name for path in folder.glob("history/*.part")) == []
    events = list(read_events(folder))
    assert [event["event"] for event in events].count("built") == 1
    steps = [event["step"] for event in events if event["event"] == "committed"]
    assert 20 < steps[0] < 60
    assert steps == list(range(steps[0], 61))
    digest = digest_of_history(folder)
    assert digest.spans == [(steps[0], 60)]
    page = Followed()
    page.take(events)
    assert page.built == built | {"kept": True}
    assert page.series(None, 1000)["columns"]["step"] == steps


def test_a_refusal_behind_what_was_kept_belongs_to_its_own_step(tmp_path: Path) -> None:
    fold = StepFold()
    assert fold.take({"event": "built", "kept": True}).step == 0
    assert fold.take({"event": "refused", "step": 5000}).step == 5000


def test_the_built_event_is_removed_where_it_leaves_no_room_for_others(tmp_path: Path) -> None:
    history = History(tmp_path, 8 << 10)  # 2 KiB of events
    history.record("built", patches="p" * 1500)
    for step in range(9):
        history.record("committed", step=step, quality={}, digest="0" * 300)
        history.record("failed", step=step, message="m" * 900)
    found = [event["event"] for event in read_events(tmp_path)]
    assert "built" not in found
    assert found[-2:] == ["committed", "failed"]


def reference_last_committed(data: bytes) -> tuple[bool, int]:
    end = len(data)
    while (
        place := max(data.rfind(known, 0, end) for known in (b',"event":"committed",', b',"event":"resumed",'))
    ) >= 0:
        event = parse_line(data[data.rfind(b"\n", 0, place) + 1 : data.find(b"\n", place) + 1])
        if event is not None:
            return True, int(event["step"])
        end = place
    return bool(data), 0


LINES = st.one_of(
    st.builds(
        lambda event, step, length: line_of(1.5, event, {"step": step, "message": "m" * length}),
        st.sampled_from(["committed", "resumed", "moved", "refused"]),
        st.integers(0, 99),
        st.integers(0, 200),
    ),
    st.sampled_from([b"\n", b"\n\n", b"{", b"x" * 70, b"\0" * 33, '{"at":1.0,"event":"ü"}\n'.encode()]),
)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(lines=st.lists(st.tuples(LINES, st.integers(0, 40)), max_size=8), block=st.sampled_from([1, 2, 7, 64, 1 << 16]))
def test_reading_backwards_finds_what_reading_all_finds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lines: list[tuple[bytes, int]], block: int
) -> None:
    """Files of whole lines and cut ones; the end of each lacks this number of bytes."""
    data = b"".join(line[: len(line) - (lost if lost > 20 else 0)] for line, lost in lines)
    path = tmp_path / "history" / "events-00000000.jsonl"
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(data)
    monkeypatch.setattr("mesh_motion_server.session.history.events._BLOCK", block)
    assert last_committed(tmp_path) == reference_last_committed(data)
    with path.open("rb") as file:
        assert list(lines_backwards(file)) == data.split(b"\n")[-2::-1]


def test_the_last_step_of_a_long_history_takes_no_memory(tmp_path: Path) -> None:
    history = History(tmp_path, 1 << 30)
    for step in range(200):
        history.record("committed", step=step, quality={"standard": "x" * 40_000}, digest="00")
    history.close()
    tracemalloc.start()
    try:
        assert last_committed(tmp_path) == (True, 199)
        assert tracemalloc.get_traced_memory()[1] < 1 << 20
    finally:
        tracemalloc.stop()


def test_the_boundary_stops_where_its_part_is_used_and_says_so(store: SessionStore) -> None:
    driver, folder = new(store, limits=ServerSettings(reserve_disk_bytes=0, history_bytes=32 << 10)), folder_of
    step, ended = 0, list[dict[str, Any]]()
    while not ended:
        step += 1
        advance(driver, step)
        ended = [e for e in read_events(folder(store)) if e["event"] == "boundary_ended"]
    assert 100 < step < 300
    assert "its part of history_bytes = 32768 is used" in ended[0]["message"]
    whole = BoundaryLog(folder(store)).steps
    assert whole == step - 1
    lost(driver)
    again = resume_driver(driver, store, limits=LIMITS)
    assert again.host.step == step
    for later in range(step + 1, step + 4):
        advance(again, later)
    missing = [e for e in read_events(folder(store)) if e["event"] == "boundary_ended"]
    assert missing[-1]["step"] == step + 1  # there is room now, but the gap stays
    assert "steps before it are missing" in missing[-1]["message"]
    assert BoundaryLog(folder(store)).steps == whole


def test_numbers_that_json_does_not_know_are_null() -> None:
    line = line_of(1.0, "moved", {"quality": {"min": math.nan, "worst": [{"metric": -math.inf}]}, "odd": object})
    found = parse_line(line)
    assert found["quality"] == {"min": None, "worst": [{"metric": None}]}
    assert list(found)[:2] == ["at", "event"]
    assert parse_line(b'"a string"\n') is None
    assert parse_line(line_of(1.0, "refused", {"message": 'a "quoted"\nline \ud800'})) is not None


def test_a_summary_that_comes_twice_is_written_out_twice() -> None:
    """It is encoded once, for speed; its content and position do not matter."""
    summary = {"min": 0.5, "worst": [{"type": '"standard":0', "cell": 1}]}
    quality = {"metric": '"corrected":0', "standard": summary, "corrected": summary}
    values = {"step": 1, "quality": quality, "warnings": ['say "standard":0 and "corrected":0']}
    found = parse_line(line_of(1.0, "moved", values))
    assert found == {"at": 1.0, "event": "moved", **values}
    summary["min"] = math.nan
    found = parse_line(line_of(1.0, "moved", values))
    assert found["quality"]["corrected"]["min"] is None


# --- nothing of it reaches the session -------------------------------------------------------------------------------

ERRORS = (errno.ENOSPC, errno.EIO, errno.EROFS, errno.EACCES)


def live(root: Path, level: str) -> list[bytes]:
    """A session with every kind of event; return the acknowledged digests."""
    store = SessionStore(root)
    driver = new(store, spec={"durability": level})
    found = digests(driver, range(1, 2))
    driver.move(9)
    driver.move(2)
    driver.all(Rollback, step=2)
    driver.host.reclaim(TOKEN)
    driver.join()
    driver.host.suspend()
    driver.host.close()
    again = resume_driver(driver, store, limits=LIMITS)
    found += digests(again, range(2, 3))
    assert again.ask(Close, outcome="keep").type == "CLOSED"
    return found


class Failing:
    """System calls on a history's files, of which one fails, or all from one on."""

    def __init__(self, patch: pytest.MonkeyPatch, error: int, at: int, *, for_ever: bool) -> None:
        self.error, self.at, self.for_ever, self.count = error, at, for_ever, 0
        self.failed: list[str] = []
        for name in ("open", "write", "mkdir", "unlink", "fstat", "pread", "ftruncate"):
            patch.setattr(os, name, self.wrapped(name, getattr(os, name)))

    def wrapped(self, called: str, call: Any) -> Any:
        def attempt(target: Any, *rest: Any, **named: Any) -> Any:
            name = os.readlink(f"/proc/self/fd/{target}") if isinstance(target, int) else str(target)
            if "/history" in name:
                self.count += 1
                if self.count == self.at or (self.for_ever and self.count > self.at):
                    self.failed.append(called)
                    raise OSError(self.error, os.strerror(self.error))
            return call(target, *rest, **named)

        return attempt


@pytest.mark.parametrize(("level", "stride"), [("full", 2), ("replay", 7), ("relaxed", 11)])
def test_whatever_fails_the_session_answers_as_ever(
    tmp_path: Path, level: str, stride: int, monkeypatch: pytest.MonkeyPatch, caplog: Any
) -> None:
    expected = live(tmp_path / "undisturbed", level)
    at, failed = 1, True
    while failed:
        caplog.clear()
        with monkeypatch.context() as patch:
            failing = Failing(patch, ERRORS[at % len(ERRORS)], at, for_ever=bool(at % 3))
            assert live(tmp_path / str(at), level) == expected
        failed = failing.count >= at
        warnings = [record for record in caplog.records if record.levelno >= logging.WARNING]
        assert len(warnings) <= 3, "one warning each time that the session was taken up"
        assert bool(warnings) == failed
        assert all("the session goes on" in record.getMessage() for record in warnings)
        at += stride
    assert at > 20


def test_a_short_write_is_gone_on_with(store: SessionStore, monkeypatch: pytest.MonkeyPatch) -> None:
    write = os.write
    monkeypatch.setattr(os, "write", lambda handle, data: write(handle, bytes(data)[:7]))
    new(store).advance(1)
    assert events_of(store) == ["built", "moved", "committed"]
    assert BoundaryLog(folder_of(store)).steps == 1


def test_a_slow_disk_costs_some_slow_steps_and_not_each(
    store: SessionStore, monkeypatch: pytest.MonkeyPatch, caplog: Any
) -> None:
    """Each write that a step waits for takes twice the limit."""
    write, slow, now = os.write, [], [0.0]
    timer = SimpleNamespace(monotonic=lambda: now[0])
    monkeypatch.setattr("mesh_motion_server.session.history.segments.time", timer)
    driver = new(store)
    driver.advance(1)

    def hang(handle: int, data: bytes) -> int:
        slow.append(handle)
        now[0] += 0.1
        return write(handle, data)

    monkeypatch.setattr("mesh_motion_server.session.history.segments.PATIENCE", 0.05)
    monkeypatch.setattr("mesh_motion_server.session.history.segments.ALLOWANCE", 0.15)
    with monkeypatch.context() as patch:
        patch.setattr(os, "write", hang)
        for step in range(2, 6):
            assert driver.advance(step)[-1].type == "COMMITTED"
    assert len(slow) in (2, 3)  # the events' and the boundary's are waited for apart
    (warning,) = [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING]
    assert re.search(r"ends, the session goes on: steps waited 0\.[23] s for the disk in all, this one 0\.1 s", warning)
    before = len(events_of(store))
    driver.host.reclaim(TOKEN)
    driver.join()
    driver.advance(6)  # it is tried again when the session is taken up
    assert events_of(store)[before:].count("committed") >= 3  # those that were left out meanwhile, and this one
    assert events_of(store)[-1] == "committed"


def test_a_pause_now_and_then_costs_no_history(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: Any) -> None:
    """A machine that pauses for four seconds every ten minutes; then a disk that takes four seconds each time."""
    now = [0.0]
    timer = SimpleNamespace(monotonic=lambda: now[0])
    monkeypatch.setattr("mesh_motion_server.session.history.segments.time", timer)
    write = os.write

    def pause(handle: int, data: bytes) -> int:
        now[0] += 4.0
        return write(handle, data)

    monkeypatch.setattr(os, "write", pause)
    history = History(tmp_path, 1 << 30)
    for step in range(1, 1001):
        history.record("committed", step=step, quality={}, digest="00")
        now[0] += 600.0
    assert not caplog.records
    while not caplog.records and step < 2000:
        step += 1
        history.record("committed", step=step, quality={}, digest="00")
    assert "s for the disk in all" in caplog.records[0].getMessage()


def test_many_bytes_may_take_their_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: Any) -> None:
    """The boundary of a million nodes is 24 MB: a disk needs half a second for it in any case."""
    monkeypatch.setattr("mesh_motion_server.session.history.segments.PATIENCE", 0.0)
    monkeypatch.setattr("mesh_motion_server.session.history.segments.ALLOWANCE", 0.0)
    clock = iter(float(k) for k in range(100))
    timer = SimpleNamespace(monotonic=lambda: next(clock) * 0.7)
    monkeypatch.setattr("mesh_motion_server.session.history.segments.time", timer)
    history = History(tmp_path, 1 << 30)
    history.record_input(1, lambda: BoundaryInput("committed", bytes(24 << 20), ""), 3)
    assert not caplog.records
    history.record("committed", step=1, quality={}, digest="00")
    assert "this one 0.7 s" in caplog.records[0].getMessage()


@pytest.mark.parametrize("error", [MemoryError(), RuntimeError("unforeseen"), ValueError()])
def test_an_unforeseen_error_ends_the_history_only(
    store: SessionStore, error: Exception, monkeypatch: pytest.MonkeyPatch, caplog: Any
) -> None:
    driver = new(store)
    monkeypatch.setattr("mesh_motion_server.session.history.writer.line_of", raising(error))
    assert driver.advance(1)[-1].type == "COMMITTED"
    assert driver.advance(2)[-1].type == "COMMITTED"
    assert events_of(store) == ["built"]
    assert len(caplog.records) == 1


@pytest.mark.parametrize(("reserves", "begins"), [(3.9, False), (4.1, True)])
def test_the_history_stops_long_before_sessions_are_refused(
    store: SessionStore, reserves: float, begins: bool, monkeypatch: pytest.MonkeyPatch, caplog: Any
) -> None:
    limits = ServerSettings(reserve_disk_bytes=1 << 20)
    room = SimpleNamespace(free=int(reserves * limits.reserve_disk_bytes))
    monkeypatch.setattr("mesh_motion_server.session.history.segments.disk_room", lambda _: room)
    new(store, limits=limits).advance(1)
    assert (folder_of(store) / "history").exists() == begins
    assert ["bytes of the disk are free" in record.getMessage() for record in caplog.records] == [True] * (not begins)


def test_a_link_in_place_of_a_file_is_not_followed(store: SessionStore, tmp_path: Path) -> None:
    driver = new(store, limits=ServerSettings(history_bytes=0))
    driver.host.close()
    history = folder_of(store) / "history"
    history.mkdir()
    (tmp_path / "elsewhere").write_bytes(b"")
    (history / "events-00000000.jsonl").symlink_to(tmp_path / "elsewhere")
    again = resume_driver(driver, store, limits=LIMITS)
    again.advance(1)
    assert (tmp_path / "elsewhere").read_bytes() == b""


# --- kill -9 ---------------------------------------------------------------------------------------------------------


@pytest.mark.nightly
@pytest.mark.parametrize("level", DURABILITY_LEVELS)
def test_all_that_was_acknowledged_before_a_kill_is_in_it(
    level: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Processes that commit as fast as they can, killed at random moments."""
    monkeypatch.setattr(kill_nine, "_LONGEST", 1.5)
    witness = kill_again_and_again(tmp_path, Random(f"history {level}"), Budget(8), level)
    (folder,) = (tmp_path / "sessions").iterdir()
    assert witness.replies
    events = list(read_events(folder))
    committed = {event["step"]: event["digest"] for event in events if event["event"] == "committed"}
    log = BoundaryLog(folder)
    for step, frame in witness.replies.items():
        digest = bytes.fromhex(committed[step])
        assert digest in frame, f"step {step}"
        assert log.digest(step) == digest or step > witness.last
    assert witness.last <= log.steps <= witness.last + 1
    assert sum(event["event"] == "built" for event in events) == 1
    assert sum(event["event"] == "resumed" for event in events) <= witness.lives - 1
    if level != "relaxed":
        steps = [event["step"] for event in events if event["event"] == "committed"]
        assert steps == list(range(1, steps[-1] + 1)), "each once"
