"""Files of other programs: read with their patches, written back with moved nodes, refused in one clear line."""

import os
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from fnmatch import fnmatch
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from format_files import (
    CELLS,
    PATCHES,
    POINTS,
    WRITERS,
    abaqus,
    elmer,
    ensight,
    ensight_binary,
    exodus,
    exodus_hdf5,
    fluent,
    kratos,
    med,
    medit,
    mfem,
    mfem_by_axes,
    rows,
    universal,
    vtkhdf,
    xdmf,
    xdmf_binary,
    xdmf_hdf5,
)
from mesh_files import lists, one_line, quiet_gmsh, refused_when_damaged, replaced
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.metrics import cell_quality, reference_sizes
from mesh_motion_numerics.quality.orientation import oriented
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.files import read_mesh, write_mesh
from mesh_motion_server.files.format import Format
from mesh_motion_server.files.formats import FORMATS

_CUBE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]])
#: Corners of a cell of each type that has volume in space, in the order of messages and of Gmsh.
_CORNERS = {"tetra": _CUBE[[0, 1, 3, 4]], "hexahedron": _CUBE, "wedge": _CUBE[[0, 1, 3, 4, 5, 7]], "pyramid": _CUBE[:5]}

#: Files in which the names have another length, or that say their alphabet.
_BINARY = ("h5", ".e", ".exo", ".med", ".cgns", ".npz", ".vtu", "hdf", "xdmf", ".xmf", ".ugrid")


@pytest.mark.parametrize("name", WRITERS)
def test_every_format_says_the_same_and_comes_back_with_moved_nodes(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    WRITERS[name](path)
    mesh = read_mesh(path)
    np.testing.assert_array_equal(mesh.points, POINTS)
    assert lists(mesh.patches) == {key: nodes.tolist() for key, nodes in PATCHES.items()}
    (block,) = oriented(mesh.points, mesh.cell_table).cells
    assert sorted(map(sorted, block.nodes.tolist())) == sorted(map(sorted, CELLS.tolist()))
    cells = CellTable([block])
    assert cell_quality(POINTS, cells, reference_sizes(POINTS, cells)).skew.min() > 0.9  # no node is out of order
    moved = mesh.points * [1.5, 1.0, 1 / 3] + 0.1
    write_mesh(tmp_path / f"moved_{name}", replace(mesh, points=moved))
    after = read_mesh(tmp_path / f"moved_{name}")
    np.testing.assert_array_equal(after.points, moved)
    for kind, nodes in mesh.cells.items():
        np.testing.assert_array_equal(after.cells[kind], nodes)
    assert lists(after.patches) == {key: nodes.tolist() for key, nodes in PATCHES.items()}
    write_mesh(tmp_path / f"back_{name}", replace(after, points=mesh.points))  # nothing but coordinates has changed
    if path.is_file() and not name.endswith(
        ("h5", "hdf", "h5.xdmf", ".xmf", "cgns", "med", "exo", ".e", ".npz", ".vtu")
    ):
        assert (tmp_path / f"back_{name}").read_bytes().split() == path.read_bytes().split()


@pytest.mark.parametrize("stem", ["t\udc80", "a & b", "a<b", "a:b", "a\nb", 'a"b', "a*b", "a b"])
@pytest.mark.parametrize("name", WRITERS)
def test_a_target_with_any_name_comes_back_or_is_refused(tmp_path: Path, name: str, stem: str) -> None:
    """Some formats have the names of their other files in their text."""
    (path := tmp_path / "first" / name).parent.mkdir()
    WRITERS[name](path)
    if name == "box.geo":
        path.with_suffix(".case").write_text("FORMAT\ntype: ensight gold\nGEOMETRY\nmodel: box.geo\n")
        path = path.with_suffix(".case")
    mesh, target = read_mesh(path), tmp_path / f"{stem}{path.suffix}"
    moved = replace(mesh, points=mesh.points + 1.0)
    if stem != "a b" and name in ("box_h5.xdmf", "box.xmf", "box.geo"):
        with pytest.raises(InvalidInput, match="it names its other files after itself, without"):
            write_mesh(target, moved)
        assert os.listdir(tmp_path) == ["first"]
        return
    write_mesh(target, moved)
    np.testing.assert_array_equal(read_mesh(target).points, moved.points)


@pytest.mark.parametrize(
    ("source", "target"),
    [
        ("box.mesh", "moved.meshb"),
        ("box.vtu", "moved.vts"),
        ("box.b8.ugrid", "moved.lb8.ugrid"),
        ("box.ugrid", "moved.b8.ugrid"),
    ],
)
def test_a_copy_with_an_ending_for_another_encoding_is_refused(tmp_path: Path, source: str, target: str) -> None:
    """The copy has the encoding of its source, but other programs go by the ending."""
    WRITERS["box" + Path(source).suffix](tmp_path / source)
    with pytest.raises(InvalidInput, match=r"are written and, as|a copy of .* ends in "):
        write_mesh(tmp_path / target, read_mesh(tmp_path / source))
    assert not list(tmp_path.glob("moved*"))


def test_a_folder_s_copy_has_any_name_but_a_file_s(tmp_path: Path) -> None:
    WRITERS["box_elmer"](tmp_path / "case.v2")
    mesh = read_mesh(tmp_path / "case.v2")
    write_mesh(tmp_path / "moved", mesh)
    np.testing.assert_array_equal(read_mesh(tmp_path / "moved").points, mesh.points)
    with pytest.raises(
        InvalidInput, match=r"moved\.msh: \.npz and \.vtu are written and, as an Elmer folder, a folder "
    ):
        write_mesh(tmp_path / "moved.msh", mesh)


def test_the_copy_of_a_case_by_its_foam_file_is_a_folder(tmp_path: Path) -> None:
    WRITERS["box_foam"](tmp_path / "case")
    (tmp_path / "case" / "case.foam").touch()
    mesh = read_mesh(tmp_path / "case" / "case.foam")
    with pytest.raises(
        InvalidInput, match=r"and, as an OpenFOAM case, a folder \(name a new folder, without an ending"
    ):
        write_mesh(tmp_path / "moved.foam", mesh)
    write_mesh(tmp_path / "moved", mesh)


@pytest.mark.parametrize("name", [name for name in WRITERS if not name.endswith(_BINARY)])
def test_names_in_the_alphabet_of_windows_stay_apart(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    WRITERS[name](path)
    for file in path.iterdir() if path.is_dir() else [path]:
        content = file.read_bytes().replace(b"wall", "Wände".encode("cp1252"))
        file.write_bytes(content.replace(b"sides", "Wönde…".encode("cp1252")))
    mesh = read_mesh(path)
    assert sorted(mesh.patches) == ["Wände", "Wönde…", "far"]
    write_mesh(tmp_path / f"moved_{name}", replace(mesh, points=mesh.points + 1))
    assert lists(read_mesh(tmp_path / f"moved_{name}").patches) == lists(mesh.patches)


@pytest.mark.parametrize("number", [rb"(?<=[\s(,])(\d*\.\d)(\d[^\s),]*)", rb"(?<=[\s(,\"=])([1-9])(\d)(?=[\s),\"])"])
@pytest.mark.parametrize("name", [*(one for one in WRITERS if not one.endswith((*_BINARY, ".cas"))), "box.xdmf"])
def test_numbers_of_python_only_are_none(tmp_path: Path, name: str, number: bytes) -> None:
    """Python reads 0.3_5 as 0.35, and 2_7 as 27; digits of other scripts, too."""
    path = tmp_path / name
    WRITERS[name](path)
    changed = 0
    for file in path.iterdir() if path.is_dir() else [path]:
        content = file.read_bytes()
        file.write_bytes(re.sub(number, rb"\1_\2", content))
        changed += file.read_bytes() != content
    assert changed
    with pytest.raises(InvalidInput):
        read_mesh(path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("(2 3)", "(2 4)", "4 dimensions, expected 2 or 3"),
        (
            "(13 (5 21 24 3 4)(",
            "(13 (5 21 24 3 2)(1 2 1 0 2 3 1 0 3 4 1 0 4 5 1 0))(0 (",
            "face 33 of a 3D mesh has 2 nodes",
        ),
        ("(10 (1 1 1b 1 3)", "(10 (1 1 1c 1 3)", "nodes 1 to 28 are 84 coordinates, but 81 follow"),
        ("(13 (5 ", "(58 (1 2 3)(4))\n(13 (5 ", "hanging nodes"),
        ("(13 (5 ", "(2040 (2 1 8 1)(((((", "the section at byte 1[0-9]+ does not end"),
        ("(13 (5 21", "(13 (5 22", "faces 34 to 36 are 18 numbers, but 24 follow"),
        ("(13 (5 21 24", "(13 (5 22 25", "face 33 is expected, but face 34 follows"),
        ("wall wall 1)())", "wall wall 1)()", "does not end"),
    ],
)
def test_fluent_meshes_that_do_not_fit(tmp_path: Path, old: str, new: str, message: str) -> None:
    fluent(tmp_path / "m.msh")
    one_line(replaced(tmp_path / "m.msh", old, new), message)


@pytest.mark.parametrize(
    ("kind", "role"), [(3, None), (7, "symmetry"), (37, "symmetry"), (8, "periodic"), (12, "periodic")]
)
def test_fluent_marks_symmetry_axes_and_periodic_sides(tmp_path: Path, kind: int, role: str | None) -> None:
    fluent(tmp_path / "m.msh")
    text = (tmp_path / "m.msh").read_text()
    begin = text.index("(13 (5 ")
    head, rest = text[:begin], text[begin:]
    (tmp_path / "m.msh").write_text(head + rest.replace(" 3 4)", f" {kind:x} 4)", 1))
    assert read_mesh(tmp_path / "m.msh").marked == {"sides": "symmetry"} | ({"wall": role} if role else {})


def test_fluent_in_the_plane_with_a_polygon(tmp_path: Path) -> None:
    """A pentagon and a triangle; the zones have no names."""
    (tmp_path / "m.msh").write_text(
        "(2 2)\n(10 (1 1 6 1 2)(\n0 0\n1 0\n1.5 1\n.5 1.5\n-.5 1\n2 0\n))\n(12 (1 1 2 1 0))\n"
        "(13 (2 1 1 2 2)(\n2 3 1 2\n))\n"
        "(13 (3 2 5 3 2)(\n1 2 1 0\n3 4 1 0\n4 5 1 0\n5 1 1 0\n))\n(13 (4 6 7 a 0)(\n2 2 6 2 0\n2 6 3 2 0\n))\n"
    )
    mesh = read_mesh(tmp_path / "m.msh")
    assert {name: len(nodes) for name, nodes in mesh.cells.items()} == {"triangle": 6}
    np.testing.assert_allclose(mesh.points[6], [0.5, 0.7])  # the pentagon's middle
    assert lists(mesh.patches) == {"wall-3": [0, 1, 2, 3, 4], "velocity-inlet-4": [1, 2, 5]}
    write_mesh(tmp_path / "moved.msh", replace(mesh, points=mesh.points * 2))
    np.testing.assert_array_equal(read_mesh(tmp_path / "moved.msh").points[:6], mesh.points[:6] * 2)


def test_vtk_reads_the_same_cells_of_fluent(tmp_path: Path) -> None:
    """A peer: VTK's reader of .cas finds the hexahedra of the file."""
    geometry = pytest.importorskip("vtkmodules.vtkIOGeometry")
    numpy_support = pytest.importorskip("vtkmodules.util.numpy_support")
    fluent(tmp_path / "m.cas")
    reader = geometry.vtkFLUENTReader()
    reader.SetFileName(str(tmp_path / "m.cas"))
    reader.Update()
    grid = reader.GetOutput().GetBlock(4)  # after the zones of faces
    nodes = numpy_support.vtk_to_numpy(grid.GetCells().GetConnectivityArray()).reshape(-1, 8)
    np.testing.assert_allclose(
        numpy_support.vtk_to_numpy(grid.GetPoints().GetData()), POINTS, atol=1e-7
    )  # its own are short
    assert sorted(map(sorted, nodes.tolist())) == sorted(map(sorted, CELLS.tolist()))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("m.msh", "solid x\n facet normal 0 0 1\n", r"a surface \(STL\), which is not read \(it has no cells"),
        (
            "m.mesh",
            "MFEM NURBS mesh v1.0\n",
            r"an MFEM mesh of another kind, which is not read \(versions .* are read; .* MFEM writes",
        ),
        ("m.msh", "3 1 3\n0 0 1\n1 0 1\n", r"a FreeFEM mesh, which is not read .*savevtk"),
        ("m.ccm", "@(#)ADF Database Version A02011>", r"a STAR-CCM\+ mesh, which is not read"),
        ("m.dat", 'TITLE = "x"\n', "a Tecplot file, which is not read"),
        ("m.inp", "\7\4\0\0\0", "a binary AVS UCD file, which is not read"),
        ("m.ply2", "3\n1\n0 0 0\n1 0 0\n", "unknown kind of mesh file; known are"),
        ("m.txt", "4 1 0 0 0\n4 1 0 0 0\n", "unknown kind of mesh file; known are"),
        ("m.geo", "Point(1) = {0, 0, 0};", r"a geometry of Gmsh, which is not read \(mesh it"),
        ("m.vtu", "", r"an empty file, which is not read \(was its program"),
        ("m.dat", "", "an empty file, which is not read"),
        ("m.msh", "\x1f\x8b\x08", r"a packed file, which is not read \(unpack it"),
        ("m.cgns", "version https://git-lfs.github.com/spec/v1\n", r"a pointer of Git LFS, .*git lfs pull"),
        ("m.vtu", "<!DOCTYPE html>\n<html>", "a page of the web, which is not read"),
        ("m.msh", "\xef\xbb\xbf$MeshFormat\n", "a text with a byte order mark, which is not read"),
        ("m.dat", '# by x\nVARIABLES = "X"\n', "a Tecplot file, which is not read"),
        ("m.hmf", "\x89HDF\r\n\x1a\n", r"a file in HDF5, which is not read \(give it the ending"),
        ("m.h5m", "\x89HDF\r\n\x1a\n", r"a MOAB mesh, which is not read \(.*mbconvert"),
        ("m.e", "CDF\5", r"a netCDF file of 64-bit numbers \(CDF-5\), which is not read \(nccopy"),
        ("m.pvts", '<VTKFile type="PStructuredGrid"/>', "Append Datasets"),
        ("m.pvtr", '<VTKFile type="PRectilinearGrid"/>', "Append Datasets"),
        ("m.vtm", '<VTKFile type="vtkMultiBlockDataSet"/>', "give one of the files"),
        ("m.vtpc", '<VTKFile type="vtkPartitionedDataSetCollection"/>', "give one of the files"),
        ("m.vtu.series", '{"file-series-version": "1.0"}', "give one of the files"),
        ("m.f3grid", "* FLAC3D grid\n", r"a FLAC3D grid, which is not read \(meshio"),
        ("m.dato", "!\n$ENTER COMPONENT NAME=X\n", r"a PERMAS model, which is not read \(meshio"),
        ("m.msh", '(1 "meshio 5.3.5")\n(2 3)\n', r"cells without faces, written by meshio as 'ansys'.*\(let meshio"),
        ("m.msh", "$NOD\n3\n", r"a Gmsh mesh of version 1, which is not read \(Gmsh reads it"),
        ("m.k", "*KEYWORD\n*NODE\n 1 0. 0. 0.\n", "an LS-DYNA deck, which is not read"),
        ("m.inp", "*KEYWORD\n*NODE\n 1 0. 0. 0.\n", "an LS-DYNA deck, which is not read"),
        ("m.inp", "*NODE\n 1 0. 0. 0.\n*ELEMENT_SHELL\n", "an LS-DYNA deck, which is not read"),
        ("m.msh", "/PREP7\nNBLOCK,6,SOLID,8,8\n", "an Ansys deck, which is not read"),
        ("m.vrt", "PROSTAR_VERTEX\n4000 0 0", r"a STAR-CD mesh, which is not read \(star4ToFoam"),
        ("m.neu", "        CONTROL INFO 2.4.6\n", "a Gambit mesh, which is not read"),
        ("m.txt", "# Created by COMSOL Multiphysics.\n", "a COMSOL mesh, which is not read"),
        ("m.xml", '<dolfin><mesh celltype="triangle" dim="2">', "a mesh of DOLFIN, which is not read"),
        ("m.msh", "\3\0\0\0\2\0\0\0" + 12 * "\n" + "\1" + 11 * "\0", r"a GiD mesh, which is not read \(.*\.mdpa"),
        ("m.msh", 8 * "\0" + "\x10\0\0\0GID_MESHSET 1.2", "a GiD mesh, which is not read"),
        ("m.msh", 'MESH "a" dimension 3 ElemType Tetrahedra Nnode 4\n', "a GiD mesh, which is not read"),
        ("m.xda", "libMesh-0.7.0+\n10\n", r"a libMesh mesh, which is not read \(.* meshtool -i"),
        ("m.xdr", "\0\0\0\rlibMesh-1.8.0", "a libMesh mesh, which is not read"),
        ("m.dgf", "DGF\nVertex\n", r"a DUNE grid, which is not read \(Dune::GmshWriter"),
        ("m.rad", "#RADIOSS STARTER\n/BEGIN\n", r"a Radioss deck, which is not read \(HyperMesh"),
        ("m.mail", "TITRE\nx\nFINSF\nCOOR_3D\nN1 0 0 0\n", r"a mesh of code_aster, .*\(code_aster writes MED"),
        ("m.xml", '<?xml version="1.0"?>\n<NEKTAR>', r"a Nektar\+\+ mesh, which is not read \(FieldConvert"),
        ("m.feb", '<?xml version="1.0"?>\n<febio_spec version="4.0">', "an FEBio model, which is not read"),
        ("m.node", "4 3 0 0\n", r"a mesh of TetGen, which is not read \(tetgen -g"),
        ("m.in2d", "splinecurves2dv2\n", r"a geometry of Netgen, which is not read \(mesh it in Netgen"),
        ("m.mesh", "5\n  0.000  0.000  1.000\n  1.0 0.0 0.0\n", "a neutral mesh of Netgen, .*ending .vol"),
        ("m.grd", "Version = 210903\nCoordinate System = Cartesian 2D\n", r"an input of ElmerGrid, .*\(ElmerGrid 1 2"),
        ("m.msh", "# by x\no Cube\nv 0 0 -1e-3\n", r"a surface \(OBJ\), which is not read"),
        ("m.ply", "ply\nformat ascii 1.0\n", r"a surface \(PLY\), which is not read"),
        ("m.off", "OFF\n3 1 0\n", r"a surface \(OFF\), which is not read"),
        ("m.txt", 72 * " " + "S      1\n", r"a geometry \(IGES\), which is not read"),
        ("m.txt", "DBRep_DrawableShape\n", r"a geometry \(BREP\), which is not read"),
        ("blockMeshDict", "FoamFile\n{\n", r"a file of OpenFOAM, which is not read \(give the folder"),
        ("m.pvd", '<VTKFile type="Collection"/>', r"a VTK file of type Collection, .*\(give one of the files"),
        (
            "m.vti",
            '<VTKFile type="ImageData"/>',
            r"a VTK file of type ImageData, .*\(convert it with ParaView's filter Append",
        ),
        ("m.msh", "hello", r"neither a Gmsh .* nor a GiD mesh: it begins with b'hello' .*export one of these"),
    ],
)
def test_a_file_of_another_kind_is_named(tmp_path: Path, name: str, content: str, message: str) -> None:
    (tmp_path / name).write_text(content, encoding="latin-1")
    one_line(tmp_path / name, message)


