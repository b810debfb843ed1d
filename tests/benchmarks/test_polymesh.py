"""The polyMesh writer: ordering rules, geometry, and checkMesh's own opinion where OpenFOAM is installed."""

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.metrics import reference_sizes

from benchmarks.peers.movers.small_task import small_task
from benchmarks.peers.openfoam.case import Settings, write_case
from benchmarks.peers.openfoam.foam_files import read_points
from benchmarks.peers.openfoam.polymesh import PolyMesh
from benchmarks.peers.openfoam.run import environment, missing
from benchmarks.peers.task import Task

TYPES = {"triangle": 2, "quad": 2, "tetra": 3, "hexahedron": 3}


def task_of(kind: str) -> Task:
    d = TYPES[kind]
    shell = Task(
        np.empty((0, d)), {kind: np.empty((0, d), dtype=np.int64)}, *[np.empty(0, dtype=np.int64)] * 2, np.empty(0)
    )
    return small_task(shell)


def poly(task: Task) -> PolyMesh:
    patches = {"moving": task.moving, "fixed": task.fixed}
    return PolyMesh.from_cells(task.points, CellTable.from_arrays(task.cells), patches)


@pytest.fixture(params=TYPES)
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def test_a_2d_node_is_two_points_and_comes_back() -> None:
    task = task_of("triangle")
    mesh = poly(task)
    n = len(task.points)
    assert len(mesh.points) == 2 * n
    assert (mesh.point_values(task.points)[n:, :2] == task.points).all()
    assert (mesh.node_values(mesh.points) == task.points).all()


def test_a_face_without_a_patch_is_named() -> None:
    points = np.array([[0.0, 0], [1, 0], [0, 1]])
    cells = CellTable.from_arrays({"triangle": np.array([[0, 1, 2]])})
    with pytest.raises(ValueError, match="2 boundary faces belong to no patch"):
        PolyMesh.from_cells(points, cells, {"one": np.array([0, 1])})


def test_points_survive_the_binary_file(tmp_path: Path, kind: str) -> None:
    mesh = write_case(task_of(kind), tmp_path, Settings())
    assert (read_points(tmp_path / "constant" / "polyMesh" / "points") == mesh.points).all()


def test_a_file_that_holds_no_points_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "points"
    path.write_text("FoamFile\n{\n    format ascii;\n}\n1\n((0 0 0))\n", encoding="ascii")
    with pytest.raises(ValueError, match="binary list"):
        read_points(path)


@pytest.mark.skipif(missing() is not None, reason=str(missing()))
def test_openfoam_accepts_the_mesh(tmp_path: Path, kind: str) -> None:
    write_case(task_of(kind), tmp_path, Settings())
    done = subprocess.run(
        ["checkMesh", "-case", str(tmp_path)], check=False, capture_output=True, text=True, env=environment()
    )
    assert "Mesh OK." in done.stdout, done.stdout[-2000:]
    assert "Upper triangular ordering OK." in done.stdout
    task = task_of(kind)
    cells = CellTable.from_arrays(task.cells)
    area = reference_sizes(task.points, cells).sum() * cells.blocks[0].type.size_factor
    thickness = np.ptp(poly(task).points[:, 2]) if TYPES[kind] == 2 else 1.0
    (volume,) = re.findall(r"Total volume = ([\d.e+-]+)\. ", done.stdout)
    assert float(volume) == pytest.approx(area * thickness, rel=1e-5)
