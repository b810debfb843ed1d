from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.cases.case import RigidMotion, read_case
from mesh_motion_server.cases.motion_program import MotionProgram, RigidProgram
from mesh_motion_server.files import read_mesh, write_npz


def program(path: Path) -> MotionProgram:
    case = read_case(path)
    return MotionProgram.of(case, case.read_mesh())


def rotation(degrees: float) -> np.ndarray:
    a = np.deg2rad(degrees)
    return np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])


def test_a_rigid_motion_interpolates_angle_and_translation(make_case) -> None:
    motion = program(make_case(("count = 2", "count = 4"), ("10.0", "180.0")))
    points = read_mesh(make_case().parent / "mesh.npz").points[motion.nodes]
    for step in range(5):
        turned = (points - 0.5) @ rotation(45.0 * step).T + 0.5 + step / 4 * np.array([0.05, 0.02])
        np.testing.assert_allclose(points + motion.displacement(step), turned, atol=1e-15)
    half_way = points + motion.displacement(2)  # a body stays rigid on the way
    np.testing.assert_allclose(
        np.linalg.norm(half_way[1:] - half_way[:-1], axis=1),
        np.linalg.norm(points[1:] - points[:-1], axis=1),
        rtol=1e-13,
    )


def test_the_axis_counts_not_its_length() -> None:
    points = np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 5.0]])
    about_z = RigidProgram(points, RigidMotion(rotation=90.0, centre=[0, 0, 0], axis=[0, 0, 3]), float)
    np.testing.assert_allclose(points + about_z.displacement(1), [[0, 1, 0], [-2, 0, 5]], atol=1e-15)
    cyclic = RigidProgram(points, RigidMotion(rotation=120.0, centre=[0, 0, 0], axis=[1, 1, 1]), float)
    np.testing.assert_allclose(points + cyclic.displacement(1), [[0, 1, 0], [5, 0, 2]], atol=1e-15)
    back = RigidProgram(np.array([[1.0, 0.0]]), RigidMotion(rotation=90.0, centre=[0, 0], axis=[0, 0, -1]), float)
    np.testing.assert_allclose(back.displacement(1), [[-1, -1]], atol=1e-15)


def test_motions_of_a_patch_add_up_from_the_reference(make_case) -> None:
    twice = """[[motion]]
patch = "block"
rigid = { rotation = 90.0, centre = [0.0, 0.0] }
[[motion]]
patch = "block"
rigid = { rotation = 90.0, centre = [0.0, 0.0] }
"""
    path = make_case(("[steps]", twice + "[steps]"), (", rotation = 10.0, centre = [0.5, 0.5]", ""))
    motion = program(path)
    points = read_mesh(path.parent / "mesh.npz").points[motion.nodes]
    one = points @ rotation(90).T - points
    np.testing.assert_allclose(motion.displacement(2), 2 * one + [0.05, 0.02], atol=1e-14)


def with_table(path: Path, **arrays: np.ndarray) -> Path:
    np.savez(path.parent / "motion.npz", **arrays)  # type: ignore[arg-type]
    return path


TABLE = ("rigid = { translation = [0.05, 0.02], rotation = 10.0, centre = [0.5, 0.5] }", 'table = "motion.npz"')


def test_a_table_may_name_the_nodes_in_any_order(make_case) -> None:
    path = make_case(TABLE)
    nodes = read_mesh(path.parent / "mesh.npz").patches["block"]
    shuffled = np.random.default_rng(1).permutation(nodes)
    values = np.stack([np.stack([shuffled, -shuffled], axis=1) * step for step in (1.0, 2.0, 3.0)])
    motion = program(with_table(path, node_ids=shuffled, displacement=values))  # three steps, the case plays two
    np.testing.assert_array_equal(motion.displacement(0), 0)
    np.testing.assert_array_equal(motion.displacement(2), 2.0 * np.stack([motion.nodes, -motion.nodes], axis=1))


