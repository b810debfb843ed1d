"""Loops on one thread and on several."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import mesh_motion_kernels as kernels


@contextmanager
def on_threads(threads: int) -> Iterator[None]:
    """Let compiled loops of the calling thread use this number of threads inside."""
    before = kernels.get_threads()
    kernels.set_threads(threads)
    try:
        yield
    finally:
        kernels.set_threads(before)


def on_one_and_on_all_threads(make: Callable[[], Any]) -> list[Any]:
    found = []
    for threads in (1, kernels.get_threads()):
        with on_threads(threads):
            found.append(make())
    return found
