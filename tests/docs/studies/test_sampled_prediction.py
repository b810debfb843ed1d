"""Sampled prediction misses nothing: exact minimum, true bounds, every cell type, also in a real motion."""

import numpy as np
import pytest
from box_meshes import box_mesh
from frame_meshes import rotation
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.interpolant import Interpolant, factorize
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.paths import fit_rigid_motion
from mesh_motion_numerics.quality.metrics import QUALITY_METRICS, cell_quality, cells_at_rest, reference_sizes

from docs.studies.thesis._linear_polynomial import WithPolynomial
from docs.studies.thesis._sampling import BOUNDS, ExpandableField, SampledQuality, predict_sampled
from docs.studies.thesis._sampling.expansion import EXPANDABLE, expand, monomials
from docs.studies.thesis._sampling.groups import group_cells
from docs.studies.thesis._sampling.remainder import remainders

KINDS = ("quad", "quad + triangle", "tetra", "hexahedron", "wedge", "pyramid")


def moved_box(kind: str, *, size: float, radius: float = 0.8, n: int = 10) -> tuple[np.ndarray, CellTable, Interpolant]:
    mesh = box_mesh(kind, n)
    displacement = np.zeros((len(mesh.outer) + len(mesh.body), mesh.points.shape[1]))
    displacement[len(mesh.outer) :, 0] = size
    displacement[len(mesh.outer) :, 1] = 0.5 * size + 0.3 * size * mesh.points[mesh.body, 0]
    control = mesh.points[np.concatenate([mesh.outer, mesh.body])]
    return mesh.points, mesh.cells, factorize(control, support_radius=radius).solve(displacement)


def sampled(points, cells, interpolant, **choices) -> tuple[SampledQuality, np.ndarray]:
    """The sampled prediction and the exact metric."""
    moved, sizes = evaluation.displacement(interpolant, points), cells_at_rest(points, cells)
    field = ExpandableField(interpolant)
    exact = cell_quality(points + moved, cells, sizes).metric(choices.get("metric", "size-skew"))
    return predict_sampled(points, cells, sizes, field, lambda nodes: moved[nodes], **choices), exact


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("size", [0.001, 0.1, 0.25])
def test_no_bad_cell_is_missed_and_every_bound_holds(kind, size):
    points, cells, interpolant = moved_box(kind, size=size)
    found, exact = sampled(points, cells, interpolant, threshold=0.5, groups=8)
    assert found.in_full[exact < 0.5].all()
    assert (found.least <= exact).all()
    assert exact.min() >= 0.5 or found.quality.metric("size-skew").min() == exact.min()
    np.testing.assert_array_equal(found.least[found.in_full], exact[found.in_full])
    if size == 0.001:
        assert not found.in_full.all()


@pytest.mark.parametrize("metric", QUALITY_METRICS)
@pytest.mark.parametrize("group_size", [1, 5, 10_000])
def test_the_minimum_is_exact_for_any_metric_and_group_size(metric, group_size):
    points, cells, interpolant = moved_box("quad + triangle", size=0.1)
    found, exact = sampled(
        points, cells, interpolant, threshold=-1.0, metric=metric, groups=group_size, settle="minimum"
    )
    assert found.quality.metric(metric).min() == exact.min()
    assert (found.least <= exact).all()


def test_the_estimated_bound_expands_more_and_evaluates_less():
    points, cells, interpolant = moved_box("quad", size=0.05, n=40)
    shares = [sampled(points, cells, interpolant, groups=4, bound=bound)[0].in_full.mean() for bound in BOUNDS]
    assert shares[1] < shares[0]


@pytest.mark.parametrize("basis", EXPANDABLE)
@pytest.mark.parametrize("d", [1, 2, 3])
def test_an_expansion_is_of_fourth_order(basis, d):
    rng = np.random.default_rng(d)
    control = rng.uniform(0, 1, (12, d))
    made = factorize(control, support_radius=1.5, basis=basis)
    made = made if made.basis.needs_polynomial else WithPolynomial(made)
    interpolant = made.solve(rng.normal(size=(12, d)))
    point, direction = np.full((1, d), 0.5), rng.normal(size=d)
    away = np.abs(np.linalg.norm(control - point, axis=1)).min()
    errors = []
    for h in (0.2 * away, 0.1 * away):
        y = h * direction / np.linalg.norm(direction)
        terms = np.array([np.prod(y[list(axes)]) for axes in monomials(d)])
        change = evaluation.displacement(interpolant, point + y) - evaluation.displacement(interpolant, point)
        errors.append(np.abs(expand(interpolant, point)[0] @ terms - change[0]).max())
    assert np.log2(errors[0] / errors[1]) > 3.6


@pytest.mark.parametrize("basis", EXPANDABLE)
def test_the_remainder_bounds_the_gradient_in_the_ball(basis):
    points, cells, _ = moved_box("quad", size=0.1)
    rng = np.random.default_rng(7)
    control = points[rng.choice(len(points), 40, replace=False)]
    interpolant = factorize(control, support_radius=0.8, basis=basis).solve(rng.normal(size=(40, 2)))
    groups = group_cells(points, [block.nodes for block in cells], 4)
    bound, coefficients = remainders(interpolant, groups, near=np.inf), expand(interpolant, groups.centres)
    for _ in range(10):
        away = rng.normal(size=groups.centres.shape)
        away *= (groups.radii * rng.uniform(0.5, 1.0, len(groups)) / np.linalg.norm(away, axis=1))[:, None]
        gradient = evaluation.gradient(interpolant, groups.centres + away)
        x, y = away.T
        c = coefficients.transpose(2, 0, 1)
        model = np.stack(
            [
                c[0] + 2 * c[2] * x[:, None] + c[3] * y[:, None] + 3 * c[5] * (x**2)[:, None]
                + 2 * c[6] * (x * y)[:, None] + c[7] * (y**2)[:, None],
                c[1] + c[3] * x[:, None] + 2 * c[4] * y[:, None] + c[6] * (x**2)[:, None]
                + 2 * c[7] * (x * y)[:, None] + 3 * c[8] * (y**2)[:, None],
            ],
            axis=2,
        )  # fmt: skip
        assert (np.linalg.norm(gradient - model, ord=2, axis=(1, 2)) <= bound).all()


def test_a_mesh_that_is_carried_along_is_as_good_as_it_was():
    points, cells, interpolant = moved_box("quad", size=0.0)
    control = interpolant.control_points
    rigid = fit_rigid_motion(control, control @ rotation(50).T + 1.0)
    moved = rigid.apply(points) - points
    sizes = reference_sizes(points, cells)
    found = predict_sampled(points, cells, sizes, ExpandableField(interpolant, rigid), lambda nodes: moved[nodes])
    np.testing.assert_allclose(found.quality.metric("size-skew"), 1.0, rtol=1e-12)
    assert found.in_full.mean() < 0.1
