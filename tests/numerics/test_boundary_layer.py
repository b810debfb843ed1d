"""Layers carried by their wall: exact if it moves rigidly, kept if it bends, given up if keeping is impossible."""

from dataclasses import replace

import numpy as np
import pytest
from box_meshes import box_mesh
from carried_layers import with_layer
from frame_meshes import rotation, square_frame, tensor_grid
from mesh_motion_numerics.interpolation.factor_source import MakeEachTime
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.boundary_layer import BoundaryLayer
from mesh_motion_numerics.motion.motion import MotionModel, _Step
from mesh_motion_numerics.motion.motion_found import Motion
from mesh_motion_protocol.errors import QualityRefused
from periodic_meshes import periodic_box

from docs.studies.beyond._layers import bent_flag, bent_wing, stored_layer
from docs.studies.beyond._motions import stored
from docs.studies.run.judged_runs import least_shape

DISPLACEMENTS = ("relative", "absolute", "reanchored")


def model_of(mesh=None, thickness: float = 0.12, *, offered: bool = False, **choices) -> MotionModel:
    points, cells, patches = mesh or square_frame()
    usual = {"support_radius": 0.5, "correction": "optimised"}
    model = MotionModel.build(points, cells, patches, Method(**{**usual, **choices}))
    return with_layer(model, patches, thickness, offered=offered) if thickness else model


def box(kind: str, n: int = 10):
    if kind == "tetra":
        mesh = stored("correction_box")
        outer = np.setdiff1d(np.flatnonzero(mesh.held), mesh.body)
    else:
        mesh = box_mesh(kind, n)
        outer = mesh.outer
    return mesh.points, mesh.cells, {"body": Patch("moving", mesh.body), "outer": Patch("fixed", outer)}


def turned(points: np.ndarray, degrees: float, shift: float) -> np.ndarray:
    """Targets turned about the z axis through the middle, and shifted."""
    out = points - 0.5
    out[:, :2] = out[:, :2] @ rotation(degrees).T
    return out + 0.5 + shift * np.arange(1, points.shape[1] + 1)


def layer_of(model: MotionModel) -> np.ndarray:
    return model.standard_motion.layer.nodes


@pytest.mark.parametrize("displacement", DISPLACEMENTS)
@pytest.mark.parametrize("kind", ["triangle", "quad", "tetra", "hexahedron", "wedge"])
def test_a_rigid_wall_takes_its_layer_along_rigidly(kind: str, displacement: str) -> None:
    mesh = square_frame(kind=kind) if kind in ("triangle", "quad") else box(kind)
    model = model_of(mesh, displacement=displacement, correction_target="threshold")
    points = model.points
    for degrees, shift in ((7.0, 0.01), (15.0, 0.02)):  # two steps: offsets are those of the reference mesh
        points = model.move(points, turned(model.points[model.roles.moving], degrees, shift)).points
        layer = layer_of(model)
        assert len(layer) >= 20
        assert np.abs(points[layer] - turned(model.points[layer], degrees, shift)).max() < 1e-12


def test_a_mesh_that_is_only_carried_along_is_not_deformed_at_all() -> None:
    points, cells, patches = square_frame(outer="moving")
    model = model_of((points, cells, patches))
    moved = model.move(points, turned(points[model.roles.moving], 40.0, 0.3)).points
    assert np.abs(moved - turned(points, 40.0, 0.3)).max() < 1e-12


@pytest.mark.parametrize("displacement", DISPLACEMENTS)
def test_the_layer_of_the_flag_is_kept_through_its_motion(displacement: str) -> None:
    mesh = stored_layer("layer_flag")
    model = with_layer(mesh.model(support_radius=0.4, displacement=displacement), mesh.patches, mesh.thickness)
    points = model.points
    for fraction in (0.5, 1.0, 0.0, -1.0):
        motion = model.move(points, bent_flag(model.points[model.roles.moving], fraction))
        points = motion.points
        kept = mesh.kept(points)
        assert kept.thickness <= 0.02, fraction
        assert kept.orthogonality <= 2.0, fraction
        assert not [w for w in motion.warnings if "layer" in w]


def test_the_prisms_of_the_wing_are_kept_and_stay_on_the_symmetry_plane() -> None:
    mesh = stored_layer("layer_wing")
    model = with_layer(mesh.model(support_radius=1.0, quality_threshold=0.15), mesh.patches, mesh.thickness)
    motion = model.move(model.points, bent_wing(model.points[model.roles.moving], 1.0))
    kept = mesh.kept(motion.points)
    assert kept.thickness <= 0.02
    assert kept.orthogonality <= 2.0
    assert np.isin(mesh.columns[:, 1:], layer_of(model)).all()
    assert np.all(motion.points[mesh.patches["symmetry"].nodes, 2] == 0.0)


