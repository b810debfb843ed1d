"""VTK itself reads our files; we read files of VTK and meshio."""

import base64
import lzma
import re
import struct
import tracemalloc
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from frame_meshes import tensor_grid, without_unused
from mesh_files import lists, one_line, replaced
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.orientation import oriented
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.files import VtuSeries, read_mesh, write_mesh, write_vtu

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
    """This number of nodes, and triangles that all use the first node."""
    angles = np.linspace(0.0, 6.0, nodes - 1)
    points = np.concatenate([np.zeros((1, 2)), np.column_stack([np.cos(angles), np.sin(angles)])])
    rows = 1 + np.arange(triangles) % (nodes - 2)
    return points, CellTable.from_arrays({"triangle": np.column_stack([np.zeros_like(rows), rows, rows + 1])})


@pytest.mark.parametrize("counts", [(20, 39), (11, 7), (40, 60)])
def test_every_array_of_a_result_of_ours_is_found_again(tmp_path: Path, counts: tuple[int, int]) -> None:
    """With the arrays of a run; only meshio confuses arrays of (20, 39) with each other."""
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


@pytest.mark.parametrize("compressor", ["vtkZLibDataCompressor", "vtkLZMADataCompressor"])
@pytest.mark.parametrize("place", ["binary", "base64", "raw"])
@pytest.mark.parametrize(
    ("points", "reason"),
    [
        (1 << 17, r"m\.vtu: \d+ bytes that hold 104857\d or more, expected at most"),
        (1, r"array 'Points': it holds more than the 24 bytes that are expected"),
    ],
)
def test_a_small_file_that_would_fill_the_memory_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, compressor: str, place: str, points: int, reason: str
) -> None:
    """The content of a block counts, not the size in its header; at most the bytes for the piece's points are
    unpacked.
    """
    monkeypatch.setattr("mesh_motion_server.files.packages._UNPACKED_BYTES", 1 << 20)
    block = (zlib if "ZLib" in compressor else lzma).compress(bytes(3 << 20))
    head = struct.pack("<4Q", 1, 24, 0, len(block))
    text = head + block if place == "raw" else base64.b64encode(head) + base64.b64encode(block)
    inside, outside = (text, b"") if place == "binary" else (b"", b'<AppendedData encoding="%s">_%s\n</AppendedData>')
    if outside:
        outside %= place.encode(), text
    (tmp_path / "m.vtu").write_bytes(
        b'<VTKFile type="UnstructuredGrid" byte_order="LittleEndian" header_type="UInt64" compressor="%s">'
        b'<UnstructuredGrid><Piece NumberOfPoints="%d" NumberOfCells="0"><Points><DataArray type="Float64" '
        b'NumberOfComponents="3" Name="Points" format="%s" offset="0">%s</DataArray></Points></Piece>'
        b"</UnstructuredGrid>%s</VTKFile>"
        % (compressor.encode(), points, b"binary" if place == "binary" else b"appended", inside, outside)
    )
    with pytest.raises(InvalidInput, match=reason):
        read_mesh(tmp_path / "m.vtu")


def test_a_connectivity_that_is_too_long_takes_no_eight_bytes_for_each_of_its_own(tmp_path: Path) -> None:
    size = 1 << 24
    block = zlib.compress(bytes(size))
    text = base64.b64encode(struct.pack("<4Q", 1, size, 0, len(block))) + base64.b64encode(block)
    (tmp_path / "m.vtu").write_bytes(
        b'<VTKFile type="UnstructuredGrid" header_type="UInt64" compressor="vtkZLibDataCompressor"><UnstructuredGrid>'
        b'<Piece NumberOfPoints="1" NumberOfCells="1"><Points><DataArray type="Float64" NumberOfComponents="3" '
        b'format="ascii">0 0 0</DataArray></Points><Cells><DataArray type="Int8" Name="connectivity" format="binary">'
        b'%s</DataArray><DataArray type="Int8" Name="offsets" format="ascii">3</DataArray><DataArray type="Int8" '
        b'Name="types" format="ascii">5</DataArray></Cells></Piece></UnstructuredGrid></VTKFile>' % text
    )
    tracemalloc.start()
    try:
        with pytest.raises(InvalidInput, match="'connectivity': it holds more than the 3 bytes that are expected"):
            read_mesh(tmp_path / "m.vtu")
        assert tracemalloc.get_traced_memory()[1] < 4 * size
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("announced", ["NumberOfPoints", "NumberOfCells"])
def test_fewer_values_than_a_piece_announces_are_refused(tmp_path: Path, announced: str) -> None:
    """Part of a mesh is a valid mesh too."""
    path = tmp_path / "m.vtu"
    write_vtu(path, *fan(20, 39))
    counts = re.search(rb'%s="(\d+)"' % announced.encode(), path.read_bytes())
    assert counts
    path.write_bytes(path.read_bytes().replace(counts[0], counts[0].replace(counts[1], b"%d" % (2 * int(counts[1])))))
    with pytest.raises(InvalidInput, match=rf"values, but ({2 * int(counts[1])}|{6 * int(counts[1])}) are expected"):
        read_mesh(path)


