"""The number of threads of the compiled loops. Results do not depend on it."""

from collections.abc import Iterator
from contextlib import contextmanager

import mesh_motion_kernels as kernels
from mesh_motion_protocol.errors import InvalidInput

__all__ = ["checked_threads", "limited_to"]


def checked_threads(threads: int | None) -> int:
    """Return a number of threads if it is available; None stands for all threads.

    Raises
    ------
    InvalidInput
        If the number is less than 1, or more than the process had at its start.
    """
    available = kernels.available_threads()
    if threads is not None and not 1 <= threads <= available:
        raise InvalidInput(
            f"expected 1 to {available} evaluation threads, got {threads}", hint="set MESH_MOTION_THREADS for more"
        )
    return threads or available


@contextmanager
def limited_to(threads: int | None) -> Iterator[None]:
    """Limit the calling thread's compiled loops to this number of threads inside the block; None changes nothing."""
    before = kernels.get_threads()
    kernels.set_threads(min(before, threads or before))
    try:
        yield
    finally:
        kernels.set_threads(before)
