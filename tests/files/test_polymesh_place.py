"""Moved points of a case go to the time that is meant, however it is written, and nothing else goes with them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.files import MeshFile, check_target, read_mesh, write_mesh, write_moved


@pytest.fixture
def case(tmp_path: Path) -> MeshFile:
    points = np.array([[0, 0], [1, 0], [0, 1], [1, 1]], dtype=np.float64)
    cells = {"triangle": np.array([[0, 1, 3], [0, 3, 2]])}
    write_mesh(tmp_path / "case", MeshFile(points, cells, {"low": np.array([0, 1])}, Path("made")))
    return read_mesh(tmp_path / "case")


def files(folder: Path) -> set[str]:
    return {str(file.relative_to(folder)) for file in folder.rglob("*") if file.is_file()}


@pytest.mark.parametrize(
    "target",
    ["0.5", "0.5/polyMesh", "1e+06", "1e+06/polyMesh", "1E-05/polyMesh", "2", "-180", "2.5e-07"],
)
@pytest.mark.parametrize("exists", [False, True])
def test_a_time_gets_the_points_alone(case: MeshFile, target: str, exists: bool) -> None:
    before = files(case.path)
    time = target.removesuffix("/polyMesh")
    if exists:
        (case.path / time).mkdir()
    write_moved(case.path / target, case, case.points * 2)
    assert files(case.path) - before == {f"{time}/polyMesh/points"}


@pytest.mark.parametrize("target", ["polyMesh", "."])
def test_from_inside_of_the_time(case: MeshFile, target: str, monkeypatch: pytest.MonkeyPatch) -> None:
    before = files(case.path)
    (case.path / "0.5").mkdir()
    monkeypatch.chdir(case.path / "0.5")
    write_moved(Path(target), case, case.points * 2)
    assert files(case.path) - before == {"0.5/polyMesh/points"}


def test_a_link_to_a_time_and_a_time_that_is_a_link(case: MeshFile, tmp_path: Path) -> None:
    (case.path / "0.5").mkdir()
    (case.path / "latest").symlink_to("0.5")
    (tmp_path / "elsewhere").mkdir()
    (case.path / "3").symlink_to(tmp_path / "elsewhere")
    for target in ("latest", "3"):
        write_moved(case.path / target, case, case.points * 2)
    assert files(case.path / "0.5") == files(tmp_path / "elsewhere") == {"polyMesh/points"}


def test_a_number_outside_of_a_case_is_a_case(case: MeshFile, tmp_path: Path) -> None:
    write_moved(tmp_path / "2", case, case.points * 2)
    np.testing.assert_array_equal(read_mesh(tmp_path / "2").points, case.points * 2)
    write_mesh(tmp_path / "3", case)
    assert "constant/polyMesh/faces" in files(tmp_path / "3")


def test_a_time_with_a_mesh_of_its_own_is_refused(case: MeshFile) -> None:
    write_mesh(case.path / "7", case)
    before = (case.path / "7" / "polyMesh" / "points").read_bytes()
    with pytest.raises(InvalidInput, match=r"7/polyMesh: there is a mesh already"):
        write_moved(case.path / "7", case, case.points * 2)
    with pytest.raises(InvalidInput, match=r"7/polyMesh: there is a mesh already"):
        check_target(case.path / "7", case)
    check_target(case.path, case)
    check_target(case.path / "8", case)
    assert (case.path / "7" / "polyMesh" / "points").read_bytes() == before
