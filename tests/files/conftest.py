"""Meshes for the tests of several readers."""

import numpy as np
import pytest
from numpy.typing import NDArray

Cells = dict[str, NDArray[np.int64]]


@pytest.fixture
def all_solids() -> tuple[NDArray[np.float64], Cells]:
    points = np.array(
        [
            [0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1],
            [0.5, 0.5, 1.7], [2, 0, 0], [2, 1, 0], [1.7, -0.6, 0.4],
        ],
        dtype=np.float64,
    )  # fmt: skip
    cells: Cells = {
        "tetra": np.array([[1, 9, 5, 11]]),
        "hexahedron": np.array([[0, 1, 2, 3, 4, 5, 6, 7]]),
        "wedge": np.array([[1, 9, 5, 2, 10, 6]])[:, [0, 2, 1, 3, 5, 4]],
        "pyramid": np.array([[4, 5, 6, 7, 8]]),
    }
    return points, cells
