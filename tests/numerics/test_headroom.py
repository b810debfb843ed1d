"""Number of further steps that a mesh admits: exact for straight motions, an early warning for others."""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import mesh_motion_kernels as kernels
import numpy as np
import pytest
from box_meshes import CELL_KINDS, box_mesh
from correction_cases import BodyMesh, stored
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel
from mesh_motion_numerics.motion.motion_found import Motion
from mesh_motion_numerics.quality.headroom import HORIZON, Headroom, headroom
from mesh_motion_numerics.quality.metrics import QUALITY_METRICS, cell_quality, cells_at_rest, judged
from mesh_motion_protocol.errors import QualityRefused
from periodic_meshes import periodic_box
from sliding_meshes import Mesh, duct

from mesh_motion_server.session.factors import FactorCache

NONE = np.empty(0, dtype=np.int64)
Way = Callable[[np.ndarray, float], np.ndarray]


def worst_of(motion: Motion) -> np.ndarray:
    return np.array([cell.number for cell in motion.corrected.worst])


def first_roots(points: np.ndarray, step: np.ndarray, cells: CellTable) -> np.ndarray:
    """(m,) computed with numpy: the roots of the polynomials through d + 1 values of each corner's determinant."""
    d, least = points.shape[1], []
    for block in cells:
        corners = block.nodes[:, block.type.corner_array]
        edges = [(at[:, :, 1:] - at[:, :, :1]) for at in ((points + s * step)[corners] for s in range(d + 1))]
        for cell in np.moveaxis(np.linalg.det(edges), 0, -1):
            roots = [np.roots(np.polyfit(range(d + 1), values, d)) for values in cell]
            least.append(
                min([r.real for r in np.concatenate(roots) if abs(r.imag) < 1e-9 and r.real > 0.0], default=np.inf)
            )
    return np.array(least)


@pytest.mark.parametrize("kind", CELL_KINDS)
def test_the_first_root_of_the_determinants(kind: str) -> None:
    mesh = box_mesh(kind, 5)
    numbers = np.random.default_rng(len(kind))
    for size in (0.001, 0.01, 0.03):
        points = mesh.points + 0.02 * numbers.uniform(-1.0, 1.0, mesh.points.shape)
        step = size * numbers.uniform(-1.0, 1.0, mesh.points.shape)
        found = headroom(points, points - step, mesh.cells, mesh.sizes, "size", 0.0, NONE, NONE)
        expected = first_roots(points, step, mesh.cells)
        assert found.inversion == pytest.approx(expected.min(), rel=1e-9)
        steps, order = kernels.first_inversions(points, points - step, mesh.cells.nodes, NONE, HORIZON, len(mesh.cells))
        near = expected[order] < 0.999 * HORIZON
        np.testing.assert_allclose(steps[near], expected[order][near], rtol=1e-7)
        for s in (1.0 - 1e-9, 1.0 + 1e-9):
            there = points + s * found.inversion * step
            later = headroom(there, there - step, mesh.cells, mesh.sizes, "size", 0.0, NONE, NONE)
            assert (later.inversion == 0.0) == (s > 1.0)
            assert later.cell == found.cell or s < 1.0


@pytest.mark.parametrize("kind", CELL_KINDS)
@pytest.mark.parametrize("metric", QUALITY_METRICS)
def test_the_values_of_some_cells_along_a_step(kind: str, metric: str) -> None:
    """They are those of the moved meshes, before the step and after it."""
    mesh, numbers = box_mesh(kind, 5), np.random.default_rng(len(kind))
    step = 0.02 * numbers.uniform(-1.0, 1.0, mesh.points.shape)
    rest, places = cells_at_rest(mesh.points, mesh.cells), np.array([-1.0, 0.0, 0.5, 4.0])
    some = np.flatnonzero(numbers.uniform(size=len(mesh.cells)) < 0.3)
    points, *arrays = judged(mesh.points, mesh.cells, rest, metric)
    found = kernels.values_along(points, mesh.points - step, *arrays, some, places)
    moved = [cell_quality(mesh.points + s * step, mesh.cells, rest).metric(metric)[some] for s in places]
    np.testing.assert_allclose(found, moved, rtol=1e-11, atol=1e-14)


