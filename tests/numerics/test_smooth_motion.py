"""The motion that is a smooth function of the boundary: one result on every path, exact at rest, no jumps, all cell
types.
"""

import time
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from box_meshes import CELL_KINDS, box_mesh
from correction_cases import BodyMesh, rigid, stored
from mesh_motion_numerics.correction import smooth_motion, smooth_region
from mesh_motion_numerics.correction.distortion import corner_distortions, corner_simplices
from mesh_motion_numerics.correction.smooth_motion import Law, Smoothed, SmoothMotion
from mesh_motion_numerics.correction.smooth_region import SmoothRegion
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel
from mesh_motion_numerics.motion.motion_found import Motion
from mesh_motion_numerics.motion.smooth_step import NOT_SMOOTH
from mesh_motion_numerics.quality.metrics import cells_at_rest, corner_quality
from mesh_motion_numerics.stopwatch import Stopwatch
from mesh_motion_protocol.errors import QualityRefused
from periodic_meshes import periodic_box, turn
from scipy.sparse import bsr_matrix
from sliding_meshes import Mesh, duct

from mesh_motion_server.files import read_mesh
from mesh_motion_server.session.factors import FactorCache

FLAG = Path(__file__).parents[2] / "examples" / "turek_hron_flag"
PERIOD = 32


def smooth_model(mesh: BodyMesh, **choices: object) -> MotionModel:
    method = Method(**{"displacement": "absolute", "correction": "smooth", **choices})
    return MotionModel.build(mesh.points, mesh.cells, mesh.patches, method)


@cache
def block_model(**choices: object) -> MotionModel:
    return smooth_model(stored("thesis_block"), **choices)


def turned(model: MotionModel, degrees: float, shift: tuple[float, ...] = (0.0, 0.0)) -> np.ndarray:
    rest = model.points[model.roles.moving]
    if degrees == 0.0 and not any(shift):
        return rest
    angle = np.deg2rad(degrees)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return (rest - 0.5) @ turn.T + 0.5 + shift


def played(model: MotionModel, targets: list[np.ndarray]) -> list[Motion]:
    factors, points, motions = FactorCache(1 << 28), model.points, []
    for target in targets:
        motions.append(model.move(points, target, factors))
        points = motions[-1].points
    return motions


def second_difference(points: list[np.ndarray]) -> float:
    """The largest of a node's second differences."""
    triples = zip(points, points[1:], points[2:], strict=False)
    return max(np.linalg.norm(a - 2.0 * b + c, axis=1).max() for a, b, c in triples)


# --- one result on every way ----------------------------------------------------------------------------------------


_NIGHTLY = [pytest.param(goal, marks=pytest.mark.nightly) for goal in ((60.0, -0.2, -0.2), (150.0, 0.0, 0.0))]


@pytest.mark.parametrize("goal", [(90.0, 0.0, 0.0), (0.0, -0.3, 0.0), *_NIGHTLY])
def test_six_ways_end_at_the_same_mesh(goal: tuple[float, ...]) -> None:
    model, whole = block_model(), np.array(goal)
    direct = [[whole * k / n for k in range(1, n + 1)] for n in (1, 2, 5, 16)]
    around = [[whole * 0.3, whole * [0.5, 0.2, 0.9], whole], [whole * 0.4, whole * -0.3, whole * 0.6, whole]]
    ends = []
    for way in (*direct, *around):
        motions = played(model, [turned(model, degrees, (x, y)) for degrees, x, y in way])
        assert not any(motion.corrected.inverted for motion in motions)
        assert not any("stopped before" in warning for motion in motions for warning in motion.warnings)
        ends.append(motions[-1].points)
    assert max(np.abs(end - ends[0]).max() for end in ends) < 1e-9


@pytest.mark.parametrize("mesh", [duct("quad"), duct("quad + triangle"), periodic_box("quad", ends="slip")])
def test_nodes_of_plane_and_periodic_walls_are_free_along_them(mesh: Mesh) -> None:
    model = MotionModel.build(*mesh, Method())
    rest, shift = model.points[model.roles.moving], np.array([-0.1, 0.35])
    direct, led = (played(model, [rest + shift * k / n for k in range(1, n + 1)]) for n in (1, 4))
    assert direct[-1].correction.method == "smooth"
    assert np.abs(direct[-1].points - led[-1].points).max() < 1e-9
    sliding, periodic = model.standard_motion.sliding, model.standard_motion.periodic
    places = direct[-1].points[sliding.nodes]
    assert np.array_equal(sliding.project(places), places)
    if periodic is not None:
        assert np.array_equal(periodic.tied(direct[-1].points, model.roles.moving), direct[-1].points)
    held = replace(model, smooth=SmoothMotion.build(model.points, model.cells, model.held, None))
    assert direct[-1].corrected.metric.min > played(held, [rest + shift])[-1].corrected.metric.min


