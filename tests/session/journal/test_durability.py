"""The levels of durability of a session: replies, the state after a restart, and refusals."""

import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mesh_motion_protocol.errors import DataLoss
from mesh_motion_protocol.messages import Close, Commit, Fetch, Move, Status
from raising import raising

from mesh_motion_server.session import replay as replay_module
from mesh_motion_server.session.inspection import inspect_session
from mesh_motion_server.session.journal.files import read_journal
from mesh_motion_server.session.journal.filesystem import PosixFileSystem
from mesh_motion_server.session.journal.journal import Journal
from mesh_motion_server.session.journal.relaxed import RelaxedKeeper
from mesh_motion_server.session.store import SessionStore
from mesh_motion_server.settings import ServerSettings
from tests.faults.check import BrokenPromise, require
from tests.faults.driver import SESSION, TOKEN, make_driver, resume_driver
from tests.faults.stand_in import StandIn, grid_mesh, split_mesh

LIMITS = ServerSettings(snapshot_steps=4)


@pytest.fixture
def opened(tmp_path: Path) -> Any:
    """Opens a session of a level; ``again()`` resumes it after its process was killed."""
    store = SessionStore(tmp_path)
    drivers: list[Any] = []

    def open_it(level: str, parts: int = 1) -> Any:
        meshes = split_mesh(grid_mesh(), parts) if parts > 1 else [grid_mesh()]
        driver = make_driver(store, meshes, spec={"durability": level}, limits=LIMITS)
        driver.open()
        drivers.append(driver)
        return driver

    def again() -> Any:
        drivers[-1].host._session.close(keep=False)  # what is not on the disk is lost
        drivers.append(resume_driver(drivers[-1], store, limits=LIMITS))
        return drivers[-1]

    yield SimpleNamespace(open=open_it, again=again, folder=tmp_path / "sessions" / SESSION, store=store)
    for driver in drivers:
        driver.host.close()


@pytest.fixture
def held(monkeypatch: pytest.MonkeyPatch) -> threading.Event:
    event, honest = threading.Event(), Journal.store

    def store(self: Journal, *given: Any) -> None:
        assert event.wait(30)
        honest(self, *given)

    monkeypatch.setattr(Journal, "store", store)
    return event


def records(folder: Path) -> list[str]:
    reported = []
    for record in read_journal(folder, PosixFileSystem()).records:
        body = record.body
        if record.kind == "snapshot":
            reported.append(f"step {body['step']}, stored")
        elif record.kind == "commit":
            reported.append(f"step {body['step']}" + (", logged" if "rows" in body else ""))
        else:
            commits = body.get("commits")
            reported.append(f"epoch {body['epoch']}" + (f", step {commits[-1]['step']}" if commits else ""))
    return reported


def until_durable(driver: Any, step: int) -> Any:
    deadline = time.monotonic() + 30
    while (status := driver.ask(Status)).durable_step < step:
        assert time.monotonic() < deadline
        time.sleep(1e-3)
    return status


# --- replay ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("parts", [1, 3])
def test_logged_steps_are_computed_again_bitwise(opened: Any, parts: int) -> None:
    driver = opened.open("replay", parts)
    committed = [driver.advance(step)[0] for step in range(1, 4)]
    assert [(reply.step, reply.durable_step) for reply in committed] == [(1, 1), (2, 2), (3, 3)]
    digests = [reply.digest for reply in committed]
    driver.all(Move, [2 * rows for rows in driver.displacement(4)], step=4, frame="reference")
    digests.append(driver.all(Commit, step=4)[0].digest)
    digests += [driver.advance(step)[0].digest for step in range(5, 8)]
    points = [driver.ask(Fetch, p).points for p in range(parts)]
    again = opened.again()
    assert (again.host.step, again.ask(Status).durable_step) == (7, 7)
    for p in range(parts):
        np.testing.assert_array_equal(again.ask(Fetch, p).points, points[p])
    assert records(opened.folder)[:5] == ["epoch 1", "step 1, logged", "step 2, logged", "step 3, logged", "step 4"]
    assert len(set(digests)) == 7
    next_here = again.move(8)[0].displacement
    undisturbed = opened.again().move(8)[0].displacement
    np.testing.assert_array_equal(next_here, undisturbed)