@pytest.mark.parametrize("row", FORMATS, ids=lambda row: row.name)
def test_no_head_is_sought_over_blank_lines(row: Format) -> None:
    """``\\s*`` takes all blank lines after each line: the work grows with the square of their number."""
    pattern = row.head.pattern
    assert not (row.head.flags & re.MULTILINE and rb"^\s" in pattern), pattern


def test_an_empty_file_named_foam_is_its_case(tmp_path: Path) -> None:
    (tmp_path / "m.foam").touch()
    one_line(tmp_path / "m.foam", "neither an OpenFOAM case nor a polyMesh folder")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("m.h5", "without Fluent's group 'meshes' .*give the .xdmf"),
        ("m.exo", "neither coord nor coordx"),
        ("m.vtkhdf", "without VTK's group 'VTKHDF'"),
    ],
)
def test_hdf5_of_another_program_is_no_damaged_file(tmp_path: Path, name: str, message: str) -> None:
    with pytest.importorskip("h5py").File(tmp_path / name, "w") as file:
        file["points"] = POINTS
    one_line(tmp_path / name, message)


def test_vtkhdf_of_vtk_itself(tmp_path: Path) -> None:
    """Two parts, which are joined; VTK reads what comes back of one."""
    hdf = pytest.importorskip("vtkmodules.vtkIOHDF")
    numpy_support = pytest.importorskip("vtkmodules.util.numpy_support")
    model, extraction = map(pytest.importorskip, ("vtkmodules.vtkCommonDataModel", "vtkmodules.vtkFiltersCore"))
    vtkhdf(tmp_path / "m.vtkhdf")

    def vtk_reads(path: Path) -> Any:
        reader = hdf.vtkHDFReader()
        reader.SetFileName(str(path))
        reader.Update()
        return reader.GetOutputDataObject(0)

    grid, parts = vtk_reads(tmp_path / "m.vtkhdf"), model.vtkPartitionedDataSet()
    for part in range(2):
        half = extraction.vtkExtractCells()
        half.SetInputData(grid)
        half.AddCellRange(4 * part, 4 * part + 3)
        half.Update()
        parts.SetPartition(part, half.GetOutput())
    writer = hdf.vtkHDFWriter()
    writer.SetFileName(str(tmp_path / "parts.vtkhdf"))
    writer.SetInputData(parts)
    writer.Write()
    mesh = read_mesh(tmp_path / "parts.vtkhdf")
    assert mesh.notes == ("2 pieces were joined; 9 nodes were in several of them",)
    assert {name: len(nodes) for name, nodes in mesh.patches.items()} == {name: len(of) for name, of in PATCHES.items()}
    with pytest.raises(InvalidInput, match="several parts, each with points of its own"):
        write_mesh(tmp_path / "moved.vtkhdf", mesh)
    mesh = read_mesh(tmp_path / "m.vtkhdf")
    write_mesh(tmp_path / "moved.vtkhdf", replace(mesh, points=mesh.points / 3))
    points = numpy_support.vtk_to_numpy(vtk_reads(tmp_path / "moved.vtkhdf").GetPoints().GetData())
    np.testing.assert_array_equal(points, POINTS / 3)


def test_a_name_in_vtkhdf_that_is_not_in_utf_8(tmp_path: Path) -> None:
    vtkhdf(path := tmp_path / "m.vtkhdf")
    name = "patch_Wände".encode("cp1252")
    changed_hdf5(path, lambda file: file["VTKHDF/PointData"].create_dataset(name, data=[1] + [0] * 26))
    assert lists(read_mesh(path).patches)["Wände"] == [0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda root: root.attrs.update(Type=np.bytes_("PolyData")), "of type 'PolyData', expected UnstructuredGrid"),
        (lambda root: root["Connectivity"].write_direct(np.full(64, 99)), "names node 99"),
        (lambda root: root["NumberOfPoints"].write_direct(np.array([99])), "54 rows of an array, expected 99"),
        (lambda root: root["Types"].write_direct(np.full(8, 42, np.uint8)), r"VTK's type 42 \(polyhedra\)"),
        (lambda root: root.pop("Types"), "malformed or damaged VTKHDF file: .*Types"),
    ],
)
def test_vtkhdf_files_that_do_not_fit(tmp_path: Path, change: Callable[[Any], None], message: str) -> None:
    vtkhdf(tmp_path / "m.vtkhdf")
    one_line(changed_hdf5(tmp_path / "m.vtkhdf", lambda file: change(file["VTKHDF"])), message)


def test_su2_with_a_byte_order_mark(tmp_path: Path) -> None:
    WRITERS["box.su2"](tmp_path / "m.su2")
    plain = read_mesh(tmp_path / "m.su2")
    (tmp_path / "m.su2").write_bytes(b"\xef\xbb\xbf" + (tmp_path / "m.su2").read_bytes())
    np.testing.assert_array_equal(read_mesh(tmp_path / "m.su2").points, plain.points)
    write_mesh(tmp_path / "moved.su2", replace(read_mesh(tmp_path / "m.su2"), points=plain.points + 0.5))
    np.testing.assert_array_equal(read_mesh(tmp_path / "moved.su2").points, plain.points + 0.5)


@pytest.mark.parametrize(("suffix", "order"), [("med", 1), ("med", 2), ("su2", 1), ("unv", 1), ("unv", 2)])
def test_gmsh_writes_the_mesh_of_its_own_file(tmp_path: Path, suffix: str, order: int) -> None:
    """A check with another reader: Gmsh reads a universal file that is written back."""
    with quiet_gmsh("Med" if suffix == "med" else "") as gmsh:
        gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
        gmsh.model.occ.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.5)
        gmsh.model.addPhysicalGroup(2, [1, 2], name="wet wall")
        gmsh.model.addPhysicalGroup(2, [3], name="outlet")
        gmsh.model.addPhysicalGroup(3, [1], name="fluid")
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(order)
        for one in ("msh", suffix):
            gmsh.write(str(tmp_path / f"m.{one}"))
        ours, other = (read_mesh(tmp_path / f"m.{one}") for one in (suffix, "msh"))
        assert ours.n_cells == other.n_cells
        assert ours.notes == other.notes
        found, there = ({"all": np.arange(len(mesh.points))} | dict(mesh.patches) for mesh in (ours, other))
        found = {name.replace("_", " "): nodes for name, nodes in found.items()}  # which SU2 has for blanks
        assert sorted(found) == sorted(there) == ["all", "outlet", "wet wall"]
        for name, nodes in there.items():
            one, same = ours.points[found[name]], other.points[nodes]
            np.testing.assert_allclose(
                one[np.lexsort(one.round(9).T)], same[np.lexsort(same.round(9).T)], rtol=0.0, atol=1e-12
            )
        if suffix == "unv":
            np.testing.assert_array_equal(ours.cells["tetra"], other.cells["tetra"])
            moved = ours.points * [2.0, 3.0, -1 / 3]
            write_mesh(tmp_path / "moved.unv", replace(ours, points=moved))
            gmsh.open(str(tmp_path / "moved.unv"))
            _, points, _ = gmsh.model.mesh.getNodes()
            np.testing.assert_array_equal(np.unique(points.reshape(-1, 3), axis=0), np.unique(moved, axis=0))


@pytest.mark.parametrize("order", [1, 2])
def test_med_lists_corners_in_an_order_of_its_own(tmp_path: Path, order: int) -> None:
    """A check with another writer: a cell of each type, written by Gmsh, has Gmsh's corners in the correct order."""
    with quiet_gmsh("Med") as gmsh:
        gmsh.option.setNumber("Mesh.SecondOrderIncomplete", 1)  # MED has no pyramid of 14 nodes
        volume = gmsh.model.addDiscreteEntity(3)
        for number, (kind, name) in enumerate([(4, "tetra"), (5, "hexahedron"), (6, "wedge"), (7, "pyramid")]):
            corners = _CORNERS[name] + np.array([2.0 * number, 0, 0])
            tags = 10 * number + 1 + np.arange(len(corners))
            gmsh.model.mesh.addNodes(3, volume, tags, corners.ravel())
            gmsh.model.mesh.addElementsByType(volume, kind, [number + 1], tags)
        gmsh.model.mesh.setOrder(order)
        gmsh.write(str(tmp_path / "m.med"))
    mesh = read_mesh(tmp_path / "m.med")
    for number, (name, corners) in enumerate(_CORNERS.items()):
        np.testing.assert_array_equal(mesh.points[mesh.cells[name]], (corners + np.array([2.0 * number, 0, 0]))[None])


def test_vtk_reads_the_same_side_sets_of_exodus(tmp_path: Path) -> None:
    """A check with another reader: VTK finds the sets of the file that the readers' test makes."""
    module = pytest.importorskip("vtkmodules.vtkIOExodus")
    exodus(tmp_path / "m.exo")
    reader = module.vtkExodusIIReader()
    reader.SetFileName(str(tmp_path / "m.exo"))
    reader.UpdateInformation()
    kind = reader.SIDE_SET
    names = [reader.GetObjectName(kind, number) for number in range(reader.GetNumberOfObjects(kind))]
    assert [name.partition(" ")[0] for name in names] == list(PATCHES)
    for name in names:
        reader.SetObjectStatus(kind, name, 1)
    reader.Update()
    sets = reader.GetOutput().GetBlock(4)
    for number, name in enumerate(PATCHES):
        block = sets.GetBlock(number)
        points = {tuple(np.round(block.GetPoint(k), 6)) for k in range(block.GetNumberOfPoints())}
        assert points == {tuple(row) for row in POINTS[PATCHES[name]].round(6).tolist()}


def changed_hdf5(path: Path, change: Callable[[Any], None]) -> Path:
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "r+") as file:
        change(file)
    return path


