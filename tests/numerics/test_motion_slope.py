"""The motion's derivative compared with central differences, and its transpose to rounding, for all motions with a
derivative.
"""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from box_meshes import CELL_KINDS
from carried_layers import with_layer
from far_meshes import aerofoil, far_block, near_block
from mesh_motion_numerics.correction.smooth_slope import SmoothSlope
from mesh_motion_numerics.decomposition import nearest_rotation, nearest_rotation_slope
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.interpolation_map import interpolation_map
from mesh_motion_numerics.interpolation.periodic_interpolant import PeriodicLevels, periodic_factorization_of
from mesh_motion_numerics.interpolation.two_scale.factorization import TwoScalePlan
from mesh_motion_numerics.mesh import wall_lines
from mesh_motion_numerics.mesh.rigid_transforms import Transform
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel
from mesh_motion_protocol.errors import InvalidInput, QualityRefused
from periodic_meshes import joined_sector, periodic_box, sector, turn
from sliding_meshes import Mesh, duct, rounded

from mesh_motion_server.session.factors import FactorCache

PLAIN = {"correction": "none", "displacement": "absolute"}


def all_moving(kind: str) -> Mesh:
    points, cells, patches = near_block(kind)
    return points, cells, {name: Patch("moving", patch.nodes) for name, patch in patches.items()}


def field(x: np.ndarray, degrees: float = 12.0) -> np.ndarray:
    """A turn about the middle, a shift and a bend, (k, d)."""
    angle = np.deg2rad(degrees)
    turn = np.eye(x.shape[1])
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return (x - 0.5) @ turn.T + 0.5 - x + 0.03 + 0.02 * np.sin(4.0 * x[:, ::-1])


def velocity(x: np.ndarray) -> np.ndarray:
    found = np.cos(3.0 * x[:, ::-1]) + 0.3 * x + 0.1 * np.sin(9.0 * x)
    return found / np.abs(found).max()


def one_slides(mesh: Mesh) -> Mesh:
    points, cells, patches = mesh
    return points, cells, patches | {"z0": Patch("slip", patches["z0"].nodes)}


def nothing_fixed(mesh: Mesh, *moving: str) -> Mesh:
    """All its sides slip except the periodic ones and some moving ones."""
    points, cells, patches = mesh
    roles = {name: "moving" if name in ("body", *moving) else "slip" for name in patches}
    kept = {name: patch for name, patch in patches.items() if patch.role == "periodic"}
    return points, cells, {name: Patch(role, patches[name].nodes) for name, role in roles.items()} | kept


def motion_of(name: str, x: np.ndarray) -> np.ndarray:
    """The displacement (k, d) of a case: a shift along walls may be larger than a turn; a layer must not give way."""
    if "carried" in name:
        return field(x, 1.0) + 0.3 * np.eye(x.shape[1])[0]
    return field(x, 5.0 if "curved slip walls with a layer" in name else 20.0 if "oblique" in name else 12.0)


