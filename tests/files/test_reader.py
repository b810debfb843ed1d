import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mesh_files import refused_when_damaged
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.files import MeshFile, read_mesh, write_mesh
from mesh_motion_server.files.reader import SUFFIXES


def test_a_missing_file_and_an_unknown_suffix(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="no such mesh file"):
        read_mesh(tmp_path / "none.npz")
    (tmp_path / "mesh.odd").write_text("odd")
    with pytest.raises(InvalidInput, match=r"known are \.npz, \.msh"):
        read_mesh(tmp_path / "mesh.odd")


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_folder_is_no_mesh(tmp_path: Path, suffix: str) -> None:
    (tmp_path / f"folder{suffix}").mkdir()
    with pytest.raises(InvalidInput, match="neither an OpenFOAM case nor a polyMesh folder"):
        read_mesh(tmp_path / f"folder{suffix}")


def test_a_folder_with_a_name_that_is_not_in_utf_8(tmp_path: Path) -> None:
    (tmp_path / "a\udc80b").touch()
    with pytest.raises(InvalidInput, match="neither an OpenFOAM case nor a polyMesh folder"):
        read_mesh(tmp_path)


@pytest.mark.parametrize("suffix", ["npz", "vtu"])
def test_a_patch_whose_name_no_session_can_have_is_left_out_and_named(tmp_path: Path, suffix: str) -> None:
    """`check` called such a mesh usable, and `play` refused it."""
    points, quad = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]), np.array([[0, 1, 2, 3]])
    names = ["", "ü" * 128, "ü" * 129]
    patches = {name: np.array([number]) for number, name in enumerate(names)}
    write_mesh(tmp_path / f"m.{suffix}", MeshFile(points, {"quad": quad}, patches, tmp_path))
    mesh = read_mesh(tmp_path / f"m.{suffix}")
    assert {name: nodes.tolist() for name, nodes in mesh.patches.items()} == {"ü" * 128: [1]}
    assert mesh.notes == (
        "the patch '' is left out: its name has 0 bytes, expected 1 to 256",
        f"the patch '{'ü' * 40}' is left out: its name has 258 bytes, expected 1 to 256",
    )


def test_reading_imports_neither_h5py_nor_gmsh() -> None:
    """Both packages are extras; only reading HDF5 needs one."""
    code = "import sys, mesh_motion_server.files; sys.exit('h5py' in sys.modules or 'gmsh' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def _files(folder: Path) -> dict[str, bytes]:
    """A small valid mesh in each format that is read without extras."""
    square = '$MeshFormat\n{version} 0 8\n$EndMeshFormat\n$PhysicalNames\n1\n1 1 "wall"\n$EndPhysicalNames\n'
    msh22 = square.format(version=2.2) + (
        "$Nodes\n4\n1 0 0 0\n2 1 0 0\n3 1 1 0\n4 0 1 0\n$EndNodes\n"
        "$Elements\n3\n1 1 2 1 1 1 2\n2 2 2 5 1 1 2 3\n3 2 2 5 1 1 3 4\n$EndElements\n"
    )
    msh41 = square.format(version=4.1) + (
        "$Entities\n0 1 1 0\n1 0 0 0 1 0 0 1 1 0\n1 0 0 0 1 1 0 0 1 1\n$EndEntities\n"
        "$Nodes\n1 4 1 4\n2 1 0 4\n1\n2\n3\n4\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n$EndNodes\n"
        "$Elements\n2 3 1 3\n1 1 1 1\n1 1 2\n2 1 2 2\n2 1 2 3\n3 1 3 4\n$EndElements\n"
    )
    su2 = (
        "NDIME= 2\nNELEM= 2\n5 0 1 2\n5 0 2 3\nNPOIN= 4\n0 0\n1 0\n1 1\n0 1\n"
        "NMARK= 1\nMARKER_TAG= wall\nMARKER_ELEMS= 1\n3 0 1\n"
    )
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    cells = np.array([[0, 1, 2], [0, 2, 3]])
    np.savez(folder / "seed.npz", points=points, cells_triangle=cells, patch_wall=np.array([0, 1]))
    return {
        "a.msh": msh22.encode(),
        "b.msh": msh41.encode(),
        "c.su2": su2.encode(),
        "d.npz": (folder / "seed.npz").read_bytes(),
    }


@pytest.mark.parametrize("name", ["a.msh", "b.msh", "c.su2", "d.npz"])
def test_every_format_says_the_same_and_a_damaged_byte_never_more_than_one_line(tmp_path: Path, name: str) -> None:
    content = _files(tmp_path)[name]
    path = tmp_path / name
    path.write_bytes(content)
    mesh = read_mesh(path)
    np.testing.assert_array_equal(mesh.cells["triangle"], [[0, 1, 2], [0, 2, 3]])
    np.testing.assert_array_equal(mesh.patches["wall"], [0, 1])
    assert refused_when_damaged(path, path, 400, np.random.default_rng(2024)) > 50