def corner_determinants(points: np.ndarray, cells: CellTable) -> np.ndarray:
    """(m,) smallest determinant of each cell's corners."""
    least = []
    for block in cells:
        at = points[block.nodes[:, block.type.corner_array]]
        least.append(np.linalg.det(at[:, :, 1:] - at[:, :, :1]).min(axis=1))
    return np.concatenate(least)


LARGE = [("quad + triangle", 170), ("hexahedron", 33), ("wedge", 27), ("pyramid", 19), ("tetra", 19)]


def smooth_way(x: np.ndarray) -> np.ndarray:
    mixed = np.random.default_rng(1).uniform(-5.0, 5.0, (x.shape[1],) * 2)
    return 0.02 * np.sin(x @ mixed)


@pytest.mark.parametrize(("kind", "n"), LARGE)
@pytest.mark.parametrize("rough", [0.0, 1.0])
def test_the_first_cells_of_a_large_mesh(kind: str, n: int, rough: float) -> None:
    """Most groups of cells are left out if the step is smooth, none if it is rough; no cell inverts earlier."""
    mesh, numbers = box_mesh(kind, n), np.random.default_rng(n)
    every = np.arange(len(mesh.cells))
    assert len(every) >= 8 * 4096  # from here on groups of cells are left out
    x, count = mesh.points, 64
    way = smooth_way(x) + rough * numbers.uniform(-1.0, 1.0, x.shape) / n**2
    for inverting in (count, 20):
        steps, first = kernels.first_inversions(x, x - way, mesh.cells.nodes, NONE, HORIZON, count)
        all_steps, order = kernels.first_inversions(x, x - way, mesh.cells.nodes, every, HORIZON, len(every))
        assert sorted(order) == list(every)
        np.testing.assert_allclose(steps, all_steps[:count], rtol=1e-13)
        np.testing.assert_array_equal(first[:inverting], order[:inverting])
        assert np.isfinite(steps).sum() == inverting
        last = min(steps[-1], HORIZON)
        for s in np.linspace(0.0, 0.999999 * last, 8):
            least = corner_determinants(x + s * way, mesh.cells)
            assert (np.delete(least, first[steps <= last]) > 0.0).all()
        if inverting == count:
            way *= (0.5 * (steps[19] + steps[20])) / HORIZON


@pytest.mark.parametrize(("kind", "n"), LARGE)
def test_cells_at_a_node_that_moves_alone(kind: str, n: int) -> None:
    """They are looked at if they are near the moving boundary, or among the worst cells."""
    mesh, numbers = box_mesh(kind, n), np.random.default_rng(n)
    for node in numbers.integers(len(mesh.points), size=10):
        way = smooth_way(mesh.points)
        way[node] += 0.5 / n
        near = np.flatnonzero(np.concatenate([(own.nodes == node).any(axis=1) for own in mesh.cells]))
        every = np.arange(len(mesh.cells))
        (first,), (cell,) = kernels.first_inversions(
            mesh.points, mesh.points - way, mesh.cells.nodes, every, HORIZON, 1
        )
        assert cell in near
        for worst, at_moving in ((NONE, near), (near[::-1], NONE)):
            found = headroom(mesh.points, mesh.points - way, mesh.cells, mesh.sizes, "size", 0.0, worst, at_moving)
            assert found.cell == cell
            assert found.inversion == pytest.approx(first, rel=1e-13)


@pytest.mark.parametrize("kind", CELL_KINDS)
def test_a_mesh_that_is_squeezed_evenly(kind: str) -> None:
    """Its size falls by 0.1 in each step."""
    mesh = box_mesh(kind, 5)
    step = np.zeros_like(mesh.points)
    step[:, 0] = -0.1 * mesh.points[:, 0]

    def after(steps: float, step: np.ndarray, threshold: float) -> Headroom:
        there = mesh.points + steps * step
        return headroom(there, there - step, mesh.cells, mesh.sizes, "size", threshold, NONE, NONE)

    found = after(0.0, step, 0.25)
    assert found.inversion == pytest.approx(10.0, rel=1e-12)
    assert found.threshold == pytest.approx(7.5, rel=1e-3)
    slow = after(0.0, 0.099 * step, 0.25)
    assert slow.inversion == np.inf  # 101 steps
    assert slow.threshold == pytest.approx(7.5 / 0.099, rel=1e-3)
    assert after(0.0, -step, -1.0).threshold == np.inf
    assert after(8.0, step, 0.25).threshold == 0.0
    assert HORIZON == 100.0  # as SPEC.md says