CASES: dict[str, tuple[Callable[[], Mesh], dict[str, object]]] = {
    **{f"smooth {kind}": (lambda kind=kind: near_block(kind), {}) for kind in CELL_KINDS},
    "plain": (lambda: near_block("quad"), PLAIN),
    "polynomial": (lambda: near_block("tetra"), PLAIN | {"basis": "tps"}),
    "nothing fixed": (lambda: all_moving("quad"), {}),
    "nothing fixed in space": (lambda: all_moving("tetra"), PLAIN),
    "layer": (lambda: near_block("quad", 10), {"correction": "smooth"}),
    "layer in space": (lambda: near_block("tetra", 10), PLAIN),
    "high layer on short facets": (lambda: near_block("quad", 30), PLAIN),
    "high layer in space": (lambda: near_block("tetra", 20), PLAIN),
    "slip walls": (lambda: duct("quad"), {}),
    "slip walls in space": (lambda: duct("hexahedron", 5), {}),
    "slip walls with a layer": (lambda: duct("quad", 10), PLAIN),
    "periodic": (lambda: periodic_box("quad"), {}),
    "periodic both ways, oblique, in space": (lambda: periodic_box("tetra", 5, axes="yz", shear=0.3), {}),
    "a sector": (lambda: sector("quad + triangle"), {}),
    "a sector in space": (lambda: sector("hexahedron", 5), {}),
    "a sector of 50°": (lambda: sector("quad + triangle", sectors=7.2), {}),
    "a sector with a wall that slides": (lambda: one_slides(sector("hexahedron", 5)), PLAIN),
    "curved slip walls": (lambda: duct("quad", bend=0.6), {}),
    "curved slip walls, and nodes that slide no more": (lambda: duct("quad", bend=0.6), PLAIN),
    "curved slip walls and edges": (lambda: duct("hexahedron", 5, bend=0.6), {}),
    "curved slip walls of triangles": (lambda: duct("tetra", 5, bend=0.6), PLAIN),
    "curved slip walls with a layer": (lambda: nothing_fixed(duct("quad", 10, bend=0.6), "x0", "x1"), PLAIN),
    "nothing fixed, in a box that slips": (lambda: nothing_fixed(duct("quad")), {}),
    "nothing fixed, in a bend that slips": (lambda: nothing_fixed(duct("hexahedron", 5, bend=0.6)), PLAIN),
    "nothing fixed, in a disc that slips": (lambda: rounded(2, around=24), {}),
    "nothing fixed, in a cylinder that slips": (lambda: rounded(3, around=24), PLAIN),
    "nothing fixed, in a rounded box that slips": (lambda: rounded(2, power=4.0), PLAIN),
    "nothing fixed, carried along walls": (lambda: nothing_fixed(duct("quad"), "x0", "x1"), {}),
    "nothing fixed, carried along walls in space": (lambda: nothing_fixed(duct("tetra", 5), "x0", "x1"), PLAIN),
    "nothing fixed, periodic both ways": (lambda: periodic_box("quad", axes="xy"), {}),
    "nothing fixed, periodic along walls": (lambda: periodic_box("hexahedron", 5, ends="slip"), {}),
    "nothing fixed, a sector in an annulus": (lambda: sector("quad", ends="slip"), {}),
    "a blade on the slip hub of a sector": (lambda: joined_sector("quad", 10, angle=0.8), PLAIN),
    "nothing fixed, a sector between hub and tip": (lambda: sector("hexahedron", 5, ends="slip"), {}),
    "far field": (lambda: far_block("quad", 20), {}),
    "far field in space, plain": (lambda: far_block("tetra", 10), PLAIN),
    "far field in two scales": (aerofoil, PLAIN),
    "spline on a grid": (lambda: near_block("quad", 300), PLAIN),
    "spline on a grid in space": (lambda: near_block("hexahedron", 15), PLAIN),
}


CARRIED = {
    "nothing fixed",
    "nothing fixed in space",
    *(name for name in CASES if name.startswith(("nothing fixed, carried", "nothing fixed, periodic"))),
    *(name for name in CASES if name.startswith(("nothing fixed, a sector", "nothing fixed, in a disc"))),
    "nothing fixed, in a cylinder that slips",
}


@pytest.mark.parametrize("name", CASES)
def test_it_is_that_of_differences_and_its_transpose(name: str) -> None:
    make, choices = CASES[name]
    points, cells, patches = make()
    model, factors = MotionModel.build(points, cells, patches, Method(**choices)), FactorCache(1 << 28)
    if "layer" in name:
        model = with_layer(model, patches, 0.31 if "high" in name else 0.11)
        wall = model.standard_motion.layer.wall
        assert ("high" in name) == (wall.around.nnz > wall.simplices.size)  # whether nodes have means
    rest = points[model.roles.moving]
    moved = model.move(points, rest + motion_of(name, rest), factors).points
    slope, v = model.slope(moved, factors), velocity(rest)
    assert (slope.plain.interpolated.rigid is not None) == (name in CARRIED)
    if choices.get("correction") != "none" and "fixed" not in name:
        assert slope.smooth is not None
        assert slope.smooth.region is not None  # some nodes are free
    found = slope.tangent(v)

    def difference(h: float) -> np.ndarray:
        there, back = (model.move(moved, moved[model.roles.moving] + s * h * v, factors).points for s in (1, -1))
        return (there - back) / (2.0 * h)

    # the motion has a third derivative only between the places where further cells begin to resist: a difference over
    # such a place is wrong by up to 2e-6, and a shorter one loses digits
    sizes = (2.5e-4,) if slope.smooth is None else (3e-5, 5e-6)
    errors = [np.abs(found - (4.0 * difference(h / 2.0) - difference(h)) / 3.0).max() for h in sizes]
    assert min(errors) < 1e-8 * np.abs(found).max()
    assert (found[model.roles.moving] == v).all()
    w = np.random.default_rng(3).standard_normal(points.shape)
    back = slope.cotangent(w)
    assert abs(np.sum(w * found) - np.sum(back * v)) < 1e-12 * (np.abs(w * found).sum() + np.abs(back * v).sum())