def test_lengths_that_medcoupling_does_not_write_and_arrays_of_faces(tmp_path: Path) -> None:
    path = tmp_path / "m.vtu"
    points, table = fan(20, 39)
    write_vtu(path, points, table)
    whole = path.read_bytes()
    begin, raw = whole.index(b"\n_") + 2, bytearray(whole)
    for offset in re.findall(rb'offset="(\d+)"', whole):
        raw[begin + int(offset) : begin + int(offset) + 8] = b"1234    "
    faces = b'<DataArray type="Int64" Name="faces" format="ascii">1 2 3</DataArray></Cells>'
    path.write_bytes(raw.replace(b"</Cells>", faces))
    mesh = read_mesh(path)
    np.testing.assert_array_equal(mesh.points, points)
    np.testing.assert_array_equal(mesh.cells["triangle"], next(iter(table)).nodes)


@pytest.mark.parametrize("word", [4, 8])
@pytest.mark.parametrize("alone", [True, False], ids=["by itself", "with the values"])
def test_the_length_of_values_in_base64_may_be_encoded_by_itself(tmp_path: Path, word: int, alone: bool) -> None:
    """As DUNE and hpGEM do; VTK reads both."""

    def array(name: str, values: Any, kind: str) -> str:
        body = np.asarray(values, dtype=kind).tobytes()
        parts = [len(body).to_bytes(word, "little"), body]
        coded = "".join(base64.b64encode(part).decode() for part in (parts if alone else [b"".join(parts)]))
        kinds = {"f8": "Float64", "i4": "Int32", "u1": "UInt8"}
        head = f'<DataArray type="{kinds[kind]}" Name="{name}" NumberOfComponents="{3 if kind == "f8" else 1}"'
        return f'{head} format="binary">{coded}</DataArray>'

    cells = array("connectivity", [0, 1, 2], "i4") + array("offsets", [3], "i4") + array("types", [5], "u1")
    points = array("Points", [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "f8")
    path = tmp_path / "m.vtu"
    path.write_text(
        f'<VTKFile type="UnstructuredGrid" byte_order="LittleEndian" header_type="UInt{8 * word}"><UnstructuredGrid>'
        f'<Piece NumberOfPoints="3" NumberOfCells="1"><Points>{points}</Points><Cells>{cells}</Cells></Piece>'
        "</UnstructuredGrid></VTKFile>"
    )
    assert vtk_read(path).GetNumberOfPoints() == 3
    mesh = read_mesh(path)
    assert mesh.points.tolist() == [[0, 0], [1, 0], [0, 1]]
    assert lists(mesh.cells) == {"triangle": [[0, 1, 2]]}


def test_appended_data_that_ends_too_soon_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "m.vtu"
    write_vtu(path, *fan(20, 39))
    whole = path.read_bytes()
    end = whole.index(b"\n</AppendedData>")
    for lost in (1, 100, 700, end - whole.index(b"\n_") - 2):
        path.write_bytes(whole[: end - lost] + whole[end:])
        one_line(path, r"not readable as \.vtu")


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
    points = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    write_vtu(tmp_path / "m.vtu", points, CellTable.from_arrays({"triangle": np.array([[0, 1, 2]])}))
    writer = legacy.vtkUnstructuredGridWriter()
    writer.SetFileName(str(tmp_path / "m.vtk"))
    writer.SetInputData(vtk_read(tmp_path / "m.vtu"))
    writer.Write()
    np.testing.assert_array_equal(read_mesh(tmp_path / "m.vtk").points, points)
    replaced(tmp_path / "m.vtk", "ASCII\nDATASET", "ascii\nDataset")
    np.testing.assert_array_equal(read_mesh(tmp_path / "m.vtk").points, points)


@pytest.mark.parametrize("name", ["a\x1b[31m", "\x00", "\udcff", "a<\"&'>", "[/x]"])
def test_any_name_can_be_read_again(tmp_path: Path, name: str) -> None:
    """XML allows no control characters and no lone surrogates."""
    ends = np.array([1, 0], dtype=np.uint8)
    path = tmp_path / "line.vtu"
    cells = CellTable.from_arrays({"line": np.array([[0, 1]])})
    write_vtu(path, np.array([[0.0], [1.0]]), cells, point_data={f"patch_{name}": ends})
    assert list(read_mesh(path).patches) == [re.sub("[\x00\x1b\udcff]", "�", name)]


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
    path = tmp_path / f"damaged{suffix}"
    path.write_text(content)
    one_line(path, r"not read|a VTK file of type PolyData")


def test_cells_of_higher_order_are_read_by_their_corners(tmp_path: Path) -> None:
    meshio = pytest.importorskip("meshio")
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, 0, 0], [0.5, 0.5, 0], [0, 0.5, 0]])
    cells = [("triangle6", np.arange(6)[None]), ("line3", np.array([[0, 1, 3]]))]
    meshio.Mesh(points, cells, cell_data={"patch": [np.array([0]), np.array([2])]}).write(tmp_path / "m.vtu")
    mesh = read_mesh(tmp_path / "m.vtu")
    np.testing.assert_array_equal(mesh.cells["triangle"], [[0, 1, 2]])
    np.testing.assert_array_equal(mesh.patches["2"], [0, 1, 3])  # its middle goes where the patch goes
    assert mesh.notes == (
        "1 cells of higher order are moved and judged by their corners; their other nodes move along",
    )


