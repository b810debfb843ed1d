"""The paths of the moving boundary: every body turns separately, seams stay together, the ends are exact."""

import numpy as np
import pytest
from box_meshes import box_mesh
from correction_cases import squeezed, stored
from frame_meshes import rotation, square_frame, tensor_grid, without_unused
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.motion.body_paths import Way, moving_bodies, ways


def distances(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points[:, None] - points, axis=2)


def test_two_blocks_are_two_bodies() -> None:
    mesh = stored("correction_two_blocks")
    bodies = moving_bodies(mesh.cells, mesh.body)
    assert len(bodies) == 2
    assert np.array_equal(np.sort(np.concatenate([body.rows for body in bodies])), np.arange(len(mesh.body)))
    for body in bodies:
        x = mesh.points[mesh.body[body.rows], 0]
        assert (x < 0.5).all() or (x > 0.5).all()
        assert len(body.seam) == 0


@pytest.mark.parametrize("kind", ["quad", "hexahedron", "tetra", "hexahedron + wedge"])
def test_a_body_in_a_box_is_one(kind: str) -> None:
    mesh = box_mesh(kind, 5)
    (body,) = moving_bodies(mesh.cells, mesh.body)
    assert np.array_equal(body.rows, np.arange(len(mesh.body)))


def test_nodes_inside_the_mesh_belong_together() -> None:
    points, cells, _ = square_frame(10)
    inside = np.flatnonzero(np.all((points > 0.05) & (points < 0.35), axis=1))
    (body,) = moving_bodies(cells, inside)
    assert np.array_equal(body.rows, np.arange(len(inside)))


def test_nodes_of_a_line_go_straight() -> None:
    lines = CellTable.from_arrays({"line": np.column_stack([np.arange(6), np.arange(1, 7)])})
    bodies = moving_bodies(lines, np.array([0, 6]))
    assert [body.rows.tolist() for body in bodies] == [[0], [1]]
    origin, targets = np.array([[0.0], [6.0]]), np.array([[1.0], [5.0]])
    (way,) = ways(origin, targets, bodies)
    assert way.at(0.25).tolist() == [[0.25], [5.75]]


def test_every_body_turns_as_a_rigid_one_and_the_ends_are_bitwise() -> None:
    mesh = stored("correction_two_blocks")
    origin = mesh.points[mesh.body]
    bodies = moving_bodies(mesh.cells, mesh.body)
    targets = origin.copy()
    for body, degrees in zip(bodies, (170.0, -60.0), strict=True):
        centre = origin[body.rows].mean(axis=0)
        targets[body.rows] = (origin[body.rows] - centre) @ rotation(degrees).T + centre + (0.05, 0.0)
    found = list(ways(origin, targets, bodies))
    assert len(found) == 3  # the centres do not turn about each other
    for way in found:
        assert way.at(0.0).tobytes() == origin.tobytes()
        assert way.at(1.0).tobytes() == targets.tobytes()
        np.testing.assert_allclose(way.at(1.0 - 1e-12), targets, atol=1e-10)
    for way, turned in ((found[0], (85.0, -30.0)), (found[1], (-95.0, -30.0))):
        half = way.at(0.5)
        for body, degrees in zip(bodies, turned, strict=True):
            before, after = origin[body.rows], half[body.rows]
            np.testing.assert_allclose(distances(after), distances(before), atol=1e-12)
            edge = (before[1] - before[0]) @ rotation(degrees).T
            np.testing.assert_allclose(after[1] - after[0], edge, atol=1e-12)
    np.testing.assert_allclose(found[2].at(0.5), 0.5 * (origin + targets))


def test_without_a_rotation_there_is_only_the_straight_way() -> None:
    mesh = stored("correction_two_blocks")
    origin = mesh.points[mesh.body]
    targets = origin + squeezed(mesh, 0.1)[mesh.body]
    (way,) = ways(origin, targets, moving_bodies(mesh.cells, mesh.body))
    assert np.array_equal(way.at(0.5), Way(origin, targets).at(0.5))


def test_bodies_that_change_places_go_around_each_other() -> None:
    mesh = stored("correction_two_blocks")
    origin = mesh.points[mesh.body]
    bodies = moving_bodies(mesh.cells, mesh.body)
    centres = [origin[body.rows].mean(axis=0) for body in bodies]
    targets = origin.copy()
    for body, goal, centre in zip(bodies, reversed(centres), centres, strict=True):
        targets[body.rows] += goal - centre
    straight, around = ways(origin, targets, bodies)
    assert np.ptp(straight.at(0.5)[:, 0]) < 0.16  # one upon the other
    half = around.at(0.5)
    for body in bodies:
        np.testing.assert_allclose(distances(half[body.rows]), distances(origin[body.rows]), atol=1e-12)
    meanwhile = [half[body.rows].mean(axis=0) for body in bodies]
    apart = np.linalg.norm(centres[1] - centres[0])
    np.testing.assert_allclose(np.linalg.norm(meanwhile[1] - meanwhile[0]), apart, rtol=1e-12)
    assert around.at(1.0).tobytes() == targets.tobytes()
    np.testing.assert_allclose(around.at(1.0 - 1e-12), targets, atol=1e-10)


def flap() -> tuple[np.ndarray, CellTable, np.ndarray]:
    points, quads = tensor_grid(np.arange(9.0), np.arange(9.0))
    x, y = points[quads].mean(axis=1).T
    points, quads = without_unused(points, quads[~((x == 4.5) & (y < 4.0))])
    moving = np.flatnonzero((points[:, 0] >= 4) & (points[:, 0] <= 5) & (points[:, 1] <= 4))
    return points, CellTable.from_arrays({"quad": quads}), moving


def test_a_body_that_hangs_on_the_wall_turns_about_its_seam() -> None:
    points, cells, moving = flap()
    (body,) = moving_bodies(cells, moving)
    origin = points[moving]
    assert origin[body.seam].tolist() == [[4.0, 0.0], [5.0, 0.0]]
    x, y = origin.T
    angle = np.deg2rad(40.0) * y / 4.0  # bent, the more the higher, about the middle of the seam
    targets = np.column_stack([4.5 + (x - 4.5) * np.cos(angle) + y * np.sin(angle), y * np.cos(angle)])
    targets[:, 1] -= (x - 4.5) * np.sin(angle)
    way = next(iter(ways(origin, targets, (body,))))
    for fraction in (0.25, 0.5, 0.75):
        drift = np.linalg.norm(way.at(fraction)[body.seam] - origin[body.seam], axis=1)
        assert drift.max() < 0.03
