"""A body in a far field: its mean displacement reaches far, its rotation moves no node much faster than the body."""

from dataclasses import replace

import numpy as np
import pytest
from far_meshes import aerofoil, bare_aerofoil, cusped_aerofoil, far_block, near_block
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.far_field import FarFieldFactorization
from mesh_motion_numerics.interpolation.interpolant import factorize
from mesh_motion_numerics.interpolation.interpolation_map import FieldMap, interpolation_map
from mesh_motion_numerics.interpolation.support_radius import suggest_support_radius
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel

from docs.studies.aerofoil_grids import o_grid
from docs.studies.beyond.slip_and_periodic import Duct
from mesh_motion_server.session.factors import FactorCache

PLAIN = {"correction": "none", "displacement": "absolute"}


def turned(x: np.ndarray, degrees: float) -> np.ndarray:
    """Positions (k, d) turned in the plane about the middle of the box."""
    angle, moved, middle = np.deg2rad(degrees), x.copy(), 0.5 * (x.min(axis=0) + x.max(axis=0))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    moved[:, :2] = middle[:2] + (x - middle)[:, :2] @ turn.T
    return moved


@pytest.mark.parametrize("choices", [{}, PLAIN])
@pytest.mark.parametrize("make", [lambda: far_block("quad", 40), lambda: far_block("hexahedron", 15), aerofoil])
def test_no_node_moves_twice_as_fast_as_a_body_that_turns(make, choices):
    points, cells, patches = make()
    model, factors = MotionModel.build(points, cells, patches, Method(**choices)), FactorCache(1 << 28)
    rest = points[model.roles.moving]
    moved = [model.move(points, turned(rest, degrees), factors).points for degrees in (15.0, 16.0)]
    steps = np.linalg.norm(moved[1] - moved[0], axis=1)
    assert steps.max() < 2.0 * steps[model.roles.moving].max()


def test_a_shift_is_carried_into_the_far_field():
    """No cell is sheared by more than the shift over a third of the way to the fixed nodes."""
    points, cells, patches = far_block("quad", 40)
    model = MotionModel.build(points, cells, patches, Method(**PLAIN))
    rest, shift = points[model.roles.moving], np.array([0.3, 0.2])
    moved = model.move(points, rest + shift, FactorCache(1 << 28)).points - points
    edges = np.concatenate([cells.blocks[0].nodes[:, [k, (k + 1) % 4]] for k in range(4)])
    first, last = edges.T
    slope = np.linalg.norm(moved[last] - moved[first], axis=1) / np.linalg.norm(points[last] - points[first], axis=1)
    assert slope.max() < 3.0 * np.linalg.norm(shift) / 1.7


def between_periodic_sides():
    duct = Duct.build(2, 60, 0.0)
    sides = {f"{'xy'[a]}{end}": Patch(("fixed", "periodic")[a], duct.on(a, end)) for a in (0, 1) for end in (0, 1)}
    return duct.points, duct.cells, {"body": Patch("moving", duct.body), **sides}


@pytest.mark.parametrize(
    "make", [lambda: far_block("quad", 40), aerofoil, cusped_aerofoil, bare_aerofoil, between_periodic_sides]
)
def test_noise_of_the_boundary_moves_no_node_much_more(make):
    points, cells, patches = make()
    model, factors = MotionModel.build(points, cells, patches, Method()), FactorCache(1 << 28)
    rest = turned(points[model.roles.moving], 10.0)
    noise = 1e-8 * np.random.default_rng(1).uniform(-1.0, 1.0, rest.shape)
    moved = [model.move(points, rest + more, factors).points for more in (0.0, noise)]
    assert np.abs(moved[1] - moved[0]).max() < 10.0 * np.abs(noise).max()


def test_a_body_near_a_fixed_node_and_a_named_radius_or_correction_have_one_radius():
    box, (points, cells, patches) = near_block("quad", 20), far_block("quad", 20)
    middle = np.abs(points[:, 1] - 0.5).max()

    def mean_radius(patches: dict[str, Patch], **choices: object) -> float:
        return MotionModel.build(points, cells, patches, Method(**choices)).standard_motion.reach.mean_radius

    assert mean_radius(patches) == pytest.approx(1.6 * middle, rel=0.05)
    assert mean_radius(patches, **PLAIN) == mean_radius(patches, correction="none") == mean_radius(patches)
    assert mean_radius(patches, support_radius=3.0) == mean_radius(patches, correction="optimised") == 0.0
    assert MotionModel.build(points, cells, patches, Method()).method.support_radius == pytest.approx(10 * 0.2)
    clamped = patches["body"].nodes[:3]
    moving = Patch("moving", np.setdiff1d(patches["body"].nodes, clamped))
    held = {**patches, "body": moving, "clamp": Patch("fixed", clamped)}
    assert mean_radius(held) == 0.0
    other = MotionModel.build(points, cells, held, Method(basis="wendland-c4"))
    radius = suggest_support_radius(points, other.roles)
    assert (other.method.basis, other.method.support_radius) == ("wendland-c4", radius)
    assert MotionModel.build(points, cells, held, Method()).method.support_radius == pytest.approx(10 * 0.2)
    near = MotionModel.build(*box, Method()).method
    assert (near.basis, near.support_radius) == ("wendland-c2-multiscale", pytest.approx(10 * 0.2))


@pytest.mark.parametrize("smoothing", [0.0, 1e-3])
def test_it_is_exact_at_all_control_points_and_a_field_of_its_arrays(smoothing):
    points, _, patches = aerofoil()
    controls = np.concatenate([patch.nodes for patch in patches.values()])
    near = factorize(points[controls], support_radius=7.0)
    made = FarFieldFactorization(near, np.arange(len(patches["body"].nodes)), 30.0)
    values = np.random.default_rng(2).standard_normal((len(controls), 2))
    there = interpolation_map(made, points).apply(values)
    assert np.abs(there[controls] - values).max() < 1e-6 * np.abs(there).max() + 1e-8
    np.testing.assert_array_equal(evaluation.displacement(FieldMap(made).interpolant(values), points), there)


def test_interpolated_first_cells_turn_with_their_wall():
    """No first edge leans over by more than 2.5° or changes its length by 3.5 % when an aerofoil turns by 45°."""
    grid = o_grid("sharp", around=128, layers=32, first=1e-2, far=50.0)
    model = MotionModel.build(grid.points, CellTable.from_arrays(grid.cells), grid.patches, Method())
    assert not model.layered.thin
    model = replace(model, layered=None)
    there = turned(grid.points[model.roles.moving], 45.0)
    moved = model.move(grid.points, there, FactorCache(1 << 28)).points
    quads = grid.cells["quad"]
    edges = np.concatenate([quads[:, [k, (k + 1) % 4]] for k in range(4)])
    start, end = edges[np.isin(edges, grid.body).sum(axis=1) == 1].T
    before, after = ((x[end] - x[start]) @ [1.0, 1j] for x in (grid.points, moved))
    change = after / before * np.exp(-1j * np.deg2rad(45.0))
    assert np.abs(np.rad2deg(np.angle(change))).max() < 2.5
    assert np.abs(np.abs(change) - 1.0).max() < 0.035