@pytest.mark.parametrize("choices", [{}, PLAIN])
@pytest.mark.parametrize(
    "make", [lambda: near_block("hexahedron", 15), lambda: near_block("quad", 10), lambda: all_moving("quad")]
)
def test_a_step_without_correction_is_not_repeated(
    make: Callable[[], Mesh], choices: dict[str, object], monkeypatch: pytest.MonkeyPatch
) -> None:
    points, cells, patches = make()
    model, factors = MotionModel.build(points, cells, patches, Method(**choices)), FactorCache(1 << 28)
    rest, w = points[model.roles.moving], np.random.default_rng(2).standard_normal(points.shape)
    motion = model.move(points, rest + 0.05 * field(rest), factors)
    assert not motion.correction.freed_nodes
    repeated = model.slope(motion.points.copy(), factors).cotangent(w)
    with monkeypatch.context() as patched:
        patched.delattr("mesh_motion_numerics.motion.standard_motion.StandardMotion.trial")
        assert (model.slope(motion.points, factors).cotangent(w) == repeated).all()


def test_differences_approach_it_with_the_square_of_the_step() -> None:
    points, cells, patches = near_block("quad + triangle", 10)
    model, factors = MotionModel.build(points, cells, patches, Method()), FactorCache(1 << 28)
    rest = points[model.roles.moving]
    moved = model.move(points, rest + field(rest), factors).points
    found, errors = model.slope(moved, factors).tangent(velocity(rest)), []
    for h in (2e-4, 1e-4, 5e-5):
        there, back = (model.move(moved, moved[model.roles.moving] + s * h * velocity(rest), factors) for s in (1, -1))
        errors.append(np.abs((there.points - back.points) / (2.0 * h) - found).max())
    assert all(3.8 < coarse / fine < 4.2 for coarse, fine in pairwise(errors)), errors


def test_it_is_not_that_of_a_frozen_correction() -> None:
    points, cells, patches = near_block("quad + triangle", 10)
    model, factors = MotionModel.build(points, cells, patches, Method()), FactorCache(1 << 28)
    rest = points[model.roles.moving]
    slope = model.slope(model.move(points, rest + field(rest, 40.0), factors).points, factors)
    whole, frozen = slope.tangent(velocity(rest)), slope.plain.apply(velocity(rest))
    assert np.abs(whole - frozen).max() > 0.1 * np.abs(whole).max()


def test_at_rest_it_is_that_of_the_plain_motion() -> None:
    points, cells, patches = near_block("quad + triangle", 10)
    model, factors = MotionModel.build(points, cells, patches, Method()), FactorCache(1 << 28)
    slope, v = model.slope(points, factors), velocity(points[model.roles.moving])
    assert (slope.tangent(v) == slope.plain.apply(v)).all()
    turn = slope.tangent(np.zeros_like(v))
    assert not turn.any()


def test_a_rigid_motion_of_everything_is_one_of_all_nodes() -> None:
    """Velocities of a mesh without fixed nodes that turns about a point and shifts."""
    points, cells, patches = all_moving("tetra")
    model, factors = MotionModel.build(points, cells, patches, Method()), FactorCache(1 << 28)
    spin = np.array([[0.0, -0.3, 0.1], [0.3, 0.0, -0.2], [-0.1, 0.2, 0.0]])
    found = model.slope(points, factors).tangent((points @ spin.T + 0.7)[model.roles.moving])
    np.testing.assert_allclose(found, points @ spin.T + 0.7, atol=1e-12)


FITTING = {"displacement": ("absolute",), "correction": ("none", "smooth"), "reduction": ("none",)}


