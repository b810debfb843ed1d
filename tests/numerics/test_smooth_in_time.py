"""The correction that is smooth in time: small increments, exact return, no memory, every cell type."""

from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from box_meshes import CELL_KINDS, box_mesh
from correction_cases import BodyMesh, moved, rigid, stored

from mesh_motion_server.files import read_mesh
from mesh_motion_server.numerics.correction.correction import correct
from mesh_motion_server.numerics.correction.smooth_in_time import SmoothInTime, gradient_stiffness, travel
from mesh_motion_server.numerics.mesh.cells import CellTable
from mesh_motion_server.numerics.mesh.roles import Patch
from mesh_motion_server.numerics.method import Method
from mesh_motion_server.numerics.motion.motion import MotionModel
from mesh_motion_server.numerics.motion.motion_found import Motion
from mesh_motion_server.session.factors import FactorCache

FLAG = Path(__file__).parents[2] / "examples" / "turek_hron_flag"
PERIOD = 32
SMOOTH = Method(correction_in_time="smooth", displacement="absolute", quality_metric="size-skew")


@cache
def block_model(**choices) -> MotionModel:
    mesh = stored("thesis_block")
    patches = {"body": Patch("moving", mesh.body), "outer": Patch("fixed", mesh.outer)}
    chosen = {"support_radius": 0.5, "displacement": "absolute", "correction_in_time": "smooth", **choices}
    return MotionModel.build(mesh.points, mesh.cells, patches, Method(**{"quality_metric": "size-skew", **chosen}))


def turned(model: MotionModel, degrees: float) -> np.ndarray:
    """The body's nodes, rotated about the centre."""
    angle, x = np.deg2rad(degrees), model.points[model.roles.moving] - 0.5
    if degrees == 0.0:
        return model.points[model.roles.moving]
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return x @ turn.T + 0.5


