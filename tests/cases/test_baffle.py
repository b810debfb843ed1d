"""A plate without thickness in a square: two rows of nodes at the same place, moved end to end."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mesh_motion_client import QualityRefused, Server

from mesh_motion_server.cases.play import play

CASE = """
[mesh]
file = "mesh.npz"
[patches]
outer = "fixed"
{roles}
{motions}
[steps]
count = {count}
"""
TURN = "translation = [0.05, 0.1], rotation = {angle}, centre = [0.5, 0.5]"


def plate(patches: dict[str, slice]) -> dict[str, Any]:
    """A grid of 20 × 20 quads with a slit in the middle; row 0 has the slit's lower side, row 1 its upper side."""
    grid = np.linspace(0.0, 1.0, 21)
    points = np.stack(np.meshgrid(grid, grid), -1).reshape(-1, 2)
    number = np.arange(441).reshape(21, 21)
    below = number[10, 5:16]
    above = np.r_[below[0], 441 + np.arange(9), below[-1]]
    tops = number.copy()
    tops[10, 5:16] = above
    low = np.concatenate([number[:10], tops[10:20]])
    quads = np.stack([low[:, :-1], low[:, 1:], number[1:, 1:], number[1:, :-1]], -1).reshape(-1, 4)
    rim = np.flatnonzero((points == 0).any(axis=1) | (points == 1).any(axis=1))
    sides = np.concatenate([below, above[1:-1]])
    named = {f"patch_{name}": np.unique(sides[part]) for name, part in patches.items()}
    return {"points": np.vstack([points, points[below[1:-1]]]), "cells_quad": quads, "patch_outer": rim, **named}


ONE, TWO = {"plate": slice(None)}, {"below": slice(11), "above": slice(11, None)}


def case(folder: Path, patches: dict[str, slice], rigid: dict[str, str], count: int = 1, method: str = "") -> Path:
    """The case file: each patch's rigid motion."""
    np.savez(folder / "mesh.npz", **plate(patches))
    roles = "\n".join(f'{name} = "moving"' for name in patches)
    motions = "\n".join(f'[[motion]]\npatch = "{name}"\nrigid = {{ {rigid[name]} }}' for name in patches)
    path = folder / "case.toml"
    path.write_text(CASE.format(roles=roles, motions=motions, count=count) + f"[method]\n{method}\n")
    return path


@pytest.mark.parametrize(("angle", "count"), [("25.0", 3), ("100.0", 1)])
@pytest.mark.parametrize("patches", [ONE, TWO], ids=["one patch", "two patches"])
def test_a_plate_without_thickness_moves(
    server: Server, tmp_path: Path, patches: dict[str, slice], angle: str, count: int
) -> None:
    path = case(tmp_path, patches, dict.fromkeys(patches, TURN.format(angle=angle)), count)
    played = play(path, tmp_path / "out", endpoint=server.endpoint)
    warned = "the boundary nodes 216 and 441 and 8 more pairs are at the same place; they are interpolated as one"
    assert any(warning.startswith(warned) for warning in played.warnings)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["boundary_error"] <= 1e-15
    assert summary["steps"][-1]["inverted_cells"] == 0
    points = np.load(tmp_path / "out" / "points.npy")
    np.testing.assert_allclose(points[216:225], points[441:], rtol=0, atol=1e-15)


def test_its_sides_part(server: Server, tmp_path: Path) -> None:
    apart = {"below": "translation = [0.0, -0.02]", "above": "translation = [0.0, 0.02]"}
    played = play(case(tmp_path, TWO, apart), tmp_path / "out", endpoint=server.endpoint)
    assert played.steps[-1].inverted_cells == 0
    np.testing.assert_allclose(played.points[441:, 1] - played.points[216:225, 1], 0.04, rtol=1e-12)


@pytest.mark.parametrize("turned", [False, True], ids=["all along", "at one end"])
def test_its_sides_do_not_pass_through_each_other(server: Server, tmp_path: Path, turned: bool) -> None:
    rigid = {"below": "translation = [0.0, 0.02]", "above": "translation = [0.0, -0.02]"}
    if turned:  # about the middle: they part on one side of it and pass through each other on the other
        rigid = {name: f"rotation = {a}, centre = [0.5, 0.5]" for name, a in (("below", 4.0), ("above", -4.0))}
    with pytest.raises(QualityRefused, match=r"pass through itself at node (\d+) and node (\d+), which are") as refused:
        play(case(tmp_path, TWO, rigid), tmp_path / "out", endpoint=server.endpoint)
    one, other = map(int, re.findall(r"node (\d+)", str(refused.value))[:2])
    assert (one, other) in set(zip(range(216, 225), range(441, 450), strict=True))


def halves(folder: Path, motions: dict[str, str]) -> Path:
    """Two adjacent squares; the nodes on the common side have equal positions, and each side moves separately."""
    grid = np.linspace(0.0, 1.0, 9)
    left = np.stack(np.meshgrid(grid, grid), -1).reshape(-1, 2)
    number = np.arange(81).reshape(9, 9)
    quads = np.stack([number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]], -1).reshape(-1, 4)
    np.savez(
        folder / "mesh.npz",
        points=np.vstack([left, left + np.array([1.0, 0.0])]),
        cells_quad=np.vstack([quads, quads + 81]),
        patch_left=number[1:-1, 8],
        patch_right=81 + number[1:-1, 0],
        patch_outer=np.r_[number[:, 0], 81 + number[:, 8]],
    )
    moves = "\n".join(f'[[motion]]\npatch = "{name}"\nrigid = {{ translation = {t} }}' for name, t in motions.items())
    (folder / "case.toml").write_text(CASE.format(roles='left = "moving"\nright = "moving"', motions=moves, count=1))
    return folder / "case.toml"


@pytest.mark.parametrize(
    ("left", "right"),
    [("[-0.03, 0.0]", "[0.03, 0.0]"), ("[0.0, 0.03]", "[0.0, -0.03]"), ("[0.03, 0.0]", "[0.03, 0.0]")],
)
def test_the_sides_of_an_interface_part_slide_and_move_together(
    server: Server, tmp_path: Path, left: str, right: str
) -> None:
    played = play(halves(tmp_path, {"left": left, "right": right}), tmp_path / "out", endpoint=server.endpoint)
    assert played.steps[-1].inverted_cells == 0


def test_an_interface_that_overlaps_is_refused_although_no_cell_is_inverted(server: Server, tmp_path: Path) -> None:
    path = halves(tmp_path, {"left": "[0.03, 0.0]", "right": "[-0.03, 0.0]"})
    with pytest.raises(QualityRefused, match="pass through itself at node 17 and node 90, which are at the same place"):
        play(path, tmp_path / "out", endpoint=server.endpoint)