@pytest.mark.parametrize(
    ("choices", "key"),
    [
        ({"displacement": "relative"}, "displacement"),
        ({"displacement": "reanchored", "correction": "none"}, "displacement"),
        ({"displacement": "absolute", "correction": "optimised"}, "correction"),
        ({"displacement": "relative", "correction": "optimised", "reduction": "greedy"}, "displacement"),
        ({"displacement": "absolute", "correction": "none", "reduction": "greedy"}, "reduction"),
    ],
)
def test_a_method_that_has_none_is_refused_by_its_key(choices: dict[str, object], key: str) -> None:
    model = MotionModel.build(*near_block("quad"), Method(**choices))
    refusal = model.why_no_slope()
    assert refusal is not None
    assert refusal.details == {"setting": key}
    wrong = [name for name, fits in FITTING.items() if getattr(model.method, name) not in fits]
    ways_out = (f"{name} {' or '.join(map(repr, FITTING[name]))}" for name in wrong)
    assert refusal.hint == f"open the session with {' and '.join(ways_out)}"
    with pytest.raises(InvalidInput, match=f"^{key} = "):
        model.slope(model.points, FactorCache(0))


@pytest.mark.parametrize(
    "make",
    [
        lambda: nothing_fixed(duct("quad")),
        lambda: periodic_box("quad", axes="xy"),
        lambda: periodic_box("quad", ends="slip"),
        lambda: all_moving("tetra"),
    ],
)
def test_at_rest_it_is_that_of_small_motions_without_a_fixed_node(make: Callable[[], Mesh]) -> None:
    points, cells, patches = make()
    model, factors = MotionModel.build(points, cells, patches, Method(**PLAIN)), FactorCache(1 << 28)
    rest, v = points[model.roles.moving], velocity(points[model.roles.moving])
    found, h = model.slope(points, factors).tangent(v), 1e-5
    there, back = (model.move(points, rest + s * h * v, factors).points for s in (1, -1))
    assert np.abs(found - (there - back) / (2.0 * h)).max() < 1e-8 * np.abs(found).max()


def test_at_rest_it_is_refused_if_walls_admit_some_rigid_motions() -> None:
    """A shift along the duct is one of all nodes, a turn is not: there is a kink."""
    model = MotionModel.build(*nothing_fixed(duct("quad"), "x0", "x1"), Method())
    assert model.why_no_slope() is None
    with pytest.raises(QualityRefused, match="at rest it depends on the direction"):
        model.slope(model.points, FactorCache(1 << 28))


def test_where_a_node_is_at_a_corner_of_its_curved_wall_it_is_the_mean_of_both_sides() -> None:
    points, cells, patches = duct("quad", bend=0.6)
    model, factors = MotionModel.build(points, cells, patches, Method(**PLAIN)), FactorCache(1 << 28)
    rest, v = points[model.roles.moving], velocity(points[model.roles.moving])
    found = model.slope(points, factors).tangent(v)

    def one_sided(h: float) -> np.ndarray:
        once, twice = (model.move(points, rest + k * h * v, factors).points - points for k in (1, 2))
        return (4.0 * once - twice) / (2.0 * h)

    there, back = (one_sided(h) for h in (1e-5, -1e-5))
    assert np.abs(there - back).max() > 1e-3 * np.abs(found).max()
    assert np.abs(found - 0.5 * (there + back)).max() < 1e-8 * np.abs(found).max()


def test_a_mesh_that_another_correction_made_is_refused() -> None:
    points, cells, patches = near_block("quad + triangle", 10)
    for choices in ({}, PLAIN):
        model, factors = MotionModel.build(points, cells, patches, Method(**choices)), FactorCache(1 << 28)
        rest = points[model.roles.moving]
        moved = model.move(points, rest + field(rest), factors).points.copy()
        inner = np.flatnonzero(~model.held)
        moved[inner] += 1e-3 * np.sin(40.0 * moved[inner])
        with pytest.raises(QualityRefused, match="not corrected by the smooth correction"):
            model.slope(moved, factors)


def test_a_mesh_whose_other_nodes_left_the_plain_motion_is_refused() -> None:
    points, cells, patches = near_block("quad + triangle", 10)
    model, factors = MotionModel.build(points, cells, patches, Method()), FactorCache(1 << 28)
    rest = points[model.roles.moving]
    motion = model.move(points, rest + 0.05 * field(rest), factors)
    assert motion.correction.method == "none"  # so no node is free
    moved = motion.points.copy()
    moved[np.flatnonzero(~model.held)[0]] += 1e-3
    with pytest.raises(QualityRefused, match="not corrected by the smooth correction"):
        model.slope(moved, factors)