def test_short_polygons_strips_and_polylines_are_divided(tmp_path: Path) -> None:
    text = "# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 5 double\n"
    text += "0 0 0 1 0 0 2 1 0\n1 2 0 0 1 0\nCELLS 2 9\n4 0 1 3 4\n3 1 2 3\nCELL_TYPES 2\n7\n7\n"
    (tmp_path / "m.vtk").write_text(text)
    cells = read_mesh(tmp_path / "m.vtk").cells
    assert {name: nodes.tolist() for name, nodes in cells.items()} == {"triangle": [[1, 2, 3]], "quad": [[0, 1, 3, 4]]}
    strip = text.replace("CELLS 2 9\n4 0 1 3 4\n3 1 2 3\n", "CELLS 2 10\n5 4 0 3 1 2\n3 0 1 2\n").replace(
        "7\n7", "6\n4"
    )
    (tmp_path / "m.vtk").write_text(f"{strip}CELL_DATA 2\nSCALARS patch int 1\nLOOKUP_TABLE default\n0\n5\n")
    mesh = read_mesh(tmp_path / "m.vtk")
    assert lists(mesh.cells) == {"triangle": [[4, 0, 3], [0, 1, 3], [3, 1, 2]]}
    assert lists(mesh.patches) == {"5": [0, 1, 2]}


@pytest.mark.parametrize("kind", ["MeshTri", "MeshQuad", "MeshTet", "MeshHex"])
def test_boundaries_of_scikit_fem_are_patches(tmp_path: Path, kind: str) -> None:
    skfem = pytest.importorskip("skfem")
    mesh = getattr(skfem, kind)().refined(2)
    last = mesh.p.shape[0] - 1
    ends = {"left": (0, 0.0), "right": (0, 1.0), "top": (last, 1.0), "bottom": (last, 0.0)}
    sides = {name: (lambda x, axis=axis, at=at: abs(x[axis] - at) < 1e-12) for name, (axis, at) in ends.items()}
    mesh.with_boundaries(sides).save(tmp_path / "m.vtu")
    found = read_mesh(tmp_path / "m.vtu")
    expected = {
        name: np.flatnonzero(abs(found.points[:, axis] - at) < 1e-12).tolist() for name, (axis, at) in ends.items()
    }
    assert lists(found.patches) == expected


def test_a_text_that_names_a_compressor_has_none(tmp_path: Path) -> None:
    """VTK names it also where all values are text."""
    arrays = (("connectivity", "0 1 2"), ("offsets", "3"), ("types", "5"))
    cells = "".join(f'<DataArray type="Int64" Name="{name}" format="ascii">{of}</DataArray>' for name, of in arrays)
    (tmp_path / "m.vtu").write_text(
        '<VTKFile type="UnstructuredGrid" compressor="vtkLZ4DataCompressor"><UnstructuredGrid>'
        '<Piece NumberOfPoints="3" NumberOfCells="1"><Points><DataArray type="Float32" NumberOfComponents="3" '
        'format="ascii">0 0 0 1 0 0 0 1 0</DataArray></Points>'
        f"<Cells>{cells}</Cells></Piece></UnstructuredGrid></VTKFile>"
    )
    mesh = read_mesh(tmp_path / "m.vtu")
    write_mesh(tmp_path / "moved.vtu", replace(mesh, points=mesh.points + 1 / 3))
    assert read_mesh(tmp_path / "moved.vtu").points.tolist() == (mesh.points + 1 / 3).tolist()
    text = (tmp_path / "m.vtu").read_text()
    (tmp_path / "m.vtu").write_text(text.replace('format="ascii">5', 'format="binary">AQAAAAEAAAA='))
    one_line(tmp_path / "m.vtu", "compressed by vtkLZ4DataCompressor; .*compressor ZLib")


