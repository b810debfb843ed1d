"""A real file system without room: refused requests, running sessions, and both after room was made."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mesh_motion_client import MeshMotionError, connect
from mesh_motion_protocol.errors import ResourceExhausted
from mesh_motion_protocol.messages import Build, Commit, Fetch, Status
from served import small_mesh

from mesh_motion_server.session.journal import journal, next_manifest
from mesh_motion_server.session.store import SessionStore
from tests.faults.driver import Driver, make_driver, resume_driver
from tests.faults.model_files import ModelFiles
from tests.faults.stand_in import grid_mesh
from tests.faults.waiting import wait_until

_MIB = 1 << 20


class Filler:
    """Fills the rest of a disk, again and again."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / "filler"

    def fill(self) -> None:
        with self._path.open("ab", buffering=0) as file, contextlib.suppress(OSError):
            while True:
                file.write(bytes(4096))

    def empty(self) -> None:
        self._path.unlink()


def undisturbed(steps: int) -> list[bytes]:
    driver = make_driver(SessionStore(Path("/model"), files=ModelFiles()), [grid_mesh()])
    driver.open()
    return list(commits(driver, steps))


def advance(driver: Driver) -> Any:
    step = driver.host.step + 1
    (moved,) = driver.move(step, frame="reference")
    assert moved.type == "MOVED", moved
    (reply,) = driver.all(Commit, step=step)
    return reply


def commits(driver: Driver, steps: int) -> Iterator[bytes]:
    while driver.host.step < steps:
        reply = advance(driver)
        assert reply.type == "COMMITTED", reply
        yield reply.digest


def test_a_session_that_is_built_needs_no_more_room(small_disk: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(next_manifest, "_LEAST_CAPACITY", 1 << 17)
    monkeypatch.setattr(next_manifest, "_LEAST_RECORDS", 2)  # a manifest of some forty commits
    disk = small_disk(4 * _MIB)
    driver = make_driver(SessionStore(disk), [grid_mesh()])
    driver.open()
    Filler(disk).fill()
    digests = list(commits(driver, 150))  # the manifest is replaced thrice
    assert digests == undisturbed(150)
    driver.host.close()
    again = resume_driver(driver, SessionStore(disk))
    assert (again.host.step, again.host.state) == (150, "READY")
    again.host.close()


def test_frozen_then_room_then_bitwise_on(small_disk: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(next_manifest, "_LEAST_CAPACITY", 1 << 17)
    monkeypatch.setattr(next_manifest, "_LEAST_RECORDS", 2)
    monkeypatch.setattr(journal, "reserve", lambda folder, files, capacity: None)  # another one has taken it
    disk = small_disk(4 * _MIB)
    filler = Filler(disk)
    driver = make_driver(SessionStore(disk), [grid_mesh()])
    driver.open()
    filler.fill()
    digests = []
    while driver.host.state != "FROZEN":
        assert driver.host.step < 150, "the disk is not full"
        reply = advance(driver)
        if reply.type == "COMMITTED":
            digests.append(reply.digest)
    assert (reply.code, reply.retryable, reply.details["errno"]) == ("RESOURCE_EXHAUSTED.DISK", True, "ENOSPC")
    assert "resume" in reply.hint
    assert driver.ask(Status).state == "FROZEN"
    seen = driver.ask(Fetch, what="committed").points  # reading goes on
    (refused,) = driver.move(driver.host.step + 1)
    assert refused.code == "RESOURCE_EXHAUSTED.DISK"
    driver.host.close()

    filler.empty()
    again = resume_driver(driver, SessionStore(disk))
    assert again.host.step == len(digests)
    np.testing.assert_array_equal(again.ask(Fetch, what="committed").points, seen)
    digests += commits(again, 150)
    assert digests == undisturbed(150)
    again.host.close()


def test_a_build_without_room_leaves_nothing_and_may_be_repeated(small_disk: Any) -> None:
    disk = small_disk(4 * _MIB)
    filler = Filler(disk)
    driver = make_driver(SessionStore(disk), [grid_mesh()])
    driver.join()
    driver.upload()
    (folder,) = (disk / "sessions").iterdir()
    before = sorted(path.name for path in folder.iterdir())
    filler.fill()
    (refused,) = driver.all(Build)
    assert (refused.code, refused.retryable, refused.state) == ("RESOURCE_EXHAUSTED.DISK", True, "OPENING")
    assert sorted(path.name for path in folder.iterdir()) == before
    filler.empty()
    (built,) = driver.all(Build)
    assert built.type == "BUILT"
    assert list(commits(driver, 3)) == undisturbed(3)
    driver.host.close()


def test_an_open_without_room_leaves_nothing(small_disk: Any) -> None:
    disk = small_disk(_MIB)
    store = SessionStore(disk)
    make_driver(store, [grid_mesh()], session="a" * 32).host.close()
    Filler(disk).fill()
    with pytest.raises(ResourceExhausted) as refused:
        make_driver(store, [grid_mesh()], session="b" * 32)
    assert refused.value.code == "RESOURCE_EXHAUSTED.DISK"
    assert not (disk / "sessions" / ("b" * 32)).exists()


def test_a_server_on_a_full_disk(serve: Any, small_disk: Any) -> None:
    disk = small_disk(16 * _MIB)
    filler = Filler(disk)
    server = serve(state_folder=str(disk / "state"), reserve_disk_bytes=2 * _MIB)
    wait_until(lambda: server.get("/readyz")[0] == 200, "ready")
    mesh = small_mesh()
    with connect(server.endpoint, timeout=60) as client:
        session = client.open(mesh, {"support_radius": 1.0})
        filler.fill()
        wait_until(lambda: server.get("/readyz")[1].startswith("disk: "), "the page says so")
        assert server.get("/healthz")[0] == 200
        assert server.events("disk_low")
        with pytest.raises(MeshMotionError) as refused:
            client.open(mesh, {"support_radius": 1.0})
        assert refused.value.code == "RESOURCE_EXHAUSTED.DISK"
        for step in range(1, 4):
            session.move(0.01 * step * mesh.points[session.moving_nodes])
            assert session.commit().step == step
        filler.empty()
        wait_until(lambda: server.get("/readyz")[0] == 200, "ready again")
        client.open(mesh, {"support_radius": 1.0}).close("discard")
        session.close()
    assert os.listdir(disk / "state" / "sessions") == [session.credentials.session]


def test_a_log_that_takes_no_line_ends_nothing(serve: Any) -> None:
    """Its disk is often that of the sessions."""
    server = serve(log="/dev/full")
    mesh = small_mesh()
    with connect(server.endpoint, timeout=60) as client, client.open(mesh, {"support_radius": 1.0}) as session:
        session.move(0.01 * mesh.points[session.moving_nodes])
        assert session.commit().step == 1
    assert server.stop() == 0
