"""Runs the tests that call a function against each of its mutants, in processes forked from one that has loaded all.

Tests are collected once. A first child runs each of them and reports which functions it calls and its time; then
for each mutant a child puts the changed code in the place of the function's own, and runs the tests that call it until
one fails: first those that noticed the function's other mutants, then the quickest. A child that does not end in time
counts as noticed. Properties (hypothesis) are tried on the same examples each time.
"""

import contextlib
import cProfile
import gc
import importlib
import json
import os
import signal
import sys
import threading
import time
import types
from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from _pytest.runner import runtestprotocol
from mutation_operators import Mutant, mutants

__all__ = ["Trial", "run"]

#: Processor seconds that a test may take with a mutant beyond those without one; and how many times these.
_PATIENCE, _FACTOR = 2.0, 3.0
#: What waits for ever takes no processor's time: seconds on the wall.
_LONGEST = 120.0
#: Tests that write and sync need no disk where there is such a folder.
_MEMORY = Path("/dev/shm")


class Trial:
    """A pytest plugin that mutates in place of running the tests.

    Parameters
    ----------
    modules : names of the modules to be mutated
    but : by module, keys of mutants that are not tried

    Attributes
    ----------
    tried : Counter
        By module, how many mutants.
    survived : dict
        By module, keys of the mutants that no test noticed.
    problem : str
        Why nothing could be tried.
    """

    def __init__(self, modules: Iterable[str], but: Mapping[str, Collection[str]]) -> None:
        self.files = {name: str(Path(str(importlib.import_module(name).__file__)).resolve()) for name in modules}
        self.but, self.problem = but, "no tests"
        self.tried: Counter[str] = Counter()
        self.survived: dict[str, list[str]] = {name: [] for name in self.files}

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
        gc.unfreeze()  # what an earlier trial of this process has frozen is not found
        known = _functions(set(self.files.values()))
        gc.freeze()  # children then leave this process' memory as it is
        calls, seconds, failed = _in_child(_watch, session.items, set(self.files.values())) or ({}, {}, ["all"])
        self.problem = f"without a mutant these fail: {', '.join(failed)}" if failed or session.testsfailed else ""
        tests = {item.nodeid: item for item in session.items}
        for name, path in self.files.items() if not self.problem else ():
            ranks: Counter[tuple[str, str]] = Counter()
            for mutant in mutants(Path(path).read_text(encoding="utf-8"), path):
                if mutant.key in self.but.get(name, ()):
                    continue
                self.tried[name] += 1
                reporting = sorted(calls.get(f"{path}:{mutant.line}", []), key=seconds.__getitem__)
                reporting.sort(key=lambda test: -ranks[mutant.function, test])
                timed = [(tests[test], _PATIENCE + _FACTOR * seconds[test]) for test in reporting]
                end = _in_child(_first_failure, mutant, known[path, mutant.line], timed)
                ranks[mutant.function, end or ""] += 1
                if end == "":
                    self.survived[name].append(mutant.key)
            sys.stderr.write(f"{name}: {self.tried[name]} tried, {len(self.survived[name])} not noticed\n")
        return True


def run(trial: Trial, tests: Sequence[str]) -> Trial:
    """Collect the tests and let the trial have them."""
    with TemporaryDirectory(dir=_MEMORY if _MEMORY.is_dir() else None) as folder:
        where = f"--basetemp={folder}/tests"  # each child's first test empties it
        pytest.main(["-q", "-p", "no:cacheprovider", "-m", "not slow", where, *tests], plugins=[trial])
    return trial


_Known = Mapping[tuple[str, int], list[types.FunctionType]]


def _functions(files: set[str]) -> _Known:
    """(file, first line) → the functions that were made of it."""
    known: _Known = defaultdict(list)
    for each in gc.get_objects():
        if isinstance(each, types.FunctionType) and each.__code__.co_filename in files:
            known[each.__code__.co_filename, each.__code__.co_firstlineno].append(each)
    return known


# --- in children -----------------------------------------------------------------------------------------------------


def _in_child(work: Callable[..., Any], *given: object) -> Any:
    """What ``work(*given)`` returns, by way of JSON, or None if it is ended; this process stays as it is."""
    with TemporaryDirectory(dir=_MEMORY if _MEMORY.is_dir() else None) as folder:
        answer = Path(folder, "told.json")
        child = os.fork()
        if not child:
            with contextlib.suppress(BaseException), open(os.devnull, "w", encoding="utf-8") as nowhere:
                os.dup2(nowhere.fileno(), 1)  # what tests and broken code print is of no interest
                os.dup2(nowhere.fileno(), 2)
                answer.write_text(json.dumps(work(*given)))
            os._exit(0)
        os.waitpid(child, 0)
        return json.loads(answer.read_text() or "null") if answer.exists() else None


def _watch(items: Iterable[pytest.Item], files: set[str]) -> Any:
    """Function ("file:first line") → tests that call it; seconds of each test; tests that fail."""
    calls: dict[str, list[str]] = defaultdict(list)
    seconds, failed = {}, []
    for item in items:
        profiles: list[cProfile.Profile] = []
        start = time.process_time()
        threading.setprofile(lambda *_, profiles=profiles: _profile(profiles))
        _profile(profiles)
        passes = _passes(item)
        threading.setprofile(None)
        profiles[0].disable()
        seconds[item.nodeid] = time.process_time() - start
        failed += [] if passes else [item.nodeid]
        codes = {entry.code for profile in profiles for entry in profile.getstats()}
        for code in codes:
            if isinstance(code, types.CodeType) and code.co_filename in files:
                calls[f"{code.co_filename}:{code.co_firstlineno}"].append(item.nodeid)
    return calls, seconds, failed


def _profile(profiles: list[cProfile.Profile]) -> None:
    """Note the calls of this thread from now on; since Python 3.12 the first profile notes those of all threads."""
    sys.setprofile(None)
    profile = cProfile.Profile(builtins=False)
    with contextlib.suppress(ValueError):
        profile.enable()
        profiles.append(profile)


def _first_failure(
    mutant: Mutant, places: Sequence[types.FunctionType], tests: Iterable[tuple[pytest.Item, float]]
) -> str:
    """The first test that fails with this mutant in place; a signal ends the process when the time is over."""
    signal.signal(signal.SIGPROF, signal.SIG_DFL)
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_REAL, _LONGEST)
    for function in places:
        function.__code__ = mutant.code
    for item, seconds in tests:
        signal.setitimer(signal.ITIMER_PROF, seconds)
        if not _passes(item):
            return item.nodeid
    return ""


def _passes(item: pytest.Item) -> bool:
    try:
        return not any(report.failed for report in runtestprotocol(item, log=False, nextitem=None))
    except BaseException:  # what the test's own code does not expect either
        return False
