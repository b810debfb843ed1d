"""The thesis' three 2D cases (§5.4) with its numbers of iterations, and the properties of every correction."""

from dataclasses import replace

import numpy as np
import pytest
from correction_cases import THESIS, rigid, stored, thesis_case
from correction_cases import case as body_case
from mesh_motion_numerics.correction.enrichment.explicit_iterations import (
    ExplicitSettings,
    explicit_iterations,
    mean_gradient,
)
from mesh_motion_numerics.correction.enrichment.placement import Placement
from mesh_motion_numerics.correction.enrichment.space import EnrichmentSpace
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.interpolant import factorize
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.metrics import cell_quality
from mesh_motion_numerics.quality.quality_summary import judged_mesh


@pytest.mark.parametrize(
    ("name", "lowest", "highest", "printed"),
    [("x", -0.24, -0.22, -0.25), ("xy", -0.49, -0.45, -0.53), ("rotation", -0.58, -0.39, -0.57)],
)
def test_the_standard_motion_in_one_step(name, lowest, highest, printed):
    """Tables 5.4, 5.5, 5.7: the minimum size; the range is what 15 meshes of the same sizes give."""
    c = thesis_case(name)
    found = judged_mesh(c.standard, c.cells, c.reference_sizes, metric="size", distributions=False)[0].metric.min
    assert lowest <= found <= highest
    assert found == pytest.approx(printed, abs=0.1)


def test_the_standard_motion_in_twenty_relative_steps():
    """Table 5.7: 0.27 with R = 2.5; 15 meshes of the same sizes give 0.23 to 0.31."""
    c = thesis_case("rotation")
    points, control = c.start, np.flatnonzero(c.held)
    reference, translation, degrees = THESIS["rotation"]
    for step in range(1, 21):
        share = step / 20
        target = c.start + rigid(stored(reference), tuple(share * np.array(translation)), share * degrees)
        interpolant = factorize(points[control], support_radius=2.5).solve((target - points)[control])
        points = points + evaluation.displacement(interpolant, points)
        points[control] = target[control]
    found, _ = judged_mesh(points, c.cells, c.reference_sizes, metric="size", distributions=False)
    assert 0.23 <= found.metric.min <= 0.31


@pytest.mark.parametrize("name", THESIS)
def test_exact_prediction_keeps_its_word(name):
    c = thesis_case(name)
    settings = ExplicitSettings(enrichment_radius=0.5, threshold=0.15, metric="size")
    found = explicit_iterations(c, settings)
    assert found.reached
    assert all(iterate.predicted == iterate.actual for iterate in found.history)
    assert (
        judged_mesh(found.points, c.cells, c.reference_sizes, metric="size", distributions=False)[0].metric.min
        == found.history[found.best].predicted
    )
    assert not cell_quality(found.points, c.cells, c.reference_sizes).inverted.any()


def test_held_nodes_stay_bitwise_and_the_boundary_feels_nothing():
    c = thesis_case("rotation")
    found = explicit_iterations(c, ExplicitSettings(enrichment_radius=0.5, max_points=5))
    np.testing.assert_array_equal(found.points[c.held], c.standard[c.held])
    none = np.empty(0, dtype=np.int64)
    total = sum(
        EnrichmentSpace(Placement(none, x[None], np.array([0.5])), c.factorization, ("H1",)).displacement(c.start, C)
        for x, C in zip(found.enrichment_points, found.coefficients, strict=True)
    )
    assert np.abs(total[c.held]).max() < 1e-12
    np.testing.assert_allclose(found.points, c.standard + np.where(c.held[:, None], 0.0, total), atol=1e-14)


def test_the_best_iterate_is_kept_when_later_ones_are_worse():
    c = thesis_case("xy")
    found = explicit_iterations(c, ExplicitSettings(enrichment_radius=0.1, threshold=0.9, relaxation=20.0))
    predicted = [iterate.predicted for iterate in found.history]
    assert len(predicted) == 21
    assert not found.reached
    assert found.best == int(np.argmax(predicted)) < 20
    assert len(found.enrichment_points) == found.best
    assert judged_mesh(found.points, c.cells, c.reference_sizes, distributions=False)[0].metric.min == max(predicted)


def test_a_motion_that_is_no_number_ends_at_once():
    c = thesis_case("x")
    broken = c.standard.copy()
    broken[np.flatnonzero(~c.held)[0]] = np.nan
    found = explicit_iterations(replace(c, standard=broken), ExplicitSettings(enrichment_radius=0.5))
    assert (found.best, found.reached) == (0, False)
    assert found.history[0].predicted == -np.inf


def test_the_mean_gradient_of_a_cell():
    J = np.array([[0.1, 0.7], [-0.2, 0.3]])
    points = np.array([[0.0, 0.0], [1.0, 0.1], [1.2, 0.9], [0.1, 1.0]])
    for cells in ({"triangle": np.array([[0, 1, 2]])}, {"quad": np.array([[0, 1, 2, 3]])}):
        found = mean_gradient(points, points + points @ J.T + 3.0, CellTable.from_arrays(cells), 0)
        np.testing.assert_allclose(found, J, atol=1e-14)


def test_in_3d_a_motion_that_inverts_cells_becomes_valid():
    problem = body_case("3D box 0.25 + bend")
    found = explicit_iterations(problem, ExplicitSettings(enrichment_radius=0.5))
    assert found.history[0].actual < 0
    assert found.history[found.best].actual > 0.1
    assert found.coefficients.shape == (found.best, 3, 3)
    np.testing.assert_array_equal(found.points[problem.held], problem.standard[problem.held])


def test_other_functions_also_make_the_first_case_valid():
    c = thesis_case("x")
    for function in ("H2", "H3"):
        found = explicit_iterations(c, ExplicitSettings(enrichment_radius=0.5, function=function))
        assert found.history[found.best].actual > 0, function
