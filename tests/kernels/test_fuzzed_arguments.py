"""For any arguments from Python a loop gives a result, a TypeError or a ValueError; the process never ends."""

import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import settings
from loaded_scripts import loaded
from python_runs import said_by_python

_SCRIPT = Path(__file__).with_name("fuzz.py")
LOOPS = loaded(_SCRIPT).loops()


@pytest.fixture(scope="module")
def findings() -> dict[str, str]:
    """Faults of each loop, tested in separate processes: after a crash the test continues with the next loop."""
    found: dict[str, str] = {}
    while len(found) < len(LOOPS):
        rest = LOOPS[len(found) :]
        try:
            done = subprocess.run(
                [sys.executable, "-X", "faulthandler", str(_SCRIPT), str(5 * settings.default.max_examples), *rest],
                capture_output=True,
                text=True,
                timeout=240,
                check=False,
            )
            output, ending = done.stdout, f"ends the process: {done.returncode}\n{done.stderr}"
        except subprocess.TimeoutExpired as error:
            output, ending = (error.stdout or b"").decode(), "does not end, or all together take too long"
        lines = [line.split("\t") for line in output.splitlines()]
        found |= {line[0]: line[1] for line in lines if len(line) == 2}
        if len(lines) < len(rest):
            found[rest[len(lines)]] = ending
    return found


def test_there_are_loops() -> None:
    assert {"available_threads", "match_facets", "take_differences"} <= set(LOOPS)


@pytest.mark.parametrize("name", LOOPS)
def test_no_argument_ends_the_process(name: str, findings: dict[str, str]) -> None:
    assert findings[name] == ""


@pytest.mark.nightly
@pytest.mark.timeout(900)
def test_no_index_ends_the_process() -> None:
    printed = said_by_python(_SCRIPT.with_name("corrupted_calls.py"))
    found = dict(line.split("\t") for line in printed.splitlines())
    assert set(found) == set(LOOPS) - {"available_threads", "get_threads", "set_threads"}
    assert {name: finding for name, finding in found.items() if finding} == {}
