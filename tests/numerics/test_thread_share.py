"""The number of threads follows the work and is restored, also after an error."""

import pytest
from numba import get_num_threads

from mesh_motion_server.numerics.thread_share import threads_for


@pytest.mark.parametrize(("items", "expected"), [(0, 1), (1, 1), (10**6, get_num_threads())])
def test_threads_follow_the_work(items, expected):
    before = get_num_threads()
    with threads_for(items):
        assert get_num_threads() == expected
    assert get_num_threads() == before
    with pytest.raises(RuntimeError), threads_for(items):
        raise RuntimeError
    assert get_num_threads() == before