def test_prisms_at_the_wings_sharp_edge_keep_the_shape_of_the_interpolation() -> None:
    """Its walls are sheared: a rotation would tilt prisms at the trailing edge by a multiple of their height."""
    mesh = stored_layer("layer_wing")
    targets = bent_wing(mesh.points[np.sort(mesh.body)], 0.5)
    shapes = []
    for choices in ({}, {"correction": "none", "displacement": "absolute"}):
        model = MotionModel.build(mesh.points, mesh.cells, mesh.patches, Method(**choices))
        model = model if not choices else replace(model, layered=None)
        shapes.append(least_shape(mesh.points, model.move(model.points, targets).points, mesh.cells))
    assert shapes[0] > 0.98 * shapes[1] > 0.8


def test_interpolation_and_correction_alone_lose_it() -> None:
    mesh = stored_layer("layer_flag")
    model = replace(mesh.model(support_radius=0.4), layered=None)
    kept = mesh.kept(model.move(model.points, bent_flag(model.points[model.roles.moving], 1.0)).points)
    assert kept.thickness > 0.1
    assert kept.orthogonality > 10.0


def test_the_system_does_not_grow() -> None:
    mesh = stored_layer("layer_flag")
    targets = bent_flag(mesh.points[mesh.body], 1.0)
    model = replace(mesh.model(support_radius=0.4), layered=None)
    carried = with_layer(model, mesh.patches, mesh.thickness)
    counts = [len(one.move(mesh.points, targets).control_points) for one in (model, carried)]
    assert counts[0] != counts[1] < 1.05 * counts[0]


def test_no_correction_moves_the_layer() -> None:
    for correction in ("none", "imposed-gradient", "explicit", "enrichment", "optimised"):
        model = model_of(correction=correction, quality_threshold=0.6, displacement="absolute", allow_invalid=True)
        motion = model.move(model.points, turned(model.points[model.roles.moving], 20.0, 0.02))
        layer = layer_of(model)
        assert motion.standard.metric.min < 0.6
        assert np.abs(motion.points[layer] - turned(model.points[layer], 20.0, 0.02)).max() < 1e-12, correction


@pytest.mark.parametrize(
    "choices", [{"reduction": "greedy"}, {"basis": "tps", "correction": "none"}, {"support_radius": 1.5}]
)
def test_the_layer_is_carried_whatever_the_rest_is_interpolated_by(choices: dict[str, object]) -> None:
    model = model_of(**choices)
    motion = model.move(model.points, turned(model.points[model.roles.moving], 10.0, 0.02))
    layer = layer_of(model)
    assert np.abs(motion.points[layer] - turned(model.points[layer], 10.0, 0.02)).max() < 1e-12
    assert motion.corrected.metric.min > 0.2


def test_periodic_sides_stay_alike() -> None:
    mesh = periodic_box("quad")
    model = model_of(mesh)
    shift = np.array([0.05, 0.1])
    motion = model.move(model.points, model.points[model.roles.moving] + shift)
    layer = layer_of(model)
    assert len(layer) > 0
    assert np.abs(motion.points[layer] - model.points[layer] - shift).max() < 1e-12
    low, high = (np.flatnonzero(model.points[:, 1] == end) for end in (0.0, 1.0))
    step = motion.points - model.points
    assert np.abs(step[low] - step[high]).max() < 1e-12


def test_the_motion_depends_on_the_committed_points_and_the_targets_alone() -> None:
    """Like after a resume: a new model continues from the committed points to the same bits."""
    mesh = stored_layer("layer_flag")
    choices = {"support_radius": 0.4, "displacement": "relative"}
    first, resumed = mesh.model(**choices), mesh.model(**choices)
    start = mesh.points[first.roles.moving]
    committed = first.move(mesh.points, bent_flag(start, 0.5)).points
    first.move(committed, bent_flag(start, 0.9))  # a trial that was rolled back
    ways = [model.move(committed, bent_flag(start, -0.3)).points for model in (first, resumed)]
    assert np.array_equal(*ways)


# where a layer cannot be kept


def moved_or_refused(model: MotionModel, targets: np.ndarray) -> Motion | None:
    try:
        return model.move(model.points, targets)
    except QualityRefused:
        return None


