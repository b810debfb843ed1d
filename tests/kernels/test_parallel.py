"""Loops on several threads: at the same time, after a fork, with an error in a block, limited for one thread only."""

import os
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

import mesh_motion_kernels as kernels
import numpy as np
import pytest
from python_runs import said_by_python

#: Words of some hundred blocks.
_WORDS = np.random.default_rng(0).integers(0, 2**63, 2**21, dtype=np.uint64)

_FORK = """
import os, signal, sys, threading
import mesh_motion_kernels as kernels, numpy as np

words = np.arange(2**21, dtype=np.uint64)
expected, busy = kernels.hash_blocks(words), threading.Event()
assert kernels.get_threads() == 3
if sys.argv[1] == "busy":  # another thread is inside a loop while the process is forked
    def work():
        while True:
            kernels.hash_blocks(words)
            busy.set()
    threading.Thread(target=work, daemon=True).start()
    busy.wait()
for _ in range(20):
    child = os.fork()
    if child == 0:
        signal.alarm(20)
        same = all(np.array_equal(kernels.hash_blocks(words), expected) for _ in range(3))
        os._exit(0 if same and kernels.get_threads() == 3 else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    assert np.array_equal(kernels.hash_blocks(words), expected)
"""


def _run(script: str, *arguments: str) -> None:
    """On three threads, on any machine."""
    said_by_python("-c", script, *arguments, env=os.environ | {"MESH_MOTION_THREADS": "3"}, timeout=100)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork")
@pytest.mark.parametrize("parent", ["idle", "busy"])
def test_a_forked_child_computes(parent: str) -> None:
    _run(_FORK, parent)


def test_loops_of_several_callers_run_side_by_side() -> None:
    expected = kernels.hash_blocks(_WORDS)
    together = Barrier(4)

    def repeated(_: int) -> bool:
        together.wait()
        return all(np.array_equal(kernels.hash_blocks(_WORDS), expected) for _ in range(25))

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(repeated, range(4)))


_LOST = """
import mesh_motion_kernels as kernels, numpy as np

points, found = np.zeros((10, 3)), np.empty((10**6, 3))
for row in (0, 5 * 10**5, 10**6 - 1):
    for lost in (-1, 10):
        rows = np.zeros(10**6, dtype=np.int64)
        rows[row] = lost
        try:
            kernels.take_differences(points, points, rows, found)
        except ValueError as error:
            assert str(error) == "rows: expected rows of base", error
        else:
            raise AssertionError("no error")
rows[:] = 3
found[:] = 1.0
kernels.take_differences(points, points, rows, found)
assert (found == 0.0).all()
"""


_LIMITS = """
import threading
import mesh_motion_kernels as kernels

assert kernels.get_threads() == kernels.available_threads() == 3
kernels.set_threads(2)
found = []
def other():
    found.append(kernels.get_threads())
    kernels.set_threads(1)
    found.append(kernels.get_threads())
thread = threading.Thread(target=other)
thread.start()
thread.join()
assert found == [3, 1]
assert kernels.get_threads() == 2
for threads in (0, -1, 4):
    try:
        kernels.set_threads(threads)
    except ValueError as error:
        assert "expected 1 thread to as many as are available" in str(error)
    else:
        raise AssertionError(threads)
assert kernels.get_threads() == 2
"""


_LEFT_INSIDE = """
import threading, mesh_motion_kernels as kernels, numpy as np

words, begun = np.zeros(2**21, dtype=np.uint64), threading.Event()
def work():
    while True:
        kernels.hash_blocks(words)
        begun.set()
threading.Thread(target=work, daemon=True).start()
begun.wait()
"""


@pytest.mark.parametrize(
    "script",
    [
        pytest.param(_LOST, id="an error in a block reaches Python and the next loop runs"),
        pytest.param(_LIMITS, id="a limit is that of the calling thread"),
        pytest.param(_LEFT_INSIDE, id="an interpreter ends while a thread is inside a loop"),
    ],
)
def test_a_process_with_three_threads(script: str) -> None:
    _run(script)