def test_a_keyword_in_the_line_of_the_values_before_it(tmp_path: Path) -> None:
    """As NGSolve writes it; a surplus number is an error."""
    text = (
        "# vtk DataFile Version 3.0\nNGSolve\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 float\n"
        "0 0 0 1 0 0 1 1 0 0 1 0 CELLS 1 5\n4 0 1 2 3\nCELL_TYPES 1\n9 POINT_DATA 4\n"
        "SCALARS patch_wall int 1\nLOOKUP_TABLE default\n1 1 0 0\n"
    )
    (tmp_path / "m.vtk").write_text(text)
    mesh = read_mesh(tmp_path / "m.vtk")
    assert lists(mesh.patches) == {"wall": [0, 1]}
    write_mesh(tmp_path / "moved.vtk", replace(mesh, points=mesh.points / 3))
    after = read_mesh(tmp_path / "moved.vtk")
    np.testing.assert_array_equal(after.points, mesh.points / 3)
    assert lists(after.patches) == {"wall": [0, 1]}
    (tmp_path / "m.vtk").write_text(text.replace("9 POINT_DATA", "9 9 POINT_DATA"))
    one_line(tmp_path / "m.vtk", "1 values are expected, but 4 are found")


def test_the_labels_of_earlier_freefem(tmp_path: Path) -> None:
    """It writes the type and the number of components without a blank between them."""
    text = "# vtk DataFile Version 2.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 3 float\n0 0 0 1 0 0 0 1 0\n"
    text += "CELLS 2 7\n3 0 1 2\n2 0 1\nCELL_TYPES 2\n5 3\nCELL_DATA 2\n"
    (tmp_path / "m.vtk").write_text(text + "Scalars  Label int1\nLOOKUP_TABLE FreeFempp_table\n0\n4\n")
    assert lists(read_mesh(tmp_path / "m.vtk").patches) == {"4": [0, 1]}


def test_a_surface_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "surface.vtk"
    path.write_text("# vtk DataFile Version 3.0\nsurface\nASCII\nDATASET POLYDATA\nPOINTS 1 float\n0 0 0\n")
    with pytest.raises(InvalidInput, match=r"surface\.vtk: not readable as \.vtk: a surface \(POLYDATA\)"):
        read_mesh(path)


def two_squares(rows: slice = slice(0, 8)) -> tuple[np.ndarray, CellTable, np.ndarray]:
    """Some of the eight quads of [0, 2] × [0, 1], with their nodes only; and which nodes are at y = 0."""
    points, quads = tensor_grid(np.linspace(0, 2, 5), np.linspace(0, 1, 3))
    points, quads = without_unused(points, quads[rows])
    return points, CellTable.from_arrays({"quad": quads}), (points[:, 1] == 0).astype(np.uint8)


PARTS = (slice(0, 4), slice(4, 8))


def one_file_of(path: Path, parts: list[Path]) -> Path:
    """Two files of ours, with their data appended raw, as the pieces of one."""
    heads, data = [], []
    for part in parts:
        head, _, rest = part.read_bytes().partition(b'<AppendedData encoding="raw">\n_')
        heads.append(head.decode())
        data.append(rest.rpartition(b"\n</AppendedData>")[0])
    shift = len(data[0])
    second = re.search(r"<Piece.*</Piece>", heads[1], re.DOTALL)
    assert second is not None
    moved = re.sub(r'offset="(\d+)"', lambda found: f'offset="{int(found[1]) + shift}"', second[0])
    head = heads[0].replace("</UnstructuredGrid>", moved + "</UnstructuredGrid>")
    path.write_bytes(
        head.encode() + b'<AppendedData encoding="raw">\n_' + b"".join(data) + b"\n</AppendedData></VTKFile>"
    )
    return path


def rewritten(path: Path, mode: str) -> Path:
    """The file as VTK writes it in another mode."""
    xml = pytest.importorskip("vtkmodules.vtkIOXML")
    writer = xml.vtkXMLUnstructuredGridWriter()
    writer.SetFileName(str(path.with_name("theirs_" + path.name)))
    writer.SetInputData(vtk_read(path))
    getattr(writer, f"SetDataModeTo{mode}")()
    writer.SetCompressorTypeToNone() if mode == "Ascii" else writer.SetCompressorTypeToZLib()
    assert writer.Write()
    return path.with_name("theirs_" + path.name)


