import numpy as np
import pytest
from mesh_motion_numerics.interpolation.assembly import dense_block, mean_row_entries, sparse_matrix
from mesh_motion_numerics.interpolation.centres import CentreLayout
from mesh_motion_numerics.interpolation.factorizations import choice
from mesh_motion_numerics.interpolation.interpolant import factorize
from mesh_motion_numerics.interpolation.kernels import BASES, values

C2 = BASES["wendland-c2"]


def square(n):
    """Boundary points of the unit square, n a side, and their spacing."""
    t = np.linspace(0, 1, n, endpoint=False)
    zero, one = np.zeros(n), np.ones(n)
    sides = [(t, zero), (one, t), (1 - t, one), (zero, 1 - t)]
    return np.concatenate([np.column_stack(side) for side in sides])


@pytest.mark.parametrize(
    ("n", "radius", "solver"),
    [
        (100, 0.01, "dense"),  # few points
        (500, 0.02, "sparse"),  # ten spacings
        (500, 0.5, "dense"),  # long rows
    ],
)
def test_auto(n, radius, solver):
    assert factorize(square(n), support_radius=radius).solver == solver


def test_auto_beyond_the_dense_order(monkeypatch):
    monkeypatch.setattr(choice, "_DENSE_ORDER", 300)
    assert factorize(square(100), support_radius=0.5).solver == "iterative"


@pytest.mark.parametrize("name", ["wendland-c2", "ctps-c1"])
def test_sparse_rows_are_the_dense_matrix(name):
    points = np.random.default_rng(0).random((400, 3))
    layout = CentreLayout.build(points, BASES[name], 0.15)
    assert not layout.is_direct
    sparse = sparse_matrix(layout, BASES[name], 0.15)
    ordered = points[layout.order]
    dense = values(BASES[name], np.linalg.norm(ordered[:, None] - ordered, axis=2) / 0.15)
    assert np.allclose(sparse.toarray(), dense, rtol=0, atol=1e-14)
    assert sparse.has_sorted_indices
    assert sparse.nnz == round(mean_row_entries(layout, 0.15) * 400)
    assert np.allclose(dense_block(BASES[name], 0.15, ordered[:7], ordered[3:50]), dense[:7, 3:50], rtol=0, atol=1e-14)