def test_med_and_exodus_files_that_do_not_fit(tmp_path: Path) -> None:
    path, step = tmp_path / "m.med", "ENS_MAA/box/-0000000000000000001-0000000000000000001"
    med(path)
    changed_hdf5(path, lambda file: file[f"{step}/MAI/HE8/NOD"].write_direct(np.full(64, 99)))
    one_line(path, "element 1 of type HE8 names node 99")
    med(path)
    changed_hdf5(path, lambda file: file[f"{step}/MAI"].move("HE8", "POE"))
    one_line(path, "malformed or damaged MED file: .*INN")
    med(path)
    changed_hdf5(path, lambda file: file[f"{step}/MAI"].move("HE8", "PO2"))
    one_line(path, r"elements of type PO2; known are .*convertQuadraticCellsToLinear makes polygons")
    for key, value, message in (("TYP", 1, "'box' is structured"), ("REP", 1, "of the mesh 'box' are cylindrical")):
        med(path)
        changed_hdf5(path, lambda file, key=key, value=value: file["ENS_MAA/box"].attrs.update({key: value}))
        one_line(path, message)
    med(path)
    changed_hdf5(path, lambda file: file.pop(step))
    one_line(path, "the mesh 'box' has no nodes")
    path.write_bytes(path.read_bytes()[:3000])
    one_line(path, "malformed or damaged MED file")
    path = tmp_path / "m.exo"
    exodus(path)
    data = path.read_bytes()
    path.write_bytes(data.replace(b"HEX8", b"NSID"))
    one_line(path, "block 1 of elements of type 'NSID'")
    path.write_bytes(data[:700])
    one_line(path, "malformed or damaged Exodus file")
    exodus_hdf5(path)
    changed_hdf5(path, lambda file: file["side_ss2"].write_direct(np.full(16, 7, ">i4")))
    one_line(path, "side 7 of a hexahedron, which has 6 sides")


@pytest.mark.parametrize(
    ("write", "old", "new", "message"),
    [
        (abaqus, "C3D8", "C3D6", r"elements C3D6 of 6 nodes, but 72 numbers follow$"),
        (
            abaqus,
            "*ELEMENT, TYPE=C3D8",
            "*ELEMENT, TYPE=C3D6\n" + ", ".join(["1"] * 19) + "\n*ELEMENT, TYPE=C3D8",
            "19 numbers follow; Gmsh calls wedges of 18 nodes so: .*SecondOrderIncomplete = 1",
        ),
        (abaqus, "C3D8", "C3D20", r"\*ELEMENT in line 32: elements C3D20 of 20 nodes, but 72 numbers follow"),
        (abaqus, "1, S", "77, S", "element 77 is named, but does not exist"),
        (abaqus, ", S1", ", S9", "side 9 of a hexahedron"),
        (abaqus, "\n27, ", "\n28, ", "node 27 is named, but does not exist"),
        (abaqus, "\n27, ", "\n26, ", "node 26 appears twice"),
        (abaqus, "\n27, ", f"\n{10**20}, ", "too large"),
        (abaqus, "*ELEMENT, TYPE=C3D8", "*NGEN\n1, 3\n*ELEMENT, TYPE=C3D8", r"\*NGEN in line 32: it generates nodes"),
        (abaqus, "*Node", "*SYSTEM\n0, 0, 1\n*Node", "nodes in a local coordinate system"),
        (abaqus, "NSET=Nall", "NSET=Nall, SYSTEM=C", "SYSTEM=C, expected Cartesian"),
        (abaqus, "*STEP", "*INSTANCE, NAME=a, PART=p\n1, 0, 0\n*STEP", "'a' is moved to its place"),
        (abaqus, "*STEP", "*INSTANCE, NAME=a, PART=p\n*INSTANCE, NAME=b, PART=p\n*STEP", "'b' follows 'a', but one"),
        (
            abaqus,
            "*MATERIAL",
            "*SURFACE, NAME=all, COMBINE=UNION\na, b\n*MATERIAL",
            "COMBINE=UNION of other surfaces; list",
        ),
        (
            abaqus,
            "*MATERIAL",
            "*ELEMENT, TYPE=U1\n900, 1, 2\n*SURFACE, NAME=all\n900, S1\n*MATERIAL",
            "element 900 is named, but is of type U1, which is not read",
        ),
        (
            abaqus,
            "*MATERIAL",
            "*PART, NAME=a\n*PART, NAME=b\n*NODE\n1, 0, 0, 0\n*MATERIAL",
            "node 1 appears twice, because each of 2 parts counts its own; Abaqus/CAE writes one list",
        ),
        (abaqus, "*STEP", "*INCLUDE, INPUT=none.inp\n*STEP", "'none.inp', which is not there: run the pre-"),
        (
            abaqus,
            "*SURFACE",
            "*NSET, NSET=n, GENERATE\n1, 3000000000, 1\n*SURFACE",
            "more than 50000000 numbers from 1 to",
        ),
        (abaqus, "*SURFACE", "*NSET, NSET=n, GENERATE\n1, 4, 0\n*SURFACE", "an increment of 0, expected at least 1"),
        (
            abaqus,
            "*SURFACE",
            "*NSET, NSET=n, GENERATE\n4, 1, -1\n*SURFACE",  # an empty set, without a word
            "an increment of -1, expected at least 1",
        ),
        (kratos, "\n27 ", "\n28 ", "node 27 is named, but does not exist"),
        (kratos, "\n24\n", "\n25\n", "names condition 25, which is not there"),
        (kratos, "End Elements", "End Conditions", "line 43: 'End Conditions' ends a block that is not open"),
    ],
)
def test_text_of_finite_elements_that_does_not_fit(
    tmp_path: Path, write: Callable[[Path], None], old: str, new: str, message: str
) -> None:
    write(tmp_path / "m.txt")
    one_line(replaced(tmp_path / "m.txt", old, new), message)


def test_sets_of_faces_in_abaqus_count_before_those_of_their_lists(tmp_path: Path) -> None:
    """Groups as in files of Gmsh: each surface is listed with its name, and a set names the elements of a group."""
    points = "1, 0, 0, 0\n2, 1, 0, 0\n3, 1, 1, 0\n4, 0, 1, 0\n5, 0.4, 0.4, 1\n"
    lists = [("CPS4", "Surface1", "1, 1, 2, 3, 4"), ("CPS3", "Surface2", "2, 1, 2, 5\n3, 2, 3, 5"),
             ("CPS3", "Surface3", "4, 3, 4, 5"), ("C3D5", "Volume1", "9, 1, 2, 3, 4, 5")]  # fmt: skip
    elements = "".join(f"*ELEMENT, TYPE={kind}, ELSET={name}\n{rows}\n" for kind, name, rows in lists)
    sets = "*ELSET, ELSET=wall\n1, 2\n*ELSET, ELSET=side\nSurface3\n*ELSET, ELSET=all\n1, 2, 3, 4, 9\n"
    (tmp_path / "m.inp").write_text(f"*NODE\n{points}{elements}{sets}")
    found = {name: nodes.tolist() for name, nodes in read_mesh(tmp_path / "m.inp").patches.items()}
    assert found == {"Surface2": [0, 1, 2, 4], "wall": [0, 1, 2, 3, 4], "side": [2, 3, 4]}


def test_sets_of_an_instance_in_abaqus(tmp_path: Path) -> None:
    """One part as in files of Abaqus/CAE: sets of the assembly name nodes, elements and sets of its instance."""
    nodes = "1, 0, 0\n2, 1, 0\n3, 1, 1\n4, 0, 1\n"
    part = f"*PART, NAME=p\n*NODE\n{nodes}*ELEMENT, TYPE=CPS4\n1, 1, 2, 3, 4\n*NSET, NSET=of_part\n3,\n*END PART\n"
    sets = "*NSET, NSET=a\np-1.of_part, p-1.4\n*SURFACE, NAME=s\np-1.1, S1\n*NSET, NSET=b, INSTANCE=p-1\n2,\n"
    assembly = f"*ASSEMBLY, NAME=x\n*INSTANCE, NAME=p-1, PART=p\n*END INSTANCE\n{sets}*END ASSEMBLY\n"
    (tmp_path / "m.inp").write_text(part + assembly)
    assert lists(read_mesh(tmp_path / "m.inp").patches) == {"s": [0, 1], "of_part": [2], "a": [2, 3], "b": [1]}


def test_geometries_and_nested_parts_of_kratos(tmp_path: Path) -> None:
    """A file without elements has its geometries as cells, and a part has the cells of its sub-parts, too."""
    points = "".join(f"{k} {x} {y} {z}\n" for k, (x, y, z) in enumerate(
        [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0.4, 0.4, 1), (0.4, 0.4, -1)], start=1))  # fmt: skip

    def part(name: str, what: str, numbers: str, inner: str = "") -> str:
        listed = f"Begin SubModelPart{what}\n{numbers}\nEnd SubModelPart{what}\n"
        return f"Begin SubModelPart {name}\n{listed}{inner}End SubModelPart\n"

    parts = part("boundary", "Nodes", "1\n2\n3\n4\n6", part("foot", "Geometries", "9"))
    parts += part("fluid", "Nodes", "5", part("half", "Geometries", "1")) + part("all", "Nodes", "1\n2\n3\n4\n5\n6")
    (tmp_path / "m.mdpa").write_text(
        f"Begin Nodes\n{points}End Nodes\nBegin Geometries Pyramid3D5\n1 1 2 3 4 5\nEnd Geometries\n"
        f"Begin Geometries Quadrilateral3D4\n9 1 2 3 4\nEnd Geometries\n{parts}"
    )
    mesh = read_mesh(tmp_path / "m.mdpa")
    assert lists(mesh.cells) == {"pyramid": [[0, 1, 2, 3, 4]]}
    assert lists(mesh.patches) == {"boundary.foot": [0, 1, 2, 3], "boundary": [0, 1, 2, 3, 5]}
    elements = "Begin Elements MembraneElement3D4N\n3 0 1 2 3 4\nEnd Elements\n"
    elements += "Begin Elements MembraneElement2D2N\n7 0 1 2\nEnd Elements\n"
    elements += "Begin Elements Element3D5N\n4 0 1 2 3 4 5\nEnd Elements\n"
    nested = part("body", "Nodes", "1", part("cells", "Elements", "4"))
    (tmp_path / "m.mdpa").write_text((tmp_path / "m.mdpa").read_text() + elements + nested)
    mesh = read_mesh(tmp_path / "m.mdpa")
    assert lists(mesh.cells) == {"pyramid": [[0, 1, 2, 3, 4]]}
    assert "body" not in mesh.patches


def test_parts_of_elmer_are_one_mesh(tmp_path: Path) -> None:
    """As ElmerGrid divides it: nodes of an interface in both parts, copies of other parts' elements, names outside."""
    elmer(whole := tmp_path / "mesh")
    (parts := whole / "partitioning.2").mkdir()
    nodes, elements, boundary = (
        (whole / f"mesh.{of}").read_text().splitlines() for of in ("nodes", "elements", "boundary")
    )
    for part, own in ((1, elements[:4]), (2, elements[4:])):
        numbers = {word for row in own for word in row.split()[3:]}
        cells = {row.split()[0] for row in own}
        files = {
            "header": ["18 4 0"],
            "nodes": [row for row in reversed(nodes) if row.split()[0] in numbers],
            "elements": [*own, f"99/{3 - part} 1 808 {' '.join(own[0].split()[3:])}"],
            "boundary": [row for row in boundary if row.split()[2] in cells],
        }
        for name, lines_of in files.items():
            (parts / f"part.{part}.{name}").write_text("\n".join(lines_of) + "\n")
    mesh, expected = read_mesh(parts), read_mesh(whole)
    rows = [np.flatnonzero((expected.points == point).all(axis=1))[0] for point in mesh.points]
    assert sorted(rows) == list(range(27))
    assert {name: sorted(rows[node] for node in of) for name, of in mesh.patches.items()} == lists(expected.patches)
    np.testing.assert_array_equal(np.array(rows)[mesh.cells["hexahedron"]], expected.cells["hexahedron"])
    write_mesh(tmp_path / "moved", replace(mesh, points=mesh.points + 1 / 3))
    moved = read_mesh(tmp_path / "moved")
    assert moved.points.tolist() == (mesh.points + 1 / 3).tolist()
    assert lists(moved.patches) == lists(mesh.patches)
    one_line(whole / "mesh.header", r"a file of an Elmer folder, which is not read \(give its folder\)")


def test_comments_and_lines_of_kratos(tmp_path: Path) -> None:
    """Kratos reads words, not lines, and comments over several lines; checked with Kratos 10.4."""
    (tmp_path / "m.mdpa").write_text(
        "/* of\nBegin Nodes\n*/\nBegin Nodes\n1 0 0 0 /* one */\n2 1 0 0 // two\n/* 9 9 9 9 */\n3 1\n1 0 4 0 1 0\n"
        "End Nodes\nBegin Elements Element2D4N\n1 0 1 2\n3 4\nEnd Elements\nBegin Conditions LineCondition2D2N\n"
        "1 0 1 2 2 0\n2 3\nEnd Conditions\nBegin SubModelPart a\nBegin SubModelPart b\n"
        "Begin SubModelPartConditions\n1 2\nEnd SubModelPartConditions\nEnd SubModelPart\nEnd SubModelPart\n"
    )
    mesh = read_mesh(tmp_path / "m.mdpa")
    assert mesh.points.tolist() == [[0, 0], [1, 0], [1, 1], [0, 1]]
    assert lists(mesh.cells) == {"quad": [[0, 1, 2, 3]]}
    assert lists(mesh.patches) == {"a.b": [0, 1, 2]}
    write_mesh(tmp_path / "moved.mdpa", replace(mesh, points=mesh.points + 1 / 3))
    moved = (tmp_path / "moved.mdpa").read_text()
    assert read_mesh(tmp_path / "moved.mdpa").points.tolist() == (mesh.points + 1 / 3).tolist()
    assert all(comment in moved for comment in ("/* of\nBegin Nodes\n*/", "/* one */", "// two", "/* 9 9 9 9 */"))
    (tmp_path / "m.mdpa").write_text("Begin Nodes\n1 0 0\nEnd Nodes\n")
    one_line(tmp_path / "m.mdpa", "block 'Nodes' in line 1: 3 numbers, expected four for each node")