@pytest.mark.parametrize(
    ("mode", "compressor", "encoded", "header", "order"),
    [
        ("Ascii", "None", False, 32, "Little"),
        ("Binary", "None", False, 32, "Big"),
        ("Binary", "ZLib", False, 64, "Little"),
        ("Appended", "None", False, 64, "Big"),
        ("Appended", "LZMA", True, 32, "Little"),
    ],
)
def test_vtk_s_file_comes_back_with_moved_nodes_and_all_its_arrays(
    tmp_path: Path, mode: str, compressor: str, encoded: bool, header: int, order: str, all_solids: Mesh
) -> None:
    xml = pytest.importorskip("vtkmodules.vtkIOXML")
    support = pytest.importorskip("vtkmodules.util.numpy_support")
    points, cells = all_solids
    data = {"patch_low": points[:, 2] == 0.0, "velocity": points * 2}
    write_vtu(tmp_path / "ours.vtu", points, CellTable.from_arrays(cells), point_data=data)
    writer = xml.vtkXMLUnstructuredGridWriter()
    writer.SetFileName(str(path := tmp_path / "m.vtu"))
    writer.SetInputData(vtk_read(tmp_path / "ours.vtu"))
    for setting in (f"DataModeTo{mode}", f"CompressorTypeTo{compressor}", f"HeaderTypeToUInt{header}"):
        getattr(writer, "Set" + setting)()
    getattr(writer, f"SetByteOrderTo{order}Endian")()
    writer.SetEncodeAppendedData(encoded)
    assert writer.Write()
    mesh = read_mesh(path)
    write_mesh(tmp_path / "moved.vtu", replace(mesh, points=mesh.points / 3))
    before, after = vtk_read(path), vtk_read(tmp_path / "moved.vtu")
    np.testing.assert_array_equal(support.vtk_to_numpy(after.GetPoints().GetData()), mesh.points / 3)
    for old, new in ((before.GetPointData(), after.GetPointData()), (before.GetCellData(), after.GetCellData())):
        assert old.GetNumberOfArrays() == new.GetNumberOfArrays() > 0
        for number in range(old.GetNumberOfArrays()):
            values = [support.vtk_to_numpy(arrays.GetArray(number)) for arrays in (old, new)]
            np.testing.assert_array_equal(*values)
    again = read_mesh(tmp_path / "moved.vtu")
    np.testing.assert_array_equal(again.points, mesh.points / 3)
    assert lists(again.patches) == lists(mesh.patches)


def test_pieces_come_back_with_their_common_nodes_moved_together(tmp_path: Path) -> None:
    parts = [tmp_path / f"part_{i}.vtu" for i in range(2)]
    for part, rows in zip(parts, PARTS, strict=True):
        points, table, low = two_squares(rows)
        write_vtu(part, points, table, point_data={"patch_low": low})
    mesh = read_mesh(path := one_file_of(tmp_path / "whole.vtu", parts))
    write_mesh(tmp_path / "moved.vtu", replace(mesh, points=mesh.points + 1 / 3))
    again = read_mesh(tmp_path / "moved.vtu")
    assert again.notes == mesh.notes
    np.testing.assert_array_equal(again.points, mesh.points + 1 / 3)
    assert lists(again.patches) == lists(mesh.patches)
    listed = "".join(f'<Piece Source="{part.name}"/>' for part in parts)
    path = tmp_path / "whole.pvtu"
    path.write_text(f'<VTKFile type="PUnstructuredGrid"><PUnstructuredGrid>{listed}</PUnstructuredGrid></VTKFile>')
    with pytest.raises(InvalidInput, match=r"moved\.pvtu: \.npz and \.vtu are written"):
        write_mesh(tmp_path / "moved.pvtu", read_mesh(path))


@pytest.mark.parametrize("binary", [False, True])
def test_bytes_that_vtk_writes_as_colours_are_patches(tmp_path: Path, binary: bool) -> None:
    """VTK's legacy writer has no other word for the active scalars of a grid if they are bytes."""
    legacy = pytest.importorskip("vtkmodules.vtkIOLegacy")
    points, table, low = two_squares()
    write_vtu(tmp_path / "m.vtu", points, table, point_data={"patch_low": low * np.uint8(1)})
    grid = vtk_read(tmp_path / "m.vtu")
    grid.GetPointData().SetActiveScalars("patch_low")
    writer = legacy.vtkUnstructuredGridWriter()
    writer.SetFileName(str(tmp_path / "m.vtk"))
    writer.SetInputData(grid)
    writer.SetFileType(1 + binary)
    assert writer.Write()
    assert b"COLOR_SCALARS" in (tmp_path / "m.vtk").read_bytes()
    assert lists(read_mesh(tmp_path / "m.vtk").patches) == {"low": np.flatnonzero(low).tolist()}


