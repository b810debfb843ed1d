"""How a wall deforms at its nodes, and the columns that stand on it."""

import numpy as np
from box_meshes import box_mesh
from frame_meshes import rotation, square_frame
from mesh_motion_numerics.mesh.boundary_facets import boundary_facets
from mesh_motion_numerics.mesh.boundary_layer_stacks import column_feet
from mesh_motion_numerics.mesh.boundary_layer_wall import ALONG, MovingWall


def wall_of(points: np.ndarray, cells, body: np.ndarray) -> MovingWall:
    moving = np.zeros(len(points), dtype=bool)
    moving[body] = True
    return MovingWall.build(points, boundary_facets(cells), moving, moving)


def turns() -> np.ndarray:
    about_z, about_x = np.eye(3), np.eye(3)
    about_z[:2, :2], about_x[1:, 1:] = rotation(130.0), rotation(-50.0)
    return about_z @ about_x


def test_a_rotated_wall_turns_by_that_rotation() -> None:
    mesh = box_mesh("wedge")
    wall, turn = wall_of(mesh.points, mesh.cells, mesh.body), turns()
    assert np.abs(wall.deformations(wall.reference @ turn.T + 3.0) - turn).max() < 1e-14


def test_a_stretched_wall_keeps_heights_and_stretches_along_itself() -> None:
    points, cells, patches = square_frame()
    wall = wall_of(points, cells, patches["block"].nodes)
    found = wall.deformations(wall.reference * [1.5, 1.5])
    low, high = wall.reference.min(axis=0), wall.reference.max(axis=0)
    at_ends = np.isclose(wall.reference, low) | np.isclose(wall.reference, high)
    corner = at_ends.all(axis=1)
    assert np.allclose(found[corner], np.eye(2) * (1.0 + 1.5 * ALONG) / (1.0 + ALONG))
    assert np.allclose(found[~corner], [np.diag(np.where(ends, 1.0, 1.5)) for ends in at_ends[~corner]])


def test_normals_stay_normal_where_the_wall_is_sheared() -> None:
    mesh = box_mesh("hexahedron")
    wall = wall_of(mesh.points, mesh.cells, mesh.body)
    moved = wall.reference.copy()
    moved[:, 1] += 0.6 * wall.reference[:, 2]
    inverse = np.linalg.inv(np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.6], [0.0, 0.0, 1.0]]))
    middle = np.flatnonzero((wall.reference[:, 1] == wall.reference[:, 1].max()) & _inside(wall.reference[:, [0, 2]]))
    goal = inverse.T @ [0.0, 1.0, 0.0]
    assert len(middle)
    turned = wall.deformations(moved)[middle] @ [0.0, 1.0, 0.0]
    assert np.abs(turned - goal / np.linalg.norm(goal)).max() < 1e-12


def _inside(coordinates: np.ndarray) -> np.ndarray:
    """Rows (w, 2) away from the largest and smallest coordinates."""
    low, high = coordinates.min(axis=0) + 1e-9, coordinates.max(axis=0) - 1e-9
    return ((coordinates > low) & (coordinates < high)).all(axis=1)


def test_a_wall_that_is_turned_inside_out_has_finite_deformations() -> None:
    points, cells, patches = square_frame()
    wall = wall_of(points, cells, patches["block"].nodes)
    for moved in (1.0 - wall.reference, wall.reference * [-1.0, 1.0], np.zeros_like(wall.reference)):
        assert np.abs(wall.deformations(moved)).max() < 2.0


def test_fixed_facets_belong_to_the_wall_where_a_moving_one_is_clamped_to_them() -> None:
    points, cells, patches = square_frame()
    block = patches["block"].nodes
    moving, prescribed = np.zeros(len(points), dtype=bool), np.zeros(len(points), dtype=bool)
    moving[block[points[block, 0] > 0.5]] = True
    prescribed[block] = prescribed[patches["outer"].nodes] = True
    assert np.array_equal(MovingWall.build(points, boundary_facets(cells), moving, prescribed).nodes, block)


def test_places_are_the_nearest_ones() -> None:
    mesh = box_mesh("wedge")
    wall = wall_of(mesh.points, mesh.cells, mesh.body)
    places, _ = wall.closest(mesh.points)
    low, high = wall.reference.min(axis=0), wall.reference.max(axis=0)
    assert np.allclose(places.of(wall.reference), np.clip(mesh.points, low, high), atol=1e-12)
    assert np.allclose(places.weights.sum(axis=1), 1.0)
    away = np.linalg.norm(mesh.points - np.clip(mesh.points, low, high), axis=1)
    near, facets = wall.closest(mesh.points, within=0.15)
    assert np.array_equal(facets >= 0, away <= 0.15)
    assert np.allclose(near.of(wall.reference)[facets >= 0], places.of(wall.reference)[facets >= 0])


def test_columns_stand_on_the_walls_sides_and_not_on_its_corners() -> None:
    for kind, d in (("quad", 2), ("hexahedron", 3)):
        mesh = box_mesh(kind)
        low, high = mesh.points[mesh.body].min(axis=0), mesh.points[mesh.body].max(axis=0)
        distances = np.linalg.norm(mesh.points - np.clip(mesh.points, low, high), axis=1)
        feet = column_feet(mesh.points, mesh.cells, mesh.body, np.arange(len(mesh.points)), distances)
        low, high = low - 1e-9, high + 1e-9
        above = np.count_nonzero((mesh.points < low) | (mesh.points > high), axis=1) == 1
        assert np.array_equal(feet >= 0, above | np.isin(np.arange(len(feet)), mesh.body))
        away = mesh.points[above] - mesh.points[feet[above]]
        assert np.all(np.count_nonzero(np.abs(away) > 1e-12, axis=1) == 1), d
