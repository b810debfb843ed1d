"""Every state × operation cell, through the requests themselves."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mesh_motion_protocol.messages import (
    Build,
    Close,
    Commit,
    Correct,
    Fetch,
    Join,
    Judge,
    Move,
    Rollback,
    Status,
    Upload,
)

from mesh_motion_server.errors import SessionError
from mesh_motion_server.session.state import TABLE, Operation, State
from mesh_motion_server.session.store import SessionStore
from proofs.driver import TOKEN, make_driver
from proofs.model_files import FailingFiles, ModelFiles
from proofs.stand_in import grid_mesh

JUDGED = {"part": {}, "questions": [], "bins": np.empty((0, 3), dtype=np.int64), "values": np.empty((0, 3)),
          "worst": np.empty((0, 8))}  # fmt: skip
REGION = {"part": {}, "nodes": np.empty((0, 2), dtype=np.int64), "points": np.empty((0, 2)),
          "positions": np.empty((0, 2)), "corners": np.empty((0, 1), dtype=np.int64)}  # fmt: skip


def bring(state: State) -> Any:
    """A driver whose session is in this state."""
    failing = FailingFiles(ModelFiles())
    driver = make_driver(SessionStore(Path("/model"), files=failing), [grid_mesh()])
    driver.join()
    if state is State.NEW:
        return driver
    driver.upload()
    if state is State.OPENING:
        return driver
    driver.all(Build)
    if state in (State.TRIAL, State.FROZEN):
        driver.move(1)
    if state is State.FROZEN:
        failing.fail_at = 0
        driver.all(Commit, step=1)
    if state is State.SUSPENDED:
        driver.host.suspend()
    if state is State.FAILED:
        driver.host._session.fail()
    if state is State.COMMITTING:
        driver.host._session._swap(state=State.COMMITTING)
    if state is State.CLOSED:
        driver.host.close()
    return driver


def perform(driver: Any, operation: Operation) -> Any:
    """Ask for it; the reply, or what was raised."""
    if operation is Operation.RESUME:
        try:
            return driver.host.reclaim(TOKEN)
        except SessionError as error:
            return error
    if operation is Operation.LEASE_END:
        return driver.host.suspend()
    fields: dict[Operation, dict[str, Any]] = {
        Operation.JOIN: {"token": TOKEN},
        Operation.UPLOAD: {"item": "nodes", "rows": np.zeros((1, 2))},
        Operation.MOVE: {"step": 1, "displacement": driver.displacement(1)[0]},
        Operation.JUDGE: {"step": 1, **JUDGED},
        Operation.CORRECT: {"step": 1, **REGION},
        Operation.COMMIT: {"step": 1},
        Operation.ROLLBACK: {"step": 1},
    }
    kinds: dict[Operation, Any] = {
        Operation.JOIN: Join, Operation.UPLOAD: Upload, Operation.BUILD: Build, Operation.MOVE: Move,
        Operation.JUDGE: Judge, Operation.CORRECT: Correct,
        Operation.COMMIT: Commit, Operation.ROLLBACK: Rollback, Operation.FETCH: Fetch, Operation.STATUS: Status,
        Operation.CLOSE: Close,
    }  # fmt: skip
    return driver.ask(kinds[operation], **fields.get(operation, {}))


@pytest.mark.parametrize("operation", list(Operation), ids=str)
@pytest.mark.parametrize("state", list(State), ids=str)
def test_every_cell(state: State, operation: Operation) -> None:
    driver = bring(state)
    assert driver.host.state is state
    reply = perform(driver, operation)
    cell = TABLE[state][operation]
    if operation in (Operation.JUDGE, Operation.CORRECT):  # the server judges the cells of these sessions
        assert reply.code == "FAILED_PRECONDITION.STATE"
        assert driver.host.state is state
        return
    if isinstance(cell, State):
        assert getattr(reply, "type", "") != "ERROR", reply
        assert driver.host.state is cell
        return
    assert driver.host.state is state
    assert reply.code == cell.code
    assert cell.message in reply.message


def test_a_suspended_session_admits_nothing_but_what_the_table_says_after_a_join_elsewhere() -> None:
    driver = bring(State.TRIAL)
    driver.host.suspend()
    assert driver.ask(Join, token=TOKEN).state == "READY"
    assert driver.all(Commit, step=1)[0].code == "ABORTED.TRIAL_LOST"
    moved = driver.move(1)[0]
    assert moved.iteration == 1
    assert driver.all(Commit, step=1)[0].type == "COMMITTED"
