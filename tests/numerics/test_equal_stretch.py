"""The optimum in one dimension."""

import numpy as np
import pytest
from mesh_motion_numerics.correction.equal_stretch import equal_stretch
from mesh_motion_numerics.correction.trial_nodes import TrialMesh
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.metrics import reference_sizes


def line(x: np.ndarray, held: list[int], lines: np.ndarray | None = None) -> TrialMesh:
    points = x[:, None]
    n = np.arange(len(x))
    cells = CellTable.from_arrays({"line": np.column_stack([n[:-1], n[1:]]) if lines is None else lines})
    marked = np.zeros(len(x), dtype=bool)
    marked[held] = True
    return TrialMesh(points, cells, reference_sizes(points, cells), marked, "size")


def test_the_case_of_table_4_1_reaches_its_ceiling() -> None:
    x = np.linspace(0, 1, 21)
    mesh = line(x, [0, 4, 16, 20])
    positions = mesh.reference.copy()
    positions[4] += 0.15
    positions[16] -= 0.15
    moved = equal_stretch(positions, mesh)
    assert np.array_equal(moved[mesh.held], positions[mesh.held])
    # the middle 0.6 shrinks to 0.3, the outer 0.2 grow to 0.35
    assert mesh.quality(moved).min() == pytest.approx(0.5)
    assert mesh.quality(moved)[0] == pytest.approx(0.2 / 0.35)


def test_cells_of_different_size_keep_their_proportions() -> None:
    x = np.array([0.0, 0.1, 0.4, 1.0])
    mesh = line(x, [0, 3])
    moved = equal_stretch(np.array([[0.0], [9.0], [-4.0], [2.0]]), mesh)
    np.testing.assert_allclose(moved[:, 0], 2 * x)


def test_numbering_gaps_and_loose_ends() -> None:
    x = np.array([0.5, 0.0, 2.0, 0.25, 2.5, 3.0])  # 0 – .25 – .5 and 2 – 2.5 – 3, only one node held in the second
    mesh = line(x, [1, 0, 4], np.array([[1, 3], [3, 0], [2, 4], [4, 5]]))
    positions = mesh.reference.copy()
    positions[0], positions[4] = 1.0, 3.5
    np.testing.assert_allclose(equal_stretch(positions, mesh)[:, 0], [1.0, 0.0, 3.0, 0.5, 3.5, 4.0])
