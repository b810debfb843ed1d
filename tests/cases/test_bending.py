from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from frame_meshes import tensor_grid, without_unused
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.cases.case import Bending, read_case
from mesh_motion_server.cases.check import check
from mesh_motion_server.cases.draft import draft
from mesh_motion_server.cases.motion_program import BendingProgram, MotionProgram
from mesh_motion_server.files import read_mesh

ALONG = np.linspace(0.0, 2.0, 201)


def bent(motion: Bending, points: np.ndarray) -> np.ndarray:
    return points + BendingProgram(points, motion, float).displacement(1)


def length(line: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())


@pytest.mark.parametrize("angle", [1e-9, 5.0, -90.0, 350.0])
def test_the_middle_line_becomes_an_arc_of_its_length_and_the_clamp_rests(angle: float) -> None:
    line = np.column_stack([0.3 + ALONG, np.full(201, 0.1)])
    moved = bent(Bending(rotation=angle, clamp=[0.3, 0.1], tip=[2.3, 0.1]), line)
    assert np.array_equal(moved[0], line[0])
    assert length(moved) == pytest.approx(2.0, rel=2e-4)
    theta = np.deg2rad(angle)
    tip = line[0] + 2.0 * np.array([np.sinc(theta / np.pi), np.sinc(theta / 2 / np.pi) * np.sin(theta / 2)])
    assert moved[-1] == pytest.approx(tip, abs=1e-12)


def test_the_face_at_the_clamp_and_what_lies_behind_it_rest_and_what_is_past_the_tip_turns_rigidly() -> None:
    points = np.array([[0.0, 0.2], [0.0, -0.2], [-1.0, 0.5], [2.0, 0.1], [3.0, 0.1], [3.0, -0.1]])
    moved = bent(Bending(rotation=30.0, clamp=[0.0, 0.0], tip=[2.0, 0.0]), points)
    assert np.array_equal(moved[:3], points[:3])
    ahead = moved[4] - moved[3]
    assert ahead == pytest.approx([np.cos(np.pi / 6), np.sin(np.pi / 6)], abs=1e-12)
    assert np.linalg.norm(moved[4] - moved[5]) == pytest.approx(0.2, abs=1e-12)


def test_a_body_clamped_at_both_ends_rests_at_both_with_the_slope_that_is_given_between() -> None:
    line = np.column_stack([ALONG, np.zeros(201)])
    moved = bent(Bending(rotation=20.0, clamp=[0.0, 0.0], tip=[2.0, 0.0], both_ends=True), line)
    assert np.array_equal(moved[[0, -1]], line[[0, -1]])
    slope = np.diff(moved[:, 1]) / np.diff(moved[:, 0])
    assert np.rad2deg(np.arctan(slope.max())) == pytest.approx(20.0, rel=1e-3)
    assert abs(slope[[0, -1]]).max() < 0.02


def test_in_space_it_bends_about_its_axis() -> None:
    points = np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.5], [0.0, 1.0, -0.5]])
    moved = bent(Bending(rotation=10.0, clamp=[0.0, 0.0, 0.0], tip=[0.0, 1.0, 0.0], axis=[0.0, 0.0, 1.0]), points)
    assert np.array_equal(moved[:, 2], points[:, 2])
    assert (moved[1:, 0] < -0.08).all()


@pytest.mark.parametrize(
    ("keys", "reason"),
    [
        ("rotation = 0.0, clamp = [0.0, 0.0], tip = [0.0, 1.0]", "rotation"),
        ("rotation = 5.0, clamp = [0.0, 0.0], tip = [0.0, 0.0]", "two places"),
        ("rotation = 95.0, clamp = [0.0, 0.0], tip = [0.0, 1.0], both_ends = true", "between -90 and 90"),
        ("rotation = 5.0, clamp = [0.0, 0.0, 0.0], tip = [0.0, 1.0]", "clamp has 3 entries"),
    ],
)
def test_a_wrong_bending_is_refused_by_the_key(make_case: Callable[[], Path], keys: str, reason: str) -> None:
    path: Path = make_case()
    text = draft(read_mesh(path.parent / "mesh.npz"), path.parent)
    rigid = next(line for line in text.splitlines() if line.startswith("rigid"))
    path.write_text(text.replace(rigid, f"bending = {{ {keys} }}"), encoding="utf-8")
    with pytest.raises(InvalidInput, match=reason):
        read_case(path).read_mesh()


