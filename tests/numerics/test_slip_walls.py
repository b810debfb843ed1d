"""Slip walls in the plain motion: never worse than fixed ones, and no node passes the end of its wall."""

import numpy as np
import pytest
from box_meshes import box_mesh
from frame_meshes import tensor_grid
from hypothesis import example, given, settings
from hypothesis import strategies as st
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.mesh.sliding import SlidingSurfaces
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel
from mesh_motion_protocol.errors import QualityRefused
from sliding_meshes import duct, rounded

CORNERS = {"quad": ((0, 1, 3), (1, 2, 0), (2, 3, 1), (3, 0, 2)), "triangle": ((0, 1, 2),), "tetra": ((0, 1, 2, 3),)}
PLAIN = {"correction": "none", "allow_invalid": True}


def least_shape(rest: np.ndarray, now: np.ndarray, cells: CellTable) -> float:
    """Least d det(T)^(2/d) / |T|² of T = A_now A_rest⁻¹ over the corners of cells; −1 if one is inverted."""
    least = 1.0
    for block in cells:
        for first, *others in CORNERS[block.type.name]:
            a, b = (
                np.stack([x[block.nodes[:, k]] - x[block.nodes[:, first]] for k in others], -1) for x in (rest, now)
            )
            t = b @ np.linalg.inv(a)
            det, d = np.linalg.det(t), t.shape[1]
            shape = np.where(det > 0.0, d * np.abs(det) ** (2.0 / d) / np.sum(t * t, axis=(1, 2)), -1.0)
            least = min(least, float(shape.min()))
    return least


def walls_of(points: np.ndarray, role: str) -> dict[str, Patch]:
    sides = {f"{'xyz'[axis]}{end}": points[:, axis] == end for axis in range(points.shape[1]) for end in (0, 1)}
    return {name: Patch(role, np.flatnonzero(side)) for name, side in sides.items()}


def moved_body(
    kind: str, role: str, shift: tuple[float, ...], angle: float, method: Method
) -> tuple[MotionModel, np.ndarray]:
    mesh = box_mesh(kind, 10 if kind != "tetra" else 5)
    d = mesh.points.shape[1]
    turn = np.eye(d)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    patches = {"body": Patch("moving", mesh.body)} | walls_of(mesh.points, role)
    model = MotionModel.build(mesh.points, mesh.cells, patches, method)
    return model, (mesh.points[model.roles.moving] - 0.5) @ turn.T + 0.5 + np.array(shift[:d])


def least_quality(model: MotionModel, targets: np.ndarray) -> float:
    """The smallest of the method's metric after a motion from rest; −∞ where it is refused."""
    try:
        return model.move(model.points, targets).corrected.metric.min
    except QualityRefused:
        return -np.inf


def tank(tilt: float) -> tuple[MotionModel, np.ndarray]:
    points, quads = tensor_grid(np.linspace(0.0, 1.0, 31), np.linspace(0.0, 0.5, 16))
    number = np.arange(len(points)).reshape(31, 16).T
    sides = {"left": number[:, 0], "right": number[:, -1], "bottom": number[0]}
    patches = {"surface": Patch("moving", number[-1])} | {name: Patch("slip", side) for name, side in sides.items()}
    model = MotionModel.build(points, CellTable.from_arrays({"quad": quads}), patches, Method(**PLAIN))
    targets = points[model.roles.moving]
    return model, targets + np.column_stack([0.0 * targets[:, 0], tilt * np.cos(np.pi * targets[:, 0])])