def test_a_wrong_table_of_motions_is_named(make_case) -> None:
    path = make_case(TABLE)
    nodes = read_mesh(path.parent / "mesh.npz").patches["block"]
    zero = np.zeros((2, len(nodes), 2))
    nan = zero.copy()
    nan[1, 3] = np.nan
    for arrays, message in [
        ({"node_ids": nodes, "displacement": zero[:1]}, rf"\(S, n, d\) = \(at least 2, {len(nodes)}, 2\)"),
        ({"node_ids": nodes, "displacement": zero[:, :, :1]}, "displacement: expected real numbers"),
        ({"node_ids": nodes, "displacement": zero[:, 1:]}, "displacement: expected real numbers"),
        ({"node_ids": nodes, "displacement": zero * 1j}, "complex128"),
        ({"node_ids": nodes * 1.0, "displacement": zero}, "node_ids: expected integers"),
        ({"node_ids": nodes, "displacement": nan}, f"node {nodes[3]} in step 2 is not finite"),
        ({"node_ids": nodes[1:], "displacement": zero[:, 1:]}, f"node {nodes[0]} of patch 'block' is not in"),
        ({"node_ids": np.r_[nodes[0], nodes[:-1]], "displacement": zero}, f"node {nodes[0]} appears twice"),
        (
            {"node_ids": np.r_[nodes, 0], "displacement": np.zeros((2, len(nodes) + 1, 2))},
            "node 0 in node_ids does not",
        ),
        ({"nodes": nodes, "displacement": zero}, "expected 'node_ids' and 'displacement', got 'nodes'"),
    ]:
        with pytest.raises(InvalidInput, match=message):
            program(with_table(path, **arrays))
    (path.parent / "motion.npz").unlink()
    with pytest.raises(InvalidInput, match="no such motion table"):
        program(path)


def two_moving_patches(make_case, second: str) -> Path:
    path = make_case(('block = "moving"', 'block = "moving"\nlid = "moving"'), ("[steps]", second + "[steps]"))
    mesh = read_mesh(path.parent / "mesh.npz")
    block = mesh.patches["block"]
    write_npz(mesh.path, replace(mesh, patches={**mesh.patches, "lid": block[:4]}))
    return path


def test_a_node_on_two_moving_patches_must_have_one_displacement(make_case) -> None:
    same = '[[motion]]\npatch = "lid"\nrigid = { translation = [0.05, 0.02], rotation = 10.0, centre = [0.5, 0.5] }\n'
    motion = program(two_moving_patches(make_case, same))
    assert motion.displacement(2).shape == (len(motion.nodes), 2)
    with pytest.raises(InvalidInput, match=r"node \d+ is on the moving patches 'block' and 'lid', which move it"):
        program(two_moving_patches(make_case, same.replace("10.0", "10.001")))


def test_a_moving_patch_without_a_motion_stays(make_case) -> None:
    path = make_case(('outer = "fixed"', 'outer = "moving"'))
    motion = program(path)
    assert motion.still == ("outer",)
    outer = read_mesh(path.parent / "mesh.npz").patches["outer"]
    np.testing.assert_array_equal(motion.displacement(2)[np.searchsorted(motion.nodes, outer)], 0)


RIGID = "rigid = { translation = [0.05, 0.02], rotation = 10.0, centre = [0.5, 0.5] }"


def test_an_oscillation_begins_and_ends_its_period_at_rest(make_case) -> None:
    along = "oscillation = { amplitude = 0.1, frequency = 0.125, phase = 30.0, direction = [0.0, 2.0] }"
    motion = program(make_case((RIGID, along), ("count = 2", "count = 8")))
    for step in range(9):
        expected = [0.0, 0.1 * (np.sin(np.deg2rad(45.0 * step + 30.0)) - 0.5)]
        np.testing.assert_allclose(motion.displacement(step), np.tile(expected, (len(motion.nodes), 1)), atol=1e-15)


def test_an_oscillation_about_an_axis_turns(make_case) -> None:
    about = "oscillation = { amplitude = 20.0, frequency = 0.25, centre = [0.5, 0.5] }"
    path = make_case((RIGID, about))
    motion = program(path)
    points = read_mesh(path.parent / "mesh.npz").points[motion.nodes]
    for step, degrees in ((0, 0.0), (1, 20.0), (2, 0.0)):
        turned = (points - 0.5) @ rotation(degrees).T + 0.5
        np.testing.assert_allclose(points + motion.displacement(step), turned, atol=1e-15)
