"""The polyMesh writer: ordering rules, geometry, and checkMesh's own opinion where OpenFOAM is installed."""

import subprocess
from pathlib import Path

import numpy as np
import pytest
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.metrics import reference_sizes

from benchmarks.peers.movers.small_task import small_task
from benchmarks.peers.openfoam.case import Settings, write_case
from benchmarks.peers.openfoam.foam_files import read_points
from benchmarks.peers.openfoam.polymesh import FRONT_AND_BACK, PolyMesh
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


def face_vectors(mesh: PolyMesh) -> tuple[np.ndarray, np.ndarray]:
    """Area vectors and centres of planar faces, by a fan of triangles."""
    areas, centres = [], []
    for row in mesh.faces:
        x = mesh.points[row[row >= 0]]
        parts = [np.cross(x[i] - x[0], x[i + 1] - x[0]) / 2 for i in range(1, len(x) - 1)]
        areas.append(np.sum(parts, axis=0))
        centres.append(x.mean(axis=0))
    return np.array(areas), np.array(centres)


@pytest.fixture(params=TYPES)
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def test_inner_faces_come_first_in_upper_triangular_order(kind: str) -> None:
    mesh = poly(task_of(kind))
    inner = len(mesh.neighbour)
    pairs = np.column_stack([mesh.owner[:inner], mesh.neighbour])
    assert (pairs[:, 0] < pairs[:, 1]).all()
    assert (np.lexsort((pairs[:, 1], pairs[:, 0])) == np.arange(inner)).all()
    assert len(np.unique(pairs, axis=0)) == inner  # two cells share one face


def test_patches_tile_the_boundary(kind: str) -> None:
    mesh = poly(task_of(kind))
    start = len(mesh.neighbour)
    for patch in mesh.patches:
        assert patch.start == start
        assert patch.count > 0
        start += patch.count
    assert start == len(mesh.faces)
    assert [patch.name for patch in mesh.patches][:2] == ["moving", "fixed"]
    assert ([p.kind for p in mesh.patches if p.name == FRONT_AND_BACK] == ["empty"]) == (TYPES[kind] == 2)


def test_every_cell_is_closed_and_has_its_volume(kind: str) -> None:
    """Gauss: normals that all point outwards sum to zero over a cell, and Σ S·x / 3 is its volume."""
    task = task_of(kind)
    mesh = poly(task)
    areas, centres = face_vectors(mesh)
    cells = CellTable.from_arrays(task.cells)
    closed = np.zeros((len(cells), 3))
    volume = np.zeros(len(cells))
    inner = len(mesh.neighbour)
    np.add.at(closed, mesh.owner, areas)
    np.add.at(closed, mesh.neighbour, -areas[:inner])
    flux = np.einsum("fi,fi->f", areas, centres) / 3
    np.add.at(volume, mesh.owner, flux)
    np.add.at(volume, mesh.neighbour, -flux[:inner])
    assert np.abs(closed).max() < 1e-14
    expected = reference_sizes(task.points, cells) * cells.blocks[0].type.size_factor
    if TYPES[kind] == 2:
        expected = expected * np.ptp(mesh.points[:, 2])
    np.testing.assert_allclose(volume, expected, rtol=1e-12)


def test_a_2d_node_is_two_points_and_comes_back() -> None:
    task = task_of("triangle")
    mesh = poly(task)
    n = len(task.points)
    assert len(mesh.points) == 2 * n
    assert (mesh.point_values(task.points)[n:, :2] == task.points).all()
    assert (mesh.node_values(mesh.points) == task.points).all()


def test_two_tetrahedra_by_hand() -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]], dtype=float)
    cells = CellTable.from_arrays({"tetra": np.array([[1, 2, 3, 4], [0, 1, 2, 3]])})
    mesh = PolyMesh.from_cells(points, cells, {"all": np.arange(5)})
    assert mesh.owner[0] == 0
    assert mesh.neighbour.tolist() == [1]
    assert sorted(mesh.faces[0].tolist()) == [-1, 1, 2, 3]
    # out of cell 0, whose other node is (1, 1, 1): towards the origin
    x = points[mesh.faces[0, :3]]
    assert (np.cross(x[1] - x[0], x[2] - x[0]) < 0).all()


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
