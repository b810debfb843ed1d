"""Frozen and writable inputs meet the same compiled kernel, and nobody's array is changed."""

import numpy as np
import pytest

from mesh_motion_server.numerics import corner_kernels
from mesh_motion_server.numerics.cells import CellTable
from mesh_motion_server.numerics.metrics import cell_quality, reference_sizes
from mesh_motion_server.numerics.read_only import read_only


def test_a_view_not_a_copy():
    array = np.arange(6.0).reshape(2, 3)
    view = read_only(array)
    assert np.shares_memory(view, array)
    with pytest.raises(ValueError, match="read-only"):
        view[0, 0] = 1.0
    assert array.flags.writeable
    assert read_only(array.T).flags.c_contiguous


def test_frozen_arrays_compile_nothing():
    points = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    cells = CellTable.from_arrays({"triangle": np.array([[0, 1, 2]])})
    sizes = reference_sizes(points, cells)
    cell_quality(points, cells, sizes)
    compiled = len(corner_kernels.node_quality.signatures)
    for array in (points, sizes, cells.blocks[0].nodes):
        array.flags.writeable = False
        cell_quality(points, cells, sizes)
    assert len(corner_kernels.node_quality.signatures) == compiled
