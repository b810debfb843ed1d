"""The sessions of a state folder, from their folders alone."""

import fcntl
from pathlib import Path

import pytest
from histories import made_up_events, put_events, write_history
from mesh_motion_protocol.messages import Close, Commit, Rollback

from mesh_motion_server.session.state import State
from mesh_motion_server.session.store import SessionStore
from mesh_motion_server.settings import ServerSettings
from mesh_motion_server.watch.observation.overview import Overview
from mesh_motion_server.watch.observation.sessions import Sessions
from tests.faults.driver import Driver, make_driver, resume_driver
from tests.faults.stand_in import grid_mesh


@pytest.fixture
def driver(tmp_path: Path) -> Driver:
    driver = make_driver(SessionStore(tmp_path), [grid_mesh()], spec={"label": "wing"})
    driver.open()
    return driver


def test_there_are_none() -> None:
    assert Sessions(Path("/nowhere")).views() == []


def test_a_session_through_its_life(driver: Driver, tmp_path: Path) -> None:
    sessions = Sessions(tmp_path)

    def seen() -> tuple[str, int, bool | None]:
        (view,) = sessions.views()
        return view.state, view.step, view.held

    assert seen() == ("READY", 0, True)
    driver.move(1)
    assert seen() == ("TRIAL", 0, True)
    driver.move(5)  # refused
    assert seen() == ("TRIAL", 0, True)
    driver.all(Commit, step=1)
    assert seen() == ("READY", 1, True)
    driver.host.suspend()
    assert seen() == ("SUSPENDED", 1, True)
    driver.host.close()
    assert seen() == ("SUSPENDED", 1, False)
    again = resume_driver(driver, SessionStore(tmp_path))
    assert seen() == ("READY", 1, True)
    again.ask(Close, outcome="keep")
    assert seen() == ("CLOSED", 1, False)
    (view,) = sessions.views()
    assert (view.label, view.dimension, view.partitions, view.durability, view.recorded) == ("wing", 2, 1, "full", True)


def test_a_relaxed_session_is_as_far_as_it_was_answered(tmp_path: Path) -> None:
    driver = make_driver(SessionStore(tmp_path), [grid_mesh()], spec={"durability": "relaxed"})
    driver.open()
    driver.advance(1)
    driver.advance(2)

    def step() -> int:
        (view,) = Sessions(tmp_path).views()
        return view.step

    assert step() == 2
    driver.move(3)
    assert step() == 2
    driver.all(Rollback, step=3)
    assert step() == 2


def test_a_step_that_a_crash_took_is_not_shown(tmp_path: Path) -> None:
    driver = make_driver(SessionStore(tmp_path), [grid_mesh()], spec={"durability": "relaxed"})
    driver.open()
    driver.advance(1)
    driver.host.close()
    (view,) = Sessions(tmp_path).views()
    put_events(Path(view.folder), made_up_events(5), number=1)
    (view,) = Sessions(tmp_path).views()
    assert (view.held, view.step) == (False, 1)


def test_a_client_that_is_back_and_a_disk_that_failed_are_seen(driver: Driver, tmp_path: Path) -> None:
    def state() -> str:
        (view,) = Sessions(tmp_path).views()
        return view.state

    driver.host.suspend()
    assert state() == "SUSPENDED"
    driver.join()
    assert state() == "READY"
    driver.move(1)
    driver.host._session._swap(state=State.FROZEN)
    driver.all(Commit, step=1)
    assert state() == "FROZEN"


def test_a_session_without_history(tmp_path: Path) -> None:
    driver = make_driver(SessionStore(tmp_path), [grid_mesh()], limits=ServerSettings(history_bytes=0))
    driver.open()
    driver.advance(1)
    (view,) = Sessions(tmp_path).views()
    assert (view.state, view.step, view.recorded) == ("READY", 1, False)
    assert view.changed_at > 0


def test_a_damaged_session_is_shown(driver: Driver, tmp_path: Path) -> None:
    driver.host.close()
    folder = Path(Sessions(tmp_path).views()[0].folder)
    (folder / "manifest").write_bytes(b"nothing")
    (view,) = Sessions(tmp_path).views()
    assert view.state == "FAILED"  # whatever the last event was
    (entry,) = Overview(tmp_path).listed()
    assert entry["verdict"]["why"] == "its files do not verify: mesh-motion inspect says which"
    (folder / "history" / "events-00000000.jsonl").unlink()
    (view,) = Sessions(tmp_path).views()
    assert view.state == "FAILED"


def test_a_made_up_history_is_taken_for_what_it_says(driver: Driver, tmp_path: Path) -> None:
    driver.host.close()
    folder = Path(Sessions(tmp_path).views()[0].folder)
    (folder / "history" / "events-00000000.jsonl").unlink()
    (folder / "history").rmdir()
    events = write_history(folder, 1000)
    (view,) = Sessions(tmp_path).views()
    assert view.changed_at == events[-1]["at"]
    with (folder / "lock").open() as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert Sessions(tmp_path).views()[0].held is True
