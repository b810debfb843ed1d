"""Common parts of all tests: long limits for compiling fixtures, and Ctrl-C for processes that tests start."""

import ast
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
_COMPILERS = re.compile(r"'(gcc|g\+\+|gfortran|mpicc|cmake|make|\./Allwmake)'|\bCOMPILERS\b|\bcompiler\b\[|'build'")


def limited_builds(source: str) -> Iterator[str]:
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Call) and any(k.arg in ("timeout", "patience") for k in node.keywords):
            command = ast.unparse(node.args[0]) if node.args else ""
            if _COMPILERS.search(command):
                yield command


def test_no_build_in_a_test_has_a_limit_of_its_own() -> None:
    found = {path: list(limited_builds(path.read_text("utf-8"))) for path in TESTS.rglob("*.py")}
    assert {path: builds for path, builds in found.items() if builds} == {}


def test_the_rule_sees_a_limit() -> None:
    assert list(limited_builds("run(['cmake', '--build', folder], patience=120)"))
    assert list(limited_builds("subprocess.run(['./Allwmake'], timeout=PATIENCE)"))


def test_a_test_whose_fixtures_compile_has_half_an_hour(zmq_flags: None, request: pytest.FixtureRequest) -> None:
    assert request.node.get_closest_marker("timeout").args == (1800,)


def test_ctrl_c_reaches_what_tests_start() -> None:
    assert signal.getsignal(signal.SIGINT) is not signal.SIG_IGN


def test_it_does_so_where_the_tests_run_in_the_background() -> None:
    """A shell makes ``pytest … &`` ignore it."""
    one = f"{__file__}::{test_ctrl_c_reaches_what_tests_start.__name__}"
    command = ["sh", "-c", "trap '' INT; exec \"$@\"", "sh", sys.executable, "-m", "pytest", "-q", one]
    done = subprocess.run(command, cwd=TESTS.parent, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stdout


@pytest.fixture
def zmq_flags() -> None:
    """Named like the fixture that compiles all of the C client."""