@pytest.mark.parametrize(("thickness", "displacement"), [(0.12, "relative"), (0.12, "reanchored"), (1.0, "absolute")])
def test_a_motion_that_is_valid_without_a_layer_is_valid_with_one(thickness: float, displacement: str) -> None:
    points = square_frame()[0]
    for degrees, shift in ((60.0, (-0.2, -0.2)), (0.0, (0.3, 0.0)), (0.0, (0.33, 0.33)), (150.0, (0.0, 0.0))):
        plain = model_of(thickness=0.0, displacement=displacement)
        model = model_of(thickness=thickness, offered=True, displacement=displacement)
        targets = (points[model.roles.moving] - 0.5) @ rotation(degrees).T + 0.5 + shift
        without, carried = moved_or_refused(plain, targets), moved_or_refused(model, targets)
        assert without is None or carried is not None
        if without is not None:
            assert carried.corrected.inverted == 0
            assert carried.corrected.metric.min > 0.2 * min(0.2, without.corrected.metric.min)


def test_a_layer_that_meets_a_wall_gives_way() -> None:
    model, plain = (model_of(thickness=t, offered=True, displacement="absolute") for t in (1.0, 0.0))
    targets = model.points[model.roles.moving] + [0.3, 0.0]
    motions = [one.move(one.points, targets) for one in (model, plain)]
    assert np.array_equal(*(motion.points for motion in motions))


def test_sub_steps_lead_the_layer_through() -> None:
    """Layers that gave way on the path give way at the targets too: a mesh is not put back where it was invalid."""
    for degrees in (100.0, 180.0):
        model = model_of(offered=True, displacement="absolute")
        targets = (model.points[model.roles.moving] - 0.5) @ rotation(degrees).T + 0.5
        motion = model._led(_Step(model.points, targets, MakeEachTime()))
        assert motion.sub_steps > 1
        assert motion.corrected.inverted == 0


def test_cells_that_carrying_alone_would_spoil_are_freed() -> None:
    mesh = concave()
    model = model_of(mesh, 0.25, offered=True, displacement="absolute")
    moving = model.points[model.roles.moving]
    closed = moving.copy()
    arm = moving[:, 0] > 0.6
    pivot = np.array([0.6, 0.4])
    closed[arm] = (moving[arm] - pivot) @ rotation(35.0).T + pivot
    motion = model.move(model.points, closed)
    plain = model_of(mesh, 0.0, displacement="absolute").move(model.points, closed)
    layer, moved = model.layered.layer, model.points.copy()
    moved[model.roles.moving] = closed
    kept = np.count_nonzero((motion.points[layer.nodes] == layer.carried(moved)).all(axis=1))
    assert 0.8 * len(layer.nodes) < kept < len(layer.nodes)
    assert motion.corrected.metric.min > 0.6 * plain.corrected.metric.min


def concave():
    """A box of squares whose floor moves: its right part can be lifted."""
    axis = np.linspace(0.0, 1.0, 21)
    points, quads = tensor_grid(axis, axis + 0.4)
    floor, lid = np.flatnonzero(points[:, 1] == 0.4), np.flatnonzero(points[:, 1] == points[:, 1].max())
    sides = np.flatnonzero((points[:, 0] == 0.0) | (points[:, 0] == 1.0))
    patches = {"floor": Patch("moving", floor), "lid": Patch("fixed", lid), "sides": Patch("slip", sides)}
    return points, CellTable.from_arrays({"quad": quads}), patches


# which nodes belong to it


def test_a_layer_ends_at_the_mitre_of_a_corner() -> None:
    model = model_of(square_frame(20, kind="quad"), 0.05)
    off = np.abs(model.points[layer_of(model)] - 0.5).max(axis=1)
    assert len(layer_of(model)) == 4 * 6  # one row of nodes around 4 x 4 squares, its corners included
    assert np.allclose(off, 0.15)


def test_a_third_of_a_gap_stays_free() -> None:
    points, cells, patches = square_frame(30)
    layer = BoundaryLayer.build(points, cells, patches, thickness=0.5)
    off = np.abs(points[layer.nodes] - 0.5).max(axis=1) - 0.1
    assert off.max() == pytest.approx(0.4 / 3.0, abs=1.0 / 30.0)
    assert off.max() <= 0.4 / 3.0 + 1e-9


def test_outermost_nodes_stand_for_the_wall_behind_them() -> None:
    model = model_of(square_frame(20, kind="quad"), 0.05)
    shield = model.standard_motion.layer.shield
    assert np.array_equal(shield.outermost, layer_of(model))
    assert np.array_equal(shield.behind, model.roles.moving)
    assert np.array_equal(shield.instead(model.roles.all), np.union1d(model.roles.fixed, layer_of(model)))
