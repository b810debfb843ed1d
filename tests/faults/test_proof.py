"""The frame of `python -m tests.faults`: lines, statuses, options, proof.json."""

import json
import os
import re
import signal
import subprocess
import sys
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


def breaks(seed: int, budget: Budget) -> Result:
    try:
        require(False, "step 7 is lost")
    except BrokenPromise as error:
        error.add_note("(life 3)")
        raise
    return Result("", True, {})


GOOD, BROKEN = check("good", count_up), check("broken", breaks)
MISSED = check("missed", lambda seed, budget: Result("one short", False, {"short": 1}))


def proved(out: Path, *checks: Check, **plan: Any) -> tuple[list[str], dict[str, Any]]:
    lines: list[str] = []
    proof = Proof(Plan(**plan), checks, out, report=lines.append)
    for each in checks:
        proof.run(each)
    return lines, json.loads((out / "proof.json").read_text())


def test_a_failed_row_is_named_and_the_others_still_run(tmp_path: Path) -> None:
    lines, proof = proved(tmp_path / "new" / "folder", BROKEN, MISSED, GOOD, seed=5)
    assert lines[0] == HEADING
    assert [line.split()[-1] for line in lines[1:]] == ["FAIL", "FAIL", "PASS"]
    assert re.fullmatch(r"good +2 of them +2 done +5 +\d+\.\d PASS", lines[3])
    assert proof["passed"] is False
    broken, missed, good = proof["checks"]
    assert broken["got"] == "BrokenPromise: step 7 is lost (life 3)"
    assert 'require(False, "step 7 is lost")' in broken["traceback"]
    assert (missed["traceback"], missed["details"]) == ("", {"short": 1})
    assert good["details"] == {"done": 2, "seed": 5}
    assert {"msgpack", "pyzmq", "libzmq", "protocol"} <= set(proof["versions"])


def test_a_row_that_hangs_fails_by_its_name_and_the_next_one_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def hangs(seed: int, budget: Budget) -> Result:
        with limited_context() as context, context.socket(zmq.DEALER) as dealer, suppress(Exception):
            dealer.send(b"a send that nothing takes")
        return Result("", True, {})

    monkeypatch.setattr(Check, "limit", lambda *_: 0.3)
    lines, proof = proved(tmp_path, check("hanging", hangs), GOOD)
    assert [line.split()[-1] for line in lines[1:]] == ["FAIL", "PASS"]
    assert proof["checks"][0]["got"] == "Hangs: not done within 0.3 s"
    assert "in hangs" in proof["checks"][0]["traceback"]
    assert signal.getitimer(signal.ITIMER_REAL)[0] > 1, "the limit of this test is kept"


def test_a_proof_that_was_cut_short_is_none(tmp_path: Path) -> None:
    def interrupted(seed: int, budget: Budget) -> Result:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        proved(tmp_path, GOOD, check("cut", interrupted))
    proof = json.loads((tmp_path / "proof.json").read_text())
    assert (proof["passed"], proof["finished"]) == (False, None)
    assert [each["check"] for each in proof["checks"]] == ["good"]


def command_of(process: psutil.Process) -> str:
    """The command line of a process; empty if it ends at this moment."""
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
        return started if any("multiprocessing-fork" in command_of(each) for each in started) else []

    started = wait_until(soaking, "the client of the soak")
    proof.send_signal(how)
    assert proof.wait(60) == status
    _, alive = psutil.wait_procs(started, 60)
    assert [each.cmdline() for each in alive] == []


def test_the_table() -> None:
    names = [each.name for each in table.CHECKS]
    assert len(set(names)) == len(names)
    assert sum(each.seconds for each in table.CHECKS) <= 660
    for each in table.CHECKS:
        assert 0 < each.short <= each.full
        assert 10 * each.seconds < each.limit(each.short) <= each.limit(each.full)
        assert len(each.target_of(each.full)) <= 70
        assert each.target_of(1) != each.target_of(2)


# --- the command -----------------------------------------------------------------------------------------------------

#: Rows of this module in place of the table's.
ROWS = """
from tests.faults import table, test_proof
table.CHECKS = (test_proof.GOOD, test_proof.MISSED, test_proof.BROKEN)
"""


def test_the_command_runs_what_it_is_asked_for_and_fails_with_a_row(tmp_path: Path) -> None:
    (tmp_path / "other_rows.py").write_text(ROWS)
    paths = [str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])]
    asked = ["-p", "other_rows", "--only=broken", "--only=missed", "--seed", "9", "--out", str(tmp_path)]
    done = subprocess.run(
        [sys.executable, "-m", "tests.faults", *asked], cwd=ROOT, capture_output=True, text=True, check=False,
        timeout=120, env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (pytest.ExitCode.TESTS_FAILED, "")
    heading, *lines = done.stdout.splitlines()
    assert heading == HEADING
    assert [line.split()[0] for line in lines[:2]] == ["missed", "broken"]
    proof = json.loads((tmp_path / "proof.json").read_text())
    assert [each["passed"] for each in proof["checks"]] == [False, False]
    assert (proof["seed"], bool(proof["finished"])) == (9, True)


def test_the_command_lists_and_refuses(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def asked(**given: Any) -> Any:
        """The options of pytest on the command line."""
        options = {f"--{name}": value for name, value in ({"only": []} | given).items()}
        return SimpleNamespace(getoption=lambda name, default=None: options.get(name, default))

    monkeypatch.setattr(table, "CHECKS", (GOOD, MISSED, BROKEN))
    assert pytest_cmdline_main(asked(list=True, full=True)) == 0
    assert capsys.readouterr().out.splitlines()[0].split() == ["good", "20", "000", "of", "them"]
    with pytest.raises(pytest.UsageError, match="no row 'god'; the rows are good, missed"):
        pytest_cmdline_main(asked(only=["god"]))
    assert pytest_cmdline_main(asked(only=["good"])) is None
