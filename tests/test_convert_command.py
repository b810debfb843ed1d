"""``mesh-motion convert`` as a user calls it."""

from pathlib import Path

import numpy as np
import pytest
from programs import mesh_motion

from mesh_motion_server.files import read_mesh

EXAMPLE = Path(__file__).parents[1] / "examples" / "thesis_rotation" / "mesh.npz"


def convert(folder: Path, *arguments: object) -> tuple[int, str, str]:
    return mesh_motion("convert", *arguments, cwd=folder)


@pytest.mark.parametrize("suffix", ["npz", "vtu"])
def test_there_and_back_and_moved(tmp_path: Path, suffix: str) -> None:
    mesh = read_mesh(EXAMPLE)
    status, out, _ = convert(tmp_path, EXAMPLE, f"mesh.{suffix}")
    assert (status, out) == (0, f"mesh.{suffix}: 2D, 723 nodes, 1342 triangle, 2 patches\n")
    np.save(tmp_path / "points.npy", mesh.points * 2)
    status, _, _ = convert(tmp_path, f"mesh.{suffix}", f"moved.{suffix}", "--points", "points.npy")
    assert status == 0
    moved = read_mesh(tmp_path / f"moved.{suffix}")
    np.testing.assert_array_equal(moved.points, mesh.points * 2)
    assert {name: nodes.tolist() for name, nodes in moved.patches.items()} == {
        name: nodes.tolist() for name, nodes in mesh.patches.items()
    }


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((EXAMPLE, "mesh.su2"), "mesh.su2: .npz and .vtu are written (give a file name with such an ending)"),
        (("none.msh", "mesh.npz"), "none.msh: no such mesh file"),
        ((EXAMPLE, "mesh.npz", "--points", "none.npy"), "none.npy: cannot be read"),
        (("none.msh", "missing/mesh.npz"), "missing/mesh.npz: there is no folder"),
        ((EXAMPLE, "mesh.npz", "--points", EXAMPLE), "not readable as a .npy file"),
    ],
)
def test_a_conversion_that_is_impossible_is_refused_in_one_line(
    tmp_path: Path, arguments: tuple[object, ...], message: str
) -> None:
    status, out, error = convert(tmp_path, *arguments)
    assert (status, out) == (2, "")
    assert message in error
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_points_of_another_mesh_are_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "points.npy", np.zeros((2, 2)))
    status, _, error = convert(tmp_path, EXAMPLE, "mesh.npz", "--points", "points.npy")
    assert status == 2
    assert "expected finite real coordinates of shape (723, 2), got float64 of shape (2, 2)" in error


def test_partitions_in_a_folder_and_one_of_them_as_a_mesh(tmp_path: Path) -> None:
    status, out, _ = convert(tmp_path, EXAMPLE, "parts", "--partitions", 3)
    assert (status, out) == (0, "parts: 2D, 723 nodes, 1342 triangle, 2 patches, 3 partitions\n")
    files = sorted((tmp_path / "parts").iterdir())
    assert [file.name for file in files] == [f"partition-00{number}.npz" for number in range(3)]
    assert sum(read_mesh(file).n_cells for file in files) == 1342
    assert convert(tmp_path, files[1], "part.npz")[0] == 0
    np.testing.assert_array_equal(read_mesh(tmp_path / "part.npz").global_ids, read_mesh(files[1]).global_ids)
    status, _, error = convert(tmp_path, EXAMPLE, "many", "--partitions", 2000)
    assert "1342 cells in 2000 partitions leaves partition" in error
    assert status
    assert not (tmp_path / "many").exists()
    (tmp_path / "file").touch()
    assert "is not a folder" in convert(tmp_path, EXAMPLE, "file", "--partitions", 2)[2]
    assert (
        "'--partitions': Input should be greater than or equal to 1"
        in convert(tmp_path, EXAMPLE, "none", "--partitions", 0)[2]
    )