@given(
    kind=st.sampled_from(["quad", "quad + triangle", "tetra"]),
    shift=st.tuples(*[st.floats(-0.3, 0.3)] * 3),
    angle=st.floats(-1.0, 1.0),
    displacement=st.sampled_from(["relative", "absolute", "reanchored"]),
)
def test_slip_walls_are_never_worse_than_fixed_ones(kind, shift, angle, displacement) -> None:
    """The walls are held where they would cost more than 0.02 of the method's metric; the tolerance is five times that.

    That metric includes the size, this shape does not.
    """
    least = {}
    for role in ("slip", "fixed"):
        model, targets = moved_body(kind, role, shift, angle, Method(displacement=displacement, **PLAIN))
        least[role] = least_shape(model.points, model.move(model.points, targets).points, model.cells)
    assert least["slip"] >= least["fixed"] - 0.1


@pytest.mark.slow
@settings(max_examples=25)
@given(
    kind=st.sampled_from(["quad", "quad + triangle", "tetra"]),
    shift=st.tuples(*[st.floats(-0.25, 0.25)] * 3),
    angle=st.floats(-1.0, 1.0),
)
@example(kind="tetra", shift=(-0.25, -0.125, -0.0625), angle=0.0)  # worse by 0.027
def test_with_nothing_set_slip_walls_are_never_worse_than_fixed_ones(kind, shift, angle) -> None:
    """Judged with the method's metric; if slip walls admit no motion, fixed ones admit none either.

    The correction minimises a sum over all cells, so its worst cell may be a little worse: in four of 239 random
    motions by at most 0.006, in the example by more.
    """
    least = {}
    for role in ("slip", "fixed"):
        model, targets = moved_body(kind, role, shift, angle, Method())
        least[role] = least_quality(model, targets)
    assert least["slip"] >= least["fixed"] - 0.03


@pytest.mark.parametrize("kind", ["quad", "quad + triangle", "tetra", "hexahedron", "wedge"])
@pytest.mark.parametrize("roles", [("slip", "slip"), ("symmetry", "symmetry"), ("fixed", "slip")], ids="/".join)
def test_walls_whose_patches_share_no_node_are_those_that_do(kind: str, roles: tuple[str, ...]) -> None:
    """Many codes list a node with one patch only; the corner of two walls then is on the first of them."""
    mesh = box_mesh(kind, 10 if kind.startswith("quad") else 5)
    found = []
    for disjoint in (False, True):
        patches, taken = {"body": Patch("moving", mesh.body)}, np.empty(0, dtype=np.int64)
        for name, wall in walls_of(mesh.points, "slip").items():
            nodes = np.setdiff1d(wall.nodes, taken) if disjoint else wall.nodes
            patches[name] = Patch(roles[name[0] != "x"], nodes)
            taken = np.union1d(taken, nodes)
        model = MotionModel.build(mesh.points, mesh.cells, patches, Method())
        shift = np.resize([0.2, 0.0, 0.0], mesh.points.shape[1])
        found.append(model.move(mesh.points, mesh.points[model.roles.moving] + shift).points)
    np.testing.assert_array_equal(found[1], found[0])
    for side in walls_of(mesh.points, "slip").values():  # the domain is what it was
        on = mesh.points[side.nodes]
        across = int(np.argmin(np.ptp(on, axis=0)))
        np.testing.assert_array_equal(found[1][side.nodes, across], on[:, across])
    corners = ((mesh.points == 0.0) | (mesh.points == 1.0)).all(axis=1)
    np.testing.assert_array_equal(found[1][corners], mesh.points[corners])


@pytest.mark.parametrize("tilt", [0.1, 0.35])
def test_no_node_of_a_tank_passes_its_corner(tilt: float) -> None:
    model, targets = tank(tilt)
    found = model.move(model.points, targets)
    right = found.points[model.points[:, 0] == 1.0, 1]
    assert right[0] == 0.0
    assert np.all(np.diff(right) > 0.0)
    assert found.standard.inverted == 0


