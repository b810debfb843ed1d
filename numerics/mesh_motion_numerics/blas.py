"""Linear algebra that is bitwise the same for any number of threads.

A threaded BLAS splits its sums by the number of threads, and its idle threads spin while others compute. So matrices
are cut into fixed tiles, each tile is computed by one thread of a BLAS limited to one, and the tiles are spread over
Python threads (NumPy releases the interpreter lock in matrix products).
"""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache

import mesh_motion_kernels as kernels
from threadpoolctl import LibController, ThreadpoolController


@cache
def _libraries() -> list[LibController]:
    """Find all loaded BLAS libraries; only once, because it takes milliseconds."""
    import scipy.linalg  # noqa: F401, PLC0415  SciPy's own BLAS must be loaded to be found

    return list(ThreadpoolController().select(user_api="blas").lib_controllers)


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit every loaded BLAS to one thread, and restore the limits at the end."""
    several = []
    for library in _libraries():
        # a call within another one finds 1, and restores nothing too early
        if (found := library.get_num_threads()) != 1:
            several.append((library, found))
            library.set_num_threads(1)
    try:
        yield
    finally:
        for library, found in several:
            library.set_num_threads(found)


def for_each_tile(task: Callable[[int, int], None], size: int, tile: int) -> None:
    """Call ``task(first, last)`` for every tile of ``range(size)``, on as many threads as the compiled kernels use."""
    tiles = [(first, min(first + tile, size)) for first in range(0, size, tile)]
    threads = min(len(tiles), int(kernels.get_threads()))
    if threads <= 1:  # a pool of one thread costs its start, and gains nothing
        for bounds in tiles:
            task(*bounds)
        return
    with ThreadPoolExecutor(threads) as pool:
        for future in [pool.submit(task, *bounds) for bounds in tiles]:
            future.result()  # raises what the tile raised
