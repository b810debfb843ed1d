from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.files import read_mesh
from mesh_motion_server.files.reader import READERS


def test_a_missing_file_and_an_unknown_suffix(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="no such mesh file"):
        read_mesh(tmp_path / "none.npz")
    with pytest.raises(InvalidInput, match=r"known are \.npz, \.msh"):
        read_mesh(tmp_path / "mesh.stl")


@pytest.mark.parametrize("suffix", READERS)
def test_a_folder_is_no_mesh(tmp_path: Path, suffix: str) -> None:
    (tmp_path / f"folder{suffix}").mkdir()
    with pytest.raises(InvalidInput, match="no such mesh file"):
        read_mesh(tmp_path / f"folder{suffix}")


def test_reading_imports_neither_meshio_nor_gmsh() -> None:
    """Both are extras; only reading VTK files needs one."""
    code = "import sys, mesh_motion_server.files; sys.exit('meshio' in sys.modules or 'gmsh' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