@pytest.mark.parametrize("form", ["raw", "Ascii", "Binary", "pvtu"])
def test_pieces_are_one_mesh_with_their_common_nodes_joined(tmp_path: Path, form: str) -> None:
    parts = [tmp_path / f"part_{i}.vtu" for i in range(2)]
    for part, rows in zip(parts, PARTS, strict=True):
        points, table, low = two_squares(rows)
        write_vtu(part, points, table, point_data={"patch_low": low})
    if form == "raw":
        path = one_file_of(tmp_path / "whole.vtu", parts)
    elif form == "pvtu":
        path = tmp_path / "whole.pvtu"
        listed = "".join(f'<Piece Source="{part.name}"/>' for part in parts)
        path.write_text(f'<VTKFile type="PUnstructuredGrid"><PUnstructuredGrid>{listed}</PUnstructuredGrid></VTKFile>')
    else:
        first, second = (rewritten(part, form).read_text() for part in parts)
        piece = re.search(r"<Piece.*</Piece>", second, re.DOTALL)
        assert piece is not None
        path = tmp_path / "whole.vtu"
        path.write_text(first.replace("</UnstructuredGrid>", piece[0] + "</UnstructuredGrid>"))
    mesh, (points, table, low) = read_mesh(path), two_squares()
    assert mesh.notes == ("2 pieces were joined; 3 nodes were in several of them",)
    np.testing.assert_array_equal(mesh.points, points)
    np.testing.assert_array_equal(mesh.cells["quad"], next(iter(table)).nodes)
    np.testing.assert_array_equal(mesh.patches["low"], np.flatnonzero(low))


def test_one_array_names_the_patches_of_all_pieces(tmp_path: Path) -> None:
    """The first array that marks faces; a piece without it would lose a part of its patches."""
    parts = [tmp_path / f"part_{i}.vtu" for i in range(2)]
    for number, (part, rows) in enumerate(zip(parts, PARTS, strict=True)):
        points, table, low = two_squares(rows)
        numbers = low.astype(np.int64)
        write_vtu(part, points, table, point_data={"patch": numbers * (1 - number), "ObjectId": numbers * 7})
    assert set(read_mesh(one_file_of(tmp_path / "whole.vtu", parts)).patches) == {"1"}
    write_vtu(parts[1], points, table, point_data={"ObjectId": numbers})
    with pytest.raises(InvalidInput, match=r"whole.vtu: piece 2 has no array 'patch', by which another piece names"):
        read_mesh(one_file_of(tmp_path / "whole.vtu", parts))


def test_ghost_cells_and_empty_pieces_are_left_out(tmp_path: Path) -> None:
    meshio = pytest.importorskip("meshio")
    pieces = []
    for rows, ghosts in ((slice(0, 6), [0, 0, 0, 0, 1, 1]), (slice(4, 8), [0] * 4), (slice(0, 0), [])):
        points, table, low = two_squares(rows) if ghosts else (np.empty((0, 2)), None, np.empty(0, np.uint8))
        quads = np.empty((0, 4), np.int64) if table is None else next(iter(table)).nodes.astype(np.int64)
        flags = np.array(ghosts, np.uint8)
        mesh = meshio.Mesh(np.pad(points, ((0, 0), (0, 1))), [("quad", quads)], {"patch_low": low})
        mesh.cell_data = {"vtkGhostType": [flags]}
        mesh.write(tmp_path / "piece.vtu", binary=False)
        text = (tmp_path / "piece.vtu").read_text()
        pieces.append(text[text.index("<Piece") : text.index("</Piece>") + 8])
    path = tmp_path / "m.vtu"
    path.write_text(
        '<VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian"><UnstructuredGrid>'
        + "".join(pieces)
        + "</UnstructuredGrid></VTKFile>"
    )
    mesh = read_mesh(path)
    assert (len(mesh.points), len(mesh.cells["quad"]), len(mesh.patches["low"])) == (15, 8, 5)


