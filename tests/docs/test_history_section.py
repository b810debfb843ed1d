"""Commands of docs/operations.md about histories and replays run on a session with such a folder."""

import fcntl
import json
import os
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_protocol.messages import Commit, Move
from real_sessions import computes_as_servers
from shown_commands import blocks, run

from mesh_motion_server.service.dispatch import SessionHost
from mesh_motion_server.session.model import build_motion_model
from mesh_motion_server.session.store import SessionStore
from mesh_motion_server.settings import ServerSettings
from tests.faults.driver import Driver, make_spec
from tests.faults.stand_in import grid_mesh

PAGE = (Path(__file__).parents[2] / "docs" / "operations.md").read_text(encoding="utf-8")


def record(state: Path) -> None:
    mesh = grid_mesh(9)
    sides = np.flatnonzero(((mesh.points == 0) | (mesh.points == 1)).any(axis=1))
    left = mesh.patches["left"].nodes
    mesh = replace(mesh, patches={"left": Patch("moving", left), "walls": Patch("fixed", np.setdiff1d(sides, left))})
    limits = ServerSettings(reserve_disk_bytes=0)
    host = SessionHost.create(make_spec(), SessionStore(state), limits=limits, build_model=build_motion_model)
    driver = Driver(host, [mesh])
    driver.open()
    for step in (1, 2, 3):
        rows = np.stack([0.05 * step * np.sin(np.pi * mesh.points[left, 1]), np.zeros(len(left))], axis=1)
        driver.all(Move, [rows], step=step, frame="reference")
        driver.all(Commit, step=step)
    host.close()


def test_pruning_removes_the_histories_that_are_old_and_not_held(tmp_path: Path) -> None:
    for name, age, log in (("old", 40, True), ("new", 1, True), ("held", 40, True), ("none", 40, False)):
        folder = tmp_path / "STATE" / "sessions" / name
        folder.mkdir(parents=True)
        (folder / "lock").touch()
        if log:
            (folder / "history").mkdir()
            (folder / "history" / "events-00000000.jsonl").touch()
            for path in (folder / "history" / "events-00000000.jsonl", folder / "history"):
                os.utime(path, (time.time() - age * 86400,) * 2)
    prune, _ = blocks(PAGE, "bash")
    with (tmp_path / "STATE" / "sessions" / "held" / "lock").open() as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        assert run(prune, tmp_path, "").stderr == ""
    left = {path.parent.name for path in (tmp_path / "STATE" / "sessions").glob("*/history")}
    assert left == {"new", "held"}


@pytest.mark.nightly
def test_the_commands_run(tmp_path: Path) -> None:
    if not computes_as_servers():
        pytest.skip("the record is made in this process, with other last digits than a server's")
    record(tmp_path / "sessions")
    _, script = blocks(PAGE, "bash")
    done = run(f"set -e\n{script}", tmp_path, "")
    assert done.returncode == 0, done.stderr
    assert "equal in all 3 steps" in " ".join(done.stdout.split())
    assert "predicted minimum relative-size-skew" in done.stdout
    comparison = json.loads((tmp_path / "tuned" / "comparison.json").read_text())
    assert comparison["changes"] == {"support_radius": 0.8, "quality_threshold": 0.3}
    assert (tmp_path / "report.tar.gz").stat().st_size > 1000
