"""`make test-all`: a failed test is run again, alone; flaky if it then passes, and the run fails if not."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
_PRELUDE = """
import os, time
from pathlib import Path
import pytest

def first():
    name = Path(os.environ["PYTEST_CURRENT_TEST"].split()[0].rpartition("::")[2] + ".seen")
    return not name.exists() and (name.touch() or True)

def test_good(): pass
"""
_FLAKY = {
    "call": "@pytest.mark.parametrize('name', ['a b', '[c]', 'é'])\ndef test_flaky(name): assert not first()",
    "crash": "def test_flaky():\n    if first(): os._exit(0)",
}
_RED = {
    "one of two": "def test_flaky(): assert not first()\ndef test_bad(): assert False",
    "crash again": "def test_bad(): os._exit(0)",
    "collection": "import not_there",
    "interrupt": "def test_bad(): raise KeyboardInterrupt",
    "no signal ends it": "import signal\ndef test_bad():\n"
    "    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGALRM])\n    time.sleep(60)",
}


def ran(folder: Path, source: str) -> tuple[int, str]:
    """The recipe of the Makefile in a folder with one file of tests, in two processes."""
    folder.joinpath("test_given.py").write_text(_PRELUDE + source + "\n", encoding="utf-8")
    folder.joinpath("pytest.ini").write_text(
        "[pytest]\ntimeout = 1\nfaulthandler_timeout = 2\nfaulthandler_exit_on_timeout = true\n"
    )
    (recipe,) = re.findall(r"^test-all:.*\n((?:\t.*\n)+)", (ROOT / "Makefile").read_text(), re.M)
    values = {"$(BIN)/python": sys.executable, "$(PYTEST)": "-n2", "$(TESTS)": "test_given.py"}
    for name, value in {**values, "$$": "$", "many": "default"}.items():
        recipe = recipe.replace(name, value)
    clean = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
    clean |= {
        "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
        "PYTEST_PLUGINS": "xdist.plugin,pytest_timeout,_hypothesis_pytestplugin",
    }
    run = subprocess.run(
        ["bash", "-c", recipe], cwd=folder, env=clean, capture_output=True, text=True, check=False, timeout=120
    )
    return run.returncode, run.stdout + run.stderr


@pytest.mark.parametrize("kind", _FLAKY)
def test_a_test_that_passes_alone_is_flaky_and_the_run_not_red(tmp_path: Path, kind: str) -> None:
    status, output = ran(tmp_path, _FLAKY[kind])
    assert status == 0, output
    named, _, end = output.partition("= short test summary info =")[2].rpartition("= short test summary info =")
    assert "test_given.py::test_flaky" in named, "its first failure is shown"
    assert len(re.findall(r"^PASSED test_given.py::test_flaky", end, re.M)) == (3 if kind == "call" else 1), output
    assert output.splitlines()[-1].startswith("FLAKY: ")


@pytest.mark.parametrize(
    "kind", ["one of two", *(pytest.param(kind, marks=pytest.mark.nightly) for kind in [*_RED][1:])]
)
def test_nothing_else_becomes_green(tmp_path: Path, kind: str) -> None:
    status, output = ran(tmp_path, _RED[kind])
    assert status != 0, output
    assert "FLAKY" not in output


def test_a_run_without_failures_runs_once(tmp_path: Path) -> None:
    status, output = ran(tmp_path, "")
    assert (status, output.count("1 passed")) == (0, 1)
