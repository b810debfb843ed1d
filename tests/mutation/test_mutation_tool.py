"""The tool that mutates: what it changes, and that it separates what tests notice from what they do not."""

import importlib.util
import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest
from loaded_scripts import loaded

HERE = Path(__file__).parent
OPERATORS = loaded(HERE / "mutation_operators.py")

TOY = '''
class Counter:
    """Counts up to a limit."""

    def __init__(self, limit):
        self.limit, self.count = limit, 0

    @property
    def full(self):
        return self.count >= self.limit

    def add(self, number=1):
        """Words are left alone, and so is the default."""
        if self.full:
            raise ValueError("the counter is full")
        self.count += number
        return self.count


def described(counter):
    return {"count": counter.count}
'''
TESTS = """
import toy

def test_it_counts():
    counter = toy.Counter(2)
    assert counter.add() == 1
    assert not counter.full
    assert counter.add() == 2
    assert counter.full

def test_it_is_described():
    assert toy.described(toy.Counter(1))
"""
DRIVER = """
import json, sys
import mutation_run
mutation_run._PATIENCE = 0.5
for time in range(2):  # a second trial of the same process finds the functions too
    trial = mutation_run.run(mutation_run.Trial(["toy"], {"toy": sys.argv[1:]}), ["test_toy.py"])
json.dump([trial.problem, trial.tried["toy"], trial.survived["toy"]], open("told.json", "w"))
"""


def keys(source: str) -> list[str]:
    return [mutant.key for mutant in OPERATORS.mutants(source, "toy.py")]


def tried(folder: Path, toy: str, tests: str, *but: str) -> Any:
    """Why nothing could be tried, how many mutants were, and which of them survived."""
    (folder / "toy.py").write_text(toy)
    (folder / "test_toy.py").write_text(tests)
    paths = [str(folder), str(HERE), *filter(None, [os.environ.get("PYTHONPATH")])]
    subprocess.run(
        [sys.executable, "-c", DRIVER, *but],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
        check=True,
        capture_output=True,
        timeout=120,
    )
    return json.loads((folder / "told.json").read_text())


def test_what_is_changed() -> None:
    assert keys(TOY) == [
        "Counter.__init__: 0 → 1",
        "Counter.full: return self.count >= self.limit → return None",
        "Counter.full: self.count >= self.limit → self.count > self.limit",
        "Counter.full: self.count >= self.limit → self.count < self.limit",
        "Counter.add: if self.full: → if not self.full:",
        "Counter.add: raise ValueError('the counter is full') → pass",
        "Counter.add: self.count += number → pass",
        "Counter.add: return self.count → return None",
        "described: return {'count': counter.count} → return None",
        "described: 'count' → 'xcount'",
    ]


def test_a_key_stays_when_other_code_moves_and_equal_changes_are_numbered() -> None:
    source = "def f(x):\n    g(x)\n    g(x)\n"
    assert keys(source) == keys("import os\n\n\n" + source) == ["f: g(x) → pass", "f: g(x) → pass (2)"]


def test_only_the_mutated_function_differs() -> None:
    first = next(OPERATORS.mutants(TOY, "toy.py"))
    assert (first.code.co_qualname, first.line) == ("Counter.__init__", 5)


def test_what_no_test_notices_survives(tmp_path: Path) -> None:
    untested = "Counter.add: raise ValueError('the counter is full') → pass"
    misnamed = "described: 'count' → 'xcount'"
    assert tried(tmp_path, TOY, TESTS) == ["", 10, [untested, misnamed]]
    assert tried(tmp_path, TOY, TESTS, untested) == ["", 9, [misnamed]]  # the other is explained


def test_tests_that_fail_without_a_mutant_are_reported(tmp_path: Path) -> None:
    problem, *_ = tried(tmp_path, TOY, TESTS.replace("add() == 1", "add() == 3"))
    assert problem == "without a mutant these fail: test_toy.py::test_it_counts"


@pytest.mark.nightly
def test_an_endless_loop_is_noticed(tmp_path: Path) -> None:
    toy = "def f(n):\n    while n > 0:\n        n -= 1\n    return n\n"
    tests = "import toy\n\ndef test_f():\n    assert toy.f(3) == 0\n"
    assert tried(tmp_path, toy, tests)[2] == []


def test_a_zip_that_need_not_be_strict_is_no_mutant() -> None:
    assert keys("def f(a, b):\n    return dict(zip(a, b, strict=True))\n") == [
        "f: return dict(zip(a, b, strict=True)) → return None"
    ]


@pytest.mark.nightly
def test_every_survivor_has_a_reason_and_a_module() -> None:
    known = tomllib.loads((HERE / "survivors.toml").read_text(encoding="utf-8"))
    for module, survivors in known.items():
        spec = importlib.util.find_spec(module)
        assert spec.origin is not None
        made = set(keys(Path(spec.origin).read_text(encoding="utf-8")))
        assert set(survivors) <= made, f"{module}: these are no mutants any more"
        assert all(len(reason) > 10 for reason in survivors.values())
