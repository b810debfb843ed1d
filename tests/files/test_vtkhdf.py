"""A series in one file, as VTK reads it, and as it lies on the disk when its writer was killed."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.files.series import open_series
from mesh_motion_server.files.vtkhdf import VtkHdfSeries
from mesh_motion_server.numerics.mesh.cells import CellTable

h5py = pytest.importorskip("h5py")

FloatArray = NDArray[np.float64]
VTK_TYPES = {"triangle": 5, "quad": 9, "tetra": 10, "hexahedron": 12, "wedge": 13, "pyramid": 14}


def grids_of(path: Path) -> list[tuple[float, Any]]:
    """Each time and grid that VTK finds in the file."""
    io = pytest.importorskip("vtkmodules.vtkIOHDF")
    from vtkmodules.vtkCommonDataModel import vtkUnstructuredGrid  # noqa: PLC0415
    from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline as Pipeline  # noqa: PLC0415

    reader = io.vtkHDFReader()
    reader.SetFileName(str(path))
    reader.UpdateInformation()
    key, information = Pipeline.TIME_STEPS(), reader.GetOutputInformation(0)
    found = []
    if not information.Has(key):  # VTK takes a single time for no series
        reader.Update()
        return [(0.0, reader.GetOutput())]
    for index in range(information.Length(key)):
        time = information.Get(key, index)
        reader.UpdateTimeStep(time)
        grid = vtkUnstructuredGrid()
        grid.DeepCopy(reader.GetOutput())
        found.append((time, grid))
    return found


def array(values: Any) -> NDArray[Any]:
    from vtkmodules.util.numpy_support import vtk_to_numpy  # noqa: PLC0415

    return vtk_to_numpy(values)


def check(path: Path, cells: CellTable, times: list[float], points: list[FloatArray]) -> None:
    """VTK finds these points and cells, and the arrays that :func:`write` adds."""
    grids = grids_of(path)
    assert [time for time, _ in grids] == times
    for k, ((_, grid), expected) in enumerate(zip(grids, points, strict=True)):
        np.testing.assert_array_equal(array(grid.GetPoints().GetData())[:, : expected.shape[1]], expected)
        assert grid.GetNumberOfCells() == len(cells)
        row = 0
        for block in cells:
            for nodes in block.nodes:
                assert grid.GetCellType(row) == VTK_TYPES[block.type.name]
                ids = grid.GetCell(row).GetPointIds()
                assert [ids.GetId(i) for i in range(ids.GetNumberOfIds())] == nodes.tolist()
                row += 1
        data = grid.GetPointData()
        np.testing.assert_array_equal(
            array(data.GetArray("displacement"))[:, : expected.shape[1]], expected - points[0]
        )
        np.testing.assert_array_equal(array(data.GetArray("on")), np.arange(len(expected)) % 2)
        np.testing.assert_array_equal(array(grid.GetCellData().GetArray("size_skew")), quality(cells, k))


def quality(cells: CellTable, k: int) -> FloatArray:
    return np.linspace(-1.0, 1.0, len(cells)) ** (k + 1)


def write(series: Any, time: float, k: int, points: FloatArray, first: FloatArray, cells: CellTable) -> None:
    series.write(
        time,
        points,
        cells,
        point_data={"displacement": points - first, "on": np.arange(len(points)) % 2 == 1},
        cell_data={"size_skew": quality(cells, k)},
    )


def test_vtk_finds_all_solids_at_every_time(tmp_path: Path, all_solids: tuple[FloatArray, dict[str, Any]]) -> None:
    first, arrays = all_solids
    cells = CellTable.from_arrays(arrays)
    moved = [first + 0.1 * k * np.sin(first[:, ::-1] + k) for k in range(4)]
    times = [0.0, 0.1, 0.5, 1e9]
    with open_series("vtkhdf", tmp_path, "mesh", 6) as series:
        for k, points in enumerate(moved):
            write(series, times[k], k, points, first, cells)
            check(tmp_path / "mesh.vtkhdf", cells, times[: k + 1], moved[: k + 1])  # while it is open for writing
    check(tmp_path / "mesh.vtkhdf", cells, times, moved)
    assert [file.name for file in tmp_path.iterdir()] == ["mesh.vtkhdf"]


def test_a_plane_mesh_lies_at_z_0(tmp_path: Path) -> None:
    first = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [2.0, 0.5]])
    cells = CellTable.from_arrays({"triangle": np.array([[1, 4, 2]]), "quad": np.array([[0, 1, 2, 3]])})
    with open_series("vtkhdf", tmp_path, "mesh", 2) as series:
        write(series, 0.0, 0, first, first, cells)
        write(series, 2.0, 1, first * 2, first, cells)
    check(tmp_path / "mesh.vtkhdf", cells, [0.0, 2.0], [first, first * 2])
    assert not array(grids_of(tmp_path / "mesh.vtkhdf")[1][1].GetPoints().GetData())[:, 2].any()


def test_cells_are_stored_once(tmp_path: Path) -> None:
    n = 20_000
    points = np.random.default_rng(0).random((n, 3))
    cells = CellTable.from_arrays({"tetra": np.arange(n).reshape(-1, 4)})
    with open_series("vtkhdf", tmp_path, "mesh", 3) as series:
        for k in range(3):
            series.write(float(k), points, cells)
    with h5py.File(tmp_path / "mesh.vtkhdf") as file:
        assert file["VTKHDF/Connectivity"].shape == (n,)
        assert file["VTKHDF/Points"].shape == (3 * n, 3)
    assert (tmp_path / "mesh.vtkhdf").stat().st_size < 3 * points.nbytes + 4 * n


ENDLESS = """
import sys
import numpy as np
from pathlib import Path
from mesh_motion_server.files.vtkhdf import VtkHdfSeries
from mesh_motion_server.numerics.mesh.cells import CellTable
points = np.arange(3.0 * 400).reshape(400, 3)
cells = CellTable.from_arrays({"tetra": np.arange(400).reshape(-1, 4)})
series = VtkHdfSeries(Path(sys.argv[1]), "mesh", 100_000)
for k in range(100_000):
    series.write(k + 1.0, points + k, cells, cell_data={"step": np.full(100, float(k))})
    if k == 0:
        print("first", flush=True)
