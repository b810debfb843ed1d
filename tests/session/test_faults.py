"""A disk that fails at any operation: FROZEN, nothing lost, and after a resume everything continues bitwise."""

from __future__ import annotations

import errno
from pathlib import Path
from typing import Any

import pytest
from mesh_motion_protocol.messages import Build, Close, Commit, Fetch, Move, Status

from mesh_motion_server.errors import MeshMotionError
from mesh_motion_server.session.store import SessionStore

ROOT = Path("/model")
STEPS = 4


class Ended(Exception):
    """The life ended with an error reply; its code, and the last acknowledged step."""


def live(driver: Any, last: int, acknowledged: dict[int, bytes]) -> None:
    """Move and commit up to a step; raises Ended at the first error reply."""
    while driver.host.step < last:
        step = driver.host.step + 1
        moved = driver.move(step)[0]
        assert moved.type == "MOVED"
        (reply,) = driver.all(Commit, step=step)
        if reply.type == "ERROR":
            raise Ended(reply.code)
        acknowledged[reply.step] = reply.digest


def undisturbed(kit: Any) -> dict[int, bytes]:
    driver = kit.make_driver(SessionStore(ROOT, files=kit.files.ModelFiles()), [kit.grid_mesh()])
    driver.open()
    digests: dict[int, bytes] = {}
    live(driver, STEPS, digests)
    return digests


@pytest.mark.parametrize("error", [errno.ENOSPC, errno.EIO])
@pytest.mark.parametrize("for_ever", [True, False])
def test_failures_at_every_operation(kit: Any, error: int, for_ever: bool) -> None:
    expected = undisturbed(kit)
    outcomes: dict[str, int] = {}
    fail_at = 0
    while True:
        fail_at += 1
        raw = kit.files.ModelFiles()
        files = kit.files.FailingFiles(raw, error=error, for_ever=for_ever)
        files.fail_at = fail_at
        acknowledged: dict[int, bytes] = {}
        outcome = one_life(kit, files, acknowledged)
        outcomes[outcome] = outcomes.get(outcome, 0) + 1
        if not files.failed:
            break
        raw.handles.clear()
        continue_after(kit, raw, acknowledged, expected)
    assert outcomes.pop("whole") == 1
    assert set(outcomes) == {"not created", "not built", "FROZEN"}
    assert outcomes["FROZEN"] > 20


def one_life(kit: Any, files: Any, acknowledged: dict[int, bytes]) -> str:
    """What the failing disk did to it."""
    try:
        driver = kit.make_driver(SessionStore(ROOT, files=files), [kit.grid_mesh()])
    except MeshMotionError as error:
        return "not created" if error.code == "RESOURCE_EXHAUSTED.DISK" else error.code
    driver.join()
    driver.upload()
    (built,) = driver.all(Build)
    if built.type == "ERROR":
        assert (built.code, built.state) == ("RESOURCE_EXHAUSTED.DISK", "OPENING")
        return "not built"
    try:
        live(driver, STEPS, acknowledged)
    except Ended as ended:
        frozen(driver, acknowledged)
        return "FROZEN" if str(ended) == "RESOURCE_EXHAUSTED.DISK" else str(ended)
    return "whole"


def frozen(driver: Any, acknowledged: dict[int, bytes]) -> None:
    """Reads still work, nothing is written any more, the last committed step is told."""
    status = driver.ask(Status)
    assert (status.state, status.step) == ("FROZEN", max(acknowledged, default=0))
    assert driver.ask(Fetch).type == "FETCHED"
    refused = driver.all(Move, driver.displacement(1), step=status.step + 1)[0]
    assert (refused.code, refused.state) == ("RESOURCE_EXHAUSTED.DISK", "FROZEN")
    assert driver.ask(Close).type == "CLOSED"


def continue_after(kit: Any, raw: Any, acknowledged: dict[int, bytes], expected: dict[int, bytes]) -> None:
    """Another process, a healthy disk: the session is there and goes on bitwise, or it was never built."""
    store = SessionStore(ROOT, files=raw)
    try:
        host = kit.resume(store)
    except MeshMotionError as error:
        if acknowledged or error.code != "NOT_FOUND":
            raise
        return
    assert host.step in (max(acknowledged, default=0), max(acknowledged, default=0) + 1)
    driver = kit.Driver(host, [kit.grid_mesh()])
    driver.sequences = [1000]
    driver.join()
    live(driver, STEPS, acknowledged)
    assert all(expected[step] == digest for step, digest in acknowledged.items())


@pytest.mark.parametrize("most", [1, 7, 1000])
def test_short_writes_are_continued(kit: Any, most: int) -> None:
    expected = undisturbed(kit)
    raw = kit.files.ModelFiles()
    driver = kit.make_driver(SessionStore(ROOT, files=kit.files.ShortFiles(raw, most)), [kit.grid_mesh()])
    driver.open()
    acknowledged: dict[int, bytes] = {}
    live(driver, STEPS, acknowledged)
    assert acknowledged == expected
    driver.host.close()
    assert kit.resume(SessionStore(ROOT, files=raw)).step == STEPS
