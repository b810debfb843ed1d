"""Runs the tests that call a function against each of its mutants, in processes forked from one that has loaded all.

Tests are collected once. A first child runs each of them and tells which functions of the modules it calls and how long
it takes; then for each mutant a child puts the changed code in the place of the function's own, and runs the tests that
call it, the quickest first, until one fails. A child that does not end in time counts as noticed.
"""

from __future__ import annotations

import builtins
import contextlib
import gc
import importlib
import json
import os
import signal
import sys
import time
import types
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any

import mutation_operators as operators
import pytest
from _pytest.runner import runtestprotocol

__all__ = ["Outcome", "Trial", "run"]

#: Processor seconds that the tests of one mutant may take beyond those without one; and how many times these.
_PATIENCE, _FACTOR = 2.0, 3.0
#: What waits for ever takes no processor's time: seconds on the wall.
_LONGEST = 120.0
#: A set among the builtins while functions tell when they are called.
_TOLD = "__called__"
#: Of a function's tests those of the module's own file are run, and the quickest others, processor seconds together.
_OTHERS = 1.0


@dataclass
class Outcome:
    """What came of a module's mutants.

    Attributes
    ----------
    killed : int
    survived : list of str
        Keys of those that no test noticed.
    """

    killed: int = 0
    survived: list[str] = field(default_factory=list)

    @property
    def total(self) -> int:
        """Mutants that were tried."""
        return self.killed + len(self.survived)


@dataclass
class Trial:
    """A pytest plugin that mutates in place of running the tests.

    Attributes
    ----------
    modules : sequence of str
    sample : int or None
        So many mutants of each module, chosen at random.
    seed : int
    outcomes : dict
        By module.
    problem : str
        Why nothing could be tried.
    """

    modules: Sequence[str]
    sample: int | None = None
    seed: int = 1
    outcomes: dict[str, Outcome] = field(default_factory=dict)
    problem: str = ""

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Called once the tests are collected."""
        files = {name: _file(name) for name in self.modules}
        sources = {name: Path(path).read_text(encoding="utf-8") for name, path in files.items()}
        known = _functions(set(files.values()))
        gc.freeze()  # children then leave this process' memory as it is
        calls, seconds, failed = _in_child(lambda: _watch(session.items, files.values(), known))
        if failed or session.testsfailed:
            self.problem = f"without a mutant these fail: {', '.join(failed) or 'collection'}"
            return True
        by_name = {item.nodeid: item for item in session.items}
        for name, path in files.items():
            self.outcomes[name] = outcome = Outcome()
            for mutant in self._chosen(sources[name]):
                tests = _telling(name, calls.get(f"{path}:{mutant.line}", []), seconds)
                limit = _PATIENCE + _FACTOR * sum(seconds[test] for test in tests)
                if _noticed(mutant, path, known, [by_name[test] for test in tests], limit):
                    outcome.killed += 1
                else:
                    outcome.survived.append(mutant.key)
                    _tell(f"{name}: {mutant.key}")
            _tell(f"{name}: {outcome.killed} of {outcome.total} noticed")
        return True

    def _chosen(self, source: str) -> Iterable[operators.Mutant]:
        made = list(operators.mutants(source))
        if self.sample is None or self.sample >= len(made):
            return made
        return Random(self.seed).sample(made, self.sample)


def run(trial: Trial, tests: Sequence[str]) -> Trial:
    """Collect the tests and let the trial have them."""
    pytest.main(["-q", "-p", "no:cacheprovider", "-m", "not slow", *tests], plugins=[trial])
    return trial


def _tell(line: str) -> None:
    sys.stderr.write(line + "\n")


def _telling(module: str, tests: Iterable[str], seconds: Mapping[str, float]) -> list[str]:
    """Of the tests that call a function those to be run, the quickest first."""
    own, left, chosen = f"test_{module.rpartition('.')[2]}.py", _OTHERS, []
    for test in sorted(tests, key=lambda test: seconds[test]):
        if own not in test:
            left -= seconds[test]
        if own in test or left > 0:
            chosen.append(test)
    return chosen


def _file(module: str) -> str:
    return str(Path(str(importlib.import_module(module).__file__)).resolve())


# --- in children -----------------------------------------------------------------------------------------------------


def _in_child(work: Any) -> Any:
    """What ``work`` returns, as JSON tells it; this process stays as it is."""
    reader, writer = os.pipe()
    child = os.fork()
    if not child:
        status = 1
        with contextlib.suppress(BaseException):
            with _silence():
                result = work()
            with os.fdopen(writer, "w", encoding="utf-8") as stream:
                json.dump(result, stream)
            status = 0
        os._exit(status)
    os.close(writer)
    with os.fdopen(reader, encoding="utf-8") as stream:
        told = stream.read()
    _, status = os.waitpid(child, 0)
    if status:
        raise RuntimeError("the run without mutants ended before its time")
    return json.loads(told)


#: (file, first line) → the functions that were made of it.
_Known = dict[tuple[str, int], list[types.FunctionType]]


def _functions(files: set[str]) -> _Known:
    """All functions of these files."""
    known: _Known = defaultdict(list)
    for each in gc.get_objects():
        if isinstance(each, types.FunctionType) and each.__code__.co_filename in files:
            known[each.__code__.co_filename, each.__code__.co_firstlineno].append(each)
    return known


def _watch(items: Sequence[pytest.Item], files: Iterable[str], known: _Known) -> Any:
    """Function ("file:first line") → tests that call it; seconds of each test; tests that fail."""
    calls: dict[str, list[str]] = defaultdict(list)
    seconds, failed = {}, []
    called: set[str] = set()
    for path in files:
        _let_tell(path, known, called)
    for item in items:
        called.clear()
        start = time.process_time()
        if not _passes(item):
            failed.append(item.nodeid)
        seconds[item.nodeid] = time.process_time() - start
        for function in called:
            calls[function].append(item.nodeid)
    return calls, seconds, failed


def _let_tell(path: str, known: _Known, called: set[str]) -> None:
    """All functions of a file tell when they are called; a profiler would take many times as long."""
    setattr(builtins, _TOLD, called)
    source = Path(path).read_text(encoding="utf-8")
    for function, telling in operators.telling(source, path, _TOLD):
        for each in known[path, function]:
            each.__code__ = telling


def _passes(item: pytest.Item) -> bool:
    return not any(report.failed for report in runtestprotocol(item, log=False, nextitem=None))


def _noticed(mutant: operators.Mutant, path: str, known: _Known, tests: Sequence[pytest.Item], seconds: float) -> bool:
    """Whether a test fails, or does not end."""
    child = os.fork()
    if not child:
        status = 2
        with contextlib.suppress(BaseException):
            for timer, number, limit in (
                (signal.ITIMER_PROF, signal.SIGPROF, seconds),
                (signal.ITIMER_REAL, signal.SIGALRM, _LONGEST),
            ):
                signal.signal(number, signal.SIG_DFL)
                signal.setitimer(timer, limit)
            with _silence():
                changed = operators.code_of(mutant, path)
                for function in known[path, mutant.line]:
                    function.__code__ = changed
                status = 0 if all(_passes(item) for item in tests) else 1
        os._exit(status)
    _, status = os.waitpid(child, 0)
    return status != 0


@contextlib.contextmanager
def _silence() -> Iterator[None]:
    """What tests and broken code print is nobody's matter."""
    with open(os.devnull, "w", encoding="utf-8") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        os.dup2(nowhere.fileno(), 2)
        yield
