import numpy as np
import pytest
from mesh_motion_numerics.blas import for_each_tile, one_blas_thread
from threadpoolctl import threadpool_info, threadpool_limits


@pytest.mark.parametrize(("size", "tile"), [(0, 4), (1, 4), (4, 4), (5, 4), (1000, 7)])
def test_every_index_is_in_one_tile(size, tile):
    count = np.zeros(size, dtype=int)

    def visit(first, last):
        assert 0 < last - first <= tile
        count[first:last] += 1

    for_each_tile(visit, size, tile)
    assert (count == 1).all()


def test_a_tile_s_error_reaches_the_caller():
    def fail(first, last):
        if first == 8:
            raise ValueError("tile 8")

    with pytest.raises(ValueError, match="tile 8"):
        for_each_tile(fail, 20, 4)


def test_blas_has_one_thread_inside_and_its_own_number_again_outside():
    def threads():
        return [pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"]

    with one_blas_thread():
        pass  # SciPy's library is loaded by now
    with threadpool_limits(2, "blas"):
        with one_blas_thread():
            assert set(threads()) == {1}
        assert set(threads()) == {2}
