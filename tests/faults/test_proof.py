"""The frame of `python -m tests.faults`: lines, statuses, options, proof.json."""

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import psutil
import pytest
import zmq

from tests.faults import table
from tests.faults.check import BrokenPromise, Budget, Check, Result, require
from tests.faults.conftest import pytest_cmdline_main
from tests.faults.limited_context import limited_context
from tests.faults.proof import HEADING, Plan, Proof
from tests.faults.waiting import wait_until

ROOT = Path(__file__).parents[2]


def check(name: str, run: Any) -> Check:
    return Check(name, "{count} of them", short=2, full=20_000, seconds=3, run=run)


def count_up(seed: int, budget: Budget) -> Result:
    done = 0
    while budget.admits(done):
        done += 1
    return Result(f"{done} done", True, {"done": done, "seed": seed})


def misses(seed: int, budget: Budget) -> Result:
    return Result("one short", False, {"short": 1})


def breaks(seed: int, budget: Budget) -> Result:
    try:
        require(False, "step 7 is lost")
    except BrokenPromise as error:
        error.add_note("(life 3)")
        raise
    return Result("", True, {})


GOOD, MISSED, BROKEN = check("good", count_up), check("missed", misses), check("broken", breaks)


def proved(out: Path, *checks: Check, **plan: Any) -> tuple[bool, list[str], dict[str, Any]]:
    lines: list[str] = []
    proof = Proof(Plan(**plan), checks, out, report=lines.append)
    passed = [proof.run(check).passed for check in checks]
    return all(passed), lines, json.loads((out / "proof.json").read_text())


def test_a_line_for_each_check(tmp_path: Path) -> None:
    passed, lines, proof = proved(tmp_path / "new" / "folder", GOOD, seed=5)
    assert passed
    assert lines[0] == HEADING
    assert re.fullmatch(r"good +2 of them +2 done +5 +\d+\.\d PASS", lines[1])
    assert proof["passed"] is True
    assert proof["checks"][0]["details"] == {"done": 2, "seed": 5}


def test_what_fails_does_not_keep_the_others_from_running(tmp_path: Path) -> None:
    passed, lines, proof = proved(tmp_path, BROKEN, MISSED, GOOD)
    assert not passed
    assert [line.split()[-1] for line in lines[1:]] == ["FAIL", "FAIL", "PASS"]
    assert proof["passed"] is False
    broken, missed, _ = proof["checks"]
    assert broken["got"] == "BrokenPromise: step 7 is lost (life 3)"
    assert 'require(False, "step 7 is lost")' in broken["traceback"]
    assert (missed["traceback"], missed["details"]) == ("", {"short": 1})


def test_a_row_that_hangs_fails_by_its_name_and_the_next_one_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def hangs(seed: int, budget: Budget) -> Result:
        with limited_context() as context, context.socket(zmq.DEALER) as dealer, suppress(Exception):
            dealer.send(b"a send that nothing takes")
        return Result("", True, {})

    monkeypatch.setattr(Check, "limit", lambda *_: 0.3)
    passed, lines, proof = proved(tmp_path, check("hanging", hangs), GOOD)
    assert not passed
    assert [line.split()[0] for line in lines[1:]] == ["hanging", "good"]
    assert [line.split()[-1] for line in lines[1:]] == ["FAIL", "PASS"]
    assert proof["checks"][0]["got"] == "Hangs: not done within 0.3 s"
    assert "in hangs" in proof["checks"][0]["traceback"]
    assert signal.getitimer(signal.ITIMER_REAL)[0] > 1, "the limit of this test is kept"


def test_every_row_has_a_limit_that_grows_with_its_count() -> None:
    for row in table.CHECKS:
        assert 10 * row.seconds < row.limit(row.short, None) <= row.limit(row.full, None)
        assert row.limit(row.short, 30.0) == 900.0


def test_the_proof_says_what_it_was_measured_on(tmp_path: Path) -> None:
    _, _, proof = proved(tmp_path, GOOD, scale="full")
    assert proof["scale"] == "full"
    assert proof["finished"] >= proof["started"]
    assert {"mesh-motion-server", "protocol", "python", "libzmq", "numpy"} <= set(proof["versions"])
    assert proof["machine"]["cores"] >= 1
    assert proof["machine"]["memory_bytes"] > 1 << 28
    assert proof["checks"][0]["target"] == "20 000 of them"
    assert set(proof["checks"][0]) == {
        "check", "target", "got", "seed", "seconds", "passed", "details", "traceback",
    }  # fmt: skip


def test_a_proof_that_was_cut_short_is_none(tmp_path: Path) -> None:
    def interrupted(seed: int, budget: Budget) -> Result:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        proved(tmp_path, GOOD, check("cut", interrupted))
    proof = json.loads((tmp_path / "proof.json").read_text())
    assert (proof["passed"], proof["finished"]) == (False, None)
    assert [each["check"] for each in proof["checks"]] == ["good"]


