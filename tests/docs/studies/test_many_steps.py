"""Prediction over many steps: exact for affine steps, as accurate as over one step, and equal to the thesis' product in
1D.
"""

import numpy as np
import pytest
from box_meshes import box_mesh
from mesh_motion_numerics.interpolation.interpolant import factorize
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.metrics import cell_quality, reference_sizes

from docs.studies.thesis._many_steps import predict_many_steps
from docs.studies.thesis._predictors import PREDICTORS, CallableField, InterpolantField


def square(n: int) -> tuple[np.ndarray, CellTable]:
    mesh = box_mesh("quad + triangle", n)
    return mesh.points, mesh.cells


def affine(matrix: np.ndarray, shift: np.ndarray) -> CallableField:
    return CallableField(
        lambda x: x @ matrix.T + shift, lambda x: np.broadcast_to(matrix, (len(x), len(shift), len(shift)))
    )


@pytest.mark.parametrize("name", PREDICTORS)
def test_affine_steps_are_predicted_exactly_in_their_order(name):
    points, cells = square(5)
    sizes, rng = reference_sizes(points, cells), np.random.default_rng(3)
    steps = [affine(0.3 * rng.normal(size=(2, 2)), rng.normal(size=2)) for _ in range(4)]
    moved = points
    for step in steps:
        moved = moved + step.displacement(moved)
    predicted, actual = predict_many_steps(name, points, cells, sizes, steps), cell_quality(moved, cells, sizes)
    np.testing.assert_allclose(predicted.size, actual.size, rtol=1e-9)
    np.testing.assert_allclose(predicted.skew, actual.skew, rtol=1e-9)
    assert not np.allclose(predict_many_steps(name, points, cells, sizes, steps[::-1]).skew, actual.skew, rtol=0.01)


def test_one_dimension_is_the_product_of_the_thesis():
    """(3.12): two bodies approach in ten steps; each step has its own interpolant of the moved boundary."""
    points = np.linspace(0.0, 1.0, 21)[:, None]
    cells = CellTable.from_arrays({"line": np.c_[np.arange(20), np.arange(1, 21)]})
    sizes, boundary = reference_sizes(points, cells), points[[0, 4, 16, 20]]
    changes = np.array([[0.0], [0.015], [-0.015], [0.0]])
    steps, centres, product = [], 0.5 * (points[1:] + points[:-1]), np.ones(20)
    for _ in range(10):
        step = InterpolantField(factorize(boundary, support_radius=0.4).solve(changes))
        product *= 1.0 + step.gradient(centres)[:, 0, 0]
        centres, boundary = centres + step.displacement(centres), boundary + changes
        steps.append(step)
    predicted = predict_many_steps("centre-gradient", points, cells, sizes, steps)
    np.testing.assert_allclose(predicted.size, np.minimum(product, 1.0 / product), rtol=1e-12)
    exact = predict_many_steps("trial-nodes", points, cells, sizes, steps)
    assert np.abs(predicted.size - exact.size).max() < 0.04
    assert exact.size.min() > 0.0
