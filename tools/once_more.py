"""A pytest plugin, ``-p tools.once_more``: a failed test is run once more, alone, after all others have ended.

A test that then passes is flaky: it is listed at the end, and the run does not fail because of it. A test that fails
again makes the run fail, with both failures. A test that fails in its teardown runs again with its whole file: another
test of the file may be the reason. Only tests are run again: after an error while tests are collected, an interrupt or
an error of pytest itself, the run fails at once. A test that crashes its process, or hangs, fails in a separate process
the second time.

pytest-rerunfailures repeats in the same worker, while other tests run, with the fixtures that the failure left.
``--last-failed`` in a second run loses the counts of the first, and a crash there loses the results of all other tests.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Generator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

__all__ = [
    "pytest_report_teststatus",
    "pytest_sessionfinish",
    "pytest_terminal_summary",
    "pytest_testnodedown",
    "pytest_xdist_node_collection_finished",
]

#: Longest time for all second runs together; failures that remain then stay red. A broken checkout ends in time.
_SECONDS = 1800
_FLAKY = "flaky"


_COLLECTED = pytest.StashKey[set[str]]()
_CRASHES = pytest.StashKey[int]()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_node_collection_finished(node: Any, ids: Sequence[str]) -> None:
    """Store the list of tests: with xdist only its workers know it."""
    node.config.stash.setdefault(_COLLECTED, set()).update(ids)


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any, error: object) -> None:
    """Count crashed workers: xdist itself ignores a crash while no test runs, for example at the end."""
    if error:
        node.config.stash[_CRASHES] = node.config.stash.get(_CRASHES, 0) + 1


@pytest.hookimpl(trylast=True)  # xdist's workers have ended: no other test runs
def pytest_sessionfinish(session: pytest.Session) -> None:
    """Run each failed test a second time; the session's status is that of tests that failed twice."""
    finished = session.exitstatus in (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED)
    if not finished or hasattr(session.config, "workerinput"):
        return
    stats = session.config.pluginmanager.getplugin("terminalreporter").stats
    failures = [*stats.get("failed", []), *stats.get("error", [])]
    red = _unseen_faults(session, stats)
    passed = _passed_alone(session.config, failures)
    for outcome in ("failed", "error"):
        for report in stats.pop(outcome, []):
            if _target(report) in passed:
                report.outcome = _FLAKY
                session.config.hook.pytest_runtest_logreport(report=report)
            else:
                stats.setdefault(outcome, []).append(report)
    red = red or any(_target(report) not in passed for report in failures)
    session.exitstatus = pytest.ExitCode.TESTS_FAILED if red else pytest.ExitCode.OK


def pytest_report_teststatus(report: pytest.CollectReport | pytest.TestReport) -> tuple[str, str, str] | None:
    """Flaky tests are counted in the last line; no letter of progress."""
    return (_FLAKY, "", "") if report.outcome == _FLAKY else None


@pytest.hookimpl(wrapper=True, tryfirst=True)  # around the terminal's own: the names stand above the last line
def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> Generator[None]:
    """Show the first failure of each flaky test, as help for its repair; list their names at the end."""
    flaky = terminalreporter.stats.get(_FLAKY, [])
    for report in flaky:
        terminalreporter.section(f"flaky: {report.nodeid} ({report.when})")
        terminalreporter.line(report.longreprtext)
    yield
    for test in dict.fromkeys(report.nodeid for report in flaky):
        terminalreporter.line(f"FLAKY {test} - failed next to others, passed alone", yellow=True)


def _unseen_faults(session: pytest.Session, stats: dict[str, list[Any]]) -> bool:
    """True if there was an error outside of tests; it is shown."""
    reports = [report for group in stats.values() for report in group if isinstance(report, pytest.TestReport)]
    collected = session.config.stash.get(_COLLECTED, {item.nodeid for item in session.items})
    missing = collected - {report.nodeid for report in reports}
    crashes = session.config.stash.get(_CRASHES, 0) - sum(str(report.when) == "???" for report in reports)
    terminal = session.config.pluginmanager.getplugin("terminalreporter")
    if missing:  # after -x, or too many crashed workers
        terminal.write_line(f"{len(missing)} tests have not run, among them {min(missing)}", red=True)
    if crashes > 0:
        terminal.write_line(f"{crashes} workers crashed outside of tests", red=True)
    return bool(missing) or crashes > 0


def _passed_alone(config: pytest.Config, failures: Sequence[pytest.TestReport | pytest.CollectReport]) -> set[str]:
    """Targets that pass in a second run, of all failed tests."""
    tests = dict.fromkeys(_target(report) for report in failures if isinstance(report, pytest.TestReport))
    deadline = time.monotonic() + _SECONDS
    return {test for test in tests if _passes_alone(config, test, deadline)}


def _target(report: pytest.TestReport | pytest.CollectReport) -> str:
    """The target of the second run of a failure: the test, or its file."""
    return report.nodeid.partition("::")[0] if report.when == "teardown" else report.nodeid


def _passes_alone(config: pytest.Config, test: str, deadline: float) -> bool:
    """True if a test, or a file of tests, passes in a separate process; its output is shown if it fails."""
    terminal = config.pluginmanager.getplugin("terminalreporter")
    terminal.write_line("")
    terminal.write_line(f"once more, alone: {test}")
    left = deadline - time.monotonic()
    if left <= 0:
        terminal.write_line(f"not run: the {_SECONDS} s for second runs are over")
        return False
    with tempfile.TemporaryDirectory() as scratch:
        output, verdict = Path(scratch, "output"), Path(scratch, "verdict.xml")
        status = _status_of([*_same_command(config), f"--junitxml={verdict}", test], output, left)
        passed = status == 0 and _has_passed(verdict, whole_file="::" not in test)
        terminal.write_line("passed alone" if passed else f"{output.read_text(errors='replace')}\nstatus {status}")
    return passed


def _same_command(config: pytest.Config) -> list[str]:
    """This run's interpreter and options, without xdist, the tests that it names and this plugin."""
    arguments = config.invocation_params.args
    before = sys.orig_argv[1 : len(sys.orig_argv) - len(arguments)]  # -S -m pytest, or the script's path
    options = [argument for argument in arguments if argument not in config.option.file_or_dir]
    return [sys.executable, *before, *options, "-n0", "-p", f"no:{__name__}"]


def _status_of(command: Sequence[str], output: Path, seconds: float) -> int:
    """The exit status of a process with a time limit; its child processes end with it."""
    with output.open("w") as file:  # no pipe: one that a grandchild keeps open would not end
        process = subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT, start_new_session=True)
        try:
            return process.wait(seconds)
        except subprocess.TimeoutExpired:
            file.write(f"\nstill running after {seconds:.0f} s")
            return -signal.SIGKILL
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def _has_passed(verdict: Path, *, whole_file: bool) -> bool:
    """True if the test ran and passed; a skipped test does not count."""
    if not verdict.exists():  # os._exit(0) in a test
        return False
    counts = ElementTree.parse(verdict).getroot()[0].attrib
    return whole_file or (counts["tests"], counts["skipped"]) == ("1", "0")
