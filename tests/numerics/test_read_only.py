"""Inputs are handed over frozen, and nobody's array is changed."""

import numpy as np
import pytest

from mesh_motion_server.numerics.read_only import read_only


def test_a_view_not_a_copy():
    array = np.arange(6.0).reshape(2, 3)
    view = read_only(array)
    assert np.shares_memory(view, array)
    with pytest.raises(ValueError, match="read-only"):
        view[0, 0] = 1.0
    assert array.flags.writeable
    assert read_only(array.T).flags.c_contiguous
