"""As many threads as there is work for.

A parallel loop with one work item still wakes every thread and waits for all of them: on a busy machine milliseconds
for a loop of microseconds. Results never depend on the number of threads, so it may follow the work.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from numba import get_num_threads, set_num_threads

__all__ = ["threads_for"]


@contextmanager
def threads_for(items: int) -> Iterator[None]:
    """Run the parallel kernels inside on at most ``items`` threads, at least one."""
    before = get_num_threads()
    set_num_threads(max(1, min(items, before)))
    try:
        yield
    finally:
        set_num_threads(before)
