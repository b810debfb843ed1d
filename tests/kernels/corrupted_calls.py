"""Calls loops like moves and tests, but with one invalid whole number; prints ``name finding`` for each loop.

A loop gives a result, a TypeError or a ValueError. Each call runs in a separate process, which may end.
"""

import os
import sys
from collections.abc import Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
import fuzz
from recorded_calls import LOOPS, Recorder

#: Of each array of a call so many entries are changed, one at a time.
_TRIALS = 12


class Kept(Recorder):
    def __init__(self) -> None:
        super().__init__(sys.stdout.buffer)
        self.kept: dict[str, list[tuple[Any, ...]]] = {name: [] for name in LOOPS}

    def call(self, name: str, arguments: tuple[Any, ...]) -> Any:
        self.kept[name].append(deepcopy(arguments))
        self.calls[name] += 1
        return self.loops[name](*arguments)


def arrays_in(arguments: Any) -> Iterator[np.ndarray]:
    if isinstance(arguments, tuple | list):
        for each in arguments:
            yield from arrays_in(each)
    elif isinstance(arguments, np.ndarray) and arguments.dtype.kind == "i" and arguments.size:
        yield arguments


def corrupted(call: tuple[Any, ...], rng: np.random.Generator, name: str) -> Iterator[tuple[Any, ...]]:
    """The call with one changed whole number, for all changes."""
    for number in range(len(list(arrays_in(call)))):
        for _ in range(_TRIALS):
            other = deepcopy(call)
            array = list(arrays_in(other))[number]
            wrong = fuzz.no_indices(array.dtype)
            # No node number is too large there: the loop visits all smaller numbers, which takes seconds.
            wrong = wrong[wrong < 0] if name == "match_facets" else wrong
            array.flat[rng.integers(array.size)] = rng.choice(wrong)
            yield other


def finding(name: str, loop: Any, calls: list[tuple[Any, ...]]) -> str:
    rng = np.random.default_rng(0)
    for call in calls:
        for arguments in corrupted(call, rng, name):
            try:
                loop(*arguments)
            except (TypeError, ValueError):
                pass
            except Exception as error:
                return f"{error!r} of {fuzz.shown(arguments)}"
    return ""


if __name__ == "__main__":
    recorder = Kept()
    recorder.of_use()
    for name in LOOPS:
        sys.stdout.flush()
        child = os.fork()
        if not child:
            sys.stdout.write(f"{name}\t{finding(name, recorder.loops[name], recorder.kept[name])}\n")
            sys.stdout.flush()
            os._exit(0)
        status = os.waitpid(child, 0)[1]
        if status:
            sys.stdout.write(f"{name}\tends the process: {os.waitstatus_to_exitcode(status)}\n")
