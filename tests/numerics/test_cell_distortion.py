"""The distortion of whole cells: it equals the metric, its gradient equals differences, its curvature is an upper
bound.
"""

import numpy as np
import pytest
from box_meshes import CELL_KINDS, shaken
from correction_cases import stored
from mesh_motion_numerics.correction.cell_distortion import cell_groups, mean_cell_distortion
from mesh_motion_numerics.correction.distortion import PNorm, mean_distortion
from mesh_motion_numerics.correction.free_region import FreeRegion, free_region
from mesh_motion_numerics.correction.region_measure import MEASURES, region_measure
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.metrics import cell_quality, cells_at_rest
from scipy.sparse import bsr_matrix

NORMS = (PNorm(8, 2, of="cells"), PNorm(60, 8, of="cells", size_weight=1.0))


@pytest.mark.parametrize("kind", CELL_KINDS)
def test_it_is_the_logarithm_of_one_over_size_skew(kind: str) -> None:
    points, region = shaken(kind)
    values = cell_quality(points, region.cells, region.reference_sizes).metric("size-skew")
    assert values.min() > 0
    groups = cell_groups(region.cells, region.reference_sizes, region.simplices)
    energy, weights = mean_cell_distortion(points, groups, PNorm(8, 1e4))
    # rounding |log τ| costs at most log 2 / 2m
    assert energy == pytest.approx(np.log(np.mean(values**-8.0)) / 8, abs=np.log(2) / 1e4)
    np.testing.assert_allclose(weights, values**-8.0 / np.sum(values**-8.0), rtol=1e-3)


def flat() -> tuple[np.ndarray, FreeRegion]:
    """Points at rest of flat triangles, and their region."""
    mesh = stored("thesis_block")
    rest = mesh.points * [1.0, 0.02]
    return rest, free_region(rest, mesh.cells, cells_at_rest(rest, mesh.cells), ~mesh.held)


def test_relative_to_cells_at_rest_it_vanishes_for_a_rigid_motion() -> None:
    rest, region = flat()
    turned = rest[region.nodes].copy()
    turned[:, 0], turned[:, 1] = -rest[region.nodes, 1], rest[region.nodes, 0].copy()
    energy, weights = mean_cell_distortion(turned, region.groups, PNorm(8, 1e4))
    assert energy == pytest.approx(np.log(2) / 8, abs=1e-6)  # what rounding min(1, skew / skew at rest) costs
    np.testing.assert_allclose(weights, 1.0 / len(weights), rtol=1e-5)


def test_a_cell_that_is_better_than_at_rest_pays_for_its_size_all_the_same() -> None:
    rest = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 1.0]])
    cells = CellTable.from_arrays({"triangle": np.array([[0, 1, 2]])})
    region = free_region(rest, cells, cells_at_rest(rest, cells), np.ones(3, dtype=bool))
    lower = np.array([[0.0, 0.0], [0.5, 0.0], [0.5, 0.5]])[region.nodes]
    energy, _ = mean_cell_distortion(lower, region.groups, PNorm(1e4, 1e4))
    assert energy == pytest.approx(-np.log(np.sqrt(0.25)), abs=1e-3)


@pytest.mark.parametrize(("kind", "relative"), [*((kind, False) for kind in CELL_KINDS), ("tetra", True)])
@pytest.mark.parametrize("norm", NORMS, ids=str)
def test_gradient_and_curvature(kind: str, relative: bool, norm: PNorm) -> None:
    points, region = shaken(kind, relative=relative)
    measure = MEASURES["cells"](region, norm)
    energy, weights = measure.mean(points)
    gradient = measure.gradient(points, weights)
    pattern = region.adjacency
    hessian = bsr_matrix(
        (measure.hessian(points, weights, refresh=0.0, floor=0.0), pattern.columns, pattern.row_starts)
    ).toarray()
    np.testing.assert_allclose(hessian, hessian.T, atol=1e-6 * hessian.max())
    values = np.linalg.eigvalsh(hessian)
    assert values.min() > -1e-6 * values.max()
    rng = np.random.default_rng(2)
    for _ in range(5):
        direction = rng.normal(size=gradient.shape)

        def along(t: float, direction: np.ndarray = direction) -> float:
            trial = points.copy()
            trial[: region.n_free] += t * direction
            return measure.mean(trial)[0]

        slope = np.vdot(gradient, direction)
        assert (along(1e-6) - along(-1e-6)) / 2e-6 == pytest.approx(slope, rel=1e-4, abs=1e-6)
        curvature = (along(1e-4) - 2 * energy + along(-1e-4)) / 1e-8 + norm.p * slope**2
        assert direction.ravel() @ hessian @ direction.ravel() > 0.98 * curvature


def test_light_cells_keep_their_curvature() -> None:
    points, region = shaken("hexahedron")
    measure = MEASURES["cells"](region, NORMS[0])
    _, weights = measure.mean(points)
    first = measure.hessian(points, weights, refresh=0.0, floor=0.1).copy()
    points[: region.n_free] += 0.001
    assert np.array_equal(measure.hessian(points, weights, refresh=1e9, floor=0.1), first)
    assert not np.array_equal(measure.hessian(points, weights, refresh=0.0, floor=0.1), first)


@pytest.mark.parametrize("kind", CELL_KINDS)
def test_an_inverted_corner_is_outside_the_barrier(kind: str) -> None:
    points, region = shaken(kind)
    points[0] += 1.0
    assert mean_cell_distortion(points, region.groups, NORMS[0])[0] == np.inf


def test_simplices_are_their_own_corners() -> None:
    points, region = shaken("tetra")
    norm = NORMS[0]
    whole = MEASURES["cells"](region, norm)
    energy, weights = whole.mean(points)
    expected, corner_weights = mean_distortion(points, region.simplices, norm)
    assert energy == pytest.approx(expected, rel=1e-12)
    quick = region_measure(region, norm)
    assert type(quick) is MEASURES["corners"]
    np.testing.assert_allclose(whole.gradient(points, weights), quick.gradient(points, corner_weights), atol=1e-9)
    hessians = [m.hessian(points, w, refresh=0.0, floor=0.1) for m, w in ((whole, weights), (quick, corner_weights))]
    # the projection of the parts, instead of the sum, may keep a little more
    np.testing.assert_allclose(*hessians, atol=0.2 * np.abs(hessians[1]).max())


def test_relative_to_rest_the_corners_of_cells_are_measured_and_triangles_as_a_whole() -> None:
    assert type(region_measure(flat()[1], NORMS[0])) is MEASURES["cells"]
    for kind in ("quad", "hexahedron", "quad + triangle"):
        assert type(region_measure(shaken(kind, relative=True)[1], NORMS[0])) is MEASURES["corners"]
        assert type(region_measure(shaken(kind)[1], NORMS[0])) is MEASURES["cells"]


@pytest.mark.parametrize("kind", ["hexahedron", "hexahedron + wedge"])
def test_the_pattern_couples_all_nodes_of_a_cell(kind: str) -> None:
    _, region = shaken(kind)
    for adjacency in region.cell_adjacency:
        places = region.groups[region.cell_adjacency.index(adjacency)].nodes[
            adjacency.entries // adjacency.slots.shape[1]
        ]
        assert np.array_equal(adjacency.slots >= 0, places < region.n_free)
        assert np.array_equal(
            region.adjacency.columns[adjacency.slots[places < region.n_free]], places[places < region.n_free]
        )