def command_of(process: psutil.Process) -> str:
    """Its command line; nothing of one that ends in this moment."""
    try:
        return " ".join(process.cmdline())
    except (psutil.NoSuchProcess, psutil.ZombieProcess):
        return ""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("how", "status"),
    [
        (signal.SIGTERM, pytest.ExitCode.INTERRUPTED),
        pytest.param(signal.SIGKILL, -signal.SIGKILL, marks=pytest.mark.nightly),
    ],
)
def test_a_proof_that_gets_a_signal_leaves_no_process_behind(tmp_path: Path, how: int, status: int) -> None:
    proof = psutil.Popen([sys.executable, "-m", "tests.faults", "--only", "soak", "--out", str(tmp_path)])

    def soaking() -> list[psutil.Process]:
        started: list[psutil.Process] = proof.children(recursive=True)
        return started if any("soak_client" in command_of(each) for each in started) else []

    started = wait_until(soaking, "the client of the soak")
    proof.send_signal(how)
    assert proof.wait(60) == status
    _, alive = psutil.wait_procs(started, 60)
    assert [each.cmdline() for each in alive] == []


def test_time_instead_of_counts_is_shared_out(tmp_path: Path) -> None:
    plan = Plan(minutes=1)
    assert plan.seconds(GOOD, [GOOD, MISSED, BROKEN]) == pytest.approx(20)
    assert Plan().seconds(GOOD, [GOOD]) is None
    _, _, proof = proved(tmp_path, GOOD, minutes=0.01)
    assert proof["checks"][0]["details"]["done"] > 2  # in 0.6 s
    assert proof["checks"][0]["target"] == "n of them"


def test_what_is_not_counted_is_a_tenth_of_the_plan() -> None:
    assert [Budget(100).warms_up(done, 3) for done in (9, 10)] == [True, False]
    assert [Budget(10).warms_up(done, 3) for done in (2, 3)] == [True, False]
    timed = Budget(1, 20.0)
    assert [timed.warms_up(done, 3) for done in (2, 1000)] == [True, True]
    timed._start -= 2.0
    assert [timed.warms_up(done, 3) for done in (2, 3)] == [True, False]


def test_progress_is_reported(tmp_path: Path) -> None:
    lines: list[str] = []
    Proof(Plan(), [GOOD], tmp_path, report=lambda line: None, progress=lines.append).run(GOOD)
    assert lines == ["good: 0 of 2", "good: 1 of 2", "good: 2 of 2"]


def test_the_table() -> None:
    names = [each.name for each in table.CHECKS]
    assert len(set(names)) == len(names)
    assert sum(each.seconds for each in table.CHECKS) <= 660
    for each in table.CHECKS:
        assert 0 < each.short <= each.full
        assert len(each.target_of(each.full)) <= 70
        assert each.target_of(1) != each.target_of(2)


# --- the command -----------------------------------------------------------------------------------------------------

#: Rows of this module in place of the table's.
ROWS = """
from tests.faults import table, test_proof
table.CHECKS = (test_proof.GOOD, test_proof.MISSED, test_proof.BROKEN)
"""


@pytest.fixture
def command(tmp_path: Path) -> Callable[..., subprocess.CompletedProcess[str]]:
    """`python -m tests.faults` with other rows."""
    (tmp_path / "other_rows.py").write_text(ROWS)
    paths = [str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])]

    def run(*arguments: object) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "tests.faults", "-p", "other_rows", *map(str, arguments)],
            cwd=ROOT, env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)}, capture_output=True, text=True,
            check=False, timeout=120,
        )  # fmt: skip

    return run


def test_the_command_runs_what_it_is_asked_for_and_fails_with_a_row(command: Any, tmp_path: Path) -> None:
    done = command("--only=broken", "--only=missed", "--seed", 9, "--out", tmp_path)
    assert (done.returncode, done.stderr) == (pytest.ExitCode.TESTS_FAILED, "")
    heading, *lines = done.stdout.splitlines()
    assert heading == HEADING
    assert [line.split()[0] for line in lines[:2]] == ["missed", "broken"]
    proof = json.loads((tmp_path / "proof.json").read_text())
    assert [each["passed"] for each in proof["checks"]] == [False, False]
    assert proof["seed"] == 9
    assert proof["finished"]


def asked(**given: Any) -> Any:
    """The options of pytest, as the command line has given them."""
    options = {f"--{name}": value for name, value in ({"only": []} | given).items()}
    return SimpleNamespace(getoption=lambda name, default=None: options.get(name, default))


def test_the_command_lists_and_refuses(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(table, "CHECKS", (GOOD, MISSED, BROKEN))
    assert pytest_cmdline_main(asked(list=True, full=True)) == 0
    assert capsys.readouterr().out.splitlines()[0].split() == ["good", "20", "000", "of", "them"]
    with pytest.raises(pytest.UsageError, match="no row 'god'; the rows are good, missed"):
        pytest_cmdline_main(asked(only=["god"]))
    with pytest.raises(pytest.UsageError, match="more than 0"):
        pytest_cmdline_main(asked(minutes=0.0))
    assert pytest_cmdline_main(asked(only=["good"], minutes=1.0)) is None


@pytest.mark.nightly  # it loads all rows in another process
def test_rows_run_only_where_they_are_asked_for() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "--collect-only", str(Path(__file__).with_name("test_rows.py"))],
        cwd=ROOT, capture_output=True, text=True, check=False, timeout=120,
    )  # fmt: skip
    assert (done.returncode, "deselected" in done.stdout) == (pytest.ExitCode.NO_TESTS_COLLECTED, True)