def test_a_closed_session_has_nothing_to_compute(opened: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    driver = opened.open("replay")
    for step in (1, 2):
        driver.advance(step)
    points = driver.ask(Fetch).points
    assert driver.ask(Close).step == 2
    assert records(opened.folder)[-1] == "step 2, stored"
    monkeypatch.setattr(StandIn, "move", None)
    again = resume_driver(driver, opened.store)
    np.testing.assert_array_equal(again.ask(Fetch).points, points)
    again.host.close()


def test_the_log_is_bounded_by_steps_and_bytes(opened: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    driver = opened.open("replay")
    for step in range(1, 14):
        driver.advance(step)
        logged = read_journal(opened.folder, PosixFileSystem()).ledger.logged
        assert len(logged) == step % 4
    ledger = driver.host._session._built.keeper.journal.ledger
    monkeypatch.setattr(type(ledger.foundation), "__getattribute__", lambda self, name: (
        1000 if name == "log_bytes" else object.__getattribute__(self, name)))  # fmt: skip
    driver.advance(14)
    assert read_journal(opened.folder, PosixFileSystem()).ledger.logged == ()


def test_the_log_is_bounded_by_time(opened: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """For moves of any duration, the replay of the logged ones ends before the supervisor's time limit for the
    worker.
    """
    driver = opened.open("replay")
    driver.advance(1)
    monkeypatch.setattr("mesh_motion_server.session.journal.durability._LONGEST_LOG", 0.0)
    driver.advance(2)
    monkeypatch.undo()
    driver.advance(3)
    assert records(opened.folder) == ["epoch 1", "step 1, logged", "step 2", "step 3, logged"]


def test_each_step_that_is_computed_again_is_reported(opened: Any) -> None:
    """A waiting client gets reports that the session starts, however long the replay of another machine's log takes
    here.
    """
    driver = opened.open("replay")
    for step in (1, 2, 3):
        driver.advance(step)
    driver.host._session.close(keep=False)
    reported: list[int] = []
    again = resume_driver(driver, opened.store, progress=reported.append)
    assert reported == [1, 2, 3]
    again.host.close()


def test_steps_that_took_long_to_compute_again_are_stored(opened: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Otherwise a worker that fails again and again would have ever more to compute."""
    driver = opened.open("replay")
    for step in (1, 2):
        driver.advance(step)
    points = driver.ask(Fetch).points
    opened.again()
    assert records(opened.folder)[-1] == "epoch 2"
    monkeypatch.setattr(replay_module, "_LONG_SECONDS", -1.0)
    again = opened.again()
    assert records(opened.folder)[-2:] == ["step 2, stored", "epoch 3"]
    np.testing.assert_array_equal(again.ask(Fetch).points, points)
    again.advance(3)
    assert records(opened.folder)[-1] == "step 3, logged"


def test_an_input_as_costly_as_the_state_is_not_logged(opened: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mesh_motion_server.session.journal.durability._SMALL_INPUT", 0)
    driver = opened.open("replay")
    for step in (1, 2):
        driver.advance(step)
    assert records(opened.folder) == ["epoch 1", "step 1", "step 2"]


def diverging(opened: Any, monkeypatch: pytest.MonkeyPatch) -> Any:
    """A session with a log that another version computes a little differently; return the result of its RESUME."""
    driver = opened.open("replay")
    for step in (1, 2):
        driver.advance(step)
    honest, points = StandIn.move, driver.ask(Fetch).points

    def rounded(self: Any, committed: Any, targets: Any, factors: Any, **choices: Any) -> Any:
        motion = honest(self, committed, targets, factors, **choices)
        motion.points[12] = np.nextafter(motion.points[12], 1)
        return motion

    monkeypatch.setattr(StandIn, "move", rounded)
    again = opened.again()
    require(np.array_equal(again.ask(Fetch).points, points), "the coordinates differ from those that were committed")
    return again


def test_a_recomputation_that_differs_is_refused(opened: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch, pytest.raises(DataLoss, match="computing step 1 again gave digest") as caught:
        diverging(opened, patch)
    assert caught.value.code == "DATA_LOSS.RECOVERY_DIVERGED"
    assert caught.value.details["step"] == 1
    assert "mesh-motion-server" in str(caught.value.details["made_by"])
    assert "resume it there and close it" in caught.value.hint
    again = opened.again()  # where it was made it still opens
    assert (again.host.step, again.host.epoch) == (2, 2)


def test_a_recomputation_whose_digest_is_not_compared_is_found(opened: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    class Equal(bytes):
        def __ne__(self, other: object) -> bool:
            return False

        __hash__ = bytes.__hash__

    monkeypatch.setattr(replay_module, "state_digest", lambda step, state: Equal())
    with pytest.raises(BrokenPromise, match="the coordinates differ"):
        diverging(opened, monkeypatch)


def test_a_recomputation_that_is_refused_has_diverged(opened: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    driver = opened.open("replay")
    driver.advance(1)
    with monkeypatch.context() as patch:
        patch.setattr(StandIn, "_areas", lambda self, points: np.array([1.0 if points is self.points else -1.0]))
        with pytest.raises(DataLoss, match=r"gave FAILED_PRECONDITION.QUALITY") as caught:
            opened.again()
    assert caught.value.code == "DATA_LOSS.RECOVERY_DIVERGED"


# --- relaxed ---------------------------------------------------------------------------------------------------------


def test_a_commit_is_answered_before_the_disk_has_it(opened: Any, held: threading.Event) -> None:
    driver = opened.open("relaxed")
    reported = [driver.advance(step)[0].durable_step for step in range(1, 6)]
    assert reported == [0] * 5
    status = driver.ask(Status)
    assert (status.step, status.durable_step) == (5, 0)
    held.set()
    assert until_durable(driver, 5).report["durability"] == "relaxed"
    (committed,) = driver.advance(6)
    assert 5 <= committed.durable_step <= 6


def test_without_memory_for_a_thread_nothing_is_taken(opened: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    driver = opened.open("relaxed")
    monkeypatch.setattr(threading.Thread, "start", raising(RuntimeError("can't start new thread")))
    (refused,) = driver.advance(1)
    assert refused.type == "ERROR"
    assert driver.host._session.commits == ()
    driver.host.close()
    monkeypatch.undo()
    assert opened.again().advance(1)[0].type == "COMMITTED"


def test_steps_passed_over_are_stored_with_their_replies(opened: Any, held: threading.Event) -> None:
    driver = opened.open("relaxed")
    asked = []
    for step in range(1, 6):
        driver.move(step)
        asked.append(driver.request(Commit, step=step))
        driver.send(asked[-1])
    held.set()
    until_durable(driver, 5)
    assert len(records(opened.folder)) < 5
    again = opened.again()
    assert again.host.step == 5
    for step, request in enumerate(asked, start=1):
        (reply,) = again.send(type(request)(**vars(request) | {"epoch": again.host.epoch}))
        assert (reply.type, reply.step, reply.durable_step) == ("COMMITTED", step, 0)


LEAVE: dict[str, Callable[[Any], Any]] = {
    "close": lambda driver: driver.ask(Close),
    "end": lambda driver: driver.host.close(),
    "suspend": lambda driver: driver.host.suspend(),
    "reclaim": lambda driver: driver.host.reclaim(TOKEN),
}


@pytest.mark.parametrize(
    ("leave", "failed"), [*((leave, False) for leave in LEAVE), ("close", True), ("end", True), ("suspend", True)]
)
def test_everything_is_durable_before(opened: Any, held: threading.Event, leave: str, failed: bool) -> None:
    """Also for a failed session: its thread stores step 1 while the others wait, and the end of the session must not
    lose them.
    """
    driver = opened.open("relaxed")
    digests = [driver.advance(step)[0].digest for step in range(1, 6)]
    if failed:
        driver.host._session.fail()
    threading.Timer(0.3, held.set).start()
    LEAVE[leave](driver)
    assert held.is_set()
    assert (driver.host.state == "FAILED") == (failed and leave == "suspend")
    found = inspect_session(opened.folder)
    assert (found.step, found.digest) == (5, digests[-1].hex())


@pytest.mark.parametrize("suspended", [False, True])
def test_a_session_that_failed_stays_so_when_its_disk_fails_too(
    opened: Any, held: threading.Event, monkeypatch: Any, suspended: bool
) -> None:
    """A FROZEN session would return coordinates that are not trusted."""
    driver = opened.open("relaxed")
    driver.advance(1)
    driver.host._session.fail()
    monkeypatch.setattr(PosixFileSystem, "sync", raising(OSError(5, "Input/output error")))
    held.set()
    if suspended:
        driver.host.suspend()  # the log says it
    else:
        refused = driver.ask(Close)
        assert (refused.code, refused.state) == ("RESOURCE_EXHAUSTED.DISK", "FAILED")
    assert driver.ask(Status).state == "FAILED"
    assert driver.ask(Fetch).code == "FAILED_PRECONDITION.STATE"
    assert driver.ask(Close).step == 0


def test_the_failure_of_the_disk_is_reported_once(opened: Any, held: threading.Event, monkeypatch: Any) -> None:
    """A refused MOVE has named it: the CLOSE after it closes."""
    driver = opened.open("relaxed")
    driver.advance(1)
    monkeypatch.setattr(PosixFileSystem, "sync", raising(OSError(5, "Input/output error")))
    held.set()
    deadline = time.monotonic() + 30
    while driver.ask(Status).state != "FROZEN":
        assert time.monotonic() < deadline
        time.sleep(1e-3)
    assert driver.move(2)[0].state == "FROZEN"
    assert driver.ask(Close).type == "CLOSED"


def test_of_a_session_that_failed_no_state_is_stored(opened: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    driver = opened.open("replay")
    driver.advance(1)
    driver.host._session.fail()
    monkeypatch.setattr(Journal, "snapshot", None)
    assert driver.ask(Close).step == 1
    monkeypatch.undo()
    assert records(opened.folder)[-1] == "step 1, logged"


def test_nothing_is_waited_for_where_nothing_is_kept(opened: Any, held: threading.Event, monkeypatch: Any) -> None:
    driver = opened.open("relaxed")
    driver.advance(1)
    monkeypatch.setattr(RelaxedKeeper, "rest", None)
    monkeypatch.setattr(RelaxedKeeper, "catch_up", None)
    threading.Timer(0.05, held.set).start()
    assert driver.ask(Close, outcome="discard").type == "CLOSED"
    assert not opened.folder.exists()


def test_something_unforeseen_in_the_background_is_logged(opened: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    driver = opened.open("relaxed")
    monkeypatch.setattr(Journal, "_store", raising(ZeroDivisionError("a defect")))
    driver.advance(1)
    refused = driver.ask(Close)
    assert (refused.code, refused.state) == ("INTERNAL", "FROZEN")
    assert "ZeroDivisionError: a defect" in refused.message