def test_nodes_that_may_belong_to_either_side_of_a_slit_are_named(tmp_path: Path) -> None:
    meshio = pytest.importorskip("meshio")
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    slit = np.concatenate([square, square[1:3], [[2.0, 0, 0], [2, 1, 0]]])  # nodes 1, 2 and 4, 5 in pairs
    quads = np.array([[0, 1, 2, 3], [4, 6, 7, 5]])
    meshio.Mesh(slit, [("quad", quads)]).write(tmp_path / "a.vtu")
    meshio.Mesh(square + np.array([1, 1, 0]), [("quad", quads[:1])]).write(tmp_path / "b.vtu")
    meshio.Mesh(square + np.array([5, 5, 0]), [("quad", quads[:1])]).write(tmp_path / "c.vtu")
    path = tmp_path / "m.pvtu"
    text = '<VTKFile type="PUnstructuredGrid"><PUnstructuredGrid><Piece Source="{}.vtu"/><Piece Source="{}.vtu"/>'
    path.write_text(text.format("a", "b") + "</PUnstructuredGrid></VTKFile>")
    with pytest.raises(InvalidInput, match="piece 1 has its nodes 2 and 5 at one place"):
        read_mesh(path)
    path.write_text(text.format("a", "c") + "</PUnstructuredGrid></VTKFile>")  # a slit within a piece stays
    assert len(read_mesh(path).points) == 12
    path.write_text(text.format("a", "gone") + "</PUnstructuredGrid></VTKFile>")
    with pytest.raises(InvalidInput, match=r"its piece .*gone\.vtu is missing"):
        read_mesh(path)
    path.write_text(text.format("a", "b").replace(".vtu", ".txt") + "</PUnstructuredGrid></VTKFile>")
    with pytest.raises(InvalidInput, match=r"expected pieces in \.vtu files, got '.*a\.txt'"):
        read_mesh(path)
    path.write_text('<VTKFile type="PUnstructuredGrid"><PUnstructuredGrid></PUnstructuredGrid></VTKFile>')
    with pytest.raises(InvalidInput, match="it lists no piece"):
        read_mesh(path)


@pytest.mark.parametrize("suffix", [".vtu", ".vtk"])
def test_curves_and_surfaces_are_numbered_apart(tmp_path: Path, suffix: str) -> None:
    meshio = pytest.importorskip("meshio")
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    cells = [("tetra", [[0, 1, 2, 3]]), ("triangle", [[0, 2, 3]]), ("line", [[0, 1], [1, 2]])]
    marks = [np.array([1]), np.array([1]), np.array([1, 2])]
    meshio.Mesh(points, cells, cell_data={"gmsh:physical": marks}).write(tmp_path / f"m{suffix}")
    found = {name: list(nodes) for name, nodes in read_mesh(tmp_path / f"m{suffix}").patches.items()}
    assert found == {"1": [0, 2, 3], "curve_1": [0, 1], "2": [1, 2]}


@pytest.mark.parametrize("suffix", [".vtu", ".vtk"])
@pytest.mark.parametrize(
    ("array", "values"),
    [
        ("medit:ref", [3, 4]),
        ("cell_tags", [-7, -8]),
        ("netgen:index", [1, 2]),
        ("gmsh:geometrical", [5, 6]),
        ("ObjectId", [1001, 1002]),
        ("Label", [1, 2]),
        ("MaterialID", [1, 2]),
        ("GeometryIds", [101, 102]),
    ],
)
def test_patch_arrays_of_converters_are_patches(tmp_path: Path, suffix: str, array: str, values: list[int]) -> None:
    meshio = pytest.importorskip("meshio")
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    cells = [("tetra", [[0, 1, 2, 3]]), ("triangle", [[0, 2, 3], [0, 1, 3]])]
    data = {array: [np.array([1]), np.array(values)], "gmsh:dim_tags": [np.array([1]), np.array([8, 9])]}
    meshio.Mesh(points, cells, cell_data=data).write(tmp_path / f"m{suffix}")
    found = {name: list(nodes) for name, nodes in read_mesh(tmp_path / f"m{suffix}").patches.items()}
    assert found == {str(values[0]): [0, 2, 3], str(values[1]): [0, 1, 3]}


def test_the_arrays_are_named_where_none_of_them_gives_patches(tmp_path: Path) -> None:
    points = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    cells = CellTable.from_arrays({"triangle": np.array([[0, 1, 2]])})
    write_vtu(tmp_path / "m.vtu", points, cells, point_data={"T": points[:, 0]}, cell_data={"Region": np.array([3])})
    (note,) = read_mesh(tmp_path / "m.vtu").notes
    assert note.startswith("its arrays are 'T' on points and 'Region', 'cell' on cells, and none of them names patches")
    assert "patch_<name> on points" in note