def test_a_body_near_a_corner_leaves_the_wall_nodes_inside_the_box() -> None:
    """The interpolated displacement takes nodes past the corner here; they are put in order."""
    mesh = box_mesh("quad + triangle", 10)
    patches = {"body": Patch("moving", mesh.body)} | walls_of(mesh.points, "slip")
    model = MotionModel.build(mesh.points, mesh.cells, patches, Method(displacement="absolute", **PLAIN))
    sliding = model.standard_motion.sliding
    found = sliding.in_order(sliding_past(model), np.isin(np.arange(len(mesh.points)), corners_of(sliding)))
    assert found.min() >= 0.0
    assert found.max() <= 1.0
    for side in walls_of(mesh.points, "slip").values():
        along = int(np.argmax(np.ptp(mesh.points[side.nodes], axis=0)))
        order = np.argsort(mesh.points[side.nodes, along])
        assert np.all(np.diff(found[side.nodes, along][order]) > 0.009)


def sliding_past(model: MotionModel) -> np.ndarray:
    """The mesh with its sliding nodes displaced along their walls by 0.3."""
    sliding, out = model.standard_motion.sliding, model.points.copy()
    out[sliding.nodes] = sliding.project(out[sliding.nodes] + 0.3)
    return out


def corners_of(sliding: SlidingSurfaces) -> np.ndarray:
    return sliding.nodes[sliding.freedom() == 0]


def test_edges_of_a_box_follow_its_corners_and_its_sides_the_edges() -> None:
    mesh = box_mesh("tetra", 5)
    patches = {"body": Patch("moving", mesh.body)} | walls_of(mesh.points, "slip")
    model = MotionModel.build(mesh.points, mesh.cells, patches, Method(**PLAIN))
    assert [len(wall.nodes) for wall in model.standard_motion.sliding.by_freedom] == [8, 48, 96]
    assert [len(line.nodes) for line in model.standard_motion.sliding.lines] == [6] * 12
    found = model.move(mesh.points, mesh.points[model.roles.moving] + [0.3, 0.0, 0.0])
    assert found.standard.inverted == 0
    assert found.points.max() <= 1.0


def test_walls_are_held_where_sliding_nodes_would_make_the_mesh_worse() -> None:
    mesh = box_mesh("quad", 10)
    slip = {"body": Patch("moving", mesh.body)} | walls_of(mesh.points, "slip")
    slip |= {name: Patch("fixed", slip[name].nodes) for name in ("x0", "x1")}
    model = MotionModel.build(mesh.points, mesh.cells, slip, Method(**PLAIN, support_radius=2.5))
    angle, body = -0.379, mesh.points[model.roles.moving]
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    found = model.move(mesh.points, (body - 0.5) @ turn.T + 0.5 + [-0.243, -0.013]).points
    walls = model.roles.sliding
    assert np.array_equal(found[walls], mesh.points[walls])


def moved_in_rounded(
    d: int, role: str, power: float, shift: tuple[float, ...], angle: float, method: Method
) -> tuple[MotionModel, np.ndarray]:
    """The block in a disc, a cylinder or a rounded box, turned about its middle and shifted along the planes."""
    points, cells, patches = rounded(d, power=power)
    model = MotionModel.build(points, cells, patches | {"wall": Patch(role, patches["wall"].nodes)}, method)
    return model, turned(points[model.roles.moving], angle) + np.resize([*shift, 0.0], 3)[:d]


def turned(places: np.ndarray, angle: float) -> np.ndarray:
    """Places (k, d) turned about the z axis."""
    turn = np.eye(places.shape[1])
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return places @ turn.T


