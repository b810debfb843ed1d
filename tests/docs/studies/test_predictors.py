"""Affine displacements are predicted exactly on every cell type, and trial nodes predict exactly.

The orders of convergence are claims of studies (tests/docs/test_studies.py): Figs 3.4, 3.8 and 3.12, and section 3.4.
"""

import numpy as np
import pytest
from box_meshes import CELL_KINDS, box_mesh
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.interpolant import factorize
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.metrics import cell_quality, reference_sizes

from docs.studies.thesis._predictors import PREDICTORS, CallableField, InterpolantField, predict


@pytest.mark.parametrize("kind", CELL_KINDS)
@pytest.mark.parametrize("name", PREDICTORS)
def test_an_affine_displacement_is_predicted_exactly(name, kind):
    mesh = box_mesh(kind, 5)
    points, cells, d = mesh.points, mesh.cells, mesh.points.shape[1]
    rng = np.random.default_rng(d)
    matrix, shift = 0.3 * rng.normal(size=(d, d)), rng.normal(size=d)
    field = CallableField(lambda x: x @ matrix.T + shift, lambda x: np.broadcast_to(matrix, (len(x), d, d)))
    sizes = reference_sizes(points, cells)
    predicted = predict(name, points, cells, sizes, field)
    actual = cell_quality(points + field.displacement(points), cells, sizes)
    np.testing.assert_allclose(predicted.size, actual.size, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(predicted.skew, actual.skew, rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(predicted.inverted, actual.inverted)


def test_node_numbers_may_be_large():
    """Keys of edges are products of node numbers, which are 32 bits long."""
    unused, mesh = 60_000, box_mesh("tetra", 5)
    points = np.vstack([np.zeros((unused, 3)), mesh.points])
    cells = CellTable.from_arrays({"tetra": mesh.cells.blocks[0].nodes + unused})
    field = CallableField(lambda x: 0.1 * x**2, lambda x: 0.2 * x[:, :, None] * np.eye(3))
    found = predict("edge-midpoint-gradient", points, cells, mesh.sizes, field)
    expected = predict("edge-midpoint-gradient", mesh.points, mesh.cells, mesh.sizes, field)
    np.testing.assert_array_equal(found.skew, expected.skew)


def interpolated() -> tuple[np.ndarray, CellTable, np.ndarray, InterpolantField]:
    mesh = box_mesh("tetra", 6)
    control = mesh.points[::7]
    field = InterpolantField(factorize(control, support_radius=2.0).solve(0.1 * np.sin(4 * control[:, ::-1])))
    return mesh.points, mesh.cells, reference_sizes(mesh.points, mesh.cells), field


def test_trial_nodes_are_exact_for_an_interpolant():
    points, cells, sizes, field = interpolated()
    predicted = predict("trial-nodes", points, cells, sizes, field)
    actual = cell_quality(points + evaluation.displacement(field.interpolant, points), cells, sizes)
    np.testing.assert_array_equal(predicted.metric("size-skew"), actual.metric("size-skew"))
    edge, centre = (
        np.abs(predict(name, points, cells, sizes, field).size - actual.size).mean()
        for name in ("edge-midpoint-gradient", "centre-gradient")
    )
    assert edge < 0.3 * centre < 0.01
