"""Runs the tests that call a function against each of its mutants, in processes forked from one that has loaded all.

Tests are collected once. A first child runs each of them and tells which functions of the modules it calls and how long
it takes; then for each mutant a child puts the changed code in the place of the function's own, and runs the tests that
call it until one fails: first those that noticed the function's other mutants, then the quickest. A child that does not
end in time counts as noticed. Properties (hypothesis) are tried on the same examples each time.
"""

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
from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any

import mutation_operators as operators
import pytest
from _pytest.runner import runtestprotocol

__all__ = ["Outcome", "Trial", "run"]

#: Processor seconds that the tests of one mutant may take beyond those without one; and how many times these.
_PATIENCE, _FACTOR = 2.0, 3.0
#: What waits for ever takes no processor's time: seconds on the wall.
_LONGEST = 120.0
#: Tests that write and sync need no disk where there is such a folder.
_MEMORY = Path("/dev/shm")
#: A set among the builtins while functions tell when they are called.
_TOLD = "__called__"
#: Of a function's tests those of the module's own files are run, and the quickest others: processor seconds together.
_OTHERS = 1.0


@dataclass
class Outcome:
    """What came of a module's mutants.

    Attributes
    ----------
    killed : int
    late : int
        Of the killed ones those that did not end in time.
    survived : list of str
        Keys of those that no test noticed.
    left : int
        Mutants that were not tried.
    seconds : float
        What it took, on the wall.
    """

    killed: int = 0
    late: int = 0
    survived: list[str] = field(default_factory=list)
    left: int = 0
    seconds: float = 0.0

    @property
    def tried(self) -> int:
        """Mutants that were tried."""
        return self.killed + len(self.survived)


