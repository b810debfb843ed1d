"""Motions of periodic meshes end to end: equal to a sector of a ring or to a translated row; pairs stay pairs, and a
periodic side behaves like the inside.
"""

from dataclasses import replace

import numpy as np
import pytest
from mesh_motion_numerics.interpolation.factor_source import MakeEachTime
from mesh_motion_numerics.interpolation.periodic_interpolant import PeriodicLevels
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel
from mesh_motion_numerics.motion.motion_found import Motion
from mesh_motion_numerics.stopwatch import Stopwatch
from mesh_motion_protocol.errors import InvalidInput
from periodic_meshes import Mesh, joined_sector, periodic_box, sector, turn
from trial_stages import displacement_by


def model_of(mesh: Mesh, **choices) -> MotionModel:
    standard = {"quality_threshold": 0.9, "support_radius": 0.8, "displacement": "absolute"}
    return MotionModel.build(*mesh, Method(**{**standard, **choices}))


def moved(model: MotionModel, *shift: float) -> Motion:
    return model.move(model.points, model.points[model.roles.moving] + shift)


def pair_error(model: MotionModel, points: np.ndarray) -> float:
    """Largest distance of a node from its pair's transformed position, without the offsets of the reference."""
    periodic = model.standard_motion.periodic
    step = (points - model.points)[periodic.roots]
    turned = np.einsum("pij,pj->pi", periodic.rotations, step)
    return float(np.abs((points - model.points)[periodic.members] - turned).max())


def ring_of(mesh: Mesh, sectors: int, count: int | None = None) -> tuple[Mesh, np.ndarray]:
    """All sectors of a mesh, or the first ``count``, merged; and the number (count, n) of each one's nodes in it."""
    points, cells, patches = mesh
    d, count = points.shape[1], count or sectors
    copies = np.concatenate([points @ turn(sectors, d, k).T for k in range(count)])
    _, first, number = np.unique(np.round(copies, 9) + 0.0, axis=0, return_index=True, return_inverse=True)
    number = number.reshape(count, len(points))
    table = {b.type.name: np.concatenate([number[k][b.nodes] for k in range(count)]) for b in cells}
    whole = {n: Patch(p.role, np.unique(number[:, p.nodes])) for n, p in patches.items() if p.role != "periodic"}
    if count < sectors:
        whole |= {n: Patch("periodic", number[k][patches[n].nodes]) for n, k in (("y0", 0), ("y1", -1))}
    return (copies[first], CellTable.from_arrays(table), whole), number