def test_where_nodes_are_held_in_their_order_it_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """A kink: a node does not slide further, so that no node passes the end of its wall."""
    model, factors = MotionModel.build(*duct("quad"), Method()), FactorCache(1 << 28)
    targets = model.points[model.roles.moving] + np.array([0.1, 0.0])
    model.slope(model.move(model.points, targets, factors).points, factors)
    monkeypatch.setattr(wall_lines, "_LEAST", 0.95)  # of the even spacing
    moved = MotionModel.build(*duct("quad"), Method())  # which keeps no plain motion
    with pytest.raises(QualityRefused, match=r"node \d+ slides no further"):
        moved.slope(moved.move(moved.points, targets, factors).points, factors)


def test_the_derivative_keeps_its_factors() -> None:
    """The second vector needs no new model of the energy."""
    points, cells, patches = near_block("quad + triangle", 10)
    model, factors = MotionModel.build(points, cells, patches, Method()), FactorCache(1 << 28)
    rest = points[model.roles.moving]
    smooth = model.slope(model.move(points, rest + field(rest), factors).points, factors).smooth
    assert isinstance(smooth, SmoothSlope)
    assert smooth._model is smooth._model


@pytest.mark.parametrize("d", [2, 3])
def test_the_slope_of_a_nearest_rotation(d: int) -> None:
    numbers = np.random.default_rng(d)
    at, change, h = numbers.standard_normal((20, d, d)), numbers.standard_normal((20, d, d)), 1e-5
    found = np.einsum("mabce,mce->mab", nearest_rotation_slope(at), change)
    exact = (nearest_rotation(at + h * change) - nearest_rotation(at - h * change)) / (2.0 * h)
    np.testing.assert_allclose(found, exact, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("turned", [False, True])
def test_periodic_levels_have_a_transpose(turned: bool) -> None:
    """Points so close to each other or to an image that they need narrower levels."""
    numbers = np.random.default_rng(5)
    points = numbers.random((60, 2)) + np.array([1.0, 0.0])
    points[50:] = points[:10] + 1e-4
    period = Transform(turn(6, 2), np.zeros(2)) if turned else Transform(np.eye(2), np.array([0.0, 1.0]))
    box = np.array([[0.0, 0.0], [2.0, 2.0]])
    made = periodic_factorization_of(points, (period,), box, Method(support_radius=2.0), FactorCache(1 << 24))
    assert isinstance(made, PeriodicLevels)
    places = numbers.random((100, 2)) * 2.0
    whole = interpolation_map(made, places)
    v, w = numbers.standard_normal(points.shape), numbers.standard_normal(places.shape)
    forth, back = whole.apply(v), whole.transpose(w)
    found = made.solve(v)
    np.testing.assert_allclose(forth, evaluation.displacement(found, places), atol=1e-9 * np.abs(forth).max())
    assert abs(np.sum(w * forth) - np.sum(back * v)) < 1e-10 * (np.abs(w * forth).sum() + np.abs(back * v).sum())


@pytest.mark.parametrize("gridded", [False, True])
def test_points_at_one_place_have_a_transpose_too(gridded: bool) -> None:
    """The two sides of a baffle count as one node with their mean."""
    numbers = np.random.default_rng(7)
    points = numbers.random((300, 2))
    points[250:] = points[:50]
    plan = TwoScalePlan.build(
        points, np.ones(300, dtype=bool), basis="wendland-c2", support_radius=2.0, gridded=gridded, count=100
    )
    places = numbers.random((400, 2))
    whole = interpolation_map(plan.factorize(points, np.zeros(2), np.ones(2)), places)
    v, w = numbers.standard_normal((300, 3)), numbers.standard_normal((400, 3))
    forth, back = whole.apply(v), whole.transpose(w)
    bound = 1e-10  # compact levels are solved to 1e-13, which the sums over the levels multiply
    assert abs(np.sum(w * forth) - np.sum(back * v)) < bound * (np.abs(w * forth).sum() + np.abs(back * v).sum())
