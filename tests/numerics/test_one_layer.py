"""One layer of cells between two planes moves like its plane, both sides alike, in any direction."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from box_meshes import box_mesh
from carried_layers import with_layer
from frame_meshes import tensor_grid
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.finite_volume import extruded_cells, extruded_points
from mesh_motion_numerics.mesh.one_layer import OneLayer
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel
from mesh_motion_numerics.motion.one_layer_motion import AS_A_PLANE, OneLayerMotion, motion_model
from mesh_motion_numerics.quality.orientation import _mirrored
from mesh_motion_protocol.errors import InvalidInput
from scipy.spatial.transform import Rotation

from mesh_motion_server.session.factors import FactorCache

Patches = dict[str, Patch]
PLAIN = Method(correction="none", support_radius=0.6)


def layered(kind: str, planes: Mapping[str, str], outer: str = "fixed") -> tuple[np.ndarray, CellTable, Patches]:
    """The layer of a plane mesh, its body moving; ``planes`` gives a role to "both" planes, or to "low" and "high"."""
    mesh = box_mesh(kind, 10)
    n = len(mesh.points)
    sides = {"low": np.arange(n), "high": n + np.arange(n), "both": np.arange(2 * n)}
    flat = {"body": Patch("moving", mesh.body), "outer": Patch(outer, mesh.outer)}
    patches = {name: Patch(patch.role, np.r_[patch.nodes, n + patch.nodes]) for name, patch in flat.items()}
    patches |= {name: Patch(role, sides[name]) for name, role in planes.items()}
    listed = extruded_cells(mesh.cells, n)
    cells = CellTable.from_arrays({block.type.name: block.nodes for block in listed})
    return extruded_points(mesh.points), cells, patches


def plane_motion(kind: str, shift: np.ndarray, outer: str = "fixed") -> np.ndarray:
    """Displacement (n, 2) of the mesh in the plane."""
    mesh = box_mesh(kind, 10)
    patches = {"body": Patch("moving", mesh.body), "outer": Patch(outer, mesh.outer)}
    model = MotionModel.build(mesh.points, mesh.cells, patches, PLAIN)
    return model.move(mesh.points, mesh.points[model.roles.moving] + shift).points - mesh.points


PLANES = [{"both": "symmetry"}, {"both": "slip"}, {"low": "symmetry", "high": "slip"}, {"low": "slip", "high": "slip"}]
PLANES += [{"both": "fixed"}, {"low": "fixed", "high": "fixed"}]  # as free planes: no other node could move
SHIFT = np.array([0.11, -0.07])


@pytest.mark.parametrize("planes", PLANES)
@pytest.mark.parametrize("kind", ["quad", "quad + triangle"])
def test_both_sides_move_as_the_plane_does(kind: str, planes: dict[str, str]) -> None:
    points, cells, patches = layered(kind, planes)
    model = motion_model(points, cells, patches, PLAIN)
    assert isinstance(model, OneLayerMotion)
    assert model.warnings[-1] == AS_A_PLANE
    moving = np.unique(patches["body"].nodes)
    motion = model.move(points, points[moving] + [*SHIFT, 0.0])
    moved = motion.points - points
    low, high = np.split(moved, 2)
    np.testing.assert_array_equal(low, high)
    np.testing.assert_allclose(low[:, :2], plane_motion(kind, SHIFT), atol=1e-12)
    assert not moved[:, 2].any()
    assert motion.corrected == model.summary(motion.points)
    for cell in motion.corrected.worst:
        assert cell.centre == pytest.approx(cells.centres(motion.points, np.array([cell.number]))[0])


@pytest.mark.parametrize("planes", PLANES)
def test_planes_may_leave_their_rims_to_the_sides(planes: dict[str, str]) -> None:
    """Node sets of which each node is in one only: the body's and the walls' are not in those of the planes."""
    points, cells, patches = layered("quad + triangle", planes)
    taken = np.union1d(patches["body"].nodes, patches["outer"].nodes)
    apart = {name: Patch(role, np.setdiff1d(patches[name].nodes, taken)) for name, role in planes.items()}
    layer, whole = (OneLayer.find(points, cells, patches | given) for given in (apart, {}))
    assert layer is not None
    assert whole is not None
    for name, patch in whole.patches.items():
        np.testing.assert_array_equal(patch.nodes, layer.patches[name].nodes)
    body = points[patches["body"].nodes]
    inner = np.flatnonzero(np.abs(points[:, :2] - body[:, :2].mean(axis=0)).max(axis=1) < 0.45)  # with all of a disk
    wall = Patch("moving", inner[points[inner, 2] > 0.0])
    rest = {name: Patch(patch.role, np.setdiff1d(patch.nodes, wall.nodes)) for name, patch in (patches | apart).items()}
    assert OneLayer.find(points, cells, rest | {"piston": wall}) is None  # a part of the plane itself moves


@pytest.mark.parametrize("normal", [[1, 0, 0], [0, 1, 0], [0.6, 0, 0.8], [1, 2, 3]])
def test_the_layer_lies_anywhere(normal: list[float]) -> None:
    points, cells, patches = layered("quad + triangle", {"both": "symmetry"})
    turn = Rotation.align_vectors([normal], [[0, 0, 1]])[0].as_matrix()
    turn = np.round(turn) if max(normal) == 1 else turn
    moving = np.unique(patches["body"].nodes)
    model = motion_model(points @ turn.T + [5, 0, 0], cells, patches, PLAIN)
    assert isinstance(model, OneLayerMotion)
    moved = model.move(model.points, model.points[moving] + [*SHIFT, 0.0] @ turn.T).points - model.points
    np.testing.assert_allclose(moved[: len(moved) // 2], moved[len(moved) // 2 :], atol=1e-12)
    expected = np.pad(plane_motion("quad + triangle", SHIFT), ((0, 0), (0, 1))) @ turn.T
    np.testing.assert_allclose(moved[: len(expected)], expected, atol=1e-9)


def test_sides_slide_and_cells_may_be_mirrored() -> None:
    points, cells, patches = layered("quad", {"both": "slip"}, outer="slip")
    mirrored = _mirrored(cells, np.arange(0, len(cells), 3))
    moving = np.unique(patches["body"].nodes)
    moved = []
    for listed in (cells, mirrored):
        model = motion_model(points, listed, patches, PLAIN)
        assert isinstance(model, OneLayerMotion)
        moved.append(model.move(points, points[moving] + [*SHIFT, 0.0]).points - points)
    np.testing.assert_array_equal(moved[0], moved[1])
    np.testing.assert_allclose(moved[0][: len(points) // 2, :2], plane_motion("quad", SHIFT, "slip"), atol=1e-12)


def test_a_second_step_goes_on_from_the_first_and_the_faster_model_agrees() -> None:
    points, cells, patches = layered("quad", {"both": "symmetry"})
    model, moving = (
        motion_model(points, cells, patches, Method(quality_threshold=0.6)),
        np.unique(patches["body"].nodes),
    )
    first = model.move(points, points[moving] + [*SHIFT, 0.0]).points
    second = model.move(first, points[moving] + [*(2 * SHIFT), 0.0])
    again = model.without_distributions().move(first, points[moving] + [*(2 * SHIFT), 0.0])
    np.testing.assert_array_equal(second.points, again.points)
    np.testing.assert_array_equal(second.points[moving], points[moving] + [*(2 * SHIFT), 0.0])
    np.testing.assert_array_equal(*np.split(second.points[:, :2], 2))
    assert second.correction.freed_nodes
    assert second.corrected.metric.min > second.standard.metric.min


@pytest.mark.parametrize("lift", ["both", "one"])
def test_a_body_that_leaves_the_plane_is_refused_by_its_node(lift: str) -> None:
    points, cells, patches = layered("quad", {"both": "symmetry"})
    model, moving = motion_model(points, cells, patches, Method()), np.unique(patches["body"].nodes)
    targets = points[moving] + [*SHIFT, 0.0]
    if lift == "both":
        targets[:, 2] += 0.01
        message = f"node {moving[0]} moves across the layer, by 0.01"
    else:
        targets[3, 0] += 0.01
        message = f"node {moving[3]} moves otherwise than its opposite node, by 0.01"
    with pytest.raises(InvalidInput, match=message):
        model.move(points, targets)


@pytest.mark.parametrize("choices", [{"correction": "smooth"}, {"correction": "none", "displacement": "absolute"}])
@pytest.mark.parametrize("layers", [0.0, 0.11])
@pytest.mark.parametrize("outer", ["fixed", "slip"])
def test_its_derivative_is_that_of_differences_and_its_transpose(
    outer: str, layers: float, choices: dict[str, object]
) -> None:
    points, cells, patches = layered("quad", {"both": "symmetry"}, outer)
    turn = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()
    model, factors = motion_model(points @ turn.T, cells, patches, Method(**choices)), FactorCache(1 << 28)
    assert isinstance(model, OneLayerMotion)
    if layers:
        model = replace(model, plane=with_layer(model.plane, model.layer.patches, layers))
    rest, flat = model.points[model.moving], points[model.moving]
    shift = np.array([0.2 * (flat[:, 1] - 0.5), 0.05 - 0.2 * (flat[:, 0] - 0.5), 0.0 * flat[:, 0]]).T @ turn.T
    v = np.array([np.cos(3.0 * flat[:, 1]), np.sin(5.0 * flat[:, 0]), 0.0 * flat[:, 0]]).T @ turn.T
    moved = model.move(model.points, rest + shift, factors).points
    slope = model.slope(moved, factors)
    found = slope.tangent(v)

    def difference(h: float) -> np.ndarray:
        there, back = (model.move(moved, moved[model.moving] + s * h * v, factors).points for s in (1, -1))
        return (there - back) / (2.0 * h)

    exact = (4.0 * difference(1.25e-4) - difference(2.5e-4)) / 3.0
    assert np.abs(found - exact).max() < (1e-8 if "displacement" in choices else 1e-5) * np.abs(found).max()
    assert (found[model.moving] == v).all()
    w = np.random.default_rng(3).standard_normal(points.shape)
    back = slope.cotangent(w)
    assert abs(np.sum(w * found) - np.sum(back * v)) < 1e-12 * (np.abs(w * found).sum() + np.abs(back * v).sum())
    model.move(moved, moved[model.moving] + 0.01 * back / np.abs(back).max(), factors)  # a motion of the plane too


def test_velocities_that_leave_the_plane_are_refused_by_their_node() -> None:
    points, cells, patches = layered("quad", {"both": "symmetry"})
    model = motion_model(points, cells, patches, Method())
    assert model.why_no_slope() is None
    v = np.tile([1e-3, 0.0, 0.0], (len(model.moving), 1))
    v[3, 0] *= 2.0
    with pytest.raises(InvalidInput, match=f"node {model.moving[3]} moves otherwise than its opposite node, by 0.001"):
        model.slope(points, FactorCache(1 << 28)).tangent(v)
    assert motion_model(points, cells, patches, Method(displacement="relative")).why_no_slope() is not None


def test_the_way_out_of_the_plane_is_one() -> None:
    points, cells, patches = layered("quad", {"low": "fixed", "high": "fixed"})
    targets = points[np.unique(patches["body"].nodes)] + [0.0, 0.0, 0.01]
    with pytest.raises(InvalidInput) as refused:
        motion_model(points, cells, patches, PLAIN).move(points, targets)
    assert refused.value.hint.endswith("give one of the planes the role fixed and the other one slip")
    points, cells, patches = layered("quad", {"low": "fixed", "high": "slip"})
    assert motion_model(points, cells, patches, PLAIN).move(points, targets).corrected.metric.min > 0.8


def test_other_meshes_are_moved_in_space() -> None:
    points, cells, patches = layered("quad", {"low": "symmetry", "high": "fixed"})
    assert OneLayer.find(points, cells, patches) is None
    points, cells, patches = layered("quad", {"both": "symmetry"})
    bent = points.copy()
    bent[-1, 2] *= 1.01
    assert OneLayer.find(bent, cells, patches) is None
    solid = box_mesh("hexahedron", 5)
    everything = {"all": Patch("slip", np.arange(len(solid.points)))}
    assert OneLayer.find(solid.points, solid.cells, everything) is None


def test_a_single_row_of_cells_is_a_plane_between_those_that_slide() -> None:
    points, boxes = tensor_grid(np.arange(5.0), np.arange(2.0), np.arange(2.0))
    cells = CellTable.from_arrays({"hexahedron": boxes})
    patches = {
        "planes": Patch("symmetry", np.arange(20)),
        "bottom": Patch("fixed", np.flatnonzero(points[:, 1] == 0)),
        "top": Patch("moving", np.flatnonzero(points[:, 1] == 1)),
    }
    for axis in range(3):  # whichever coordinate is across
        layer = OneLayer.find(np.roll(points, axis, axis=1), cells, patches)
        assert layer is not None
        assert not layer.axes[:, (2 + axis) % 3].any()


@pytest.mark.parametrize("role", ["fixed", "slip", "symmetry"])
@pytest.mark.parametrize("split", [False, True])
def test_sides_in_a_patch_of_a_plane_keep_its_role(role: str, split: bool) -> None:
    """All walls in one patch, or the sides and one plane in one patch: no side leaves its position."""
    points, cells, patches = layered("quad", {"low": role, "high": role} if split else {"both": role})
    outer = patches.pop("outer")
    if split:
        patches["low"] = Patch(role, np.union1d(patches["low"].nodes, outer.nodes))
    model = motion_model(points, cells, patches, PLAIN)
    assert isinstance(model, OneLayerMotion)
    moving = np.unique(patches["body"].nodes)
    moved = model.move(points, points[moving] + [*SHIFT, 0.0]).points - points
    for axis in (0, 1):
        ends = outer.nodes[np.isin(points[outer.nodes, axis], [points[:, axis].min(), points[:, axis].max()])]
        assert np.abs(moved[ends, axis]).max() < 1e-12
        assert role != "fixed" or not moved[ends].any()


def test_a_mesh_is_checked_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """The check takes a tenth of the time in which a model in 3D is built."""
    mesh = box_mesh("hexahedron")
    monkeypatch.setattr("mesh_motion_numerics.motion.prepared_mesh.checked_mesh", None)
    assert motion_model(mesh.points, mesh.cells, mesh.patches, Method()).warnings == ()
