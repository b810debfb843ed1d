import numba
import pytest

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.threads import checked_threads, threads_for


def test_small_work_stays_on_one_thread_and_the_number_is_restored():
    before = numba.get_num_threads()
    with threads_for(1000.0):
        assert numba.get_num_threads() == 1
    assert numba.get_num_threads() == before
    with threads_for(1e9):
        assert numba.get_num_threads() == before
    with threads_for(1e9, 1):
        assert numba.get_num_threads() == 1


def test_the_number_is_restored_after_an_error():
    before = numba.get_num_threads()
    with pytest.raises(ValueError, match="inside"), threads_for(1.0):
        raise ValueError("inside")
    assert numba.get_num_threads() == before


def test_a_limit_set_outside_is_not_exceeded():
    numba.set_num_threads(1)
    try:
        with threads_for(1e9, numba.config.NUMBA_NUM_THREADS):
            assert numba.get_num_threads() == 1
    finally:
        numba.set_num_threads(numba.config.NUMBA_NUM_THREADS)


def test_numbers_that_cannot_be_had():
    available = numba.config.NUMBA_NUM_THREADS
    assert checked_threads(None) == checked_threads(available) == available
    for threads in (0, -1, available + 1):
        with pytest.raises(InvalidInput, match=f"expected 1 to {available} evaluation threads, got {threads}"):
            checked_threads(threads)