@pytest.mark.parametrize("amplitude", [60.0, 10.0, 1.0])
def test_a_block_that_turns_and_returns(amplitude: float) -> None:
    model = block_model()
    angles = [amplitude * np.sin(2 * np.pi * step / PERIOD) for step in range(1, PERIOD + 1)]
    angles[PERIOD // 2 - 1] = angles[-1] = 0.0
    motions = played(model, [turned(model, angle) for angle in angles])
    points = [model.points, *(motion.points for motion in motions)]
    steps = [np.linalg.norm(after - before, axis=1) for before, after in pairwise(points)]
    assert max(step.max() / step[model.roles.moving].max() for step in steps) <= 1.5
    assert np.array_equal(points[PERIOD // 2], model.points)
    assert np.array_equal(points[-1], model.points)
    least, plain = (min(getattr(m, kind).metric.min for m in motions) for kind in ("corrected", "standard"))
    assert least >= plain
    if amplitude == 60.0:
        assert (plain, least) == (pytest.approx(0.35, abs=0.01), pytest.approx(0.55, abs=0.01))


@pytest.mark.parametrize(("steps", "bound"), [(32, 2.0), (256, 3.0)])
def test_nodes_do_not_jolt_at_any_time_step(steps: int, bound: float) -> None:
    """A quarter of a period: where the correction sets in, grows, and is largest."""
    model = block_model()
    targets = [turned(model, 60.0 * np.sin(2 * np.pi * k / steps)) for k in range(steps // 4 + 2)]
    corrected = [motion.points for motion in played(model, targets)]
    plain = [motion.points for motion in played(block_model(correction="none"), targets)]
    assert second_difference(corrected) <= bound * second_difference(plain)


def test_noise_moves_no_node_far() -> None:
    model = block_model()
    targets = turned(model, 70.0, (0.05, 0.0))
    noise = 1e-8 * np.random.default_rng(1).uniform(-1.0, 1.0, targets.shape)
    quiet, noisy = (model.move(model.points, there).points for there in (targets, targets + noise))
    assert np.abs(noisy - quiet).max() < 1e-7


def test_where_no_cell_is_near_the_onset_the_motion_is_the_plain_one() -> None:
    model, factors = block_model(), FactorCache(1 << 28)
    targets = turned(model, 12.0)
    motion = model.move(model.points, targets, factors)
    assert motion.correction.method == "none"
    plain = model.standard_motion.trial(model.points, targets, factors, Stopwatch())
    assert np.array_equal(motion.points, plain.points)


def test_right_triangles_do_not_jump() -> None:
    """Squares divided along alternating diagonals: an equilateral form is near in two directions."""
    mesh = box_mesh("quad", 20)
    squares = mesh.cells.blocks[0].nodes
    even = np.rint(mesh.points[squares].mean(axis=1).sum(axis=1) * 20.0).astype(int) % 2 == 0
    cuts = (even, [0, 1, 2]), (even, [0, 2, 3]), (~even, [0, 1, 3]), (~even, [1, 2, 3])
    cells = CellTable.from_arrays({"triangle": np.concatenate([squares[cut][:, part] for cut, part in cuts])})
    triangles = replace(mesh, cells=cells)
    shifts = np.outer(np.sin(0.5 * np.pi * np.arange(33) / 32), [0.25, 0.1])
    ends = []
    for choices in ({}, {"correction": "none"}):
        model = smooth_model(triangles, **choices)
        targets = [model.points[model.roles.moving] + shift for shift in shifts]
        ends.append([motion.points for motion in played(model, targets)])
    corrected, plain = ends
    assert second_difference(corrected) <= 3.0 * second_difference(plain)


def test_a_gap_that_is_squeezed_to_a_quarter_pulls_no_node() -> None:
    """A block that comes near a wall: cells that hardly differ must not have a thousand times the resistance of
    others.
    """
    model = smooth_model(box_mesh("quad", 20))
    rest = model.points[model.roles.moving]
    points = [model.points]
    for share in np.sin(0.5 * np.pi * np.arange(1, 9) / 8):
        points.append(model.move(points[-1], rest + np.array([0.0, 0.33 * share])).points)
    steps = [np.linalg.norm(after - before, axis=1) for before, after in pairwise(points)]
    assert max(step.max() / step[model.roles.moving].max() for step in steps) <= 1.8


def test_a_motion_through_sub_steps_is_smooth_too() -> None:
    model = block_model(displacement="reanchored")
    motions = played(model, [turned(model, angle) for angle in (20.0, 60.0, 20.0, 0.0)])
    assert np.array_equal(motions[-1].points, model.points)
    np.testing.assert_allclose(motions[2].points, motions[0].points, atol=1e-9)


@pytest.mark.parametrize(("kind", "degrees", "most"), [("tetra", 120.0, 35), ("quad", 150.0, 45)])
def test_a_far_way_ends_at_the_same_minimum_in_few_iterations(kind: str, degrees: float, most: int) -> None:
    """Shorter parts end near the minimum, and show where the next one begins: 28 and 40 iterations, not 46 and 52."""
    mesh = box_mesh(kind, 5 if kind == "tetra" else 20)
    model = smooth_model(mesh)
    body = (mesh.points[model.roles.moving] - 0.5).T

    def targets(angle: float) -> np.ndarray:
        return (turn(360, len(body), angle) @ body).T + 0.5

    at_once = model.move(mesh.points, targets(degrees))
    assert at_once.sub_steps > 2
    assert at_once.correction.iterations <= most
    (*_, slowly) = played(model, [targets(angle) for angle in np.linspace(0.0, degrees, 9)])
    np.testing.assert_allclose(at_once.points, slowly.points, atol=1e-9)


@pytest.mark.nightly
def test_the_flag_that_bends_and_returns() -> None:
    mesh = read_mesh(FLAG / "mesh.npz")
    patches = {name: Patch("moving" if name == "flag" else "fixed", nodes) for name, nodes in mesh.patches.items()}
    method = Method(displacement="absolute", correction="smooth")
    model = MotionModel.build(mesh.points, mesh.cell_table, patches, method)
    table = np.load(FLAG / "motion.npz")
    whole = np.zeros((PERIOD, *mesh.points.shape))
    whole[:, table["node_ids"]] = table["displacement"][:PERIOD]
    whole[np.abs(whole).max(axis=(1, 2)) < 1e-12] = 0.0  # rounding of the sine at whole half periods
    motions = played(model, list(model.points[model.roles.moving] + whole[:, model.roles.moving]))
    points = [model.points, *(motion.points for motion in motions)]
    steps = [np.linalg.norm(after - before, axis=1) for before, after in pairwise(points)]
    assert max(step.max() / step[model.roles.moving].max() for step in steps) <= 1.5
    assert np.array_equal(motions[-1].points, model.points)
    assert min(m.standard.metric.min for m in motions) < 0.38
    assert min(m.corrected.metric.min for m in motions) > 0.44


# --- the function that is minimised -----------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [*CELL_KINDS, "line"])
def test_gradient_and_hessian_are_those_of_the_energy(kind: str) -> None:
    motion, region, points, rest = shaken(kind)
    n = region.free.n_free
    _, distortion = motion._energy(points, rest, region)
    assert np.count_nonzero(distortion > motion.law.onset) > 5
    gradient, hessian = motion.model(points, rest, region, distortion, exact=True)
    pattern = region.free.adjacency
    matrix = bsr_matrix((hessian, pattern.columns, pattern.row_starts)).toarray()
    rng = np.random.default_rng(2)
    for _ in range(3):
        direction = np.zeros_like(points)
        direction[:n] = rng.normal(size=gradient.shape)
        size = 1e-6 * np.ptp(points, axis=0).max()
        ahead, behind = (points + sign * size * direction for sign in (1.0, -1.0))
        slope = (motion._energy(ahead, rest, region)[0] - motion._energy(behind, rest, region)[0]) / (2 * size)
        assert slope == pytest.approx(np.vdot(gradient, direction[:n]), rel=1e-5)
        after, before = (
            motion.model(where, rest, region, motion._energy(where, rest, region)[1], exact=True)[0]
            for where in (ahead, behind)
        )
        change = matrix @ direction[:n].ravel()
        np.testing.assert_allclose((after - before).ravel() / (2 * size), change, atol=1e-5 * np.abs(change).max())


def shaken(kind: str) -> tuple[SmoothMotion, SmoothRegion, np.ndarray, np.ndarray]:
    """A mesh with a free interior, its region, and local positions (l, d): random ones and those of the plain
    motion.
    """
    mesh = line_mesh() if kind == "line" else box_mesh(kind, 5)
    law = Law(onset=0.02, stiffness=6.0)  # the function is so steep that differences of it would say little
    motion, rng = SmoothMotion(mesh.points, mesh.cells, mesh.held, law), np.random.default_rng(1)
    size = 0.2 if kind == "line" else 0.08
    spacing = np.ptp(mesh.points, axis=0).max() / (20 if kind == "line" else 5)
    plain = mesh.points + np.where(mesh.held[:, None], 0.0, size * spacing * rng.normal(size=mesh.points.shape))
    region = motion.region(plain)
    assert region is not None
    rest = plain[region.free.nodes]
    points = rest.copy()
    points[: region.free.n_free] += 0.03 * spacing * rng.normal(size=(region.free.n_free, rest.shape[1]))
    return motion, region, points, rest


def line_mesh() -> BodyMesh:
    points = np.linspace(0.0, 1.0, 21)[:, None]
    lines = np.column_stack([np.arange(20), np.arange(1, 21)])
    return BodyMesh(points, CellTable.from_arrays({"line": lines}), np.array([0, 20]), np.array([8, 12]))


def test_resistance_begins_smoothly_and_has_its_derivatives() -> None:
    law = Law()
    distortion = np.concatenate([[0.0, law.onset], law.onset + np.geomspace(1e-7, 0.5, 40)])
    value, slope, bend = law.resistance(distortion)
    assert value[0] == slope[0] == bend[0] == value[1] == slope[1] == bend[1] == 0.0
    size = 1e-6 * np.maximum(distortion - law.onset, 1e-7)
    for function, derivative in ((0, slope), (1, bend)):
        ahead, behind = (law.resistance(distortion + sign * size)[function] for sign in (1.0, -1.0))
        np.testing.assert_allclose((ahead - behind)[2:] / (2 * size[2:]), derivative[2:], rtol=1e-3)
    assert np.isinf(law.resistance(np.array([np.inf]))[0][0])


# --- meshes and roles -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", CELL_KINDS)
def test_every_cell_type_is_corrected_whatever_the_start(kind: str) -> None:
    mesh = box_mesh(kind, 5 if kind in {"pyramid", "tetra", "wedge"} else 10)
    model, d = smooth_model(mesh), mesh.points.shape[1]
    displacement = rigid(mesh, (0.12, *[0.0] * (d - 1)), 20.0)[model.roles.moving]
    rest = mesh.points[model.roles.moving]
    cold = model.move(model.points, rest + displacement)
    assert cold.corrected.metric.min > cold.standard.metric.min
    warm = played(model, [rest + share * displacement for share in (0.5, 1.2, 1.0)])[-1]
    np.testing.assert_allclose(warm.points, cold.points, atol=1e-9)


def test_one_dimension() -> None:
    mesh = line_mesh()
    model = smooth_model(mesh)
    motion = model.move(model.points, mesh.points[model.roles.moving] + 0.15)
    assert motion.corrected.metric.min > motion.standard.metric.min


@pytest.mark.parametrize("kind", ["tetra", "hexahedron"])
def test_a_region_in_space_is_solved_by_the_faster_method(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """702 free nodes: with a factorization a step takes three times as long as with conjugate gradients."""

    def seconds() -> float:
        mesh, found = box_mesh(kind, 10), []
        model = smooth_model(mesh)
        goal = (mesh.points + rigid(mesh, (0.03, 0.02, 0.05), 30.0))[mesh.body]
        for shift in 1e-4 * np.arange(3):
            begin = time.process_time()
            assert model.move(model.points, goal + shift, FactorCache(1 << 28)).correction.freed_nodes == 702
            found.append(time.process_time() - begin)
        return min(found)

    chosen = seconds()
    monkeypatch.setitem(smooth_region._DIRECT_UNKNOWNS, 3, 0)
    assert chosen < 2.0 * seconds()


def test_a_mesh_that_is_only_carried_is_not_corrected() -> None:
    mesh = stored("thesis_block")
    patches = {"all": Patch("moving", np.flatnonzero(mesh.held))}
    method = Method(support_radius=0.5, displacement="absolute", correction="smooth")
    model = MotionModel.build(mesh.points, mesh.cells, patches, method)
    motion = model.move(model.points, turned(model, 170.0))
    assert motion.correction.method == "none"
    assert motion.corrected.metric.min == pytest.approx(1.0, abs=1e-9)


def test_a_mesh_without_a_free_node_is_left_alone() -> None:
    mesh = box_mesh("quad", 5)
    plain = mesh.points + rigid(mesh, (0.05, 0.0))
    found = SmoothMotion(mesh.points, mesh.cells, np.ones(len(mesh.points), dtype=bool)).correct(plain)
    assert found.points is plain
    assert found.converged


# --- where it ends ----------------------------------------------------------------------------------------------------


def test_the_iterations_end_at_the_minimum(monkeypatch: pytest.MonkeyPatch) -> None:
    """The next step would be below 3e-12 of the extent: different paths agree to 1e-9 of an amplitude."""
    model, beyond, descend = block_model(), [], SmoothMotion._descend

    def watched(
        motion: SmoothMotion, begin: np.ndarray, rest: np.ndarray, region: SmoothRegion, *, rough: bool
    ) -> Smoothed:
        found = descend(motion, begin, rest, region, rough=rough)
        if rough:
            return found
        distortion = corner_distortions(found.points, region.free.simplices, motion.law.norm)
        gradient, hessian = motion.model(found.points, rest, region, distortion, exact=True)
        beyond.append(np.abs(region.solver(found.points, hessian)(-gradient)).max())
        return found

    monkeypatch.setattr(SmoothMotion, "_descend", watched)
    played(model, [turned(model, angle) for angle in np.linspace(25.0, 90.0, 40)])
    assert len(beyond) > 30
    assert max(beyond) < 3e-12


def test_an_early_stop_gives_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    model = block_model(quality_threshold=0.1)
    monkeypatch.setattr(smooth_motion, "_ITERATIONS", 1)
    motion = model.move(model.points, turned(model, 50.0))
    assert any("stopped before its minimum" in warning for warning in motion.warnings)


def test_bodies_that_pass_each_other_do_not_stay_at_a_saddle() -> None:
    # two boxes in a row; mesh and motion are symmetric, and the symmetric mesh is no minimum
    box = box_mesh("hexahedron", 5)
    points, places = np.unique(
        np.concatenate([box.points, np.add(box.points, [1.0, 0.0, 0.0])]).round(9), axis=0, return_inverse=True
    )
    (hexahedra,) = box.cells
    n, numbers = len(box.points), places.ravel()
    cells = CellTable.from_arrays({"hexahedron": numbers[np.concatenate([hexahedra.nodes, hexahedra.nodes + n])]})
    bodies = [numbers[box.body + first] for first in (0, n)]
    wall = np.flatnonzero(((points == 0.0) | (points == [2.0, 1.0, 1.0])).any(axis=1))
    patches = {"one": Patch("moving", bodies[0]), "other": Patch("moving", bodies[1]), "wall": Patch("fixed", wall)}
    model, targets = MotionModel.build(points, cells, patches, Method()), points.copy()
    for nodes, shift in zip(bodies, (0.2, -0.2), strict=True):
        targets[nodes] += shift
    motion = model.move(points, targets[model.roles.moving])
    assert motion.corrected
    assert not motion.warnings


def test_where_it_finds_no_mesh_the_other_correction_does_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    model = block_model()
    monkeypatch.setattr(SmoothMotion, "correct", lambda *_, **__: Smoothed(model.points, 1, 0, False, np.inf))
    targets = turned(model, 90.0)
    motion = model.move(model.points, targets)
    assert motion.warnings[-1] == NOT_SMOOTH
    assert motion.correction.method == "optimised"
    assert motion.corrected.metric.min >= 0.2
    assert np.array_equal(motion.points[model.roles.moving], targets)


def test_a_motion_that_is_impossible_is_refused_with_the_part_that_is_not() -> None:
    model = block_model()
    with pytest.raises(QualityRefused, match=r"exists|0\.\d+ of the way") as refusal:
        model.move(model.points, turned(model, 0.0, (0.6, 0.0)))
    assert refusal.value.fraction is not None
    assert 0.3 < refusal.value.fraction < 1.0


@pytest.mark.parametrize("flat", [1.0, 0.05])
@pytest.mark.parametrize("kind", CELL_KINDS)
def test_a_rank_sends_every_cell_that_resists(kind, flat):
    """Judged by its worst corner, which equals the distortion except for the smoothing of its size."""
    box, random = box_mesh(kind, 4), np.random.default_rng(7)
    points = box.points * np.array([1.0, flat, 1.0])[: box.points.shape[1]]
    rest = cells_at_rest(points, box.cells)
    simplices, norm = corner_simplices(points, box.cells, rest.sizes, at_rest=True, angles=True), Law().norm
    for shake in (1e-3, 0.02, 0.05):
        moved = points + shake * flat * random.standard_normal(points.shape)
        smallest = corner_quality(moved, box.cells, points)
        counts = np.concatenate([np.full(len(block), len(block.type.corners)) for block in box.cells])
        worst = np.maximum.reduceat(corner_distortions(moved, simplices, norm), np.cumsum(counts) - counts)
        assert (smallest <= np.exp(-worst) * (1.0 + 1e-12)).all()
        np.testing.assert_allclose(smallest, np.exp(-worst), rtol=0.05)