def flap(folder: Path, dimension: int, *, both: bool) -> Path:
    """A box of simplices or hexahedra around a flap on its floor, or a wall from floor to ceiling."""
    x, y = np.linspace(0, 4, 33), np.linspace(0, 2, 17)
    z = np.linspace(0, 1, 5)
    grid, cells = tensor_grid(x, y, z) if dimension == 3 else tensor_grid(x, y)
    middle, top = grid[cells].mean(axis=1), 2.0 if both else 1.0
    grid, cells = without_unused(grid, cells[(abs(middle[:, 0] - 2) > 0.125) | (middle[:, 1] > top)])
    inside = (abs(grid[:, 0] - 2) < 0.126) & (grid[:, 1] <= top)
    body = inside & ((abs(grid[:, 0] - 2) > 0.124) | ((grid[:, 1] == top) & (not both)))
    wall = (grid[:, 0] % 4 == 0) | (grid[:, 1] % 2 == 0)
    arrays = {"patch_flap": body, "patch_walls": wall}
    if dimension == 3:
        arrays["patch_symmetry"] = grid[:, 2] % 1 == 0
    np.savez(
        folder / "mesh.npz",
        points=grid,
        **{f"cells_{'hexahedron' if dimension == 3 else 'quad'}": cells},
        **{name: np.flatnonzero(marks) for name, marks in arrays.items()},  # type: ignore[arg-type]
    )
    return folder / "mesh.npz"


@pytest.mark.parametrize("both", [False, True])
@pytest.mark.parametrize("dimension", [2, 3])
def test_a_first_case_of_a_body_on_a_wall_bends_it_and_is_accepted(tmp_path: Path, dimension: int, both: bool) -> None:
    mesh = read_mesh(flap(tmp_path, dimension, both=both))
    path = tmp_path / "case.toml"
    path.write_text(draft(mesh, tmp_path), encoding="utf-8")
    case = read_case(path)
    assert case.content.patches["flap"] == "moving"
    program = MotionProgram.of(case, case.read_mesh())
    moved = program.displacement(case.content.steps.count)
    held = np.isin(program.nodes, mesh.patches["walls"])
    assert np.abs(moved[held]).max() < 1e-9
    assert 0.03 < np.abs(moved).max() < 0.2
    report = check(path, seconds=60.0)
    assert (report.steps, report.refused) == (10, "")


@pytest.mark.parametrize("shift", [0.0, 0.1, 0.7, 1e3])
def test_a_side_that_is_clamped_all_round_bends_between_its_edges(tmp_path: Path, shift: float) -> None:
    """Its middle and that of its edges are equal except for rounding, so they give no direction."""
    axes = [np.linspace(0, length, 7) / 3 + shift for length in (2, 1, 1)]
    points, cells = tensor_grid(*axes)
    number = np.arange(343).reshape(7, 7, 7)
    sides = {f"{'xyz'[axis]}{end}": np.take(number, end, axis).ravel() for axis in range(3) for end in (0, -1)}
    np.savez(
        tmp_path / "mesh.npz",
        points=points,
        cells_hexahedron=cells,
        **{f"patch_{name}": nodes for name, nodes in sides.items()},  # type: ignore[arg-type]
    )
    path = tmp_path / "case.toml"
    path.write_text(draft(read_mesh(tmp_path / "mesh.npz"), tmp_path), encoding="utf-8")
    report = check(path, seconds=60.0)
    assert (report.steps, report.refused) == (10, "")
    assert "both_ends = true" in path.read_text()
