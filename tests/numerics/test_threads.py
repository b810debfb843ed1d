import mesh_motion_kernels as kernels
import pytest
from mesh_motion_numerics.threads import checked_threads, limited_to
from mesh_motion_protocol.errors import InvalidInput


def test_a_limit_holds_inside_and_is_restored_also_after_an_error():
    before = kernels.get_threads()
    with limited_to(1):
        assert kernels.get_threads() == 1
    assert kernels.get_threads() == before
    with pytest.raises(ValueError, match="inside"), limited_to(1):
        raise ValueError("inside")
    assert kernels.get_threads() == before
    with limited_to(None):
        assert kernels.get_threads() == before


def test_a_limit_set_outside_is_not_exceeded():
    with limited_to(1), limited_to(kernels.available_threads()):
        assert kernels.get_threads() == 1


def test_numbers_that_cannot_be_had():
    available = kernels.available_threads()
    assert checked_threads(None) == checked_threads(available) == available
    for threads in (0, -1, available + 1):
        with pytest.raises(InvalidInput, match=f"expected 1 to {available} evaluation threads, got {threads}"):
            checked_threads(threads)
