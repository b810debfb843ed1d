"""Motions whose boundary alone shows that no valid mesh exists: exact contacts, walls that slip, boundaries that only
slide.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from box_meshes import box_mesh
from frame_meshes import square_frame, tensor_grid, without_unused
from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.mesh.boundary_facets import boundary_nodes
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.crossing import NoMeshExists
from mesh_motion_numerics.motion.motion import MotionModel
from mesh_motion_numerics.motion.prepared_mesh import PreparedMesh
from mesh_motion_protocol.errors import QualityRefused
from periodic_meshes import periodic_box, sector
from sliding_meshes import Mesh, rounded

NO_MESH = "no valid mesh exists: the boundary would "


def refused(model: PreparedMesh, targets: Floats) -> str:
    """The reason why there is no mesh with its moving nodes at targets (k, d); empty if none is known."""
    try:
        model.boundary.refuse(model.points, targets)
    except QualityRefused as error:
        return error.message.removeprefix(NO_MESH)
    return ""


def leaflets(dimension: int, sides: str = "fixed", *, triangles: bool = False) -> MotionModel:
    """A channel of height 1 with two leaflets that leave a gap from 0.4 to 0.6 between them."""
    axes = [np.linspace(0, 2, 11), np.linspace(0, 1, 11), np.linspace(0, 0.5, 3)]
    points, cells = tensor_grid(*axes[:dimension])
    centre = points[cells].mean(axis=1)
    cells = cells[~((np.abs(centre[:, 0] - 1) < 0.2) & (np.abs(centre[:, 1] - 0.5) > 0.1))]
    points, cells = without_unused(points, cells)
    x, y = points.T[:2]
    on = (np.abs(x - 1) < 0.21) & (np.abs(y - 0.5) > 0.09)
    ends = (x < 0.01) | (x > 1.99) | (y < 0.01) | (y > 0.99)
    patches = {"leaflets": Patch("moving", np.flatnonzero(on)), "ends": Patch("fixed", np.flatnonzero(ends & ~on))}
    if dimension == 3:
        patches["sides"] = Patch(sides, np.flatnonzero((points[:, 2] < 0.01) | (points[:, 2] > 0.49)))
    kind = "quad" if dimension == 2 else "hexahedron"
    if triangles:
        kind, cells = "triangle", np.concatenate([cells[:, [0, 1, 2]], cells[:, [0, 2, 3]]])
    return MotionModel.build(points, CellTable.from_arrays({kind: cells}), patches, Method())


def closed(model: MotionModel, low: float, high: float, aside: float = 0.0) -> Floats:
    start = model.points[model.roles.moving]
    y, targets = start[:, 1], start.copy()
    targets[:, 1] += np.where(y < 0.5, low * y / 0.4, -high * (1.0 - y) / 0.4)
    targets[:, 0] += np.where(y < 0.5, aside * y / 0.4, 0.0)
    return targets


@pytest.mark.parametrize("model", [(2, "fixed"), (3, "slip"), (3, "symmetry")], indirect=True, ids=str)
@pytest.mark.parametrize(
    ("motion", "fault"),
    [
        ((0.12, 0.12), "cross itself"),  # the sides are in one line
        ((0.2, 0.05), "cross itself"),
        ((0.12, 0.12, 0.013), "cross itself"),
        ((0.1, 0.1), "touch or cross itself"),  # node on node
        ((0.1, 0.1, 0.05), "touch or cross itself"),
        ((0.099, 0.1), ""),
        ((0.099, 0.1, 0.2), ""),
        ((0.15, 0.15, 0.55), ""),  # side by side
    ],
    ids=str,
)
def test_two_leaflets(model: MotionModel, motion: tuple[float, ...], fault: str) -> None:
    assert refused(model, closed(model, *motion)).split(" near")[0] == fault


@pytest.fixture(scope="module")
def model(request: pytest.FixtureRequest) -> MotionModel:
    return leaflets(*request.param)


@pytest.mark.parametrize("method", [{}, {"correction": "none"}, {"correction": "none", "sub_steps": "never"}], ids=str)
def test_a_move_of_leaflets_says_that_no_mesh_exists(method: dict[str, Any]) -> None:
    model = leaflets(2, triangles=True).with_method(**method)
    with pytest.raises(QualityRefused, match="no valid mesh exists") as caught:
        model.move(model.points, closed(model, 0.12, 0.12))
    assert "do both have the same unit" not in caught.value.hint
    with pytest.raises(QualityRefused, match="no valid mesh exists") as caught:
        model.move(model.points, closed(model, 12.0, 12.0))
    assert caught.value.hint.endswith(
        "the motion's largest displacement is 12 and the mesh's extent 2.24: do both have the same unit?"
    )


@pytest.mark.parametrize("role", ["fixed", "slip", "symmetry"])
@pytest.mark.parametrize("kind", ["quad", "hexahedron", "hexahedron + wedge"])
@pytest.mark.parametrize(
    ("shift", "leaves"),
    [
        (((0.3,), (0.0, 0.35)), False),
        (((0.4,), (0.4, 0.4)), True),  # up to the wall, node on node
        (((0.45,), (0.5, 0.07)), True),  # partly
        (((0.7,), (0.0, -0.9)), True),  # wholly
    ],
)
def test_a_body_that_leaves_through_walls(
    role: str, kind: str, shift: tuple[tuple[float, ...], ...], leaves: bool
) -> None:
    mesh = box_mesh(kind, 5)
    patches = {"body": Patch("moving", mesh.body), "walls": Patch(role, mesh.outer)}
    model = MotionModel.build(mesh.points, mesh.cells, patches, Method())
    start = mesh.points[mesh.body]
    for by in shift:
        targets = start.copy()
        targets[:, : len(by)] += by
        assert bool(refused(model, targets)) == leaves
    if leaves and kind == "quad":
        with pytest.raises(QualityRefused, match=NO_MESH):
            model.move(model.points, targets)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("power", [2.0, 8.0])
@pytest.mark.parametrize(
    ("shift", "leaves"),
    [((0.35, 0.0), False), ((0.0, -0.3), False), ((0.0, 0.42), True), ((0.6, 0.0), True), ((-0.9, 0.2), True)],
)
def test_a_body_that_leaves_through_a_curved_wall_on_which_nodes_slide(
    d: int, power: float, shift: tuple[float, float], leaves: bool
) -> None:
    points, cells, patches = rounded(d, power=power)
    model = MotionModel.build(points, cells, patches, Method())
    targets = points[model.roles.moving] + np.array([*shift, 0.0][:d])
    assert bool(refused(model, targets)) == leaves
    if leaves and d == 2:
        with pytest.raises(QualityRefused, match=NO_MESH):
            model.move(model.points, targets)


@pytest.mark.parametrize("x", [0.8, 0.86, 0.9])
def test_a_body_may_enter_the_corner_next_to_a_wall_that_is_bent_inwards(x: float) -> None:
    mesh = box_mesh("quad", 10)
    points = mesh.points.copy()
    points[:, 0] *= 1.0 - 0.3 * points[:, 0] * np.sin(np.pi * points[:, 1])
    wall = np.flatnonzero(mesh.points[:, 0] == 1.0)
    patches = {"body": Patch("moving", mesh.body), "wall": Patch("slip", wall)}
    patches["rest"] = Patch("fixed", np.setdiff1d(mesh.outer, wall))
    model = MotionModel.build(points, mesh.cells, patches, Method())
    targets = (mesh.points[mesh.body] - 0.5) * 0.3 + np.array([x, 0.06])
    assert refused(model, targets) == ""
    assert refused(model, targets + np.array([1.04 - x, 0.0])) != ""


@pytest.mark.parametrize("role", ["fixed", "slip"])
@pytest.mark.parametrize("planes", ["slip", "symmetry"])
@pytest.mark.parametrize(
    ("shift", "degrees", "leaves"),
    [((0.35, 0.0), 0.0, False), ((0.2, -0.2), 70.0, False), ((0.45, 0.0), 0.0, True), ((0.9, 0.0), 0.0, True),
     ((0.0, -40.0), 30.0, True)],
)  # fmt: skip
def test_a_body_between_planes_that_leaves_through_walls(
    role: str, planes: str, shift: tuple[float, float], degrees: float, leaves: bool
) -> None:
    """Planes join its surface with that of the walls, so that all of the boundary is one part."""
    flat, layers = box_mesh("quad", 5), 3
    n, quads = len(flat.points), flat.cells.blocks[0].nodes
    cells = {"hexahedron": np.concatenate([np.hstack([quads + k * n, quads + (k + 1) * n]) for k in range(layers - 1)])}
    points = np.vstack([np.insert(flat.points, 2, 0.2 * k, axis=1) for k in range(layers)])
    sides = {"body": ("moving", flat.body), "walls": (role, flat.outer)}
    patches = {
        name: Patch(kind, np.concatenate([nodes + k * n for k in range(layers)]))
        for name, (kind, nodes) in sides.items()
    }
    for name, first in (("low", 0), ("high", (layers - 1) * n)):
        patches[name] = Patch(planes, first + np.arange(n))
    model = MotionModel.build(points, CellTable.from_arrays(cells), patches, Method())
    body, angle = points[model.roles.moving], np.deg2rad(degrees)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    targets = body.copy()
    targets[:, :2] = (body[:, :2] - 0.5) @ turn + 0.5 + shift
    assert bool(refused(model, targets)) == leaves


@pytest.mark.parametrize("shift", [0.0, 0.35, 0.45, 0.9])
@pytest.mark.parametrize("mirrored", [False, True])
def test_the_kinds_of_faults_up_to_the_one_that_is_found_are_enough(shift: float, mirrored: bool) -> None:
    points, cells, patches = square_frame()
    model = MotionModel.build(points, cells, patches, Method(support_radius=0.5))
    moving = points[model.roles.moving]
    targets = (moving * [-1.0, 1.0] + [1.0, 0.0] if mirrored else moving) + [shift, 0.01]
    try:
        model.boundary.refuse(points, targets)
    except NoMeshExists as error:
        certain = error
    else:
        assert not model.boundary.has_fault(points, targets, 9)
        return
    assert certain.looked_for > 0
    assert model.boundary.has_fault(points, targets, certain.looked_for)
    assert not model.boundary.has_fault(points, targets, certain.looked_for - 1)


@pytest.mark.parametrize("settings", [{}, {"correction": "none"}, {"displacement": "absolute"}], ids=str)
@pytest.mark.parametrize("triangles", [False, True])
def test_two_bodies_of_two_nodes_do_not_meet(settings: dict[str, Any], triangles: bool) -> None:
    points, cells = tensor_grid(np.linspace(0, 1, 6), np.linspace(0, 1, 6))
    table = {"quad": cells}
    if triangles:
        table = {"triangle": np.concatenate([cells[:, [0, 1, 2]], cells[:, [0, 2, 3]]])}
    rim = np.flatnonzero(((points < 0.01) | (points > 0.99)).any(axis=1))
    patches = {"left": Patch("moving", [14, 15]), "right": Patch("moving", [20, 21]), "rim": Patch("fixed", rim)}
    model = MotionModel.build(points, CellTable.from_arrays(table), patches, Method(**settings))
    start = points[model.roles.moving]
    towards = np.where(start[:, :1] < 0.5, 1.0, -1.0) * np.eye(2)[0]
    with pytest.raises(QualityRefused, match=NO_MESH + "bring node 14 and node 20 to the same place") as caught:
        model.move(points, start + 0.1 * towards)
    assert 0.9 < (caught.value.fraction or 0.0) < 1.0
    with pytest.raises(QualityRefused, match="no valid mesh found"):  # in half of the way the nodes are at one place
        model.move(points, start + 0.2 * towards)
    model.move(points, start + 0.09 * towards)


def interface(dimension: int) -> tuple[MotionModel, Callable[[float, float], Floats]]:
    """Two blocks, one on the other, with separate nodes on their common face: the surface of the lower one moves."""
    axes = [np.linspace(0, 1, 9), np.linspace(0, 0.5, 5), np.linspace(0, 1, 4)][:dimension]
    points, cells = tensor_grid(*axes)
    n = len(points)
    both = np.vstack([points, points + np.eye(dimension)[1] / 2])
    kind = "quad" if dimension == 2 else "hexahedron"
    table = CellTable.from_arrays({kind: np.vstack([cells, cells + n])})
    inner = ((both > 0.01) & (both < 0.99))[:, [0, *range(2, dimension)]].all(axis=1)
    moving = np.flatnonzero((np.abs(both[:, 1] - 0.5) < 0.01) & inner & (np.arange(2 * n) < n))
    rim = ((both < 0.01) | (both > 0.99)).any(axis=1) | (np.abs(both[:, 1] - 0.5) < 0.01)
    patches = {"moving": Patch("moving", moving), "rest": Patch("fixed", np.setdiff1d(np.flatnonzero(rim), moving))}

    def targets(along: float, down: float) -> Floats:
        start = both[moving]
        return start + np.sin(np.pi * start[:, :1]) * np.insert(np.zeros(dimension - 2), 0, [along, -down])

    return MotionModel.build(both, table, patches, Method()), targets


@pytest.mark.parametrize("dimension", [2, 3])
def test_an_interface_may_slide_and_open_but_not_pass(dimension: int) -> None:
    model, targets = interface(dimension)
    for along, down in ((0.0, 0.0), (0.05, 0.0), (0.0, 0.1), (0.05, 0.02)):
        assert refused(model, targets(along, down)) == ""
    assert refused(model, targets(0.0, -0.1))


@pytest.mark.parametrize("walls", ["fixed", "slip", "symmetry"])
@pytest.mark.parametrize("aside", [0.0, 0.3, 0.013])
def test_between_periodic_sides_a_body_leaves_through_a_wall(walls: str, aside: float) -> None:
    """No part of the boundary is closed there, and nodes of body and wall may have the same position."""
    points, cells = tensor_grid(np.linspace(0, 1, 11), np.linspace(0, 1, 11))
    points, cells = without_unused(points, cells[(np.abs(points[cells].mean(axis=1) - 0.5) > 0.1).any(axis=1)])
    x, y = points.T
    body = np.flatnonzero((np.abs(points - 0.5) < 0.11).all(axis=1))
    patches = {"body": Patch("moving", body)}
    for name, on in {"left": x < 0.01, "right": x > 0.99, "low": y < 0.01, "up": y > 0.99}.items():
        patches[name] = Patch(walls if name in ("low", "up") else "periodic", np.flatnonzero(on))
    model = MotionModel.build(points, CellTable.from_arrays({"quad": cells}), patches, Method())
    for up, there in ((0.5, True), (0.41, True), (0.4, True), (0.399, False)):
        assert ("cross itself" in refused(model, points[body] + np.array([aside, up]))) == there


def two_blocks(dimension: int, *, triangles: bool = False) -> MotionModel:
    """The unit square or cube with two blocks of size 0.2, from corner to corner, and their rows of moving nodes."""
    points, cells = tensor_grid(*[np.linspace(0, 1, 11)] * 2, *[np.linspace(0, 1, 6)] * (dimension - 2))
    centre = points[cells].mean(axis=1)
    inside = [np.abs(centre - middle).max(axis=1) < 0.1 for middle in (0.3, 0.7)]
    if dimension == 3:
        inside = [np.abs(centre - [m, m, 0.5]).max(axis=1) < 0.1 for m in (0.3, 0.7)]
    points, cells = without_unused(points, cells[~(inside[0] | inside[1])])
    kind = "quad" if dimension == 2 else "hexahedron"
    if triangles:
        kind, cells = "triangle", np.concatenate([cells[:, [0, 1, 2]], cells[:, [0, 2, 3]]])
    walls = ((points < 0.01) | (points > 0.99)).any(axis=1)
    bodies = (np.abs(points[:, :2] - 0.3).max(axis=1) < 0.11) | (np.abs(points[:, :2] - 0.7).max(axis=1) < 0.11)
    bodies &= np.abs(points[:, -1] - 0.5).max() > 0.0 if dimension == 2 else np.abs(points[:, 2] - 0.5) < 0.11
    patches = {"blocks": Patch("moving", np.flatnonzero(bodies)), "walls": Patch("fixed", np.flatnonzero(walls))}
    return MotionModel.build(points, CellTable.from_arrays({kind: cells}), patches, Method(correction="none"))


@pytest.mark.parametrize(("dimension", "triangles"), [(2, False), (2, True), (3, False)])
@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_blocks_that_meet_in_their_corners(dimension: int, triangles: bool, share: float) -> None:
    model = two_blocks(dimension, triangles=triangles)
    start = model.points[model.roles.moving]
    first, diagonal = start[:, :1] < 0.5, np.array([0.2, 0.2, 0.0][:dimension])
    met = start + np.where(first, (1.0 - share) * diagonal, -share * diagonal)
    assert refused(model, met).startswith("touch or cross itself near (0.")
    with pytest.raises(QualityRefused, match="no valid mesh exists"):
        model.move(model.points, met)
    assert refused(model, met - 1e-6 * diagonal * first) == ""  # next to each other
    aside = np.array([0.0, -0.01, 0.0][:dimension])
    assert refused(model, met + np.where(first, aside, 0.0)) == ""  # past each other's corners


def turned(places: Floats, axis: int) -> Floats:
    """Positions (k, 3) turned by 45° about an axis through their middle: a block then stands on an edge."""
    first, second = (k for k in range(3) if k != axis)
    out, half = places - places.mean(axis=0), np.sqrt(0.5)
    out[:, first], out[:, second] = half * (out[:, first] - out[:, second]), half * (out[:, first] + out[:, second])
    return out


def on_a_corner(places: Floats) -> Floats:
    """Positions (k, 3) of a block, relative to its corner and turned to the first axis."""
    a = np.ones(3) / np.sqrt(3.0)
    b = np.array([1.0, -1.0, 0.0]) / np.sqrt(2.0)
    out = (places - places.mean(axis=0)) @ np.array([a, b, np.cross(a, b)]).T
    return out - out[np.argmax(out[:, 0])]


@pytest.mark.parametrize("gap", [0.0, 1e-5])
@pytest.mark.parametrize("where", ["edge on edge", (0.6, 0.71, 0.52), (0.6, 0.6, 0.47), (0.6, 0.6, 0.4)])
def test_a_corner_or_an_edge_that_meets_a_facet_an_edge_or_a_corner(where: str | tuple, gap: float) -> None:
    model = two_blocks(3)
    targets = model.points[model.roles.moving].copy()
    first = targets[:, 0] < 0.5
    if where == "edge on edge":
        half = 0.1 * np.sqrt(2.0)
        targets[~first] = turned(targets[~first], 2) + np.array([0.5 + half, 0.5, 0.5])
        targets[first] = turned(targets[first], 1) + np.array([0.5 - half - gap, 0.5, 0.5])
    else:
        targets[first] = on_a_corner(targets[first]) + where - [gap, 0.0, 0.0]
    assert bool(refused(model, targets)) == (gap == 0.0)


def arms(dimension: int, *, joined: bool) -> MotionModel:
    """Two arms of a domain with a solid of width 0.2 between them, or two blocks that share a corner or an edge."""
    points, cells = tensor_grid(*[np.linspace(0, 1, 11)] * 2, *[np.linspace(0, 0.3, 4)] * (dimension - 2))
    x, y = points[cells].mean(axis=1).T[:2]
    kept = ~((np.abs(x - 0.5) < 0.1) & (y > 0.3)) if joined else (x < 0.5) == (y < 0.5)
    points, cells = without_unused(points, cells[kept])
    table = CellTable.from_arrays({"quad" if dimension == 2 else "hexahedron": cells})
    patches = {"wall": Patch("moving", boundary_nodes(table))}
    return MotionModel.build(points, table, patches, Method())


def bent_arms(model: MotionModel, amplitude: float) -> Floats:
    targets = model.points[model.roles.moving].copy()
    x, y = targets.T[:2]
    targets[:, 0] += np.where(x < 0.5, amplitude, -amplitude) * np.clip((y - 0.3) / 0.7, 0.0, 1.0) ** 2
    return targets


def turned_block(model: MotionModel, degrees: float) -> Floats:
    targets, angle = model.points[model.roles.moving].copy(), np.deg2rad(degrees)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    upper = (targets[:, :2] > 0.499).all(axis=1)
    targets[upper, :2] = (targets[upper, :2] - 0.5) @ turn + 0.5
    return targets


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize(
    ("moved", "apart", "over"),
    [(bent_arms, 0.09, 0.12), (bent_arms, 0.05, 0.3), (turned_block, 80, 100), (turned_block, 30, 170)],
)
def test_a_mesh_that_overlaps_itself_from_outside_is_refused(
    dimension: int, moved: Callable[[MotionModel, float], Floats], apart: float, over: float
) -> None:
    """No cell is inverted."""
    model = arms(dimension, joined=moved is bent_arms)
    assert not model.move(model.points, moved(model, apart)).corrected.inverted
    with pytest.raises(QualityRefused, match=f"{NO_MESH}cross itself near") as caught:
        model.move(model.points, moved(model, over))
    assert caught.value.fraction is not None
    assert 0.2 < caught.value.fraction < 1.0
    allowed = model.with_method(allow_invalid=True, correction="none")
    assert not allowed.move(model.points, moved(model, over)).corrected.inverted


def test_a_baffle_may_bend_although_its_sides_are_meshed_differently() -> None:
    """Their facets cross a little; the nodes at its ends are at the same places."""
    low, first = tensor_grid(np.linspace(0, 1, 9), np.linspace(0, 0.5, 5))
    high, second = tensor_grid(np.linspace(0, 1, 7), np.linspace(0.5, 1, 5))
    points = np.vstack([low, high])
    table = CellTable.from_arrays({"quad": np.vstack([first, second + len(low)])})
    on = np.flatnonzero(points[:, 1] == 0.5)
    patches = {"baffle": Patch("moving", on), "rest": Patch("fixed", np.setdiff1d(boundary_nodes(table), on))}
    model = MotionModel.build(points, table, patches, Method())
    targets = points[model.roles.moving].copy()
    targets[:, 1] += 0.1 * np.sin(np.pi * targets[:, 0])
    assert not model.move(points, targets).corrected.inverted


def wavy(kind: str) -> Mesh:
    """A periodic row between two walls that slip, of which one is curved."""
    n, axes = (10, "x") if kind == "quad" else (5, "xz")
    points, cells, patches = periodic_box(kind, n, axes=axes, ends="slip")
    points[:, 1] *= 1.0 + 0.05 * np.sin(2.0 * np.pi * points[:, 0])
    return points, cells, patches


LEFT = {
    **{f"out of the tip of {n} sectors": (partial(sector, "quad", sectors=n, ends="slip"), 1.0) for n in (3, 8, 48)},
    "through the hub": (partial(sector, "quad", ends="slip"), -1.1),
    "out of the tip in space": (partial(sector, "hexahedron", 5, ends="slip"), 1.0),
    "out of a fixed tip": (partial(sector, "quad + triangle"), 1.0),
    "through a curved wall of a row": (partial(wavy, "quad"), 1.2),
    "through the plane wall of a row": (partial(wavy, "quad"), -1.2),
    "through a curved wall of a row in space": (partial(wavy, "hexahedron"), 1.2),
}


@pytest.mark.parametrize("case", LEFT)
def test_a_body_that_leaves_a_periodic_domain_is_refused_without_a_search(case: str) -> None:
    make, far = LEFT[case]
    points, cells, patches = make()
    model = MotionModel.build(points, cells, patches, Method())
    up = np.eye(points.shape[1])[1]
    if "row" not in case:
        body = points[model.roles.moving].mean(axis=0)
        up = np.concatenate([body[:2], np.zeros(points.shape[1] - 2)]) / np.linalg.norm(body[:2])
    rest = points[model.roles.moving]
    with pytest.raises(NoMeshExists, match="the boundary would leave its side of another part near"):
        model.boundary.refuse(points, rest + far * up)
    model.boundary.refuse(points, rest + 0.05 * np.sign(far) * up)


@pytest.mark.parametrize("kind", ["quad", "hexahedron"])
def test_a_moving_tip_may_go_beyond_all_other_walls(kind: str) -> None:
    """The mesh is on its inner side."""
    points, cells, patches = sector(kind, 10 if kind == "quad" else 5, ends="slip")
    roles = patches | {"x1": Patch("moving", patches["x1"].nodes), "body": Patch("slip", patches["body"].nodes)}
    model = MotionModel.build(points, cells, roles, Method())
    targets = points[model.roles.moving]
    targets[:, :2] *= 1.1
    assert model.move(points, targets).corrected.inverted == 0
