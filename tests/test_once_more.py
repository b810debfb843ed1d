"""A failed test is run again, alone: flaky if it then passes, failed if not; the second run changes no other result."""

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
_PRELUDE = """
import os, time
from pathlib import Path
from typing import Any
import pytest

def first():
    name = Path(os.environ["PYTEST_CURRENT_TEST"].split()[0].rpartition("::")[2] + ".seen")
    return not name.exists() and (name.touch() or True)

def test_good(): pass
"""
#: Tests that fail the first time and pass alone.
_FLAKY = {
    "call": "@pytest.mark.parametrize('name', ['a b', '[c]', 'é'])\ndef test_flaky(name): assert not first()",
    "set-up": "@pytest.fixture\ndef given(): assert not first()\ndef test_flaky(given): pass",
    "end": "@pytest.fixture\ndef given():\n    yield\n    assert not first()\ndef test_flaky(given): pass",
    "crash": "def test_flaky():\n    if first(): os._exit(0)",
    "hang": "@pytest.mark.timeout(1)\ndef test_flaky():\n    if first(): time.sleep(60)",
    "next to others": "def test_flaky(): assert 'PYTEST_XDIST_WORKER' not in os.environ",
}
#: Runs that fail: source, options, status.
_RED = {
    "again": ("def test_bad(): assert False", ["-n2"], 1),
    "one of two": ("def test_flaky(): assert not first()\ndef test_bad(): assert False", ["-n2"], 1),
    "without xdist": ("def test_bad(): assert False", [], 1),
    "skipped alone": ("def test_bad():\n    if not first(): pytest.skip()\n    assert False", ["-n2"], 1),
    "crash again": ("def test_bad(): os._exit(0)", ["-n1", "--max-worker-restart=1"], 1),
    "crash at the end": ("", ["-n1", "-p", "ends_badly", "--max-worker-restart=0"], 1),
    "collection": ("import not_there", ["-n2"], 1),
    "collection without xdist": ("import not_there", [], 2),
    "not run": ("def test_flaky(): assert not first()\ndef test_later(): pass", ["-x"], 1),
    "interrupt": ("def test_bad(): raise KeyboardInterrupt", [], 2),
    "left by another test": (
        "LEFT = []\n@pytest.fixture(scope='module', autouse=True)\ndef clean():\n    yield\n    assert not LEFT\n"
        "def test_leaves(): LEFT.append(1)\ndef test_last(): pass",
        ["-n2", "--dist", "loadfile"],
        1,
    ),
    "usage": ("", ["--no-such-option"], 4),
}


def some(kinds: dict[str, Any], *names: str) -> list[Any]:
    return [kind if kind in names else pytest.param(kind, marks=pytest.mark.nightly) for kind in kinds]


def ran(folder: Path, source: str, *options: str) -> tuple[int, str]:
    folder.joinpath("test_given.py").write_text(_PRELUDE + source + "\n", encoding="utf-8")
    folder.joinpath("ends_badly.py").write_text(
        "import os\ndef pytest_sessionfinish(session):\n    if hasattr(session.config, 'workerinput'): os._exit(3)\n"
    )
    command = [sys.executable, "-m", "pytest", "-p", "tools.once_more", "-p", "xdist.plugin", "-p", "pytest_timeout"]
    clean = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
    paths = {"PYTHONPATH": f"{ROOT}{os.pathsep}{folder}", "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    run = subprocess.run(
        [*command, *options], cwd=folder, env=clean | paths, capture_output=True, text=True, check=False, timeout=120
    )
    return run.returncode, run.stdout + run.stderr


@pytest.mark.parametrize("kind", some(_FLAKY, "call", "crash"))
def test_a_test_that_passes_alone_is_flaky_and_the_run_not_red(tmp_path: Path, kind: str) -> None:
    status, output = ran(tmp_path, _FLAKY[kind], "-n2", "--dist", "loadfile")
    count = 3 if kind == "call" else 1
    last = output.splitlines()[-1]
    assert status == 0, output
    assert re.fullmatch(rf"=+ [12] passed, {count} flaky in .*s =+", last), output
    assert (
        len(re.findall(r"^FLAKY test_given.py::test_flaky.* - failed next to others, passed alone$", output, re.M))
        == count
    )
    assert "flaky: test_given.py::test_flaky" in output, "its first failure is shown"


@pytest.mark.parametrize("kind", some(_RED, "again", "collection", "left by another test"))
def test_nothing_else_becomes_green(tmp_path: Path, kind: str) -> None:
    source, options, status = _RED[kind]
    got, output = ran(tmp_path, source, *options)
    assert got == status, output


def test_failed_and_flaky_tests_are_counted(tmp_path: Path) -> None:
    _, output = ran(tmp_path, _RED["one of two"][0], "-n2")
    assert re.search(r"^FAILED test_given.py::test_bad", output, re.M)
    assert re.fullmatch(r"=+ 1 failed, 1 passed, 1 flaky in .*s =+", output.splitlines()[-1]), output


def test_a_run_without_failures_stays_as_it_is(tmp_path: Path) -> None:
    status, output = ran(tmp_path, "", "-n2")
    assert status == 0
    assert "once more" not in output


def test_a_test_that_no_signal_ends_is_ended_and_named(tmp_path: Path) -> None:
    blocked = "signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGALRM])"
    source = f"import signal\ndef test_bad():\n    {blocked}\n    time.sleep(60)"
    (tmp_path / "pytest.ini").write_text(
        "[pytest]\ntimeout = 1\nfaulthandler_timeout = 2\nfaulthandler_exit_on_timeout = true\n"
    )
    status, output = ran(tmp_path, source, "-n1", "--max-worker-restart=0")
    assert status == 1, output
    assert "crashed while running 'test_given.py::test_bad'" in output