@dataclass
class Trial:
    """A pytest plugin that mutates in place of running the tests.

    Attributes
    ----------
    modules : mapping
        Module → names of the files of which each test is run that calls it.
    but : mapping
        Keys that are not tried, by module.
    like : str
        What a key must contain.
    sample : int or None
        So many mutants of each module, chosen at random.
    seed : int
    outcomes : dict
        By module.
    problem : str
        Why nothing could be tried.
    """

    modules: Mapping[str, Sequence[str]]
    but: Mapping[str, Collection[str]] = field(default_factory=dict)
    like: str = ""
    sample: int | None = None
    seed: int = 1
    outcomes: dict[str, Outcome] = field(default_factory=dict)
    problem: str = ""

    def pytest_sessionstart(self) -> None:
        """Properties: the same examples each time, and no search for the simplest one."""
        from hypothesis import Phase, settings  # noqa: PLC0415  pytest loads it first

        phases = (Phase.explicit, Phase.generate)
        settings.register_profile(
            "mutation", max_examples=200, deadline=None, derandomize=True, database=None, phases=phases
        )
        settings.load_profile("mutation")

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Called once the tests are collected."""
        files = {name: _file(name) for name in self.modules}
        sources = {name: Path(path).read_text(encoding="utf-8") for name, path in files.items()}
        gc.unfreeze()  # what an earlier trial of this process has frozen is not found
        known = _functions(set(files.values()))
        gc.freeze()  # children then leave this process' memory as it is
        calls, seconds, failed = _in_child(lambda: _watch(session.items, files.values(), known))
        if failed or session.testsfailed:
            self.problem = f"without a mutant these fail: {', '.join(failed) or 'collection'}"
            return True
        by_name = {item.nodeid: item for item in session.items}
        for name, path in files.items():
            self.outcomes[name] = outcome = Outcome()
            start = time.monotonic()
            ranks: Counter[tuple[str, str]] = Counter()
            for mutant in self._chosen(name, sources[name], outcome):
                tests = _telling(self.modules[name], calls.get(f"{path}:{mutant.line}", []), seconds)
                tests.sort(key=lambda test: -ranks[mutant.function, test])
                limit = _PATIENCE + _FACTOR * sum(seconds[test] for test in tests)
                end = _end_of(mutant, path, known, [by_name[test] for test in tests], limit)
                if end == _UNNOTICED:
                    outcome.survived.append(mutant.key)
                    _tell(f"{name}: {mutant.key}")
                    continue
                outcome.killed += 1
                outcome.late += end in _LATE
                if end >= 0:
                    ranks[mutant.function, tests[end]] += 1
            outcome.seconds = time.monotonic() - start
            _tell(f"{name}: {outcome.killed} of {outcome.tried} noticed, {outcome.seconds:.0f} s")
        return True

    def _chosen(self, name: str, source: str, outcome: Outcome) -> Iterator[operators.Mutant]:
        """Those to be tried, in their order."""
        but, chosen = self.but.get(name, ()), None
        if self.sample is not None:
            total = sum(1 for _ in operators.mutants(source))
            chosen = set(Random(self.seed).sample(range(total), min(self.sample, total)))
        for number, mutant in enumerate(operators.mutants(source)):
            if (chosen is None or number in chosen) and mutant.key not in but and self.like in mutant.key:
                yield mutant
            else:
                outcome.left += 1


def run(trial: Trial, tests: Sequence[str]) -> Trial:
    """Collect the tests and let the trial have them."""
    with TemporaryDirectory(dir=_MEMORY if _MEMORY.is_dir() else None) as folder:
        where = f"--basetemp={folder}/tests"  # each child's first test empties it
        pytest.main(["-q", "-p", "no:cacheprovider", "-m", "not slow", where, *tests], plugins=[trial])
    return trial


def _tell(line: str) -> None:
    sys.stderr.write(line + "\n")


def _telling(own: Sequence[str], tests: Iterable[str], seconds: Mapping[str, float]) -> list[str]:
    """Of the tests that call a function those to be run, the quickest first."""
    left, chosen = _OTHERS, []
    for test in sorted(tests, key=lambda test: seconds[test]):
        mine = Path(test.partition("::")[0]).name in own
        left -= 0.0 if mine else seconds[test]
        if mine or left > 0:
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
    try:
        return not any(report.failed for report in runtestprotocol(item, log=False, nextitem=None))
    except BaseException:  # what the test's own code does not expect either
        return False


#: How a child ends: with the number of the test that failed or one of these, or by a signal.
_UNNOTICED, _NOT_TRIED, _MOST = 255, 254, 253
#: What may end it that did not end in time.
_LATE = (-signal.SIGPROF, -signal.SIGALRM)


def _end_of(mutant: operators.Mutant, path: str, known: _Known, tests: Sequence[pytest.Item], seconds: float) -> int:
    """How a child ends that runs the tests with this mutant in place; negative: by which signal."""
    child = os.fork()
    if not child:
        status = _NOT_TRIED
        with contextlib.suppress(BaseException):
            for timer, number, limit in (
                (signal.ITIMER_PROF, signal.SIGPROF, seconds),
                (signal.ITIMER_REAL, signal.SIGALRM, _LONGEST),
            ):
                signal.signal(number, signal.SIG_DFL)
                signal.setitimer(timer, limit)
            changed = operators.code_of(mutant, path)
            places = known[path, mutant.line]
            for function in places:
                function.__code__ = changed
            if not places:
                os._exit(_NOT_TRIED)
            with _silence():
                failing = (min(number, _MOST) for number, item in enumerate(tests) if not _passes(item))
                status = next(failing, _UNNOTICED)
        os._exit(status)
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if status == _NOT_TRIED:
        raise RuntimeError(f"cannot be put in place: {mutant.key}")
    return status


@contextlib.contextmanager
def _silence() -> Iterator[None]:
    """What tests and broken code print is nobody's matter."""
    with open(os.devnull, "w", encoding="utf-8") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        os.dup2(nowhere.fileno(), 2)
        yield