@settings(max_examples=25)
@given(
    d=st.sampled_from([2, 3]),
    power=st.floats(2.0, 6.0),
    shift=st.tuples(*[st.floats(-0.2, 0.2)] * 2),
    angle=st.floats(-1.0, 1.0),
    correction=st.sampled_from(["smooth", "none", "optimised"]),
)
@example(d=2, power=5.1, shift=(0.02, 0.01), angle=-0.52, correction="smooth")  # they followed the body
@example(d=2, power=3.3, shift=(-0.01, -0.18), angle=-0.9, correction="optimised")  # iterations stopped early: 0.03
@example(d=3, power=2.5, shift=(0.1875, 0.1875), angle=0.0, correction="optimised")  # … from nodes that had slid: 0.08
def test_walls_without_an_end_are_never_worse_than_fixed_ones(d, power, shift, angle, correction) -> None:
    """A round wall turns with the body: better by 0.2 in the mean, and worse by up to 0.035 in 3 of 40 motions.

    The optimised correction ends at a goal, not at the best mesh: it must be as good only below the threshold.
    """
    least = {}
    for role in ("slip", "fixed"):
        method = Method(correction=correction, allow_invalid=correction == "none")
        model, targets = moved_in_rounded(d, role, power, shift, angle, method)
        least[role] = least_quality(model, targets)
    goal = least["fixed"] if correction != "optimised" else min(least["fixed"], 0.2)
    assert least["slip"] >= goal - 0.05


@pytest.mark.slow
@settings(max_examples=80)
@given(
    kind=st.sampled_from(["quad", "quad + triangle", "tetra", "wedge"]),
    bend=st.floats(0.3, 1.5),
    shift=st.tuples(*[st.floats(-0.25, 0.25)] * 3),
    angle=st.floats(-0.9, 0.9),
)
@example(kind="quad", bend=0.8, shift=(0.1816, 0.0207, 0.0), angle=-0.5838)  # 0.124 worse
@example(kind="quad", bend=1.5, shift=(-0.06, 0.02, 0.0), angle=0.8)  # 0.1 worse
def test_curved_walls_between_fixed_ends_are_never_worse_than_fixed_ones(kind, bend, shift, angle) -> None:
    """Their nodes crowded at the ends of the walls, where no correction moved them: worse by up to 0.124.

    At most 0.059 in some thousand random motions (a wedge that turns by 43° and is shifted by a quarter of the duct:
    0.071 and 0.130), and better by 0.048 in the mean.
    """
    points, cells, patches = duct(kind, 10 if kind.startswith("quad") else 5, bend=bend)
    least, d = {}, points.shape[1]
    for role in ("slip", "fixed"):
        roles = {name: Patch(role if p.role == "slip" else p.role, p.nodes) for name, p in patches.items()}
        model = MotionModel.build(points, cells, roles, Method())
        body = points[model.roles.moving]
        targets = turned(body - body.mean(axis=0), angle) + body.mean(axis=0) + shift[:d]
        least[role] = least_quality(model, targets)
    assert least["slip"] >= least["fixed"] - 0.07


@pytest.mark.parametrize("shift", [(-0.2, 0.1), (-0.15, -0.15), (-0.1, 0.25)])
def test_a_round_obstacle_is_never_worse_than_a_fixed_one(shift: tuple[float, float]) -> None:
    """A part of the outer boundary moves, the rest is fixed. The obstacle followed: half of the quality was lost."""
    points, cells, patches = rounded(2)
    outer, obstacle = patches["wall"].nodes, patches["body"].nodes
    points[obstacle] *= (0.12 / np.hypot(*points[obstacle].T))[:, None]
    moves = points[outer, 0] > 0.1
    least = {}
    for role in ("slip", "fixed"):
        roles = {"part": Patch("moving", outer[moves]), "rest": Patch("fixed", outer[~moves])}
        model = MotionModel.build(points, cells, roles | {"obstacle": Patch(role, obstacle)}, Method())
        places = points[model.roles.moving]
        goal = places + (2.0 * places[:, :1] - 0.2) * np.array(shift)
        least[role] = model.move(points, goal).corrected.metric.min
    assert least["slip"] >= least["fixed"] - 0.02


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("correction", ["smooth", "none"])
def test_a_round_wall_turns_with_a_body_that_goes_round(d: int, correction: str) -> None:
    """The mesh after a shift, turned as a whole about the axis of the wall, is as good at every angle."""
    points, cells, patches = rounded(d)
    model = MotionModel.build(points, cells, patches, Method(correction=correction, displacement="absolute"))
    shifted = points[model.roles.moving] + np.resize([0.15, 0.0, 0.0], d)
    committed, least = model.points, []
    for degrees in range(0, 361, 20):
        found = model.move(committed, turned(shifted, np.deg2rad(degrees)))
        committed = found.points
        least.append(found.corrected.metric.min)
        assert not any("smooth function" in warning for warning in found.warnings)
    assert min(least) > 0.9 * least[0]
    np.testing.assert_allclose(committed, model.move(points, shifted).points, atol=1e-9)


