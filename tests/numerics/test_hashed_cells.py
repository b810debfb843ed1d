"""Rows of sparse matrices around small bodies in wide domains: equal to a search through all centres."""

import numpy as np
import pytest
from mesh_motion_numerics.interpolation.assembly import mean_row_entries, sparse_matrix, sparse_rows
from mesh_motion_numerics.interpolation.centres import CentreLayout, HashedCells
from mesh_motion_numerics.interpolation.kernels import BASES
from mesh_motion_numerics.mesh.points import padded

C2 = BASES["wendland-c2"]
RADIUS = 0.004


def _centres(d: int) -> np.ndarray:
    rng = np.random.default_rng(d)
    return np.vstack([0.5 + 0.01 * rng.normal(size=(400, d)), rng.random((50, d)), np.zeros((1, d)), np.ones((1, d))])


def _places(d: int) -> np.ndarray:
    rng = np.random.default_rng(10 + d)
    return padded(
        np.vstack([_centres(d)[::3], 0.5 + 0.012 * rng.normal(size=(300, d)), 3.0 * rng.random((50, d)) - 1.0])
    )


def _values(centres: np.ndarray, places: np.ndarray) -> np.ndarray:
    xi = np.linalg.norm(places[:, None] - padded(centres)[None], axis=2) / RADIUS
    return np.maximum(1.0 - xi, 0.0) ** 4 * (4.0 * xi + 1.0)


@pytest.mark.parametrize("d", [1, 2, 3])
def test_rows_are_those_of_all_centres(d: int) -> None:
    centres, places = _centres(d), _places(d)
    layout = CentreLayout.build(centres, C2, RADIUS)
    rows = sparse_rows(layout, C2, RADIUS, places).matrix(len(centres))
    np.testing.assert_allclose(rows.toarray(), _values(centres, places), atol=1e-13)
    matrix = sparse_matrix(layout, C2, RADIUS)
    own = padded(centres[layout.order])
    np.testing.assert_allclose(matrix.toarray(), _values(centres[layout.order], own), atol=1e-13)
    assert matrix.nnz == round(mean_row_entries(layout, RADIUS) * len(centres))


def test_every_point_is_stored_once() -> None:
    points = padded(_centres(3))
    assert sorted(HashedCells.build(points, points.min(axis=0), 1.0, RADIUS).order) == list(range(len(points)))


def test_places_far_away_and_not_finite_find_nothing() -> None:
    places = [(1e300, 0.0, 0.0), (-1e300, 0.0, 0.0), (np.inf, 0.5, 0.5), (0.5, np.nan, 0.5), (5.0, 5.0, 5.0)]
    assert len(sparse_rows(CentreLayout.build(_centres(3), C2, RADIUS), C2, RADIUS, np.array(places)).data) == 0


def test_cells_become_wider_rather_than_too_many() -> None:
    points = padded(_centres(2))
    found = HashedCells.build(points, points.min(axis=0), 1.0, 1e-12)
    assert found.inverse_side < 2**20
