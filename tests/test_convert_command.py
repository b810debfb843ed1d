"""``mesh-motion convert`` as people meet it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mesh_motion_server.files import read_mesh

EXAMPLE = Path(__file__).parents[1] / "examples" / "thesis_rotation" / "mesh.npz"


def convert(folder: Path, *arguments: object) -> tuple[int, str, str]:
    done = subprocess.run(
        [sys.executable, "-m", "mesh_motion_server", "convert", *map(str, arguments)],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    return done.returncode, done.stdout, done.stderr


def test_there_and_back_and_moved(tmp_path: Path) -> None:
    mesh = read_mesh(EXAMPLE)
    status, out, _ = convert(tmp_path, EXAMPLE, "mesh.su2")
    assert (status, out) == (0, "mesh.su2: 2D, 723 nodes, 1342 triangle, 2 patches\n")
    np.save(tmp_path / "points.npy", mesh.points * 2)
    status, _, _ = convert(tmp_path, "mesh.su2", "moved.su2", "--points", "points.npy")
    assert status == 0
    np.testing.assert_array_equal(read_mesh(tmp_path / "moved.su2").points, mesh.points * 2)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((EXAMPLE, "mesh.stl"), "mesh.stl: unknown kind of mesh file"),
        (("none.msh", "mesh.su2"), "none.msh: no such mesh file"),
        ((EXAMPLE, "mesh.su2", "--points", "none.npy"), "none.npy: cannot be read"),
        (("none.msh", "missing/mesh.su2"), "missing/mesh.su2: there is no folder"),
        (("none.msh", EXAMPLE / "case"), f"{EXAMPLE} is no folder"),
        ((EXAMPLE, "mesh.su2", "--points", EXAMPLE), "not readable as a .npy file"),
    ],
)
def test_what_cannot_be_done_is_one_line(tmp_path: Path, arguments: tuple[object, ...], message: str) -> None:
    status, out, error = convert(tmp_path, *arguments)
    assert (status, out) == (2, "")
    assert message in error
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())
