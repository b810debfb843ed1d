"""Failpoints: the table has the code's calls, a plan causes its faults, and without the variable nothing happens."""

import ast
import errno
import os
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server import failpoints
from mesh_motion_server.failpoints import VARIABLE, activate, failpoint
from mesh_motion_server.transport.serve import EXIT_CONFIGURATION
from tests.faults.failpoint_plan import PLAN, Fault, read_plan
from tests.faults.failpoint_table import POINTS

ROOT = Path(failpoints.__file__).parent
POINT, OTHER = "journal.commit.start", "worker.sent"


def called(source: str) -> list[str]:
    calls = (node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Call))
    return [
        ast.literal_eval(call.args[0]) for call in calls if getattr(call.func, "id", "") == "failpoint" and call.args
    ]


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    (tmp_path / "points").mkdir(mode=0o700)
    assert activate({VARIABLE: str(tmp_path / "points")}) == tmp_path / "points"
    yield tmp_path / "points"
    failpoints.deactivate()


def plan(folder: Path, text: str) -> None:
    (folder / "next").write_text(text)
    (folder / "next").replace(folder / PLAN)


def test_each_point_is_called_in_exactly_one_place() -> None:
    calls = Counter(name for path in ROOT.rglob("*.py") for name in called(path.read_text(encoding="utf-8")))
    assert calls == dict.fromkeys(POINTS, 1)
    assert len(POINTS) >= 40


def test_the_walk_sees_calls() -> None:
    assert called("def f():\n    failpoint('a')\n    g(failpoint('b'))") == ["a", "b"]


def test_every_fault_of_the_table_can_be_planned() -> None:
    faults = [(name, fault) for name, faults in POINTS.items() for fault in faults]
    assert all(name in read_plan(f"{name}={fault}@1") for name, fault in faults)
    assert all("kill" in faults for faults in POINTS.values())


def test_a_plan_names_faults_by_point() -> None:
    text = f"{POINT}=kill@3; {OTHER}=raise:EIO@12;\nworker.bound=sleep:0.25@1 "
    assert read_plan(text) == {
        POINT: Fault("kill", "", 3),
        OTHER: Fault("raise", "EIO", 12),
        "worker.bound": Fault("sleep", "0.25", 1),
    }
    assert read_plan("") == {}


@pytest.mark.parametrize(
    "entry",
    ["=kill@1", "kill", "kill@0", "kill:9@1", "sleep@1", "sleep:-1@1", "sleep:x@1", "raise@1", "raise:KeyError@1",
     "raise:EXXX@1", "stop@1"],
)  # fmt: skip
def test_wrong_entries_of_a_plan_are_refused(entry: str) -> None:
    with pytest.raises(InvalidInput, match="expected POINT=kill@HIT"):
        read_plan(f"{OTHER}=kill@1; {POINT}={entry}")


def test_without_the_variable_nothing_happens() -> None:
    assert activate({}) is None
    failpoint(POINT)
    failpoint("no such point")


def test_passages_are_counted_and_the_planned_one_fails(folder: Path) -> None:
    plan(folder, f"{POINT}=raise:ENOSPC@3")
    for _ in range(2):
        failpoint(POINT)
        failpoint(OTHER)
    with pytest.raises(OSError, match=os.strerror(errno.ENOSPC)) as caught:
        failpoint(POINT)
    assert caught.value.errno == errno.ENOSPC
    failpoint(POINT)
    assert ((folder / POINT).stat().st_size, (folder / OTHER).stat().st_size) == (4, 2)


def test_a_plan_may_be_replaced_and_the_count_begin_again(folder: Path) -> None:
    failpoint(POINT)
    plan(folder, f"{POINT}=raise:MemoryError@2")
    with pytest.raises(MemoryError):
        failpoint(POINT)
    (folder / POINT).unlink()
    plan(folder, f"{POINT}=raise:RuntimeError@1")
    with pytest.raises(RuntimeError):
        failpoint(POINT)
    (folder / PLAN).unlink()
    failpoint(POINT)


def test_sleep_is_late_and_nothing_else(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    slept: list[float] = []
    monkeypatch.setattr("time.sleep", slept.append)
    plan(folder, f"{POINT}=sleep:0.25@1")
    failpoint(POINT)
    assert slept == [0.25]


def test_a_passage_is_counted_over_processes_and_killed_once(folder: Path) -> None:
    plan(folder, f"{POINT}=kill@2")
    code = f"from mesh_motion_server.failpoints import *; activate(); failpoint({POINT!r})"
    environment = os.environ | {VARIABLE: str(folder)}
    codes = [subprocess.run([sys.executable, "-c", code], env=environment, check=False).returncode for _ in range(3)]
    assert codes == [0, -signal.SIGKILL, 0]


@pytest.mark.parametrize("wrong", ["missing", "open", "no plan"])
def test_a_server_does_not_start_with_a_wrong_plan(tmp_path: Path, wrong: str) -> None:
    folder = tmp_path / "points"
    if wrong != "missing":
        folder.mkdir(mode=0o755 if wrong == "open" else 0o700)
        plan(folder, "x" if wrong == "no plan" else "")
    code = (
        "import sys; from pathlib import Path; from mesh_motion_server.settings import ServerSettings;"
        "from mesh_motion_server.transport.serve import serve;"
        "sys.exit(serve(ServerSettings(endpoint='tcp://127.0.0.1:0', state_folder=Path(sys.argv[1]))))"
    )
    run = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "state")],
        env=os.environ | {VARIABLE: str(folder)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == EXIT_CONFIGURATION, run.stderr
    assert "failpoint" in run.stderr.lower()