def sine(amplitude: float) -> list[float]:
    """A period's angles, exactly 0 where the sine is."""
    angles = [amplitude * np.sin(2 * np.pi * step / PERIOD) for step in range(PERIOD + 1)]
    angles[PERIOD // 2] = angles[PERIOD] = 0.0
    return angles


def played(model: MotionModel, targets: list[np.ndarray]) -> list[Motion]:
    """Every motion committed before the next."""
    factors, points, motions = FactorCache(1 << 28), model.points, []
    for target in targets:
        motions.append(model.move(points, target, factors))
        points = motions[-1].points
    return motions


def increment_ratio(points: list[np.ndarray], moving: np.ndarray) -> float:
    """The largest of a node's step over the largest of the boundary's."""
    ratios = []
    for before, after in pairwise(points):
        length = np.linalg.norm(after - before, axis=1)
        ratios.append(length.max() / length[moving].max())
    return max(ratios)


@pytest.mark.parametrize("amplitude", [60.0, 10.0, 1.0])
def test_a_block_that_turns_and_returns(amplitude: float) -> None:
    model = block_model()
    motions = played(model, [turned(model, angle) for angle in sine(amplitude)[1:]])
    assert increment_ratio([model.points, *(m.points for m in motions)], model.roles.moving) <= 1.5
    assert max(np.abs(motions[k].points - model.points).max() for k in (15, 31)) == 0.0
    least = min(m.corrected.metric.min for m in motions)
    assert least > min(m.standard.metric.min for m in motions)
    assert min(m.corrected.inverted == 0 for m in motions)
    if amplitude == 60.0:
        assert least > 0.66


def test_a_motion_through_sub_steps_is_smooth_too() -> None:
    model = block_model(displacement="reanchored")
    motions = played(model, [turned(model, angle) for angle in sine(60.0)[1 : PERIOD // 2 + 1]])
    assert increment_ratio([model.points, *(m.points for m in motions)], model.roles.moving) <= 1.5
    assert np.array_equal(motions[-1].points, model.points)


@pytest.mark.nightly
def test_the_flag_that_bends_and_returns() -> None:
    mesh = read_mesh(FLAG / "mesh.npz")
    patches = {name: Patch("moving" if name == "flag" else "fixed", nodes) for name, nodes in mesh.patches.items()}
    method = Method(
        support_radius=0.4, quality_metric="size-skew", displacement="absolute", correction_in_time="smooth"
    )
    model = MotionModel.build(mesh.points, mesh.cell_table, patches, method)
    table = np.load(FLAG / "motion.npz")
    told = np.zeros((PERIOD, *mesh.points.shape))
    told[:, table["node_ids"]] = table["displacement"][:PERIOD]
    told[np.abs(told).max(axis=(1, 2)) < 1e-12] = 0.0  # rounding of the sine at whole half periods
    motions = played(model, list(model.points[model.roles.moving] + told[:, model.roles.moving]))
    assert increment_ratio([model.points, *(m.points for m in motions)], model.roles.moving) <= 1.5
    rest = model.summary(model.points).metric.min
    assert abs(motions[-1].corrected.metric.min - rest) <= 1e-6
    assert min(m.corrected.metric.min for m in motions) > 0.4
    assert min(m.standard.metric.min for m in motions) < 0.31


def smooth(mesh: BodyMesh) -> SmoothInTime:
    return SmoothInTime.build(mesh.trial)


@pytest.mark.parametrize("kind", CELL_KINDS)
def test_every_cell_type_is_corrected_whatever_the_start(kind: str) -> None:
    mesh = box_mesh(kind, 5 if kind in {"pyramid", "tetra", "wedge"} else 10)
    correction = smooth(mesh)
    d = mesh.points.shape[1]
    standard = moved(mesh, rigid(mesh, (0.12, *[0.0] * (d - 1)), 20.0)).standard
    travelled = travel(mesh.points, standard, mesh.held)
    cold = correction.correct(standard, travelled)
    assert cold.minimum > mesh.trial.quality(standard).min()
    assert np.array_equal(cold.points[mesh.held], standard[mesh.held])
    start = correction.correct(0.5 * (mesh.points + standard), 0.5 * travelled).points
    warm = correction.correct(standard, travelled, standard + start - 0.5 * (mesh.points + standard))
    spacing = mesh.sizes.mean() ** (1 / d)
    np.testing.assert_allclose(warm.points, cold.points, atol=2e-3 * spacing)
    assert warm.iterations < cold.iterations + 10


def test_the_way_does_not_matter() -> None:
    model = block_model()
    there = played(model, [turned(model, angle) for angle in (-50.0, 20.0, 45.0)])[-1]
    straight = played(model, [turned(model, 45.0)])[-1]
    np.testing.assert_allclose(there.points, straight.points, atol=2e-5)  # a two-thousandth of the mesh spacing
    again = played(model, [turned(model, angle) for angle in (-50.0, 20.0, 45.0)])[-1]
    assert np.array_equal(again.points, there.points)


def test_the_stiffness_is_the_mean_square_of_the_gradient() -> None:
    mesh = stored("correction_box")
    region = mesh.trial.free(~mesh.held)
    v = np.zeros((len(region.nodes), 3))
    v[: region.n_free] = np.random.default_rng(3).normal(size=(region.n_free, 3))
    corners = region.simplices
    edges = np.swapaxes(v[corners.nodes[:, 1:]] - v[corners.nodes[:, :1]], 1, 2)
    mean = np.sum((edges @ corners.ideal) ** 2) / len(corners)
    adjacency, stiffness = region.adjacency, gradient_stiffness(region)
    pulled = sum(
        v[i] @ stiffness[e] @ v[adjacency.columns[e]]
        for i in range(region.n_free)
        for e in range(adjacency.row_starts[i], adjacency.row_starts[i + 1])
    )
    assert 0.5 * pulled == pytest.approx(mean, rel=1e-6)


def test_the_onset_follows_the_correction_of_the_mesh_at_rest() -> None:
    mesh = stored("thesis_block")
    correction = smooth(mesh)
    assert 0.0 < correction.onset < 0.2
    at_rest = correction.correct(mesh.points, np.inf).points - mesh.points
    assert 8.0 * np.linalg.norm(at_rest, axis=1).max() == pytest.approx(correction.onset)
    squares = smooth(box_mesh("quad"))  # nothing to correct
    assert squares.onset < 1e-6


def test_travel_leaves_out_what_carries_the_whole_boundary() -> None:
    mesh = stored("thesis_block")
    displacement = rigid(mesh, (0.3, 0.1), 25.0)
    every = np.zeros_like(mesh.points)
    every[:, :] = [0.3, -0.2]
    assert travel(mesh.points, mesh.points + every, mesh.held) < 1e-12
    assert travel(mesh.points, mesh.points + displacement, mesh.held) > 0.2
    assert travel(mesh.points, mesh.points, mesh.held) < 1e-12


def test_a_mesh_that_is_only_carried_is_not_corrected() -> None:
    mesh = stored("thesis_block")
    patches = {"all": Patch("moving", np.flatnonzero(mesh.held))}
    method = Method(support_radius=0.5, displacement="absolute", correction_in_time="smooth")
    model = MotionModel.build(mesh.points, mesh.cells, patches, method)
    motion = model.move(model.points, turned(model, 170.0))
    expected = (model.points - 0.5) @ np.array([[-1.0, 0.0], [0.0, -1.0]])
    assert motion.corrected.metric.min == pytest.approx(model.summary(model.points).metric.min, abs=1e-12)
    assert np.linalg.norm(motion.points - 0.5, axis=1) == pytest.approx(np.linalg.norm(expected, axis=1))


def test_one_dimension() -> None:
    points = np.linspace(0.0, 1.0, 21)[:, None]
    lines = np.column_stack([np.arange(20), np.arange(1, 21)])
    mesh = BodyMesh(points, CellTable.from_arrays({"line": lines}), np.array([0, 20]), np.array([8, 12]))
    displacement = np.zeros_like(points)
    displacement[mesh.body] = 0.15
    problem = moved(mesh, displacement)
    found = correct(problem, SMOOTH)
    assert found.minimum > mesh.trial.quality(problem.standard).min()


def test_a_mesh_without_a_free_node_is_left_alone() -> None:
    mesh = box_mesh("quad", 5)
    problem = moved(mesh, rigid(mesh, (0.01, 0.0)))
    held = np.ones(len(mesh.points), dtype=bool)
    found = correct(replace(problem, held=held), SMOOTH)
    assert found.method == "none"
    assert np.array_equal(found.points, problem.standard)
