"""What we write, VTK itself reads back; and what VTK and meshio write, we read."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.files import VtuSeries, read_mesh, write_vtu
from mesh_motion_server.numerics.mesh.cells import CellTable
from mesh_motion_server.numerics.quality.orientation import oriented

Mesh = tuple[np.ndarray, dict[str, np.ndarray]]


def vtk_read(path: Path) -> Any:
    xml = pytest.importorskip("vtkmodules.vtkIOXML")
    reader = xml.vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(path))
    reader.Update()
    assert reader.GetErrorCode() == 0
    return reader.GetOutput()


def test_vtk_reads_points_cells_and_data(tmp_path: Path, all_solids: Mesh) -> None:
    support = pytest.importorskip("vtkmodules.util.numpy_support")
    points, cells = all_solids
    table = CellTable.from_arrays(cells)
    size = np.linspace(0.0, 1.0, len(table))
    path = tmp_path / "solids.vtu"
    write_vtu(path, points, table, point_data={"displacement": points * 2}, cell_data={"size": size, "bad": size > 0.5})
    grid = vtk_read(path)
    np.testing.assert_array_equal(support.vtk_to_numpy(grid.GetPoints().GetData()), points)
    np.testing.assert_array_equal(support.vtk_to_numpy(grid.GetPointData().GetArray("displacement")), points * 2)
    np.testing.assert_array_equal(support.vtk_to_numpy(grid.GetCellData().GetArray("size")), size)
    np.testing.assert_array_equal(support.vtk_to_numpy(grid.GetCellData().GetArray("bad")), [0, 0, 1, 1])
    np.testing.assert_array_equal(support.vtk_to_numpy(grid.GetCellData().GetArray("cell")), [0, 0, 0, 0])
    types = [grid.GetCellType(i) for i in range(grid.GetNumberOfCells())]
    assert types == [10, 12, 13, 14]


def test_vtk_measures_the_volumes_we_mean(tmp_path: Path, all_solids: Mesh) -> None:
    """Every cell arrives with a positive volume in VTK's own orientation, wedges included."""
    verdict = pytest.importorskip("vtkmodules.vtkFiltersVerdict")
    support = pytest.importorskip("vtkmodules.util.numpy_support")
    points, cells = all_solids
    table = CellTable.from_arrays(cells)
    write_vtu(tmp_path / "solids.vtu", points, table)
    sizes = verdict.vtkCellSizeFilter()
    sizes.SetInputData(vtk_read(tmp_path / "solids.vtu"))
    sizes.Update()
    volumes = support.vtk_to_numpy(sizes.GetOutput().GetCellData().GetArray("Volume"))
    assert volumes == pytest.approx([0.6 / 6, 1.0, 0.5, 0.7 / 3])


def test_two_dimensions_are_filled_up(tmp_path: Path) -> None:
    support = pytest.importorskip("vtkmodules.util.numpy_support")
    points = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    table = CellTable.from_arrays({"triangle": np.array([[0, 1, 2]])})
    write_vtu(tmp_path / "flat.vtu", points, table, point_data={"displacement": points})
    grid = vtk_read(tmp_path / "flat.vtu")
    np.testing.assert_array_equal(
        support.vtk_to_numpy(grid.GetPointData().GetArray("displacement")), np.pad(points, ((0, 0), (0, 1)))
    )


def test_our_own_files_come_back(tmp_path: Path, all_solids: Mesh) -> None:
    pytest.importorskip("meshio")
    points, cells = all_solids
    marks = np.array([1, 1, 1, 1, *[0] * 8])
    write_vtu(tmp_path / "m.vtu", points, CellTable.from_arrays(cells), point_data={"patch_base": marks})
    mesh = read_mesh(tmp_path / "m.vtu")
    np.testing.assert_array_equal(mesh.points, points)
    found = {block.type.name: block.nodes for block in oriented(points, mesh.cell_table).cells}  # meshio turns wedges
    for name, nodes in cells.items():
        np.testing.assert_array_equal(found[name], nodes)
    assert {name: list(nodes) for name, nodes in mesh.patches.items()} == {"base": [0, 1, 2, 3]}


def fan(nodes: int, triangles: int) -> tuple[np.ndarray, CellTable]:
    """So many nodes, and triangles that all have the first of them."""
    angles = np.linspace(0.0, 6.0, nodes - 1)
    points = np.concatenate([np.zeros((1, 2)), np.column_stack([np.cos(angles), np.sin(angles)])])
    rows = 1 + np.arange(triangles) % (nodes - 2)
    return points, CellTable.from_arrays({"triangle": np.column_stack([np.zeros_like(rows), rows, rows + 1])})


