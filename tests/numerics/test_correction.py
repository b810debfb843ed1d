"""The corrections by name: quality of the named cases, and refusals."""

from dataclasses import replace

import numpy as np
import pytest
from box_meshes import box_mesh
from correction_cases import CASES, RADIUS, case, moved, rigid, stored
from mesh_motion_numerics.correction.correction import CORRECTIONS, Correction, correct, spoils
from mesh_motion_numerics.correction.correction_problem import SMALL_MESH, CorrectionProblem
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.interpolant import factorize
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.quality.metrics import cell_quality, cells_at_rest, reference_sizes
from mesh_motion_protocol.errors import QualityRefused

# best minimum size-skew known: all nodes free, ten levels up to p = 1000 of 60 accurate Newton iterations each
CEILINGS = {
    "dx -0.3": 0.3457,
    "dx dy -0.25": 0.3259,
    "-0.2, -0.2, +60°": 0.4310,
    "dx -0.38": 0.1300,
    "rotate 90°": 0.6188,
    "rotate 180°": 0.2984,
    "squeeze between two blocks": 0.1453,
    "3D box 0.25 + bend": 0.3499,
    "3D box + 60° + bend": 0.2911,
    "3D rotate 90°": 0.3414,
}


def settings(correction: str = "optimised", **choices) -> Method:
    return replace(Method(correction=correction, quality_metric="size-skew", enrichment_radius=RADIUS), **choices)


def check(problem: CorrectionProblem, found: Correction) -> None:
    """A corrected mesh is valid, the report names the correction, and the boundary stays bit by bit."""
    quality = cell_quality(found.points, problem.cells, problem.reference_sizes)
    assert not quality.inverted.any()
    assert found.minimum == quality.metric("size-skew").min()
    assert np.array_equal(found.points[problem.held], problem.standard[problem.held])


@pytest.mark.parametrize("name", CASES)
def test_optimised_reaches_the_ceiling(name: str) -> None:
    problem = case(name)
    found = correct(problem, settings(quality_threshold=0.65, correction_target="maximum"))
    check(problem, found)
    assert found.minimum >= 0.995 * CEILINGS[name]
    assert (found.method, found.reached) == ("optimised", False)
    assert found.freed_nodes == np.count_nonzero(~problem.held)


@pytest.mark.parametrize("name", CASES)
def test_enrichment_alone_reaches_two_thirds_of_the_ceiling(name: str) -> None:
    problem = case(name)
    found = correct(problem, settings("enrichment", quality_threshold=0.65, correction_target="maximum"))
    check(problem, found)
    assert found.minimum >= 0.75 * CEILINGS[name]
    assert found.enrichment_points.shape == (20, problem.start.shape[1])
    assert found.freed_nodes == 0


def test_explicit_iterations_improve_what_they_can() -> None:
    problem = case("dx -0.3")
    found = correct(problem, settings("explicit"))
    check(problem, found)
    assert 0 < len(found.enrichment_points) <= 20
    assert 0.12 < found.minimum < CEILINGS["dx -0.3"]


def test_a_good_motion_is_unchanged() -> None:
    mesh = stored("thesis_block")
    problem = moved(mesh, rigid(mesh, (0.02, 0.0)))
    for correction in CORRECTIONS:
        found = correct(problem, settings(correction))
        assert found.points is problem.standard
        assert (found.method, found.reached, found.iterations) == ("none", True, 0)


def test_none_keeps_whatever_comes() -> None:
    problem = case("dx -0.3")
    found = correct(problem, settings("none"))
    assert found.points is problem.standard
    assert found.minimum < 0
    assert not found.reached


def test_targets() -> None:
    problem = case("3D box 0.25 + bend")
    threshold, maximum, left_out = (
        correct(problem, settings(correction_target=target)) for target in ("threshold", "maximum", None)
    )
    assert threshold.reached
    assert 0.2 <= threshold.minimum < maximum.minimum
    assert threshold.freed_nodes < maximum.freed_nodes
    assert np.array_equal(left_out.points, maximum.points)  # a small mesh