def run_of(mesh: BodyMesh, way: Way, **choices: object) -> tuple[list[float], float]:
    """Headroom after each step of a run, and the number of steps until its mesh ends."""
    model, factors = MotionModel.build(mesh.points, mesh.cells, mesh.patches, Method(**choices)), FactorCache(1 << 28)
    points, found = model.points, []
    for k in range(1, 100):
        try:
            motion = model.move(points, way(model.points[model.roles.moving], k), factors)
        except QualityRefused as refusal:
            return found, k - 1 + (refusal.fraction or 0.0)
        found.append(model.headroom(points, motion.points, worst_of(motion)).inversion)
        points = motion.points
    raise AssertionError("the mesh does not end")


def turn(x: np.ndarray, k: float) -> np.ndarray:
    angle = np.radians(5.0 * k)
    return (x - 0.5) @ np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]) + 0.5


def shift(x: np.ndarray, k: float) -> np.ndarray:
    return x + 0.02 * k * np.eye(x.shape[1])[0]


def test_a_straight_run_ends_where_its_first_step_says() -> None:
    found, end = run_of(stored("thesis_block"), shift, correction="none", displacement="absolute")
    assert all(steps + k == pytest.approx(found[-1] + len(found), rel=1e-6) for k, steps in enumerate(found, start=1))
    assert found[-1] + len(found) == pytest.approx(end, abs=0.05)  # the refusal's fraction is a search's


@pytest.mark.parametrize("mesh", ["thesis_block", "thesis_slab"])
def test_a_turning_run_is_known_five_steps_ahead(mesh: str) -> None:
    found, end = run_of(stored(mesh), turn, correction="none", displacement="absolute")
    for k, steps in enumerate(found, start=1):
        assert end - k > 5.0 or steps == pytest.approx(end - k, rel=0.1, abs=0.1)
        assert end - k > 10.0 or steps - (end - k) < 1.0  # not late by more than a step


@pytest.mark.parametrize("mesh", ["thesis_block", "thesis_slab"])
def test_a_corrected_run_ends_at_the_wall(mesh: str) -> None:
    """It makes as many further steps as each of its steps predicts."""
    found, end = run_of(stored(mesh), shift)
    assert len(found) > 15
    for k, steps in enumerate(found, start=1):
        assert int(end) - k <= steps <= int(end) - k + 1.0 + 1e-6
        assert k + steps == pytest.approx(found[0] + 1.0, rel=1e-9)


@pytest.mark.parametrize("kind", ["quad", "tetra", "pyramid", "hexahedron + wedge"])
def test_a_corrected_run_ends_at_the_wall_for_cells_of_every_type(kind: str) -> None:
    found, end = run_of(box_mesh(kind, 5), shift)
    assert int(end) == 19
    np.testing.assert_allclose(found, np.arange(19.0, 0.0, -1.0), rtol=1e-9)


def test_a_corrected_body_that_turns_does_not_end_soon() -> None:
    """By straight ways cells invert within few steps."""
    mesh = stored("thesis_block")
    model, factors = MotionModel.build(mesh.points, mesh.cells, mesh.patches, Method()), FactorCache(1 << 28)
    points, straight = model.points, []
    for k in range(1, 41):
        before, motion = points, model.move(points, turn(model.points[model.roles.moving], k), factors)
        points = motion.points
        steps, _ = kernels.first_inversions(points, before, model.cells.nodes, NONE, HORIZON, 1)
        straight.append(steps[0])
        if steps[0] < 20.0:
            assert 40.0 < model.headroom(before, points, worst_of(motion)).inversion < 80.0
    assert min(straight) < 10.0