def test_what_abaqus_and_calculix_allow_in_an_input(tmp_path: Path) -> None:
    abaqus(path := tmp_path / "box.inp")
    text = path.read_text()
    nodes = text[text.index("*Node, NSET=Nall\n") : text.index("*ELEMENT")]
    (tmp_path / "nodes.txt").write_text(nodes.partition("\n")[2].replace("0.7", "0.7D0"))
    text = text.replace(nodes, " *Node, NSET=Nall, Input=nodes.txt\n")
    text = text.replace("NSET=sides", 'NSET="my sides"').replace(
        "*MATERIAL", ' *Nset, Nset=all2\n "my sides"\n*MATERIAL'
    )
    path.write_text(
        text.replace("*MATERIAL", "*NSET, NSET=of far, ELSET=far\n*ELEMENT, TYPE=SPRINGA\n900, 1, 2\n*MATERIAL")
    )
    mesh = read_mesh(path)
    assert np.array_equal(mesh.points, POINTS)
    expected = {"wall": "wall", "far": "far", "of far": "far", "my sides": "sides", "all2": "sides"}
    assert lists(mesh.patches) == {name: PATCHES[of].tolist() for name, of in expected.items()}
    assert mesh.notes == ("its elements of type SPRINGA are not read",)
    write_mesh(tmp_path / "moved.inp", replace(mesh, points=POINTS + 1))
    assert np.array_equal(read_mesh(tmp_path / "moved.inp").points, POINTS + 1)
    (tmp_path / "plate.inp").write_text(
        "*NODE\n1, 0, 0\n2, 1, 0\n3, 0, 1\n4, .5, 0\n5, .5, .5\n6, 0, .5\n *ELEMENT, TYPE=STRI65\n1, 1, 2, 3, 4, 5, 6\n"
    )
    plate = read_mesh(tmp_path / "plate.inp")
    assert lists(plate.cells) == {"triangle": [[0, 1, 2]]}
    write_mesh(tmp_path / "moved.inp", replace(plate, points=plate.points + 1))
    assert np.array_equal(read_mesh(tmp_path / "moved.inp").points, plate.points + 1)


def test_sets_of_abaqus_that_are_generated(tmp_path: Path) -> None:
    nodes = "1, 0, 0\n2, 1, 0\n3, 1, 1\n4, 0, 1\n"
    sets = "*NSET, NSET=a, GENERATE\n1, 3, 2\n*NSET, NSET=b\na, 2\n"
    (tmp_path / "m.inp").write_text(f"*NODE\n{nodes}*ELEMENT, TYPE=CPS4\n1, 1, 2, 3, 4\n{sets}")
    patches = read_mesh(tmp_path / "m.inp").patches
    assert {name: found.tolist() for name, found in patches.items()} == {"a": [0, 2], "b": [0, 1, 2]}


@pytest.mark.parametrize("layers", [1, 2])
def test_the_set_of_all_nodes_is_a_patch_if_all_are_outside(tmp_path: Path, layers: int) -> None:
    """Both sides of one layer of elements; the set named with the nodes is not a patch."""
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1), (2, 0), (2, 1), (2, 2), (1, 2), (0, 2)], float)
    points = np.vstack([np.column_stack([corners, np.full(9, z)]) for z in range(layers + 1)])
    plane = np.array([[0, 1, 2, 3], [1, 4, 5, 2], [2, 5, 6, 7], [3, 2, 7, 8]])
    cells = np.vstack([np.hstack([plane + 9 * k, plane + 9 * k + 9]) for k in range(layers)])
    numbers = "".join(f"{k}\n" for k in range(1, len(points) + 1))
    (tmp_path / "m.inp").write_text(
        "*NODE, NSET=all\n" + rows(points, separator=", ", first=1)
        + "*ELEMENT, TYPE=C3D8\n" + rows(cells + 1, separator=", ", first=1)
        + f"*NSET, NSET=sides\n{numbers}*NSET, NSET=wall\n1, 2, 5\n"
    )  # fmt: skip
    assert sorted(read_mesh(tmp_path / "m.inp").patches) == (["sides", "wall"] if layers == 1 else ["wall"])


def test_an_extent_that_is_only_announced_takes_no_memory(tmp_path: Path) -> None:
    extent = "0 1000000 0 1000000 0 0"
    points = '<DataArray type="Float64" NumberOfComponents="3" format="ascii">0 0 0</DataArray>'
    (tmp_path / "m.vts").write_text(
        f'<VTKFile type="StructuredGrid"><StructuredGrid WholeExtent="{extent}">'
        f'<Piece Extent="{extent}"><Points>{points}</Points></Piece></StructuredGrid></VTKFile>'
    )
    one_line(tmp_path / "m.vts", f"1 points, but a piece of the extent '{extent}'")


def test_second_order_of_abaqus_by_corners_with_the_middles_of_its_sides(tmp_path: Path) -> None:
    """One C3D10 whose surface has the middles of its edges, in CalculiX' order."""
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    middles = [corners[list(ends)].mean(axis=0) for ends in ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))]
    lines = "".join(f"{k}, {x}, {y}, {z}\n" for k, (x, y, z) in enumerate([*corners, *middles], start=1))
    (tmp_path / "m.inp").write_text(
        f"*NODE\n{lines}*ELEMENT, TYPE=C3D10, ELSET=all\n1, 1, 2, 3, 4, 5, 6,\n7, 8, 9, 10\n*SURFACE, NAME=s\nall, S2\n"
    )
    mesh = read_mesh(tmp_path / "m.inp")
    np.testing.assert_array_equal(mesh.cells["tetra"], [[0, 1, 2, 3]])
    np.testing.assert_array_equal(mesh.patches["s"], [0, 1, 3, 4, 7, 8])
    assert "by their corners" in mesh.notes[0]


@pytest.mark.parametrize(
    "name", ["box.msh", *(pytest.param(name, marks=pytest.mark.nightly) for name in WRITERS if name != "box.msh")]
)
def test_a_case_plays_with_the_file_of_another_program(tmp_path: Path, name: str) -> None:
    """The wall of the file goes up by a tenth, and the solver gets its own file with all nodes moved."""
    WRITERS[name](tmp_path / name)
    (tmp_path / "case.toml").write_text(
        f"[mesh]\nfile = '{name}'\n[patches]\nwall = 'moving'\nfar = 'fixed'\nsides = 'slip'\n"
        "[[motion]]\npatch = 'wall'\nrigid = { translation = [0.0, 0.0, 0.07], rotation = 0.0, centre = [0, 0, 0], "
        "axis = [0, 0, 1] }\n[steps]\ncount = 1\n"
    )
    program = [sys.executable, "-m", "mesh_motion_server"]
    for arguments in (
        ["play", "case.toml", "--out", "out", "--quiet"],
        ["convert", name, f"moved_{name}", "--points", "out/points.npy"],
    ):
        done = subprocess.run([*program, *arguments], cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    moved = read_mesh(tmp_path / f"moved_{name}")
    np.testing.assert_array_equal(moved.points, np.load(tmp_path / "out" / "points.npy"))
    np.testing.assert_allclose(moved.points[moved.patches["wall"], 2], 0.07, atol=1e-12)
    np.testing.assert_allclose(moved.points[moved.patches["far"], 2], 0.7, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "place"),
    [
        ("box.msh.h5", "meshes/1/faces/zoneTopology/id"),
        ("box.msh.h5", "meshes/1/faces/zoneTopology/maxId"),
        ("box.msh.h5", "meshes/1/nodes/coords/1"),
        ("box.med", "FAS/box/ELEME/*/GRO/NOM"),
    ],
)
def test_a_small_file_that_holds_very_much_is_refused(tmp_path: Path, name: str, place: str) -> None:
    h5py = pytest.importorskip("h5py")
    path = tmp_path / name
    WRITERS[name](path)
    with h5py.File(path, "r+") as file:
        place = next(iter(found for found in _places(file) if fnmatch(found, place)))
        dtype, attributes = file[place].dtype, dict(file[place].attrs)
        del file[place]
        file.create_dataset(place, (1 << 33,), dtype, chunks=(1 << 20,), compression="gzip").attrs.update(attributes)
    with pytest.raises(InvalidInput, match=r"bytes that hold \d+ or more"):
        read_mesh(path)


def test_zones_of_more_faces_than_there_are(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "box.msh.h5"
    WRITERS[path.name](path)
    with h5py.File(path, "r+") as file:
        file["meshes/1/faces/zoneTopology/maxId"][-1] = 1 << 40
    with pytest.raises(InvalidInput, match=f"zones of {1 << 40} faces, but the file has"):
        read_mesh(path)


def _places(file: Any) -> list[str]:
    found: list[str] = []
    file.visit(found.append)
    return found


def test_elmer_folders_that_do_not_fit_and_calculix_input_whatever_it_is_called(tmp_path: Path) -> None:
    elmer(tmp_path / "mesh")
    (tmp_path / "mesh" / "mesh.names").write_text("$far=1\n$the sides=2\n$wall=3\n")  # as Netgen writes it
    assert lists(read_mesh(tmp_path / "mesh").patches)["the sides"] == PATCHES["sides"].tolist()
    text = (tmp_path / "mesh" / "mesh.elements").read_text()
    (tmp_path / "mesh" / "mesh.elements").write_text(text.replace("808", "504"))
    one_line(tmp_path / "mesh", "row 1 of mesh.elements is of type 504, but has 8 nodes")
    (tmp_path / "mesh" / "mesh.elements").write_text(text.replace(" 27\n", " 28\n").replace(" 27 ", " 28 "))
    one_line(tmp_path / "mesh", "mesh.elements: node 28 is named, but does not exist")
    (tmp_path / "mesh" / "mesh.nodes").unlink()
    one_line(tmp_path / "mesh", "there is no mesh.nodes")
    abaqus(tmp_path / "all.msh")  # preCICE's tutorials call it so
    assert sorted(read_mesh(tmp_path / "all.msh").patches) == ["far", "sides", "wall"]


@pytest.mark.parametrize("name", ["box.mesh", "box.ugrid", "box_elmer/mesh.nodes", "box.mdpa", "box.inp", "box.vol"])
def test_exponents_of_fortran(tmp_path: Path, name: str) -> None:
    of = tmp_path / Path(name).parts[0]
    WRITERS[of.name](of)
    text = (tmp_path / name).read_text()
    (tmp_path / name).write_text(re.sub(r"(?<![\d.])0\.7(?=[\s,])", "7.0D-01", text))
    assert "7.0D-01" in (tmp_path / name).read_text()
    np.testing.assert_array_equal(read_mesh(of).points, POINTS)


def test_abaqus_input_in_several_files(tmp_path: Path) -> None:
    """Like preCICE's tutorials: a deck includes the mesh and the sets, only from its folder, and each file once."""
    abaqus(tmp_path / "whole.inp")
    text = (tmp_path / "whole.inp").read_text()
    (tmp_path / "all.msh").write_text(text[: text.index("*NSET")])
    (tmp_path / "sets.nam").write_text(text[text.index("*NSET") : text.index("*MATERIAL")])
    deck = tmp_path / "deck.inp"
    deck.write_text("*INCLUDE, INPUT=all.msh\n*include, input=sets.nam\n*STEP\n*END STEP\n")
    mesh = read_mesh(deck)
    assert lists(mesh.patches) == {key: nodes.tolist() for key, nodes in PATCHES.items()}
    (other := tmp_path / "other").mkdir()
    write_mesh(other / "moved.inp", replace(mesh, points=POINTS + 1))  # one file: the included ones are not there
    moved = read_mesh(other / "moved.inp")
    assert np.array_equal(moved.points, POINTS + 1)
    assert lists(moved.patches) == lists(mesh.patches)
    for name, reason in (
        ("../other.inp", "not in its folder"),
        ("deck.inp", "included twice"),
        ("no.inp", "not there"),
    ):
        deck.write_text(f"*INCLUDE, INPUT={name}\n")
        one_line(deck, reason)


@pytest.mark.parametrize(
    ("write", "old", "new", "message"),
    [
        (universal, "\n       101        94", "\n       101        97", "dataset 2412, line .*elements of type 97"),
        (universal, "         8       101", "         8       999", "names element 999, which is not there"),
        (universal, "2411\n         1 ", "2411\n         2 ", "node 2 appears twice"),
        (universal, "wall\n", "wall\n\n", "group 'wall' has 0 entities, expected 5"),
        (mfem, "\n1 5 0 ", "\n1 5 27 ", "row 0 of elements names vertex 27, but there are 27"),
        (mfem, "\n1 5 0 ", "\n1 9 0 ", "row 0 of elements is of geometry 9"),
        (mfem, "vertices\n27\n", "vertices\n28\n", "28 vertices with 3 coordinates: 81 numbers, expected 84"),
        (mfem, "dimension", "dimensions", "it has no dimension"),
        (mfem_by_axes, "H1_3D_P1", "L2_T1_3D_P1", "its nodes are of L2_T1_3D_P1; only continuous ones are read"),
        (xdmf, "Hexahedron", "Polygon", "a topology of type polygon"),
        (xdmf, 'Dimensions="8 8"', 'Dimensions="9 8"', "an item of 64 numbers, but Dimensions '9 8'"),
        (xdmf, "Grid/Geometry)", "Grid/Geo)", "the reference .* has no target"),
        (xdmf_hdf5, ":/Mesh/cells", ":/Mesh/no", "object 'no' doesn't exist"),
        (
            xdmf,
            'TopologyType="Hexahedron"',
            'TopologyType="3DCoRectMesh" Dimensions="2000 2000 2000"',
            "bytes that hold",
        ),
        (
            xdmf,
            "<Grid ",
            '<Grid ItemType="x" Reference="/Xdmf/Domain/Grid[@Reference]"/><Grid ',
            "has no target|no Geometry",
        ),
        (xdmf_binary, "m.bin", "n.bin", "there is no .*n.bin, which should hold its numbers"),
    ],
)
def test_unv_mfem_and_xdmf_that_do_not_fit(
    tmp_path: Path, write: Callable[[Path], None], old: str, new: str, message: str
) -> None:
    write(tmp_path / "m.txt")
    one_line(replaced(tmp_path / "m.txt", old, new, 1), message)


@pytest.mark.parametrize("suffix", ["msh", "cgns", "unv", "med", "su2", "vtk"])
def test_groups_of_gmsh_with_one_number_are_patches_of_their_own(tmp_path: Path, suffix: str) -> None:
    """A point, a curve, a surface and the volume have the number 1, as in Gmsh's automatic numbering."""
    with quiet_gmsh("Cgns" if suffix == "cgns" else "") as gmsh:
        gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
        gmsh.model.occ.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.5)
        for dimension, (entity,) in enumerate([[8], [1], [2], [1]]):  # at x = 1, x = 0, x = 1
            gmsh.model.addPhysicalGroup(dimension, [entity], 1)
        gmsh.model.mesh.generate(3)
        gmsh.write(str(tmp_path / f"m.{suffix}"))
    mesh = read_mesh(tmp_path / f"m.{suffix}")
    ends = [{*mesh.points[nodes, 0].tolist()} for nodes in mesh.patches.values() if len(nodes) > 1]
    assert ends
    assert all(len(found) == 1 for found in ends)  # none has a surface and a curve
    assert {1.0} in ends