@pytest.mark.parametrize(("kind", "n", "ends"), [("quad", 10, "fixed"), ("quad", 10, "slip"), ("wedge", 5, "slip")])
@pytest.mark.parametrize("largest", [0, 10_000], ids=["sparse", "dense"])
def test_a_sector_moves_as_in_the_whole_ring(
    kind: str, n: int, ends: str, largest: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The interpolant of one sector with its images is the whole ring's: an ordinary one with all control points."""
    monkeypatch.setattr("mesh_motion_numerics.interpolation.periodic_interpolant._DENSE_ORDER", largest)
    sectors = 5
    mesh = sector(kind, n, sectors=sectors, ends=ends)
    ring, number = ring_of(mesh, sectors)
    one = model_of(mesh, correction="none", allow_invalid=True)
    whole = model_of(ring, correction="none", allow_invalid=True)
    shift = np.array([0.1, 0.15, 0.1])[: mesh[0].shape[1]]
    targets = ring[0].copy()
    for k in range(sectors):
        targets[number[k][mesh[2]["body"].nodes]] += turn(sectors, len(shift), k) @ shift
    expected = whole.move(whole.points, targets[whole.roles.moving]).points[number[0]]
    found = moved(one, *shift).points
    # a node may be projected onto either of two facets of a curved slip wall: the same place to rounding
    np.testing.assert_allclose(found, expected, atol=2e-10)


@pytest.mark.parametrize(("kind", "n", "ends"), [("quad", 10, "fixed"), ("quad", 10, "slip"), ("wedge", 5, "slip")])
@pytest.mark.parametrize("sectors", [7, 37])
def test_two_passages_of_an_odd_number_move_as_one(kind: str, n: int, ends: str, sectors: int) -> None:
    """Their angle, 2/7 or 2/37 of a turn, is no whole fraction of it; with equal motions they are one sector twice."""
    mesh = sector(kind, n, sectors=sectors, ends=ends)
    two, number = ring_of(mesh, sectors, 2)
    one, both = (model_of(each, correction="none", allow_invalid=True) for each in (mesh, two))
    assert not both.standard_motion.periodic.generators[0].sectors
    shift = np.array([0.1, 0.15, 0.1])[: mesh[0].shape[1]]
    shift[1] = min(shift[1], 1.0 / sectors)
    targets = two[0].copy()
    for k in range(2):
        targets[number[k][mesh[2]["body"].nodes]] += turn(sectors, len(shift), k) @ shift
    found = both.move(both.points, targets[both.roles.moving]).points
    np.testing.assert_allclose(found[number[0]], moved(one, *shift).points, atol=2e-10)
    assert pair_error(both, found) <= 1e-15


@pytest.mark.parametrize("kind", ["quad", "wedge"])
def test_one_of_two_passages_moves_alone(kind: str) -> None:
    """After a turn the images would be at the places of the other passage: they do not count."""
    mesh, number = ring_of(sector(kind, 5, sectors=7), 7, 2)
    model = MotionModel.build(*mesh, Method(correction="none"))
    targets = mesh[0].copy()
    body = number[0][sector(kind, 5)[2]["body"].nodes]
    targets[body] += [0.05, 0.1, 0.05][: mesh[0].shape[1]]
    found = model.move(mesh[0], targets[model.roles.moving])
    assert found.corrected.metric.min > 0.6
    assert pair_error(model, found.points) <= 1e-15


@pytest.mark.parametrize("kind", ["quad", "wedge"])
def test_two_passages_of_seven_turn_by_any_angle(kind: str) -> None:
    mesh, _ = ring_of(sector(kind, 5, sectors=7, ends="slip"), 7, 2)
    model = MotionModel.build(*mesh, Method())
    body = mesh[0][model.roles.moving]
    for angle in (50.0, 220.0, 600.0):
        found = model.move(mesh[0], body @ turn(360, mesh[0].shape[1], angle).T)
        assert found.corrected.metric.min > 0.95
        assert pair_error(model, found.points) <= 1e-14


def test_a_support_that_reaches_around_the_axis_is_refused() -> None:
    mesh, _ = ring_of(sector("quad", 5, sectors=7), 7, 2)
    with pytest.raises(InvalidInput, match=r"support_radius = 1.3: expected at most 1.25, .*sector of 102.857°"):
        MotionModel.build(*mesh, Method(support_radius=1.3))
    half, _ = ring_of(sector("quad", 5, sectors=9), 9, 5)
    with pytest.raises(InvalidInput, match=r"'y0' and 'y1' are 200° apart, measured through the mesh"):
        MotionModel.build(*half, Method())
    points = mesh[0] * (1.0 - 1.0 / np.linalg.norm(mesh[0], axis=1))[:, None]  # to the axis
    with pytest.raises(InvalidInput, match=r"does not reach the axis"):
        MotionModel.build(points + 1e-9 * mesh[0], *mesh[1:], Method())


@pytest.mark.parametrize("axes", ["y", "xy"])
def test_all_of_a_periodic_row_carried_along_is_not_deformed(axes: str) -> None:
    mesh = periodic_box("quad", 10, axes=axes, ends="periodic")
    patches = {name: p for name, p in mesh[2].items() if p.role != "periodic" or name[0] in axes}
    if axes == "y":  # the ends move as well
        patches |= {name: Patch("moving", mesh[2][name].nodes) for name in ("x0", "x1")}
    model = model_of((mesh[0], mesh[1], patches))
    found = moved(model, 0.31, 0.17)
    np.testing.assert_allclose(found.points, mesh[0] + [0.31, 0.17], atol=1e-15)


MESHES = {
    "a row": (periodic_box("quad", 10, ends="slip"), (0.05, 0.3)),
    "an oblique row": (periodic_box("quad", 10, ends="slip", shear=0.4), (0.05, 0.3)),
    "a lattice": (periodic_box("quad", 10, axes="xy"), (0.3, 0.3)),
    "a cube in a lattice": (periodic_box("hexahedron", 5, axes="xyz"), (0.2, 0.25, 0.1)),
    "tetrahedra between walls": (periodic_box("tetra", 5, axes="yz", ends="slip"), (0.1, 0.25, 0.1)),
    "a sector": (sector("quad", 10, ends="slip"), (0.2, 0.1)),
    "a sector in space": (sector("wedge", 5, ends="slip"), (0.2, 0.1, 0.1)),
}


@pytest.mark.parametrize("displacement", ["relative", "absolute", "reanchored"])
@pytest.mark.parametrize("name", MESHES)
def test_pairs_stay_pairs_and_come_back(name: str, displacement: str) -> None:
    mesh, shift = MESHES[name]
    model = model_of(mesh, displacement=displacement, correction_target="maximum")
    points = mesh[0]
    for fraction in (0.6, 1.0):
        targets = mesh[0][model.roles.moving] + fraction * np.array(shift)
        points = model.move(points, targets).points
        periodic = model.standard_motion.periodic
        assert pair_error(model, points) <= 1e-15
        assert np.array_equal(periodic.tied(points, model.roles.moving), points)
    assert np.abs(points - mesh[0])[periodic.members].max() > 0.02
    model = replace(model, method=replace(model.method, quality_threshold=0.2))  # so good it is at rest
    if displacement != "relative":
        assert np.array_equal(model.move(points, mesh[0][model.roles.moving]).points, mesh[0])


@pytest.mark.parametrize("name", MESHES)
def test_the_correction_uses_periodic_and_sliding_nodes(name: str) -> None:
    mesh, shift = MESHES[name]
    model = model_of(mesh, correction_target="maximum", quality_threshold=0.99)
    freed, held = moved(model, *shift), moved(replace(model, constraint=None), *shift)
    assert freed.corrected.metric.min >= held.corrected.metric.min
    if len(model.roles.fixed) or len(model.roles.sliding):
        assert freed.correction.freed_nodes > held.correction.freed_nodes
    else:  # a lattice is carried along as a whole
        assert freed.correction.method == "none"
    surfaces = model.standard_motion.sliding
    if surfaces is not None and not model.standard_motion.periodic.turns:
        places = freed.points[surfaces.nodes]
        assert np.abs(surfaces.project(places) - places).max() == 0.0


def recut(mesh: Mesh, height: float) -> tuple[Mesh, np.ndarray]:
    """The same row of cells, cut at another height; and the node (n',) of the given mesh that each node is."""
    points, cells, patches = mesh
    (block,) = cells
    up = (points[block.nodes, 1].mean(axis=1) < height).astype(float)
    corners = points[block.nodes].copy()
    corners[..., 1] += up[:, None]
    places, first, number = np.unique(
        np.round(corners.reshape(-1, 2), 9), axis=0, return_index=True, return_inverse=True
    )
    table = CellTable.from_arrays({block.type.name: number.reshape(block.nodes.shape)})
    origin = block.nodes.ravel()[first]
    sides = {name: Patch(patches[name].role, np.flatnonzero(np.isin(origin, patches[name].nodes))) for name in patches}
    for name, y in (("y0", height), ("y1", height + 1.0)):
        sides[name] = Patch("periodic", np.flatnonzero(np.isclose(places[:, 1], y)))
    return (places, table, sides), origin


@pytest.mark.parametrize(("correction", "tolerance"), [("none", 1e-12), ("optimised", 2e-3), ("smooth", 1e-9)])
def test_the_motion_does_not_depend_on_where_the_row_is_cut(correction: str, tolerance: float) -> None:
    """So the mesh has the same quality across a periodic side as inside; the optimised motion stops when it gains
    little.
    """
    mesh = periodic_box("quad", 10, ends="slip")
    other, origin = recut(mesh, 0.2)
    most = {} if correction == "smooth" else {"correction_target": "maximum"}
    here, there = (moved(model_of(m, correction=correction, **most), 0.1, 0.3) for m in (mesh, other))
    step, expected = there.points - other[0], (here.points - mesh[0])[origin]
    np.testing.assert_allclose(step, expected, atol=tolerance)
    assert there.corrected.metric.min == pytest.approx(here.corrected.metric.min, abs=tolerance)


@pytest.mark.parametrize("correction", ["explicit", "enrichment"])
def test_other_corrections_leave_pairs_alone(correction: str) -> None:
    model = model_of(periodic_box("quad", 10), correction=correction, quality_threshold=0.6)
    found = moved(model, 0.2, 0.2)
    assert found.correction.method == correction
    plain = moved(replace(model, method=replace(model.method, correction="none")), 0.2, 0.2)
    np.testing.assert_array_equal(found.points[model.held], plain.points[model.held])


def test_images_of_a_moving_body_move_alike_or_are_refused() -> None:
    points, cells, patches = periodic_box("quad", 10)
    body = np.union1d(patches["body"].nodes, np.flatnonzero(points[:, 0] == 0.0))
    patches = {"body": Patch("moving", body), **{name: patches[name] for name in ("y0", "y1", "x1")}}
    model = model_of((points, cells, patches), correction="none")
    found = moved(model, 0.02, 0.05)
    assert pair_error(model, found.points) <= 1e-15
    targets = points[model.roles.moving] + [0.02, 0.05]
    targets[0, 0] += 0.01
    with pytest.raises(
        InvalidInput, match=r"displacements of node \d+ and of node 0, its periodic image, differ by 0.01"
    ):
        model.move(points, targets)


@pytest.mark.parametrize(
    ("choice", "said"),
    [
        ({"basis": "tps"}, "no compact support"),
        ({"basis": "gauss"}, "no compact support"),
        ({"reduction": "greedy"}, "reduction = 'greedy' is not offered with periodic patches"),
    ],
)
def test_methods_that_are_not_periodic_are_refused(choice: dict[str, str], said: str) -> None:
    with pytest.raises(InvalidInput, match=said):
        model_of(periodic_box("quad", 10), **choice)


@pytest.mark.parametrize("name", ["row", "sector"])
def test_a_body_with_edges_of_a_billionth_is_moved_with_nothing_set(name: str) -> None:
    """One matrix of all its nodes is singular; with levels each node is met, pairs stay pairs, and cells stay valid."""
    points, cells, patches = sector("quad", 12) if name == "sector" else periodic_box("quad", 12)
    flat, _, _ = periodic_box("quad", 12)
    for axis in (0, 1):  # the lines next to the body's corners are drawn to them
        lines = np.unique(flat[patches["body"].nodes, axis])
        flat[flat[:, axis] == lines[1], axis] = lines[0] + 1e-9
        flat[flat[:, axis] == lines[-2], axis] = lines[-1] - 1e-9
    points = flat
    if name == "sector":
        angle, radius = points[:, 1] * np.pi / 3.0, 1.0 + points[:, 0]
        points = np.column_stack([-radius * np.sin(angle), radius * np.cos(angle)])
    model = MotionModel.build(points, cells, patches, Method(correction="none"))
    motion = moved(model, 0.02, 0.03)
    assert motion.corrected.inverted == 0
    assert pair_error(model, motion.points) < 1e-12
    body = model.roles.moving
    trial = model.standard_motion.trial(points, points[body] + [0.02, 0.03], MakeEachTime(), Stopwatch())
    assert isinstance(trial.factorization, PeriodicLevels)
    assert np.abs(displacement_by(trial, points[body]) - [0.02, 0.03]).max() < 0.03e-10


@pytest.mark.parametrize("displacement", ["relative", "absolute", "reanchored"])
@pytest.mark.parametrize(("kind", "n"), [("quad", 10), ("wedge", 5)])
@pytest.mark.parametrize("step", [50.0, 170.0, 7 * 60.0])
def test_a_sector_turns_by_any_angle_between_slip_hub_and_tip(
    kind: str, n: int, step: float, displacement: str
) -> None:
    """At least two revolutions. The mesh stays as at rest, apart from the facets of hub and tip, of 12° in space."""
    mesh = sector(kind, n, ends="slip")
    model = model_of(mesh, displacement=displacement, correction="none")
    points, body = mesh[0], mesh[0][model.roles.moving]
    for angle in np.arange(step, 721.0 + step, step):
        found = model.move(points, body @ turn(360, mesh[0].shape[1], angle).T)
        points = found.points
        assert found.corrected.metric.min > 0.95
        assert pair_error(model, points) <= 1e-14
    surfaces = model.standard_motion.sliding
    np.testing.assert_allclose(surfaces.project(points[surfaces.nodes]), points[surfaces.nodes], atol=1e-13)


@pytest.mark.parametrize("correction", ["none", "smooth"])
@pytest.mark.parametrize(
    ("kind", "n", "cone"),
    [("quad", 20, 0.0), ("hexahedron", 10, 0.0), ("hexahedron", 10, 0.3)],
    ids=["2D", "3D", "cone"],
)
def test_a_blade_on_a_slip_hub_turns_by_any_angle(kind: str, n: int, cone: float, correction: str) -> None:
    """The hub goes on over the blade's root, so the mesh turns as a whole; each step is many facets long."""
    mesh = joined_sector(kind, n, angle=np.radians(30.0), cone=cone)
    model = MotionModel.build(*mesh, Method(correction=correction))
    for angle in (5.0, 12.0, 100.0, 365.0):
        around = turn(360, mesh[0].shape[1], angle)
        found = model.move(mesh[0], mesh[0][model.roles.moving] @ around.T)
        np.testing.assert_allclose(found.points, mesh[0] @ around.T, atol=2e-3)  # facets of 3°: 2e-4 of their radius
        assert pair_error(model, found.points) <= 1e-14


def test_a_row_is_carried_along_its_slip_walls_by_several_periods() -> None:
    model = model_of(periodic_box("quad", 10, ends="slip"), displacement="absolute", correction="none")
    found = moved(model, 0.0, 7.3)
    np.testing.assert_allclose(found.points, model.points + np.array([0.0, 7.3]), atol=1e-14)


def test_a_body_passes_through_a_row_between_wavy_walls() -> None:
    """Their nodes follow it through the periodic planes; if they stayed, the mesh would be sheared."""
    points, cells, patches = periodic_box("quad", axes="x", ends="slip")
    points[:, 1] += 0.1 * np.cos(2.0 * np.pi * points[:, 0]) * (2.0 * points[:, 1] - 1.0)
    points[:, 0] *= 2.0
    model = MotionModel.build(points, cells, patches, Method())
    committed, rest = points, points[model.roles.moving]
    least = []
    for step in range(1, 31):
        found = model.move(committed, rest + np.array([0.1 * step, 0.0]))
        committed = found.points
        least.append(found.corrected.metric.min)
    assert min(least) > 0.5
