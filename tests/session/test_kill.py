"""kill -9 of a process that commits, at random moments, again and again: bitwise as if nothing had happened."""

from __future__ import annotations

import random
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from mesh_motion_server.session.store import SessionStore

KILLS = 5


def run_until_killed(root: Path, first: int, seconds: float) -> list[str]:
    """Lines of a committing process that is killed ``seconds`` after its first commit."""
    script = Path(__file__).with_name("committing_process.py")
    with subprocess.Popen(
        [sys.executable, str(script), str(root), str(first)], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        lines = [process.stdout.readline()]
        time.sleep(seconds)
        process.kill()
        return [line for line in [*lines, *process.stdout.read().splitlines(True)] if line.endswith("\n")]


def test_no_acknowledged_step_is_lost(kit: Any, tmp_path: Path) -> None:
    moments = random.Random(7)
    acknowledged: dict[int, str] = {}
    store = SessionStore(tmp_path / "killed")
    for kill in range(KILLS):
        for line in run_until_killed(tmp_path / "killed", kill, moments.uniform(0.0, 0.05)):
            step, digest = line.split()
            acknowledged[int(step)] = digest
        (stored,) = store.sessions()
        assert stored.step in (max(acknowledged), max(acknowledged) + 1)
    undisturbed = kit.make_driver(SessionStore(tmp_path / "whole"), [kit.grid_mesh()])
    undisturbed.open()
    for step in range(1, max(acknowledged) + 1):
        digest = undisturbed.advance(step)[0].digest.hex()
        assert acknowledged.get(step, digest) == digest
    assert len(acknowledged) >= KILLS
    undisturbed.host.close()


@pytest.mark.parametrize("held", [True, False])
def test_two_processes_never_hold_one_session(kit: Any, tmp_path: Path, held: bool) -> None:
    store = SessionStore(tmp_path)
    driver = kit.make_driver(store, [kit.grid_mesh()])
    driver.open()
    if held:
        script = "import sys; from mesh_motion_server.session.store import SessionStore\n"
        script += f"SessionStore({str(tmp_path)!r}).open({kit.SESSION!r}, {kit.TOKEN!r})"
        result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
        assert "UNAVAILABLE" in result.stderr or "still held" in result.stderr
        driver.host.close()
    else:
        driver.host.close()
        assert kit.resume_driver(driver, store).host.step == 0