def test_nodes_of_single_precision_come_back_in_double(tmp_path: Path) -> None:
    """Dataset 15 has six digits; a beam has an additional line before its nodes."""
    (tmp_path / "m.unv").write_text(
        "    -1\n    15\n"
        + "".join(
            f"{k:10}{0:10}{0:10}{1:10}" + "".join(f"{v:13.5E}" for v in (*xy, 0.0)) + "\n"
            for k, xy in enumerate([(0, 0), (1, 0), (1, 1), (0, 1)], start=5)
        )
        + "    -1\n    -1\n  2412\n         1        44         1         1         7         4\n"
        "         5         6         7         8\n"
        "         2        21         1         1         7         2\n         0         1         1\n"
        "         5         6\n    -1\n    -1\n  2477\n"
        "         1         0         0         0         0         0         0         1\nlow\n"
        "         8         2         0         0\n    -1\n"
    )
    mesh = read_mesh(tmp_path / "m.unv")
    assert lists(mesh.patches) == {"low": [0, 1]}
    write_mesh(tmp_path / "moved.unv", replace(mesh, points=mesh.points / 3))
    np.testing.assert_array_equal(read_mesh(tmp_path / "moved.unv").points, mesh.points / 3)


def test_curved_meshes_of_mfem_have_their_patches_between_vertices(tmp_path: Path) -> None:
    """A bar of two quadrilaterals of third order: MFEM numbers edges in the order in which elements first use them."""
    corners = np.array([[0.0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1]])
    quads = [(0, 1, 4, 3), (1, 2, 5, 4)]
    edges = list(dict.fromkeys(tuple(sorted((q[k], q[(k + 1) % 4]))) for q in quads for k in range(4)))
    between = [corners[a] + (corners[b] - corners[a]) * t for a, b in edges for t in (1 / 3, 2 / 3)]
    inside = [corners[q[0]] + [x, y] for q in quads for y in (1 / 3, 2 / 3) for x in (1 / 3, 2 / 3)]
    points = np.array([*corners, *between, *inside])
    (tmp_path / "m.mesh").write_text(
        "MFEM mesh v1.0\n\ndimension\n2\n"
        "elements\n2\n1 3 0 1 4 3\n2 3 1 2 5 4\nboundary\n3\n5 1 0 1\n5 1 2 1\n6 1 5 4\n"
        "vertices\n6\n\nnodes\nFiniteElementSpace\nFiniteElementCollection: H1_2D_P3\nVDim: 2\nOrdering: 1\n\n"
        + "".join(f"{x!r} {y!r}\n" for x, y in points.tolist())
    )
    mesh = read_mesh(tmp_path / "m.mesh")
    np.testing.assert_array_equal(mesh.points, points)
    np.testing.assert_array_equal(mesh.patches["5"], np.flatnonzero(points[:, 1] == 0.0))
    np.testing.assert_array_equal(mesh.patches["6"], np.flatnonzero((points[:, 1] == 1.0) & (points[:, 0] >= 1.0)))
    assert "by their corners" in mesh.notes[0]
    write_mesh(tmp_path / "moved.mesh", replace(mesh, points=points / 3))
    np.testing.assert_array_equal(read_mesh(tmp_path / "moved.mesh").points, points / 3)
    one_line(replaced(tmp_path / "m.mesh", "6 1 5 4", "6 1 5 3"), "row 2 of boundary is on no element")


@pytest.mark.parametrize("form", ["XML", "HDF", "Binary"])
def test_meshio_writes_mixed_topologies_of_xdmf(tmp_path: Path, form: str) -> None:
    meshio = pytest.importorskip("meshio")
    points = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1], [2, 0.5]])
    cells = [("line", [[0, 1], [1, 4]]), ("quad", [[0, 1, 2, 3]]), ("triangle", [[1, 4, 2]])]
    data = {"gmsh:physical": [np.array([3, 4]), np.array([9]), np.array([9])], "T": [np.zeros(2), [1.0], [2.0]]}
    meshio.write(tmp_path / "m.xdmf", meshio.Mesh(points, cells, cell_data=data), data_format=form)
    mesh = read_mesh(tmp_path / "m.xdmf")
    np.testing.assert_array_equal(mesh.points, points)
    assert lists(mesh.cells) == {"quad": [[0, 1, 2, 3]], "triangle": [[1, 4, 2]]}
    assert lists(mesh.patches) == {"3": [0, 1], "4": [1, 4]}
    other = tmp_path / "other"
    other.mkdir()
    write_mesh(other / "moved.xdmf", replace(mesh, points=points / 3))
    np.testing.assert_array_equal(read_mesh(other / "moved.xdmf").points, points / 3)
    if form != "Binary":  # of which meshio does not look in the folder of the file
        np.testing.assert_array_equal(meshio.read(other / "moved.xdmf").points[:, :2], points / 3)
    np.testing.assert_array_equal(read_mesh(tmp_path / "m.xdmf").points, points)  # the first file's numbers stay


def test_meshio_writes_a_series_of_steps_of_xdmf(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its steps include the mesh by another name of XInclude than FEniCS' do."""
    meshio = pytest.importorskip("meshio")
    monkeypatch.chdir(tmp_path)  # the file of numbers is written there
    points = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    with meshio.xdmf.TimeSeriesWriter("m.xdmf") as writer:
        writer.write_points_cells(points, {"quad": np.array([[0, 1, 2, 3]])})
        for time in (0.0, 0.5):
            writer.write_data(time, point_data={"patch": np.array([4, 4, 0, 0])})
    mesh = read_mesh(tmp_path / "m.xdmf")
    assert lists(mesh.cells) == {"quad": [[0, 1, 2, 3]]}
    assert lists(mesh.patches) == {"4": [0, 1]}
    write_mesh(tmp_path / "moved.xdmf", replace(mesh, points=points / 3))
    np.testing.assert_array_equal(read_mesh(tmp_path / "moved.xdmf").points, points / 3)


@pytest.mark.parametrize("space", ["http://www.w3.org/2001/XInclude", "https://www.w3.org/2001/XInclude/"])
def test_tags_of_fenics_are_patches_and_a_series_is_one_mesh(tmp_path: Path, space: str) -> None:
    """Like dolfinx: tags in a separate grid, without a number type; steps that include the mesh."""
    tags = (
        '<Attribute Name="f" AttributeType="Scalar" Center="Cell">'
        '<DataItem Dimensions="2 1" Format="XML">3\n7</DataItem>'
    )
    cells = (
        '<Topology TopologyType="Quadrilateral" NodesPerElement="4"><DataItem Dimensions="1 4" NumberType="Int" '
        'Format="XML">0 1 2 3</DataItem></Topology><Geometry GeometryType="XY"><DataItem Dimensions="4 2" '
        'Format="XML">0 0 1 0 1 1 0 1</DataItem></Geometry>'
    )
    part = (
        '<Attribute Name="part" Center="Cell"><DataItem ItemType="HyperSlab" Dimensions="1"/></Attribute>'
        '<Attribute Name="stress" AttributeType="Tensor" Center="Cell"><DataItem Format="HDF" Dimensions="1 9">'
        "none.h5:/s</DataItem></Attribute>"
    )
    step = (
        '<Grid Name="u" GridType="Uniform"><xi:include xpointer="xpointer(/Xdmf/Domain/Grid[@GridType='
        "'Uniform'][1]/*[self::Topology or self::Geometry])\"/>"
        '<Attribute Name="u" AttributeType="Scalar" Center="Node"><DataItem Dimensions="4 1" Format="HDF">'
        "none.h5:/u</DataItem></Attribute></Grid>"
    )
    text = (
        f'<Xdmf Version="3.0" xmlns:xi="{space}"><Domain>'
        f'<Grid Name="mesh" GridType="Uniform">{cells}{part}</Grid><Grid Name="tags" GridType="Uniform">'
        '<xi:include xpointer="xpointer(/Xdmf/Domain/Grid/Geometry)"/><Topology TopologyType="PolyLine" '
        'NodesPerElement="2" BaseOffset="1"><DataItem Dimensions="2 2" NumberType="Int" Format="XML">1 2 3 4</DataItem>'
        "</Topology>"
        f'{tags}</Attribute></Grid><Grid GridType="Collection" CollectionType="Temporal">{step}{step}</Grid>'
        "</Domain></Xdmf>"
    )
    (tmp_path / "m.xdmf").write_text(text)
    mesh = read_mesh(tmp_path / "m.xdmf")
    assert lists(mesh.cells) == {"quad": [[0, 1, 2, 3]]}
    assert lists(mesh.patches) == {"3": [0, 1], "7": [2, 3]}


def _hyperslabs(path: Path, rows_of: str) -> Path:
    """A quadrilateral whose points are every second row of an array, and its edges with the marks in a column."""
    points = " ".join(map(str, np.repeat([[0.0, 0], [1, 0], [1, 1], [0, 1]], 2, axis=0).ravel().tolist()))
    slab = '<DataItem ItemType="HyperSlab" Dimensions="{}"><DataItem Dimensions="3 2">{}</DataItem>{}</DataItem>'
    whole = f'<DataItem Dimensions="8 2">{points}</DataItem>'
    marks = slab.format("2", "0 1 1 1 2 1", '<DataItem Dimensions="2 2" NumberType="Int">9 3 9 7</DataItem>')
    path.write_text(
        '<Xdmf Version="3.0"><Domain><Grid Name="mesh"><Topology TopologyType="Quadrilateral">'
        '<DataItem Dimensions="1 4">0 1 2 3</DataItem></Topology>'
        f'<Geometry GeometryType="XY">{slab.format("4 2", rows_of, whole)}</Geometry></Grid>'
        '<Grid Name="edges"><Topology TopologyType="Polyline" NodesPerElement="2">'
        '<DataItem Dimensions="2 2">0 1 2 3</DataItem></Topology>'
        f'<Geometry Reference="XML">/Xdmf/Domain/Grid/Geometry</Geometry>'
        f'<Attribute Name="patch" Center="Cell">{marks}</Attribute></Grid></Domain></Xdmf>'
    )
    return path


def test_hyperslabs_of_xdmf_are_parts_of_arrays(tmp_path: Path) -> None:
    mesh = read_mesh(_hyperslabs(tmp_path / "m.xdmf", "0 0 2 1 4 2"))
    assert mesh.points.tolist() == [[0, 0], [1, 0], [1, 1], [0, 1]]
    assert lists(mesh.patches) == {"3": [0, 1], "7": [2, 3]}
    with pytest.raises(InvalidInput, match=r"its points are a part of a larger array \(HyperSlab\) \(take \.vtu\)"):
        write_mesh(tmp_path / "moved.xdmf", replace(mesh, points=mesh.points / 3))
    one_line(_hyperslabs(tmp_path / "m.xdmf", "0 0 2 1 5 2"), "from 0 to 8 by 2 in direction 0, in .* has 8 rows")
    one_line(_hyperslabs(tmp_path / "m.xdmf", "0 -1 2 1 4 2"), "from -1 to 0 by 1 in direction 1")


def test_grids_on_two_parts_of_an_array_are_two_pieces(tmp_path: Path) -> None:
    one = _hyperslabs(tmp_path / "m.xdmf", "0 0 2 1 4 2").read_text()
    grid = one[one.index("<Grid") : one.index("</Grid>") + 7]
    other = grid.replace("0 0 2 1 4 2", "1 0 2 1 4 2").replace('"mesh"', '"other"').replace("1.0", "2.0")
    (tmp_path / "m.xdmf").write_text(f"<Xdmf><Domain>{grid}{other}</Domain></Xdmf>")
    mesh = read_mesh(tmp_path / "m.xdmf")
    assert mesh.points.tolist() == [[0, 0], [1, 0], [1, 1], [0, 1], [2, 0], [2, 2], [0, 2]]


@pytest.mark.parametrize("kind", ["3DSMesh", "3DRectMesh", "3DCoRectMesh"])
def test_structured_grids_of_xdmf(tmp_path: Path, kind: str) -> None:
    """Dimensions and points run with x fastest, as VTK's."""
    lines = [np.array([0.0, 1.0]), np.array([0.0, 0.5, 1.0]), np.array([0.0, 2.0, 4.0, 6.0])]  # z, y, x
    z, y, x = (of.ravel() for of in np.meshgrid(*lines, indexing="ij"))
    points = np.column_stack([x, y, z])
    numbers = {
        "3DSMesh": ("XYZ", [points]),
        "3DRectMesh": ("VXVYVZ", lines[::-1]),
        "3DCoRectMesh": ("ORIGIN_DXDYDZ", [np.zeros(3), np.array([1.0, 0.5, 2.0])]),
    }
    geometry, arrays = numbers[kind]
    items = "".join(
        f'<DataItem Dimensions="{" ".join(map(str, of.shape))}">{" ".join(map(str, of.ravel().tolist()))}</DataItem>'
        for of in arrays
    )
    (tmp_path / "m.xmf").write_text(
        f'<Xdmf Version="2.0"><Domain><Grid><Topology TopologyType="{kind}" Dimensions="2 3 4"/>'
        f'<Geometry GeometryType="{geometry}">{items}</Geometry></Grid></Domain></Xdmf>'
    )
    mesh = read_mesh(tmp_path / "m.xmf")
    np.testing.assert_array_equal(mesh.points, points)
    assert mesh.n_cells == 6
    corners = mesh.points[mesh.cells["hexahedron"]]
    np.testing.assert_array_equal(np.ptp(corners, axis=1), np.broadcast_to([2.0, 0.5, 1.0], (6, 3)))
    (block,) = oriented(mesh.points, mesh.cell_table).cells
    np.testing.assert_array_equal(block.nodes, mesh.cells["hexahedron"])  # none is mirrored
    if kind != "3DSMesh":
        with pytest.raises(InvalidInput, match="a grid without a list of points"):
            write_mesh(tmp_path / "moved.xmf", mesh)


def test_a_copy_of_xdmf_never_replaces_numbers_of_the_first_file(tmp_path: Path) -> None:
    xdmf_hdf5(tmp_path / "m.xdmf")
    mesh = read_mesh(tmp_path / "m.xdmf")
    (tmp_path / "other.h5").write_bytes((tmp_path / "m.h5").read_bytes())
    text = (tmp_path / "m.xdmf").read_text()
    (tmp_path / "m.xdmf").write_text(text.replace("m.h5:/Mesh/faces", "other.h5:/Mesh/faces"))
    with pytest.raises(InvalidInput, match=r"the copy of m.h5 would replace other.h5"):
        write_mesh(tmp_path / "other.xdmf", mesh)
    write_mesh(tmp_path / "m.xdmf", replace(mesh, points=mesh.points / 3))  # in its own place
    np.testing.assert_array_equal(read_mesh(tmp_path / "m.xdmf").points, mesh.points / 3)


def apart(path: Path) -> None:
    """A unit square; its lower side and its upper right node both have the name "wall"."""
    if path.suffix == ".inp":
        nodes = "1, 0, 0\n2, 1, 0\n3, 1, 1\n4, 0, 1\n"
        sets = "*SURFACE, NAME=wall\n1, S1\n*NSET, NSET=wall\n3\n"
        path.write_text(f"*NODE\n{nodes}*ELEMENT, TYPE=CPS4\n1, 1, 2, 3, 4\n{sets}")
        return
    with quiet_gmsh() as gmsh:
        gmsh.model.occ.addRectangle(0, 0, 0, 1, 1)
        gmsh.model.occ.synchronize()
        for dimension, entity in ((1, 1), (0, 3)):
            gmsh.model.addPhysicalGroup(dimension, [entity], name="wall")
        gmsh.model.addPhysicalGroup(2, [1], name="fluid")
        gmsh.model.mesh.generate(2)
        gmsh.write(str(path))


@pytest.mark.parametrize("suffix", ["inp", "msh", "med"])
def test_one_name_of_a_side_and_of_a_node_elsewhere_is_said(tmp_path: Path, suffix: str) -> None:
    apart(tmp_path / f"m.{suffix}")
    mesh = read_mesh(tmp_path / f"m.{suffix}")
    assert {*mesh.points[mesh.patches["wall"], 1].tolist()} == {0.0, 1.0}
    name = "WALL" if "WALL" in mesh.patches else "wall"
    assert any(
        note.startswith(f"{name!r} is the name of a curve and of a point with 1 other node") for note in mesh.notes
    )


def with_a_node_set(path: Path, node: int, name: bytes) -> Path:
    """The box of Exodus with a node set of the number 1, which a side set has too; without ``name`` no set has a
    name.
    """
    from scipy.io import netcdf_file  # noqa: PLC0415

    exodus(path)
    with netcdf_file(path, "a", mmap=False) as file:
        for dimension in ("num_node_sets", "num_nod_ns1"):
            file.createDimension(dimension, 1)
        file.createVariable("ns_prop1", "i", ("num_node_sets",))[:] = 1
        file.createVariable("node_ns1", "i", ("num_nod_ns1",))[:] = node + 1
        names = file.createVariable("ns_names", "c", ("num_node_sets", "len_name"))
        names[0] = np.frombuffer(name.ljust(33, b"\0"), "S1")
        if not name:
            file.variables["ss_names"][:] = b"\0"
    return path


def test_restrained_nodes_of_universal_files_are_patches(tmp_path: Path) -> None:
    """As I-DEAS names inlets and outlets: sets of degrees of freedom, each with its number behind its name."""
    path = tmp_path / "m.unv"
    universal(path)
    sets = "".join(
        f"    -1\n   757\n{k:10}\n{name:>40}\n"
        f"{node:10}         4 1 0 0 0 0 0\n{node + 1:10}         4 1 1 1 1 1 1\n    -1\n"
        for k, (name, node) in enumerate({"inlet (         1)": 1, "": 3}.items(), start=1)
    )
    path.write_text(path.read_text() + sets)
    found = lists(read_mesh(path).patches)
    assert (found["inlet"], found["2"]) == ([0, 1], [2, 3])
    path.write_text(path.read_text().replace("         3         4 1 0", "        99         4 1 0"))
    one_line(path, "group '2': node 99")


def test_a_node_set_of_exodus_with_the_number_or_the_name_of_a_side_set(tmp_path: Path) -> None:
    name, nodes = next(iter(PATCHES.items()))
    node = int(np.setdiff1d(np.arange(len(POINTS)), nodes)[0])
    numbered = read_mesh(with_a_node_set(tmp_path / "number.exo", node, b""))
    assert numbered.patches["1"].tolist() == sorted(nodes)
    assert numbered.patches["nodes_1"].tolist() == [node]
    named = read_mesh(with_a_node_set(tmp_path / "name.exo", node, name.encode()))
    assert named.patches[name].tolist() == sorted([*nodes, node])
    assert any(f"{name!r} is the name of a surface and of a point with 1 other node" in note for note in named.notes)


def _exodus_of(path: Path, arrays: dict[str, Any], kinds: list[str]) -> None:
    """Variables of these names, and blocks of elements of these types."""
    from scipy.io import netcdf_file  # noqa: PLC0415

    with netcdf_file(path, "w", version=2) as file:
        for name, values in arrays.items():
            lengths = [f"{name}_{k}" for k in range(values.ndim)]
            for length, size in zip(lengths, values.shape, strict=True):
                file.createDimension(length, size)
            file.createVariable(name, values.dtype, lengths)[:] = values
        for number, kind in enumerate(kinds, start=1):
            file.variables[f"connect{number}"].elem_type = kind


def test_named_blocks_of_faces_in_exodus_are_patches(tmp_path: Path) -> None:
    """Blocks of surfaces as in files of Cubit: with names, of shells or triangles; a block without a name is no
    patch.
    """
    points = np.array([(0.0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0.4, 0.4, 1)])
    blocks = {"PYRAMID5": [[1, 2, 3, 4, 5]], "SHELL4": [[1, 2, 3, 4]], "TRI3": [[1, 2, 5]], "TRI": [[2, 3, 5]]}
    arrays: dict[str, Any] = {f"coord{axis}": points[:, k] for k, axis in enumerate("xyz")}
    arrays |= {f"connect{k}": np.array(nodes, "i") for k, nodes in enumerate(blocks.values(), start=1)}
    arrays["eb_names"] = np.array([list(name.ljust(6, "\0")) for name in ("fluid", "wall", "", "side")], "S1")
    _exodus_of(tmp_path / "m.exo", arrays, list(blocks))
    mesh = read_mesh(tmp_path / "m.exo")
    assert lists(mesh.patches) == {"wall": [0, 1, 2, 3], "side": [1, 2, 4]}
    write_mesh(tmp_path / "moved.exo", replace(mesh, points=mesh.points * 2))
    np.testing.assert_array_equal(read_mesh(tmp_path / "moved.exo").points, mesh.points * 2)


@pytest.mark.parametrize(
    ("axes", "blocks", "sides", "expected"),
    [
        ("xy", {"SHELL4": [[1, 2, 3, 4]]}, [[3], [6]], {"1": [0, 1], "2": [0, 3]}),
        ("xy", {"SHELL4": [[1, 2, 3, 4]]}, [[1], [6]], {"2": [0, 3]}),  # the first set has the face, which is the mesh
        ("xy", {"SHELL8": [[1, 2, 3, 4, 6, 7, 8, 9]]}, [[4], [5]], {"1": [1, 2, 6], "2": [2, 3, 7]}),
        ("xy", {"TRISHELL3": [[1, 2, 3]]}, [[3], [5]], {"1": [0, 1], "2": [0, 2]}),
        ("xy", {"TRI3": [[1, 2, 3]]}, [[3], [1]], {"1": [0, 2], "2": [0, 1]}),
        ("x", {"BAR2": [[1, 2]]}, [[1], [2]], {"1": [0], "2": [1]}),
        ("x", {"EDGE3": [[1, 2, 6]]}, [[1], [2]], {"1": [0], "2": [1]}),
        ("xy", {"BEAM3": [[1, 2, 6]], "TRI3": [[1, 2, 3]]}, [[1], [2]], {"1": [0, 1, 5], "2": [0, 1, 5]}),
        ("xyz", {"TRI3": [[1, 2, 4]], "TETRA4": [[1, 2, 4, 5]]}, [[1], [5]], {"1": [0, 1, 3], "2": [0, 3]}),
        (
            "xyz",
            {"SHELL4": [[1, 2, 3, 4]], "PYRAMID5": [[1, 2, 3, 4, 5]]},
            [[2], [3]],
            {"1": [0, 1, 2, 3], "2": [0, 1]},
        ),
    ],
)
def test_sides_of_exodus_shells_are_two_faces_and_the_edges(
    tmp_path: Path, axes: str, blocks: dict[str, Any], sides: list[list[int]], expected: dict[str, list[int]]
) -> None:
    """The numbers are those of libexodus: ex_get_side_set_node_list."""
    points = np.array(
        [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0.4, 0.4, 1), (0.5, 0, 0), (1, 0.5, 0), (0.5, 1, 0)]
    )
    arrays: dict[str, Any] = {f"coord{a}": np.vstack([points, (0, 0.5, 0)])[:, k] for k, a in enumerate(axes)}
    for number, side in enumerate(sides, start=1):
        arrays |= {f"elem_ss{number}": np.array([1], "i"), f"side_ss{number}": np.array(side, "i")}
    for number, nodes in enumerate(blocks.values(), start=1):
        arrays[f"connect{number}"] = np.array(nodes, "i")
    _exodus_of(tmp_path / "m.exo", arrays, list(blocks))
    found = read_mesh(tmp_path / "m.exo").patches
    assert {name: nodes.tolist() for name, nodes in found.items()} == expected