def test_an_axis_is_that_of_all_walls() -> None:
    """A disc and a cylinder turn about their axis; a rounded box does not. A fixed node holds them all."""
    for d in (2, 3):
        points, cells, patches = rounded(d)
        axis = MotionModel.build(points, cells, patches, Method()).standard_motion.sliding.axis
        np.testing.assert_allclose(axis(np.zeros((1, d))), 0.0, atol=1e-3)
    points, cells, patches = rounded(2, power=4.0)
    sliding = MotionModel.build(points, cells, patches, Method()).standard_motion.sliding
    assert sliding.axis is None
    assert not sliding.turns
    assert sliding.endless[patches["wall"].nodes].all()
    with_fixed = patches | {"pin": Patch("fixed", patches["wall"].nodes[:1])}
    assert MotionModel.build(points, cells, with_fixed, Method()).standard_motion.sliding.endless is None


def barrel(*, whole: bool) -> tuple[np.ndarray, CellTable, dict[str, Patch]]:
    """Hexahedra in a barrel along z with a curved wall, y = 1 + 0.4 sin(πx); with ``whole`` all walls are one patch.

    The piston at z = 0 moves, the head at z = 1 is fixed, the walls slip.
    """
    points, cells = tensor_grid(np.linspace(0.0, 1.0, 7), np.linspace(0.0, 1.0, 7), np.linspace(0.0, 1.0, 11))
    sides = {f"{'xyz'[axis]}{end}": np.flatnonzero(points[:, axis] == end) for axis in range(3) for end in (0, 1)}
    points[:, 1] *= 1.0 + 0.4 * np.sin(np.pi * points[:, 0])
    patches = {"piston": Patch("moving", sides.pop("z0")), "head": Patch("fixed", sides.pop("z1"))}
    walls = {"walls": np.unique(np.concatenate([*sides.values()]))} if whole else sides
    patches |= {name: Patch("slip", nodes) for name, nodes in walls.items()}
    return points, CellTable.from_arrays({"hexahedron": cells}), patches


@pytest.mark.parametrize("whole", [False, True])
@pytest.mark.parametrize("stroke", [-0.4, 0.7])
def test_a_piston_stretches_the_mesh_evenly(stroke: float, whole: bool) -> None:
    """The nodes of a curved wall ended where the wall ended at rest, and no correction moved them along it."""
    points, cells, patches = barrel(whole=whole)
    model = MotionModel.build(points, cells, patches, Method(quality_metric="relative-size-skew"))
    wall = points[:, 1] > (1.0 - 1e-9) * (1.0 + 0.4 * np.sin(np.pi * points[:, 0]))
    moved = model.move(points, points[model.roles.moving] + [0.0, 0.0, stroke]).points
    even = points + np.outer(1.0 - points[:, 2], [0.0, 0.0, stroke])
    heights = [np.diff(np.sort(x.reshape(-1, 11, 3)[..., 2]), axis=1) for x in (moved, even)]
    assert np.abs(heights[0] / heights[1] - 1.0).max() < 0.1
    section = points[wall][np.unique(points[wall, 0], return_index=True)[1]]
    away = moved[wall, 1] - np.interp(moved[wall, 0], section[:, 0], section[:, 1])
    assert np.abs(away).max() < 1e-12