"""


def whole_steps(path: Path) -> int:
    """How many steps the file has; each is whole, and all but the last surely has its time."""
    with h5py.File(path, locking=False) as file:
        root = file["VTKHDF"]
        count = int(root["Steps"].attrs["NSteps"])
        values = root["Steps/Values"][:]
        assert count - 1 <= len(values) <= count
        np.testing.assert_array_equal(values[: count - 1], np.arange(1, count))
        for k in {0, count // 2, count - 1}:
            np.testing.assert_array_equal(
                root["Points"][400 * k : 400 * (k + 1)], np.arange(1200.0).reshape(400, 3) + k
            )
            assert (root["CellData/step"][100 * k : 100 * (k + 1)] == k).all()
    return count


def test_the_check_sees_a_step_that_is_told_but_not_there(tmp_path: Path) -> None:
    points, cells = np.arange(1200.0).reshape(400, 3), CellTable.from_arrays({"tetra": np.arange(400).reshape(-1, 4)})
    with open_series("vtkhdf", tmp_path, "mesh", 4) as series:
        for k in range(2):
            series.write(k + 1.0, points + k, cells, cell_data={"step": np.full(100, float(k))})
    assert whole_steps(tmp_path / "mesh.vtkhdf") == 2
    with h5py.File(tmp_path / "mesh.vtkhdf", "r+") as file:
        file["VTKHDF/Steps"].attrs.modify("NSteps", 3)
    with pytest.raises(AssertionError):
        whole_steps(tmp_path / "mesh.vtkhdf")


@pytest.mark.slow
def test_what_a_killed_writer_leaves_has_every_whole_step(tmp_path: Path) -> None:
    delays = np.random.default_rng(3).uniform(0.0, 0.05, 12)
    counts = []
    for number, delay in enumerate(delays):
        folder = tmp_path / str(number)
        folder.mkdir()
        with subprocess.Popen([sys.executable, "-c", ENDLESS, str(folder)], stdout=subprocess.PIPE) as writer:
            assert writer.stdout is not None
            assert writer.stdout.readline() == b"first\n"
            try:
                writer.wait(float(delay))
            except subprocess.TimeoutExpired:
                writer.send_signal(signal.SIGKILL)
            writer.wait()
        counts.append(whole_steps(folder / "mesh.vtkhdf"))
    assert min(counts) >= 1
    assert len(set(counts)) > 1


def test_without_h5py_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(InvalidInput, match=r"mesh-motion-server\[mesh\]"):
        VtkHdfSeries(tmp_path, "mesh", 2)