@pytest.mark.parametrize("kind", ["BEX8", "NSIDED"])
def test_blocks_of_exodus_that_are_not_read_are_named_with_the_way_out(tmp_path: Path, kind: str) -> None:
    points = np.array([(0.0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])
    arrays: dict[str, Any] = {f"coord{axis}": points[:, k] for k, axis in enumerate("xyz")}
    flat = np.array([1, 2, 3, 4], "i")
    arrays |= {"connect1": np.array([[1, 2, 3]], "i"), "connect2": flat if kind == "NSIDED" else flat[None]}
    _exodus_of(tmp_path / "m.exo", arrays, ["TRI3", kind])
    one_line(
        tmp_path / "m.exo", rf"m.exo: block 2 of elements of type '{kind}'; known are BAR, .*\(save the mesh without"
    )


def test_points_and_thick_shells_of_exodus(tmp_path: Path) -> None:
    """A block of points has no cells; HEXSHELL has the sides of a hexahedron, as in libexodus."""
    arrays: dict[str, Any] = {f"coord{axis}": _CUBE[:, k] for k, axis in enumerate("xyz")}
    arrays |= {"connect1": np.arange(1, 9, dtype="i")[None], "connect2": np.array([[3]], "i")}
    arrays |= {"elem_ss1": np.array([1], "i"), "side_ss1": np.array([5], "i")}
    _exodus_of(tmp_path / "m.exo", arrays, ["HEXSHELL", "POINT"])
    mesh = read_mesh(tmp_path / "m.exo")
    assert {name: len(nodes) for name, nodes in mesh.cells.items()} == {"hexahedron": 1}
    assert lists(mesh.patches) == {"1": [0, 1, 2, 3]}


def test_cgns_without_bases_is_none(tmp_path: Path) -> None:
    with pytest.importorskip("h5py").File(tmp_path / "m.cgns", "w") as file:
        file["Base/Zone1/GridCoordinates/CoordinateX/ data"] = POINTS[:, 0]
    one_line(tmp_path / "m.cgns", r"no base \(CGNSBase_t\): not a CGNS file \(meshio's .cgns has none")


@pytest.mark.parametrize(
    ("solid", "side", "expected"),
    [
        ("", "E1", {"wall": [0, 1]}),
        ("", "e4", {"wall": [0, 3]}),
        ("", "SPOS", {}),  # the face of the shell is the mesh
        ("*ELEMENT, TYPE=C3D5\n2, 1, 2, 3, 4, 5\n", "SNEG", {"wall": [0, 1, 2, 3]}),
        ("*ELEMENT, TYPE=C3D5\n2, 1, 2, 3, 4, 5\n", "E2", {"wall": [1, 2]}),
        ("*ELEMENT, TYPE=C3D5\n2, 1, 2, 3, 4, 5\n", "S1", {"wall": [0, 1, 2, 3]}),
        ("", "S2", {}),
        ("", "S3", {"wall": [0, 1]}),
        ("", "S6", {"wall": [0, 3]}),
        (
            "*ELEMENT, TYPE=CPS3\n2, 1, 2, 4\n*ELSET, ELSET=e\n2,\n*SURFACE, NAME=w\ne, S1\n",
            "S5",
            {"w": [0, 1], "wall": [2, 3]},
        ),
        ("*ELEMENT, TYPE=CPS3\n2, 1, 2, 4\n*SURFACE, NAME=w\n2, SP\n", "S4", {"wall": [1, 2]}),
    ],
)
def test_surfaces_of_shells_in_abaqus(tmp_path: Path, solid: str, side: str, expected: dict[str, list[int]]) -> None:
    """Edges E1, E2, … and faces SPOS, SNEG, as Abaqus' manual names them.

    CalculiX counts: S1 and S2 are the faces of a shell, and its edges begin with S3; the edges of a plane element
    begin with S1 (``surfaces.f``).
    """
    apex = "5, 0.4, 0.4, 1\n" if "C3D5" in solid else ""
    (tmp_path / "m.inp").write_text(
        f"*NODE\n1, 0, 0, 0\n2, 1, 0, 0\n3, 1, 1, 0\n4, 0, 1, 0\n{apex}*ELEMENT, TYPE=S4R\n1, 1, 2, 3, 4\n{solid}"
        f"*SURFACE, NAME=wall\n1, {side}\n"
    )
    found = read_mesh(tmp_path / "m.inp").patches
    assert {name: nodes.tolist() for name, nodes in found.items()} == expected


_TETRA = "*ELEMENT, TYPE=C3D4\n1, 1, 2, 3, 4\n"
_ROWS = "1, 0., 0., 0.\n2, 1., 0., 0.\n3, 0., 1., 0.\n4, 0., 0., 1.\n"


@pytest.mark.parametrize(
    "text",
    [
        "*NODE\n1\n2, 1.\n** y\n3, 0., 1.,\n4, 0, 0, 1\n*ELEMENT, TYPE=C3D4\n1, 1, 2, 3, 4\n*NSET, NSET=foot\n1\n",
        f"*NODE\n{_ROWS.replace('0.', ' ')}{_TETRA}*NSET, NSET=foot\n1\n",
        f"*NODE,\n NSET=all,\n** its\n SYSTEM=R\n{_ROWS}{_TETRA}*NSET,\n NSET=foot,\n GENERATE\n1\n",
        f"* Node , nset = all\n{_ROWS}{_TETRA}* NSet , NSet = foot\n1,\n",
        f"*NODE,\n INPUT=nodes.txt\n{_TETRA}*NSET, NSET=foot\n1\n",
        f"*INCLUDE,\n INPUT=nodes.inp\n{_TETRA}*NSET, NSET=foot\n1\n",
    ],
    ids=["left out", "blank", "continued", "blanks in keywords", "of a file", "included"],
)
def test_the_ways_of_abaqus_to_list_nodes_come_back(tmp_path: Path, text: str) -> None:
    (tmp_path / "nodes.txt").write_text(_ROWS)
    (tmp_path / "nodes.inp").write_text(f"*NODE\n{_ROWS}")
    (tmp_path / "m.inp").write_text(text)
    mesh = read_mesh(tmp_path / "m.inp")
    np.testing.assert_array_equal(mesh.points, [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    write_mesh(tmp_path / "moved.inp", replace(mesh, points=mesh.points + 1 / 3))
    after = read_mesh(tmp_path / "moved.inp")
    np.testing.assert_array_equal(after.points, mesh.points + 1 / 3)
    assert lists(after.patches) == {"foot": [0]}


def test_names_in_abaqus_are_the_same_in_upper_and_lower_case(tmp_path: Path) -> None:
    part = f"*PART, NAME=P\n*NODE\n{_ROWS}{_TETRA}*END PART\n*ASSEMBLY, NAME=A\n*INSTANCE, NAME=P-1, PART=P\n"
    sets = "*END INSTANCE\n*NSET, NSET=Foot\n1\n*NSET, NSET=FOOT\np-1.2\n*NSET, NSET=all\nfoot, 3\n"
    (tmp_path / "m.inp").write_text(part + sets)
    assert lists(read_mesh(tmp_path / "m.inp").patches) == {"Foot": [0, 1], "all": [0, 1, 2]}


def test_the_nodes_of_a_part_of_the_cells_are_no_patch(tmp_path: Path) -> None:
    """Abaqus/CAE and Gmsh write a set of nodes for a region, too; the set of a face has the elements next to it."""
    square = [(0, 0), (1, 0), (1, 1), (0, 1), (2, 0), (2, 1)]
    nodes = "".join(f"{k}, {x}, {y}\n" for k, (x, y) in enumerate(square, start=1))
    sets = "*NSET, NSET=half\n1, 2, 3, 4\n*ELSET, ELSET=HALF\n1\n*NSET, NSET=edge\n1, 4\n*ELSET, ELSET=edge\n1\n"
    (tmp_path / "m.inp").write_text(f"*NODE\n{nodes}*ELEMENT, TYPE=CPS4\n1, 1, 2, 3, 4\n2, 2, 5, 6, 3\n{sets}")
    assert lists(read_mesh(tmp_path / "m.inp").patches) == {"edge": [0, 3]}
    rows_of = "".join(f"{k} 1 1 11\n {x}.0 {y}.0 0.0\n" for k, (x, y) in enumerate(square, start=1))
    cells = "1 44 1 1 7 4\n 1 2 3 4\n2 44 1 1 7 4\n 2 5 6 3\n"
    groups = "1 0 0 0 0 0 0 1\nhalf\n 8 1 0 0\n2 0 0 0 0 0 0 4\nhalf\n" + "".join(f" 7 {k} 0 0\n" for k in (1, 2, 3, 4))
    groups += "3 0 0 0 0 0 0 2\nedge\n 7 1 0 0 7 4 0 0\n"
    datasets = (("2411", rows_of), ("2412", cells), ("2467", groups))
    (tmp_path / "m.unv").write_text("".join(f"    -1\n  {number}\n{text}    -1\n" for number, text in datasets))
    assert lists(read_mesh(tmp_path / "m.unv").patches) == {"edge": [0, 3]}


def test_a_surface_of_abaqus_without_sides_is_what_is_outside(tmp_path: Path) -> None:
    """Two tetrahedra with a common face: the sides of the first one are its other three."""
    (tmp_path / "m.inp").write_text(
        f"*NODE\n{_ROWS}5, 1., 1., 1.\n{_TETRA}2, 2, 3, 4, 5\n*SURFACE, NAME=s\n2,\n*ELSET, ELSET=e\n1\n"
    )
    assert lists(read_mesh(tmp_path / "m.inp").patches) == {"s": [1, 2, 3, 4]}
    square = "1, 0, 0\n2, 1, 0\n3, 1, 1\n4, 0, 1\n5, 2, 0\n6, 2, 1\n7, 3, 0\n8, 3, 1\n"
    cells = "1, 1, 2, 3, 4\n2, 2, 5, 6, 3\n3, 5, 7, 8, 6\n"
    (tmp_path / "m.inp").write_text(f"*NODE\n{square}*ELEMENT, TYPE=CPS4, ELSET=V\n{cells}*SURFACE, NAME=s\n1\n")
    assert lists(read_mesh(tmp_path / "m.inp").patches) == {"s": [0, 1, 2, 3]}


def _curved_edge(ends: str) -> list[float]:
    """The middle of an edge of a thin curved hexahedron between corners, which are counted from 1."""
    r, angle, z = np.mean([_POLAR[int(end) - 1] for end in ends], axis=0)
    return [r * np.cos(angle), r * np.sin(angle), z]


#: Radius, angle and height of the corners: the edges along the angle bend by 24 times the thickness.
_POLAR = np.array([(1 + 1e-4 * x, 0.14 * y, 0.1 * z) for x, y, z in _CUBE])
_THIN = [_curved_edge(str(corner)) for corner in range(1, 9)]


@pytest.mark.parametrize("program", ["Exodus", "CalculiX"])
def test_nodes_between_corners_of_a_thin_curved_cell_are_on_their_own_side(tmp_path: Path, program: str) -> None:
    """The order of the nodes decides: their places are nearer to the middles of other edges."""
    level, upright, above = "12 23 34 41", "15 26 37 48", "56 67 78 85"
    order = f"{level} {upright} {above}" if program == "Exodus" else f"{level} {above} {upright}"
    points = np.array(_THIN + [_curved_edge(edge) for edge in order.split()])
    if program == "Exodus":
        arrays: dict[str, Any] = {f"coord{a}": points[:, k] for k, a in enumerate("xyz")}
        arrays |= {"connect1": np.arange(1, 21, dtype="i")[None], "elem_ss1": np.ones(1, "i")}
        path = tmp_path / "m.exo"
        _exodus_of(path, arrays | {"side_ss1": np.array([4], "i")}, ["HEX20"])
    else:
        lines = "".join(f"{k}, {x!r}, {y!r}, {z!r}\n" for k, (x, y, z) in enumerate(points.tolist(), start=1))
        nodes = f"1, {', '.join(map(str, range(1, 16)))},\n16, 17, 18, 19, 20"
        path = tmp_path / "m.inp"
        path.write_text(f"*NODE\n{lines}*ELEMENT, TYPE=C3D20\n{nodes}\n*SURFACE, NAME=wall\n1, S6\n")
    (inner,) = read_mesh(path).patches.values()
    np.testing.assert_array_equal(inner, np.flatnonzero(np.hypot(points[:, 0], points[:, 1]) < 1 + 2e-5))


def test_one_array_of_faces_and_lines_elsewhere_is_said(tmp_path: Path) -> None:
    points = "0 0 0 1 0 0 0 1 0 0 0 1"
    (tmp_path / "m.vtk").write_text(
        f"# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 double\n{points}\n"
        "CELLS 3 12\n4 0 1 2 3\n3 0 1 2\n2 0 3\nCELL_TYPES 3\n10\n5\n3\n"
        "CELL_DATA 3\nSCALARS patch_wall int 1\nLOOKUP_TABLE default\n0\n1\n1\n"
    )
    mesh = read_mesh(tmp_path / "m.vtk")
    assert mesh.patches["wall"].tolist() == [0, 1, 2, 3]
    assert any("name of a surface and of a curve with 1 other node" in note for note in mesh.notes)


@pytest.mark.parametrize("order", "<>")
def test_a_binary_case_of_ensight_is_the_first_of_its_steps(tmp_path: Path, order: str) -> None:
    """Also a check with another reader: VTK finds the moved nodes and the faces of each part."""
    for step in (10, 2):
        ensight_binary(tmp_path / f"box{step:04d}.geo", order)
    (tmp_path / "box.case").write_text(
        'FORMAT\ntype: ensight gold\nGEOMETRY\nmodel: 1 "box****.geo"  # of a run\nVARIABLE\n'
        "scalar per node: 1 p box****.p\n"
    )
    mesh = read_mesh(tmp_path / "box.case")
    np.testing.assert_array_equal(mesh.points, POINTS.astype(np.float32))
    assert lists(mesh.patches) == {key: nodes.tolist() for key, nodes in PATCHES.items()}
    assert mesh.notes == ("box0002.geo is read, the first of 2 steps",)
    moved = mesh.points * [1.5, 1.0, 1 / 3] + 0.1
    write_mesh(tmp_path / "moved.case", replace(mesh, points=moved))
    np.testing.assert_array_equal(read_mesh(tmp_path / "moved.case").points, moved.astype(np.float32))
    reading = pytest.importorskip("vtkmodules.vtkIOEnSight")
    numpy_support = pytest.importorskip("vtkmodules.util.numpy_support")
    reader = reading.vtkGenericEnSightReader()
    reader.SetCaseFileName(str(tmp_path / "moved.case"))
    reader.Update()
    blocks = [reader.GetOutput().GetBlock(k) for k in range(4)]
    assert [block.GetNumberOfCells() for block in blocks] == [8, 4, 16, 4]
    for block, nodes in zip(blocks, [np.arange(len(moved)), *PATCHES.values()], strict=True):
        found = numpy_support.vtk_to_numpy(block.GetPoints().GetData())
        np.testing.assert_array_equal(found, moved[nodes].astype(np.float32))


def _blocks(path: Path, flags: str = "") -> Path:
    """Two structured parts of 3 × 3 × 2 nodes, the wall as a third one; ids are given."""
    grid = POINTS.reshape(3, 3, 3, 3).transpose(2, 1, 0, 3)  # z, y, x: the first direction is the fastest
    text = "blocks\nby hand\nnode id given\nelement id given\n"
    for number, (name, part) in enumerate([("low", grid[:2]), ("high", grid[1:]), ("wall", grid[:1])], start=1):
        own = flags if name != "wall" else ""
        counts = part.shape[2::-1]
        n_cells = int(np.prod([max(count - 1, 1) for count in counts]))
        text += f"part\n{number:10}\n{name}\nblock{own}\n" + "".join(f"{count:10}" for count in counts) + "\n"
        text += "1 3 1 3 1 2\n" if "range" in own else ""
        text += rows(part.reshape(-1, 3).T.reshape(-1, 1))
        text += rows([[int(name != "low" or node != 0)] for node in range(18)]) if "iblanked" in own else ""
        text += (
            "ghost_flags\n" + rows([[int(name == "high" and cell == 3)] for cell in range(4)]) if "ghost" in own else ""
        )
        for what, count in (("node", np.prod(counts)), ("element", n_cells * (name != "high"))):
            text += f"{what}_ids\n" + rows(np.arange(1, count + 1)[:, None]) if count else "\n# EnSight has no ids\n\n"
    path.write_text(text)
    return path


@pytest.mark.parametrize(("flags", "n_cells"), [("", 8), (" curvilinear iblanked with_ghost", 6), (" range", 8)])
def test_structured_parts_of_ensight_are_one_mesh(tmp_path: Path, flags: str, n_cells: int) -> None:
    mesh = read_mesh(_blocks(tmp_path / "m.geo", flags))
    order = np.lexsort(mesh.points.T)
    np.testing.assert_array_equal(mesh.points[order], POINTS[np.lexsort(POINTS.T)])
    assert {name: len(nodes) for name, nodes in mesh.cells.items()} == {"hexahedron": n_cells}
    assert set(map(frozenset, order.argsort()[mesh.cells["hexahedron"]].tolist())) <= set(
        map(frozenset, np.lexsort(POINTS.T).argsort()[CELLS].tolist())
    )
    assert sorted(mesh.points[mesh.patches["wall"]].tolist()) == sorted(POINTS[PATCHES["wall"]].tolist())
    write_mesh(tmp_path / "moved.geo", replace(mesh, points=mesh.points / 3))
    after = read_mesh(tmp_path / "moved.geo")
    np.testing.assert_array_equal(after.points, mesh.points / 3)
    assert lists(after.patches) == lists(mesh.patches)


@pytest.mark.parametrize("kind", ["rectilinear", "uniform"])
def test_blocks_of_ensight_without_a_list_of_points(tmp_path: Path, kind: str) -> None:
    """VTK's reader finds the same points; they cannot be moved in this format."""
    axes = [[1.0, 1.5, 2.0], [0.0, 4.0], [-1.0, 0.0, 1.0]]
    numbers = [of for axis in axes for of in axis] if kind == "rectilinear" else [1.0, 0.0, -1.0, 0.5, 4.0, 1.0]
    (tmp_path / "m.geo").write_text(
        f"a\nb\nnode id off\nelement id off\npart\n1\nair\nblock {kind} iblanked\n3 2 3\n"
        + rows([[of] for of in numbers])
        + rows([[int(node != 0)] for node in range(18)])
    )
    mesh = read_mesh(tmp_path / "m.geo")
    np.testing.assert_array_equal(mesh.points, [[x, y, z] for z in axes[2] for y in axes[1] for x in axes[0]])
    assert lists(mesh.cells)["hexahedron"][0] == [1, 2, 5, 4, 7, 8, 11, 10]
    assert mesh.n_cells == 3
    with pytest.raises(InvalidInput, match=r"the block 'air' has no list of points \(take \.vtu\)"):
        write_mesh(tmp_path / "moved.geo", replace(mesh, points=mesh.points / 3))
    reading = pytest.importorskip("vtkmodules.vtkIOEnSight")
    (tmp_path / "m.case").write_text("FORMAT\ntype: ensight gold\nGEOMETRY\nmodel: m.geo\n")
    reader = reading.vtkEnSightGoldReader()
    reader.SetCaseFileName(str(tmp_path / "m.case"))
    reader.Update()
    theirs = reader.GetOutput().GetBlock(0)
    np.testing.assert_array_equal([theirs.GetPoint(node) for node in range(18)], mesh.points)


def test_vtk_reads_the_same_structured_parts_of_ensight(tmp_path: Path) -> None:
    reading = pytest.importorskip("vtkmodules.vtkIOEnSight")
    numpy_support = pytest.importorskip("vtkmodules.util.numpy_support")
    _blocks(tmp_path / "m.geo", " iblanked")
    (tmp_path / "m.case").write_text("FORMAT\ntype: ensight gold\nGEOMETRY\nmodel: m.geo\n")
    reader = reading.vtkEnSightGoldReader()
    reader.SetCaseFileName(str(tmp_path / "m.case"))
    reader.Update()
    low = reader.GetOutput().GetBlock(0)
    assert [bool(low.IsCellVisible(cell)) for cell in range(4)] == [False, True, True, True]
    theirs = numpy_support.vtk_to_numpy(low.GetPoints().GetData())
    mesh = read_mesh(tmp_path / "m.case")
    np.testing.assert_array_equal(mesh.points[: len(theirs)].astype(np.float32), theirs)
    assert mesh.cells["hexahedron"][0].tolist() == [low.GetCell(1).GetPointId(corner) for corner in range(8)]


def test_medit_comes_back_with_moved_nodes(tmp_path: Path) -> None:
    medit(tmp_path / "m.mesh")
    mesh = read_mesh(tmp_path / "m.mesh")
    np.testing.assert_array_equal(mesh.points, POINTS)
    np.testing.assert_array_equal(mesh.cells["hexahedron"], CELLS)
    assert lists(mesh.patches) == {str(k): of.tolist() for k, of in enumerate(PATCHES.values(), start=1)}
    moved = mesh.points * [1.5, 1.0, 1 / 3] + 0.1
    write_mesh(tmp_path / "moved.mesh", replace(mesh, points=moved))
    after = read_mesh(tmp_path / "moved.mesh")
    np.testing.assert_array_equal(after.points, moved)
    write_mesh(tmp_path / "back.mesh", replace(after, points=mesh.points))
    assert (tmp_path / "back.mesh").read_bytes().split() == (tmp_path / "m.mesh").read_bytes().split()


def test_gmsh_reads_the_moved_medit_file(tmp_path: Path) -> None:
    medit(tmp_path / "m.mesh")
    mesh = read_mesh(tmp_path / "m.mesh")
    write_mesh(tmp_path / "moved.mesh", replace(mesh, points=POINTS / 3))
    with quiet_gmsh() as gmsh:
        gmsh.open(str(tmp_path / "moved.mesh"))
        _, theirs, _ = gmsh.model.mesh.getNodes()
    assert sorted(theirs.reshape(-1, 3).tolist()) == sorted((POINTS / 3).tolist())


_PLANE = (
    'MeshVersionFormatted 1 # of FreeFEM\nDimension 2\nIdentifier\n"Made by Triangles 4"\n'
    "Vertices 5\n0 0 1\n2 0 1\n0 2 1\n# middles\n1 1 0\n1 0 0\n"
    "EdgesP2 1\n1 2 5 -4\nhVertices\n.1 .1 .1 .1 .1\nTriangles 1\n1 2 3 0\nEnd"
)


def test_medit_in_the_plane_with_comments_and_second_order(tmp_path: Path) -> None:
    (tmp_path / "m.mesh").write_text(_PLANE)
    mesh = read_mesh(tmp_path / "m.mesh")
    assert mesh.points.tolist() == [[0, 0], [2, 0], [0, 2], [1, 1], [1, 0]]
    assert lists(mesh.cells) == {"triangle": [[0, 1, 2]]}
    assert lists(mesh.patches) == {"-4": [0, 1, 4]}
    write_mesh(tmp_path / "moved.mesh", replace(mesh, points=mesh.points / 3))
    np.testing.assert_array_equal(read_mesh(tmp_path / "moved.mesh").points, mesh.points / 3)
    head, tail = _PLANE.split("Vertices", 1)
    after = (tmp_path / "moved.mesh").read_text()
    assert after.startswith(head)
    assert after.endswith(tail[tail.index("EdgesP2") :])


@pytest.mark.parametrize("incomplete", [0, 1])
@pytest.mark.parametrize("dimension", [2, 3])
def test_medit_of_gmsh_has_second_order_below_the_keywords_of_first(
    tmp_path: Path, dimension: int, incomplete: int
) -> None:
    """A peer: Gmsh writes quadrilaterals of 8 and 9 nodes as ``Quadrilaterals``, and hexahedra likewise."""
    with quiet_gmsh() as gmsh:
        gmsh.option.setNumber("Mesh.SecondOrderIncomplete", incomplete)
        surface = gmsh.model.occ.addRectangle(0, 0, 0, 1, 1)
        if dimension == 3:
            gmsh.model.occ.extrude([(2, surface)], 0, 0, 1, numElements=[2], recombine=True)
        gmsh.model.occ.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeMin", 0.4)
        gmsh.option.setNumber("Mesh.RecombineAll", 1)
        gmsh.model.mesh.generate(dimension)
        gmsh.model.mesh.setOrder(2)
        for suffix in ("msh", "mesh"):
            gmsh.write(str(tmp_path / f"m.{suffix}"))
    ours, other = read_mesh(tmp_path / "m.mesh"), read_mesh(tmp_path / "m.msh")
    np.testing.assert_allclose(ours.points, other.points, atol=1e-12)
    assert lists(ours.cells) == lists(other.cells)
    assert lists(ours.patches) == lists(other.patches)
    assert ours.notes == other.notes[1:]  # the first is on groups


def binary_medit(path: Path, order: str, version: int) -> bytes:
    """The file of :func:`medit` as libMeshb writes it."""
    medit(path)
    words = path.read_text().split()
    kinds = {"i": f"{order}i{8 if version > 3 else 4}", "r": f"{order}f{8 if version > 1 else 4}"}
    position = f"{order}i{8 if version > 2 else 4}"
    content = np.array([1, version], f"{order}i4").tobytes()

    def section(code: int, body: bytes, last: bool = False) -> bytes:
        after = 0 if last else len(content) + 4 + np.dtype(position).itemsize + len(body)
        return np.array(code, f"{order}i4").tobytes() + np.array(after, position).tobytes() + body

    content += section(3, np.array(3, f"{order}i4").tobytes())
    for keyword, code, row in (
        ("Vertices", 4, "rrri"),
        ("Quadrilaterals", 7, 5 * "i"),
        ("Corners", 13, "i"),
        ("Hexahedra", 10, 9 * "i"),
    ):
        start = words.index(keyword) + 2
        body = np.array(count := int(words[start - 1]), kinds["i"]).tobytes()
        for place in range(start, start + count * len(row)):
            body += np.array(float(words[place]), kinds[row[(place - start) % len(row)]]).tobytes()
        content += section(code, body)
    return content + section(54, b"", last=True)


@pytest.mark.parametrize(("order", "version"), [("<", 1), ("<", 2), (">", 2), ("<", 3), ("<", 4), (">", 4)])
def test_binary_medit_is_the_text_s_mesh_and_comes_back(tmp_path: Path, order: str, version: int) -> None:
    content = binary_medit(tmp_path / "m.mesh", order, version)
    (tmp_path / "m.meshb").write_bytes(content)
    expected, mesh = read_mesh(tmp_path / "m.mesh"), read_mesh(tmp_path / "m.meshb")
    np.testing.assert_allclose(mesh.points, expected.points, rtol=1e-6 if version == 1 else 0)
    assert lists(mesh.cells) == lists(expected.cells)
    assert lists(mesh.patches) == lists(expected.patches)
    write_mesh(tmp_path / "moved.meshb", replace(mesh, points=mesh.points + 0.5))
    rtol = 1e-6 if version == 1 else 0  # single precision
    np.testing.assert_allclose(read_mesh(tmp_path / "moved.meshb").points, mesh.points + 0.5, rtol=rtol)
    write_mesh(tmp_path / "back.meshb", mesh)
    assert (tmp_path / "back.meshb").read_bytes() == content


def test_binary_medit_of_meshio(tmp_path: Path) -> None:
    meshio = pytest.importorskip("meshio")
    faces, references = np.array([[0, 1, 3, 2], [4, 5, 7, 6]]), [np.array([7, 8]), np.array([0])]
    cells = [("quad", faces), ("hexahedron", np.array([[0, 1, 3, 2, 4, 5, 7, 6]]))]
    points = np.array([[x, y, z] for z in (0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0)])
    meshio.Mesh(points, cells, cell_data={"medit:ref": references}).write(tmp_path / "m.meshb")
    mesh = read_mesh(tmp_path / "m.meshb")
    np.testing.assert_array_equal(mesh.points, points)
    assert lists(mesh.patches) == {"7": [0, 1, 2, 3], "8": [4, 5, 6, 7]}


@pytest.mark.parametrize("length", [8, 9, 20, 24, 40, 700])
def test_a_binary_medit_file_that_ends_too_soon_is_one_clear_line(tmp_path: Path, length: int) -> None:
    content = binary_medit(tmp_path / "m.mesh", "<", 2)
    (tmp_path / "m.meshb").write_bytes(content[:length])
    one_line(tmp_path / "m.meshb", "malformed Medit mesh: (it ends after|keyword .* says that the next one is at)")


def test_damaged_bytes_of_binary_medit_never_more_than_one_line(tmp_path: Path) -> None:
    path = tmp_path / "m.meshb"
    path.write_bytes(binary_medit(tmp_path / "m.mesh", "<", 2))
    assert refused_when_damaged(path, path, 200, np.random.default_rng(2026)) > 50


def test_numbers_of_a_binary_medit_file_that_do_not_fit(tmp_path: Path) -> None:
    content = binary_medit(tmp_path / "m.mesh", "<", 2)
    path = tmp_path / "m.meshb"
    count = content.index(np.array([len(POINTS)], "<i4").tobytes())
    path.write_bytes(content[:count] + np.array([10**6], "<i4").tobytes() + content[count + 4 :])
    one_line(path, "malformed Medit mesh: 1000000 Vertices go beyond the end of the file")
    path.write_bytes(content[:16] + b"\4" + content[17:])
    one_line(path, "malformed Medit mesh: Dimension 4, expected 2 or 3")
    path.write_bytes(
        content.replace(
            np.array([4, count + 4], "<i4")[:1].tobytes() + content[count - 4 : count],
            np.array([60], "<i4").tobytes() + content[count - 4 : count],
            1,
        )
    )
    one_line(path, "malformed Medit mesh: there is no Vertices")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("Dimension 2", "Dimension 4", "Dimension '4', expected 2 or 3"),
        ("Vertices 5", "Nodes 5", "there is no Vertices"),
        ("Vertices 5", "Vertices 6", "6 Vertices of 3 numbers, but 15 numbers"),
        ("Triangles", "TrianglesP3", "elements TrianglesP3; known are Edges, .*"),
        ("1 2 3 0", "1 2 6 0", "row 1 of Triangles names vertex 6, but there are 1 to 5"),
        ("1 2 3 0", "1 2 x 0", "could not convert string to float.*"),
    ],
)
def test_medit_files_that_do_not_fit(tmp_path: Path, old: str, new: str, message: str) -> None:
    (tmp_path / "m.mesh").write_text(_PLANE.replace(old, new))
    one_line(tmp_path / "m.mesh", f"malformed Medit mesh: .*({message})")


def test_a_copy_of_an_ensight_case_never_replaces_the_geometry(tmp_path: Path) -> None:
    ensight(tmp_path / "wing.geo")
    (tmp_path / "box.case").write_text("FORMAT\ntype: ensight gold\nGEOMETRY\nmodel: wing.geo\n")
    with pytest.raises(InvalidInput, match="would replace the geometry of"):
        write_mesh(tmp_path / "wing.case", read_mesh(tmp_path / "box.case"))
    ensight(tmp_path / "same.geo")
    assert (tmp_path / "wing.geo").read_bytes() == (tmp_path / "same.geo").read_bytes()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("hexa8", "hexa9x", "'hexa9x', expected a part or a type of elements"),
        (
            "part\n1\ninternalMesh\n",
            "",
            "'coordinates', expected a part .*: it is EnSight 6's, of which ParaView makes",
        ),
        ("hexa8", "hexa4", "elements 'hexa4' have too few nodes"),
        (
            "coordinates\n27",
            "brick\n3 3 3",
            "'brick' in the part 'internalMesh', expected its 'coordinates' or a block",
        ),
        ("coordinates\n27", "block\n3 3 0", r"the part 'internalMesh' has a block of \[3, 3, 0\] nodes"),
        ("coordinates\n27", "coordinates\n28", "line 37: invalid literal for int.*'0.0'"),
        ("node id given", "node id yes", "'node id yes', expected 'node id' with one of: off"),
        ("quad4\n4", "quad4\n5", "line .*"),
        ("\n1 2 5 4\n", "\n1 2 5 99\n", r"part 'wall', quad4: node 99, but its nodes are 1 to 9"),
    ],
)
def test_geometries_of_ensight_that_do_not_fit(tmp_path: Path, old: str, new: str, message: str) -> None:
    ensight(tmp_path / "m.geo")
    assert old in (tmp_path / "m.geo").read_text()
    one_line(replaced(tmp_path / "m.geo", old, new), f"malformed EnSight geometry: .*({message})")