@pytest.mark.parametrize("make", [lambda: duct("quad", bend=0.6), lambda: periodic_box("quad")])
def test_where_the_nodes_of_a_wall_go_is_not_known_ahead(make: Callable[[], Mesh]) -> None:
    points, cells, patches = make()
    model = MotionModel.build(points, cells, patches, Method())
    assert model.contact is None
    way = np.where(np.isin(np.arange(len(points)), model.roles.moving)[:, None], [0.03, 0.0], 0.0)
    steps, _ = kernels.first_inversions(points + way, points, cells.nodes, NONE, HORIZON, 1)
    assert model.headroom(points, points + way, NONE).inversion == steps[0]


@pytest.mark.parametrize("mesh", ["thesis_block", "thesis_slab"])
@pytest.mark.parametrize("step", [(turn, 0.5), (shift, 0.5), (turn, 0.2)])
def test_the_threshold_of_a_corrected_run_is_known_five_steps_ahead(mesh: str, step: tuple[Way, float]) -> None:
    """On straight ways the threshold of the turning runs is up to 17 % nearer."""
    way, part = step
    body = stored(mesh)
    model, factors = MotionModel.build(body.points, body.cells, body.patches, Method()), FactorCache(1 << 28)
    points, found, lowest = model.points, [], [1.0]
    while lowest[-1] >= 0.2:
        motion = model.move(points, way(model.points[model.roles.moving], part * (len(found) + 1)), factors)
        found.append(model.headroom(points, motion.points, worst_of(motion)).threshold)
        lowest.append(motion.corrected.metric.min)
        points = motion.points
    end = len(found) - (0.2 - lowest[-1]) / (lowest[-2] - lowest[-1])
    for k, steps in enumerate(found, start=1):
        assert end - k > 12.0 or steps - (end - k) < 1.0  # not late by more than a step
    five = int(end - 4.5)
    assert found[five - 1] == pytest.approx(end - five, rel=0.11)


def test_the_threshold_and_the_end_of_a_corrected_flag_are_known_ahead() -> None:
    """Cells that invert later reach the threshold first: those that are the worst ones already. It ends at the wall."""
    folder = Path(__file__).parents[2] / "examples" / "turek_hron_flag"
    with np.load(folder / "mesh.npz") as file, np.load(folder / "motion.npz") as table:
        cells = CellTable.from_arrays({"quad": file["cells_quad"], "triangle": file["cells_triangle"]})
        names = ("flag", "cylinder", "walls", "inlet", "outlet")
        patches = {name: Patch("moving" if name == "flag" else "fixed", file[f"patch_{name}"]) for name in names}
        model = MotionModel.build(file["points"], cells, patches, Method())
        highest = np.abs(table["displacement"]).max(axis=(1, 2)).argmax()
        bent = table["displacement"][highest][np.argsort(table["node_ids"])]  # moving nodes ascend
        assert (np.sort(table["node_ids"]) == model.roles.moving).all()
    factors, rest = FactorCache(1 << 28), model.points[model.roles.moving]
    steps = range(27, 35)  # of 5 % each
    motions = [model.move(model.points, rest + 0.05 * k * bent, factors) for k in steps]
    lowest = [motion.corrected.metric.min for motion in motions]
    (last,) = (k for k in range(len(motions) - 1) if lowest[k] >= 0.2 > lowest[k + 1])
    end = last + (lowest[last] - 0.2) / (lowest[last] - lowest[last + 1])
    for k, (before, motion) in enumerate(pairwise(motions), start=1):
        found = model.headroom(before.points, motion.points, worst_of(motion))
        assert found.threshold == pytest.approx(max(end - k, 0.0), rel=0.1)
        assert k + steps.start + found.inversion == pytest.approx(51.427, abs=1e-3)
    model.move(model.points, rest + 0.05 * 51 * bent, factors)
    with pytest.raises(QualityRefused, match="the boundary would cross itself"):
        model.move(model.points, rest + 0.05 * 52 * bent, factors)
