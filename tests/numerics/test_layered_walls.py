"""Layers of thin cells move with their wall where interpolation would destroy them, and only there."""

from dataclasses import replace

import numpy as np
import pytest
from box_meshes import box_mesh
from correction_cases import BodyMesh, ring
from frame_meshes import tensor_grid
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.layered_walls import LayeredWalls
from mesh_motion_numerics.motion.motion import MotionModel

from docs.studies.aerofoil_grids import Grid, o_grid, wing


def narrow(kind: str) -> Grid:
    """An aerofoil with first cells of 1e-5 in a domain of two chords, or a wing."""
    if kind == "wing":
        return wing(o_grid("blunt", around=48, layers=16, first=1e-3, far=8.0), stations=10)
    grid = o_grid("blunt", around=96, layers=32, first=1e-5, far=8.0)
    quads = grid.cells["quad"]
    if kind == "quads":
        return grid
    return grid._replace(cells={"triangle": np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])})


def model_of(grid: Grid, **choices: object) -> MotionModel:
    return MotionModel.build(grid.points, CellTable.from_arrays(grid.cells), grid.patches, Method(**choices))


def pitched(points: np.ndarray, degrees: float, plunge: float) -> np.ndarray:
    a, moved = np.radians(degrees), points.copy()
    moved[:, 0] = np.cos(a) * points[:, 0] - np.sin(a) * points[:, 1]
    moved[:, 1] = np.sin(a) * points[:, 0] + np.cos(a) * points[:, 1] + plunge
    return moved


def stretch(model: MotionModel, moved: np.ndarray) -> float:
    """Largest relative change of the first edges' lengths."""
    layered = model.layered
    feet = layered.wall.nodes[layered.rows]
    before, now = (points[layered.above] - points[feet] for points in (model.points, moved))
    return float(np.abs(np.linalg.norm(now, axis=1) / np.linalg.norm(before, axis=1) - 1.0).max())


@pytest.mark.parametrize("kind", ["quads", "triangles", "wing"])
def test_first_cells_keep_their_height_through_a_pitch_of_20_degrees_and_a_plunge_of_half_a_chord(kind: str) -> None:
    grid = narrow(kind)
    model = model_of(grid)
    targets = pitched(grid.points[model.roles.moving], 20.0, 0.5)
    moved = model.move(grid.points, targets)
    assert stretch(model, moved.points) < 1e-6
    assert moved.corrected.inverted == 0
    assert moved.warnings == []
    alone = replace(model, layered=None, method=replace(model.method, correction="none", allow_invalid=True))
    assert stretch(model, alone.move(grid.points, targets).points) > 0.01


def test_layers_that_the_interpolation_keeps_are_left_to_it() -> None:
    grid = o_grid("blunt", first=1e-5, far=1000.0)
    model = model_of(grid, correction="optimised")
    targets = pitched(grid.points[model.roles.moving], 5.0, 0.1)
    alone = replace(model, layered=None)
    np.testing.assert_array_equal(
        model.move(grid.points, targets).points, alone.move(grid.points, targets).points, strict=True
    )


@pytest.mark.parametrize("kind", ["quad", "quad + triangle", "tetra", "hexahedron"])
def test_even_meshes_have_no_layers(kind: str) -> None:
    mesh = box_mesh(kind, 10)
    assert LayeredWalls.build(mesh.points, mesh.cells, mesh.patches, None) is None


def rolled(mesh: BodyMesh, **choices: object) -> tuple[MotionModel, np.ndarray, np.ndarray]:
    """A model of the mesh, and edges that leave its body after a turn by 15°: turned at rest, and moved."""
    model = MotionModel.build(mesh.points, mesh.cells, mesh.patches, Method(**choices))
    moved = model.move(mesh.points, pitched(mesh.points[mesh.body], 15.0, 0.1)).points
    (block,) = mesh.cells
    ends = block.nodes[np.isin(block.nodes, mesh.body).sum(axis=1) == 1]
    foot = np.where(np.isin(ends, mesh.body), ends, -1).max(axis=1)
    edges = [(points[ends] - points[foot][:, None]) for points in (pitched(mesh.points, 15.0, 0.1), moved)]
    return model, *edges