@pytest.mark.parametrize("counts", [(20, 39), (11, 7), (40, 60)])
def test_every_array_of_a_result_of_ours_is_found_again(tmp_path: Path, counts: tuple[int, int]) -> None:
    """With the arrays that a run leaves; meshio alone takes those of (20, 39) for each other."""
    pytest.importorskip("meshio")
    points, table = fan(*counts)
    quality = {name: np.linspace(0, 1, len(table)) for name in ("size", "skew", "size_skew")}
    write_vtu(tmp_path / "m.vtu", points, table, point_data={"displacement": 0 * points}, cell_data=quality)
    mesh = read_mesh(tmp_path / "m.vtu")
    np.testing.assert_array_equal(mesh.points, points)
    np.testing.assert_array_equal(mesh.cells["triangle"], next(iter(table)).nodes)


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("word", [32, 64])
@pytest.mark.parametrize("compressor", ["None", "ZLib", "LZMA"])
def test_appended_data_of_vtk_itself(tmp_path: Path, compressor: str, word: int, big: bool) -> None:
    pytest.importorskip("meshio")
    xml = pytest.importorskip("vtkmodules.vtkIOXML")
    points, table = fan(5000, 4000)  # more than one block
    write_vtu(tmp_path / "m.vtu", points, table, point_data={"patch_rim": np.arange(len(points)) > 0})
    writer = xml.vtkXMLUnstructuredGridWriter()
    writer.SetFileName(str(tmp_path / "theirs.vtu"))
    writer.SetInputData(vtk_read(tmp_path / "m.vtu"))
    writer.SetDataModeToAppended()
    writer.EncodeAppendedDataOff()
    getattr(writer, f"SetCompressorTypeTo{compressor}")()
    getattr(writer, f"SetHeaderTypeToUInt{word}")()
    if big:
        writer.SetByteOrderToBigEndian()
    assert writer.Write()
    mesh = read_mesh(tmp_path / "theirs.vtu")
    np.testing.assert_array_equal(mesh.points, points)
    np.testing.assert_array_equal(mesh.cells["triangle"], next(iter(table)).nodes)
    np.testing.assert_array_equal(mesh.patches["rim"], np.arange(1, len(points)))


def test_appended_data_that_ends_too_soon_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("meshio")
    path = tmp_path / "m.vtu"
    write_vtu(path, *fan(20, 39))
    whole = path.read_bytes()
    end = whole.index(b"\n</AppendedData>")
    for lost in (1, 100, 700, end - whole.index(b"\n_") - 2):
        path.write_bytes(whole[: end - lost] + whole[end:])
        with pytest.raises(InvalidInput, match=r"not readable as \.vtu") as caught:
            read_mesh(path)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("suffix", [".vtu", ".vtk"])
@pytest.mark.parametrize("array", ["patch", "patch_left"])
def test_patches_from_cell_arrays_of_the_edges(tmp_path: Path, suffix: str, array: str) -> None:
    meshio = pytest.importorskip("meshio")
    points = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    cells = [("triangle", np.array([[0, 1, 2], [0, 2, 3]])), ("line", np.array([[3, 0], [1, 2]]))]
    marks = [np.array([9, 9]), np.array([4, 0])]  # what cells of the mesh itself carry is not a patch
    meshio.Mesh(points, cells, cell_data={array: marks}).write(tmp_path / f"m{suffix}")
    mesh = read_mesh(tmp_path / f"m{suffix}")
    assert mesh.dimension == 2
    assert {name: list(nodes) for name, nodes in mesh.patches.items()} == {"4" if array == "patch" else "left": [0, 3]}


def test_legacy_files_of_vtk_itself(tmp_path: Path) -> None:
    legacy = pytest.importorskip("vtkmodules.vtkIOLegacy")
    pytest.importorskip("meshio")
    points = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    write_vtu(tmp_path / "m.vtu", points, CellTable.from_arrays({"triangle": np.array([[0, 1, 2]])}))
    writer = legacy.vtkUnstructuredGridWriter()
    writer.SetFileName(str(tmp_path / "m.vtk"))
    writer.SetInputData(vtk_read(tmp_path / "m.vtu"))
    writer.Write()
    np.testing.assert_array_equal(read_mesh(tmp_path / "m.vtk").points, points)


def test_a_series_lists_its_times(tmp_path: Path) -> None:
    points = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    table = CellTable.from_arrays({"triangle": np.array([[0, 1, 2]])})
    series = VtuSeries(tmp_path, "mesh")
    for time in (0.0, 0.5):
        series.write(time, points + time, table)
    assert sorted(f.name for f in tmp_path.iterdir()) == ["mesh.pvd", "mesh_0000.vtu", "mesh_0001.vtu"]
    assert '<DataSet timestep="0.5" file="mesh_0001.vtu"/>' in (tmp_path / "mesh.pvd").read_text()


@pytest.mark.parametrize("suffix", [".vtu", ".vtk"])
@pytest.mark.parametrize("content", ["", "<VTKFile>", "<VTKFile type='PolyData'/>", "no mesh\n" * 10])
def test_damaged_files_give_one_clear_line(tmp_path: Path, suffix: str, content: str) -> None:
    pytest.importorskip("meshio")
    path = tmp_path / f"damaged{suffix}"
    path.write_text(content)
    with pytest.raises(InvalidInput, match="not readable") as caught:
        read_mesh(path)
    assert "\n" not in str(caught.value)


def test_other_cells_are_refused(tmp_path: Path) -> None:
    meshio = pytest.importorskip("meshio")
    meshio.Mesh(np.random.default_rng(0).random((6, 3)), [("triangle6", np.arange(6)[None])]).write(tmp_path / "m.vtu")
    with pytest.raises(InvalidInput, match="triangle6"):
        read_mesh(tmp_path / "m.vtu")


def test_without_meshio_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "m.vtu").write_text("")
    monkeypatch.setitem(sys.modules, "meshio", None)
    with pytest.raises(InvalidInput, match=r"mesh-motion-server\[mesh\]"):
        read_mesh(tmp_path / "m.vtu")


def test_why_meshio_gave_up_is_told(tmp_path: Path) -> None:
    pytest.importorskip("meshio")
    path = tmp_path / "surface.vtk"
    path.write_text("# vtk DataFile Version 3.0\nsurface\nASCII\nDATASET POLYDATA\nPOINTS 1 float\n0 0 0\n")
    with pytest.raises(InvalidInput, match=r"surface\.vtk: not readable as \.vtk: .*not POLYDATA"):
        read_mesh(path)
