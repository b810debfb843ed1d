"""Waiting for expected events, on a machine that may be busy."""

import time
from collections.abc import Callable
from typing import TypeVar

from tests.faults.check import require

_Value = TypeVar("_Value")

#: Whatever is asked for has come, or was refused, by then; seconds.
PATIENCE = 60.0
_PAUSE = 0.01


def wait_until(condition: Callable[[], _Value], what: str, seconds: float = PATIENCE) -> _Value:
    """Poll until the condition holds, and return its value.

    Raises BrokenPromise, with ``what`` in its text, if the condition does not hold in time.
    """
    deadline = time.monotonic() + seconds
    while not (value := condition()):
        require(time.monotonic() < deadline, f"{what}: not within {seconds:.0f} s")
        time.sleep(_PAUSE)
    return value