def test_without_a_target_a_large_mesh_stops_at_the_threshold(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = case("3D box 0.25 + bend")
    monkeypatch.setitem(SMALL_MESH, 3, 100)
    left_out, threshold = correct(problem, settings()), correct(problem, settings(correction_target="threshold"))
    assert np.array_equal(left_out.points, threshold.points)


@pytest.mark.parametrize("correction", ["explicit", "enrichment", "optimised"])
def test_a_motion_through_the_wall_is_refused(correction: str) -> None:
    mesh = stored("thesis_block")
    problem = moved(mesh, rigid(mesh, (-0.7, 0.0)))
    with pytest.raises(QualityRefused, match="inverted cells") as refused:
        correct(problem, settings(correction))
    assert refused.value.best < 0
    quality = cell_quality(problem.standard, problem.cells, problem.reference_sizes)
    assert 1 <= len(refused.value.cells) <= 10
    assert quality.inverted.any()


def test_an_inverted_cell_without_free_nodes_is_refused_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = box_mesh("tetra")
    held = mesh.held.copy()
    nodes = mesh.cells.blocks[0].nodes
    crossing = nodes[~held[nodes].any(axis=1)][0]
    held[crossing] = True
    problem = moved(mesh, rigid(mesh, (0.2, 0.0, 0.0)))
    standard = problem.standard.copy()
    standard[crossing[0]], standard[crossing[1]] = problem.standard[crossing[1]], problem.standard[crossing[0]]
    monkeypatch.setitem(correct.__globals__, "polish", None)
    with pytest.raises(QualityRefused):
        correct(replace(problem, standard=standard, held=held), settings())


def test_a_mesh_without_free_nodes_is_judged_as_it_is() -> None:
    problem = case("dx -0.3")
    with pytest.raises(QualityRefused):
        correct(replace(problem, held=np.ones_like(problem.held)), settings())


def squeezed_line(distance: float = 0.15) -> CorrectionProblem:
    x = np.linspace(0, 1, 21)[:, None]
    n = np.arange(21)
    cells = CellTable.from_arrays({"line": np.column_stack([n[:-1], n[1:]])})
    held = np.isin(n, [0, 4, 16, 20])
    displacement = np.zeros_like(x)
    displacement[4], displacement[16] = distance, -distance
    factor = factorize(x[held], support_radius=0.2)
    standard = x + evaluation.displacement(factor.solve(displacement[held]), x)
    standard[held] = (x + displacement)[held]
    return CorrectionProblem(x, standard, held, cells, reference_sizes(x, cells), factor)


def test_one_dimension_the_thesis_and_the_optimum() -> None:
    problem = squeezed_line()
    choices = {"quality_metric": "size", "quality_threshold": 0.3, "support_radius": 0.2, "enrichment_radius": 1.0}
    with pytest.raises(QualityRefused):
        correct(problem, settings("enrichment", max_enrichment_points=0, **choices))
    thesis = correct(problem, settings("imposed-gradient", **choices))
    assert thesis.minimum == pytest.approx(0.26226, abs=5e-6)  # Table 4.1, H1, R = 0.2
    np.testing.assert_allclose(thesis.enrichment_points, [[0.5]])
    best = correct(problem, settings(**choices))
    assert best.minimum == pytest.approx(0.5)
    enriched = correct(problem, settings("enrichment", correction_target="maximum", **choices))
    assert enriched.minimum == pytest.approx(0.5, abs=1e-4)  # nearly dependent functions are left out
    for found in (thesis, best, enriched):
        assert np.array_equal(found.points[problem.held], problem.standard[problem.held])


@pytest.mark.parametrize("kind", ["quad", "hexahedron + wedge"])
def test_enrichment_works_on_cells_that_are_no_simplices(kind: str) -> None:
    mesh = box_mesh(kind)
    problem = moved(mesh, rigid(mesh, (0.25, *[0.0] * (mesh.points.shape[1] - 1))))
    standard = correct(problem, settings("none")).minimum
    found = correct(problem, settings("enrichment", quality_threshold=0.6))
    check(problem, found)
    assert found.minimum > standard + 0.15


def test_a_correction_that_gains_less_than_it_spoils_differs_from_one_that_gains_more() -> None:
    mesh = box_mesh("quad", 6)
    at_rest = cells_at_rest(mesh.points, mesh.cells)
    node = int(np.flatnonzero(~mesh.held)[0])
    worse = mesh.points.copy()
    worse[node] += 0.03
    before, after = (cell_quality(p, mesh.cells, at_rest) for p in (mesh.points, worse))
    extremes = zip(before.relative_extremes(), after.relative_extremes(), strict=True)
    spoiled = max(own / new for own, new in extremes)
    assert spoiled > 1.1
    assert spoils(before, after, "relative-size-skew", 0.99 * spoiled)
    assert not spoils(before, after, "relative-size-skew", 1.01 * spoiled)
    assert not spoils(before, after, "size-skew", 1.0)
