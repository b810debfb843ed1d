"""How many threads a compiled loop gets: one where the work is over before a second one has started.

A parallel loop ends when its last thread does. On a machine with other work that thread may have to wait for a core,
for milliseconds; a loop of less than that must not ask for it. Results do not depend on the number of threads.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import mesh_motion_kernels as kernels
import numba

from mesh_motion_server.errors import InvalidInput

__all__ = ["checked_threads", "limited_to", "threads_for"]

#: Evaluations of a basis function (about a nanosecond each) below which a loop stays on its caller's thread.
_SMALL = 2e6


def checked_threads(threads: int | None) -> int:
    """A number of threads that can be had; None stands for all.

    Raises
    ------
    InvalidInput
        If it is less than 1 or more than the process was started with.
    """
    available = kernels.available_threads()
    if threads is not None and not 1 <= threads <= available:
        raise InvalidInput(
            f"expected 1 to {available} evaluation threads, got {threads}", hint="set MESH_MOTION_THREADS for more"
        )
    return threads or available


@contextmanager
def limited_to(threads: int | None) -> Iterator[None]:
    """Compiled loops of the calling thread use at most so many threads inside; None changes nothing."""
    before = kernels.get_threads()
    kernels.set_threads(min(before, threads or before))
    try:
        yield
    finally:
        kernels.set_threads(before)


@contextmanager
def threads_for(work: float, at_most: int | None = None) -> Iterator[None]:
    """Limit the calling thread's parallel loops while about ``work`` basis functions are evaluated, and restore."""
    before = numba.get_num_threads()
    limit = 1 if work < _SMALL else min(before, at_most or before)
    if limit == before:  # to set what is set takes microseconds all the same
        yield
        return
    numba.set_num_threads(limit)
    try:
        yield
    finally:
        numba.set_num_threads(before)
