from __future__ import annotations

import numpy as np
import pytest

from mesh_motion_server.cases.warm import tiny_meshes
from mesh_motion_server.numerics.cells import CELL_TYPES
from mesh_motion_server.numerics.metrics import cell_quality, reference_sizes

MESHES = dict(tiny_meshes())


def test_there_is_one_of_every_type() -> None:
    assert set(MESHES) == set(CELL_TYPES)


@pytest.mark.parametrize("name", MESHES)
def test_the_tiny_meshes_fill_the_unit_cube_with_valid_cells(name: str) -> None:
    points, cells = MESHES[name]
    sizes = reference_sizes(points, cells)
    assert not cell_quality(points, cells, sizes).inverted.any()
    assert CELL_TYPES[name].size_factor * sizes.sum() == pytest.approx(1.0)
    assert np.ptp(points, axis=0) == pytest.approx(np.ones(points.shape[1]))