def vtk_sources(name: str) -> Any:
    """A grid of VTK of 4 × 3 × 2 points, of one of its kinds."""
    model = pytest.importorskip("vtkmodules.vtkCommonDataModel")
    core = pytest.importorskip("vtkmodules.vtkCommonCore")
    if name == "StructuredPoints":
        grid = model.vtkStructuredPoints()
        grid.SetDimensions(4, 3, 2)
        grid.SetSpacing(0.5, 0.25, 2.0)
        grid.SetOrigin(1.0, -1.0, 0.1)
    elif name == "RectilinearGrid":
        grid = model.vtkRectilinearGrid()
        grid.SetDimensions(4, 3, 2)
        for axis, values in (("X", [0, 1, 3, 4]), ("Y", [0, 0.1, 0.3]), ("Z", [2, 5])):
            array = core.vtkDoubleArray()
            for value in values:
                array.InsertNextValue(value)
            getattr(grid, f"Set{axis}Coordinates")(array)
    else:
        grid = model.vtkStructuredGrid()
        grid.SetDimensions(4, 3, 2)
        points = core.vtkPoints()
        points.SetDataTypeToDouble()
        for k, j, i in np.ndindex(2, 3, 4):
            points.InsertNextPoint(i + 0.1 * j, j + 0.2 * k, k + 1 / 3)
        grid.SetPoints(points)
    for array in ("IdType", "SignedChar", "TypeInt64", "Bit", "Int"):
        mark = getattr(core, f"vtk{array}Array")()
        mark.SetName(array if array != "Int" else "patch_left")
        for point in range(24):
            mark.InsertNextValue(int(point % 4 == 0))
        grid.GetPointData().AddArray(mark)
    labels, long = ["a b", "", "é\n%"] * 8, ["", "x" * 100, "y" * 20000]
    for data, texts in ((grid.GetPointData(), labels), (grid.GetFieldData(), long)):
        array = core.vtkStringArray()
        array.SetName("labels")
        for text in texts:
            array.InsertNextValue(text)
        data.AddArray(array)
    return grid


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("name", ["StructuredPoints", "RectilinearGrid", "StructuredGrid", "XMLStructuredGrid"])
def test_structured_grids_of_vtk_itself(tmp_path: Path, name: str, binary: bool) -> None:
    """The cells are those that VTK makes of the grid."""
    kind = name.removeprefix("XML")
    module = pytest.importorskip("vtkmodules.vtkIOXML" if name != kind else "vtkmodules.vtkIOLegacy")
    filters = pytest.importorskip("vtkmodules.vtkFiltersCore")
    support = pytest.importorskip("vtkmodules.util.numpy_support")
    grid = vtk_sources(kind)
    writer = getattr(module, f"vtk{name}Writer")()
    path = tmp_path / ("m.vts" if name != kind else "m.vtk")
    writer.SetFileName(str(path))
    writer.SetInputData(grid)
    if name != kind:
        writer.SetDataModeToBinary() if binary else writer.SetDataModeToAscii()
    else:
        writer.SetFileTypeToBinary() if binary else writer.SetFileTypeToASCII()
    writer.Write()
    append = filters.vtkAppendFilter()
    append.AddInputData(grid)
    append.Update()
    theirs = append.GetOutput()
    mesh = read_mesh(path)
    points = np.array([theirs.GetPoint(i) for i in range(24)])
    np.testing.assert_allclose(mesh.points, points, atol=0 if binary else 1e-6)  # VTK writes six digits
    voxels = theirs.GetCellType(0) == 11
    nodes = support.vtk_to_numpy(theirs.GetCells().GetConnectivityArray()).reshape(-1, 8)
    np.testing.assert_array_equal(mesh.cells["hexahedron"], nodes[:, [0, 1, 3, 2, 4, 5, 7, 6]] if voxels else nodes)
    np.testing.assert_array_equal(mesh.patches["left"], np.arange(0, 24, 4))


@pytest.mark.parametrize("version", [42, 51])
@pytest.mark.parametrize("binary", [False, True])
def test_a_legacy_file_comes_back_with_moved_points(tmp_path: Path, version: int, binary: bool) -> None:
    legacy = pytest.importorskip("vtkmodules.vtkIOLegacy")
    points, table, low = two_squares()
    write_vtu(tmp_path / "m.vtu", points, table, point_data={"patch_low": low, "u": np.ones((len(points), 3))})
    writer = legacy.vtkUnstructuredGridWriter()
    writer.SetFileName(str(tmp_path / "m.vtk"))
    writer.SetInputData(vtk_read(tmp_path / "m.vtu"))
    writer.SetFileVersion(version)
    writer.SetFileTypeToBinary() if binary else writer.SetFileTypeToASCII()
    writer.Write()
    mesh = read_mesh(tmp_path / "m.vtk")
    np.testing.assert_array_equal(mesh.cells["quad"], next(iter(table)).nodes)
    np.testing.assert_array_equal(mesh.patches["low"], np.flatnonzero(low))
    write_mesh(tmp_path / "moved.vtk", replace(mesh, points=points / 3))
    after = read_mesh(tmp_path / "moved.vtk")
    np.testing.assert_array_equal(after.points, points / 3)
    np.testing.assert_array_equal(after.patches["low"], np.flatnonzero(low))