def test_first_cells_of_a_body_without_thin_cells_turn_with_it() -> None:
    """Interpolation knows no points inside the circle: its first cells lag by 3.5°."""
    model, expected, found = rolled(ring())
    assert not model.layered.thin
    np.testing.assert_allclose(found, expected, atol=1e-13)
    _, _, alone = rolled(ring(), correction="none")
    assert np.abs(alone - expected).max() > 0.03 * np.abs(expected).max()


@pytest.mark.parametrize(("rings", "ratio"), [(18, 10.0), (6, 1.5)], ids=["large", "near another boundary"])
def test_first_cells_that_would_make_the_body_much_larger_are_not_carried(rings: int, ratio: float) -> None:
    mesh = ring(rings, ratio)
    model = MotionModel.build(mesh.points, mesh.cells, mesh.patches, Method())
    assert model.carrying_layers.layer is None


def test_first_cells_of_a_wall_at_the_mesh_s_border_are_not_carried() -> None:
    """It has no far side, and the row would end within the mesh."""
    mesh = box_mesh("quad", 40)
    floor = np.flatnonzero(mesh.points[:, -1] == mesh.points[:, -1].min())
    lid = np.flatnonzero(mesh.points[:, -1] == mesh.points[:, -1].max())
    patches = {"floor": Patch("moving", floor), "lid": Patch("fixed", lid)}
    model = MotionModel.build(mesh.points, mesh.cells, patches, Method())
    assert model.carrying_layers.layer is None


def test_a_layer_on_a_periodic_wall_is_kept_and_its_ends_stay_alike() -> None:
    """A bent floor, whose plain motion makes the first cells two fifths higher."""
    x, y = np.linspace(0.0, 1.0, 41), (1.25 ** np.arange(31) - 1.0) / (1.25**30 - 1.0)
    points, quads = tensor_grid(x, y)
    points[:, 1] += 0.1 * np.sin(2.0 * np.pi * points[:, 0] + 0.7) * (1.0 - points[:, 1])
    node = np.arange(len(points)).reshape(41, 31)
    sides = {"floor": ("moving", node[:, 0]), "lid": ("fixed", node[:, -1])}
    sides |= {"left": ("periodic", node[0]), "right": ("periodic", node[-1])}
    patches = {name: Patch(role, np.ascontiguousarray(nodes)) for name, (role, nodes) in sides.items()}
    model = MotionModel.build(points, CellTable.from_arrays({"quad": quads}), patches, Method())
    floor = points[model.roles.moving]
    moved = model.move(points, floor + np.stack([0.05 + 0.0 * floor[:, 0], 0.1 * np.sin(2.0 * np.pi * floor[:, 0])], 1))
    assert stretch(model, moved.points) < 0.005
    steps = (moved.points - points)[node[[0, -1]]]
    assert np.abs(steps[0] - steps[1]).max() < 1e-15


def test_layers_at_the_ends_of_a_bending_floor_stand_on_it_and_not_on_the_walls_next_to_it() -> None:
    x, y = np.linspace(0.0, 6.0, 61), (1.5 ** np.arange(25) - 1.0) / (1.5**24 - 1.0)
    points, quads = tensor_grid(x, y)
    node = np.arange(len(points)).reshape(61, 25)
    floor, rest = node[1:-1, 0], np.unique(np.concatenate([node[0], node[-1], node[:, -1]]))
    patches = {"floor": Patch("moving", np.ascontiguousarray(floor)), "rest": Patch("fixed", rest)}
    model = MotionModel.build(points, CellTable.from_arrays({"quad": quads}), patches, Method())
    targets = points[floor].copy()
    targets[:, 1] = 0.05 * np.sin(np.pi * targets[:, 0] / 6.0) ** 2
    moved = model.move(points, targets)
    assert moved.warnings == []
    assert moved.corrected.metric.min > 0.9
    assert stretch(model, moved.points) < 0.005