def test_cases_of_ensight_that_do_not_fit_and_parts_elsewhere(tmp_path: Path) -> None:
    (tmp_path / "m.case").write_text("FORMAT\ntype: ensight gold\n")
    one_line(tmp_path / "m.case", "no 'model: FILE' in its section GEOMETRY")
    (tmp_path / "m.case").write_text("FORMAT\ntype: ensight gold\nGEOMETRY\nmodel: a.geo\n")
    one_line(tmp_path / "m.case", r"its geometry 'a.geo' is missing \(keep")
    ensight_binary(tmp_path / "cut.geo")
    (tmp_path / "cut.geo").write_bytes((tmp_path / "cut.geo").read_bytes()[:-7])
    one_line(tmp_path / "cut.geo", "the file ends where 64 bytes are expected")
    (tmp_path / "cut.geo").write_bytes(b"P\0\0\0Fortran Binary".ljust(84) + b"P\0\0\0")
    one_line(tmp_path / "cut.geo", r"Fortran binary \(ParaView saves it")
    plane = "part\n9\ncut\ncoordinates\n3\n1\n2\n3\n" + "0.1\n0.2\n0.1\n" * 3 + "tria3\n1\n1\n1 2 3\n"
    ensight(tmp_path / "m.geo")
    (tmp_path / "m.geo").write_text((tmp_path / "m.geo").read_text().replace("\nwall\n", "\n\n") + plane)
    mesh = read_mesh(tmp_path / "m.geo")
    assert len(mesh.points) == len(POINTS)
    assert [*mesh.patches] == ["far", "sides", "part_4"]
    assert mesh.notes == ("the part 'cut' has nodes that no cell has (1 elements): it is not a patch",)
    write_mesh(tmp_path / "moved.geo", replace(mesh, points=POINTS + 0.5))
    assert (tmp_path / "moved.geo").read_text().endswith("\n 0.1\n 0.2\n 0.1\ntria3\n1\n1\n1 2 3\n")
    flat = "a\nb\nnode id off\nelement id off\npart\n1\nfluid\ncoordinates\n4\n" + "\n".join("011000110000") + "\n"
    for kind in ("nsided\n1\n4", "quad4\n1"):
        (tmp_path / "m.geo").write_text(flat + f"{kind}\n1 2 3 4\nbar2\n1\n1 2\n")
        mesh = read_mesh(tmp_path / "m.geo")
        assert mesh.points.tolist() == [[0, 0], [1, 0], [1, 1], [0, 1]]
        assert lists(mesh.cells) == {"quad": [[0, 1, 2, 3]]}
        assert lists(mesh.patches) == {"fluid": [0, 1]}
