"""Polyhedra and polygons in files of VTK, EnSight and MED, written by VTK itself, by OpenFOAM, and by hand."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import foam_cases as foam
import numpy as np
import pytest
from mesh_files import lists, one_line, refused_when_damaged, replaced, sizes

from mesh_motion_server.files import MeshFile, read_mesh, write_mesh

#: A hexagon, and the square at its edge 0-1; below (z = 0) and above (z = 1).
HEXAGON = [(np.cos(k * np.pi / 3), np.sin(k * np.pi / 3)) for k in range(6)]
FLAT = np.array(
    [*HEXAGON, HEXAGON[0] + np.array([np.cos(np.pi / 6), 0.5]), HEXAGON[1] + np.array([np.cos(np.pi / 6), 0.5])]
)
POINTS = np.vstack([np.pad(FLAT, ((0, 0), (0, 1)), constant_values=height) for height in (0.0, 1.0)])
PRISM = [[5, 4, 3, 2, 1, 0], [8, 9, 10, 11, 12, 13], *([k, (k + 1) % 6, 8 + (k + 1) % 6, 8 + k] for k in range(6))]
BOX = [0, 6, 7, 1, 8, 14, 15, 9]
AREA = 1.5 * 3**0.5
TOP = [8, 9, 10, 11, 12, 13]  # of the hexagon

OLD_VTU = """<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" header_type="UInt64">
<UnstructuredGrid><Piece NumberOfPoints="16" NumberOfCells="{cells}"><Points>
<DataArray type="Float64" NumberOfComponents="3" format="ascii">{points}</DataArray></Points>
<PointData>{data}</PointData><CellData></CellData><Cells>{arrays}</Cells>
</Piece></UnstructuredGrid></VTKFile>"""


def text(name: str, values: Any) -> str:
    words = " ".join(map(str, np.asarray(values).ravel().tolist()))
    return f'<DataArray type="Int64" Name="{name}" format="ascii">{words}</DataArray>'


def old_vtu(
    path: Path, faces: list[list[int]] = PRISM, points: Any = POINTS, others: Any = ((12, BOX), (7, TOP))
) -> None:
    """As VTK before 9.4 and OpenFOAM write it: a polyhedron, then other cells."""
    stream = [len(faces), *(word for face in faces for word in (len(face), *face))]
    cells = [sorted({node for face in faces for node in face}), *(nodes for _, nodes in others)]
    arrays = {
        "connectivity": np.concatenate(cells),
        "offsets": np.cumsum([len(cell) for cell in cells]),
        "types": [42, *(kind for kind, _ in others)],
        "faces": stream,
        "faceoffsets": [len(stream), *[-1] * len(others)],
    }
    content = "".join(text(name, values) for name, values in arrays.items())
    words = " ".join(map(repr, points.ravel().tolist()))
    low = text("patch_low", (points[:, 2] == 0).astype(int))
    path.write_text(OLD_VTU.format(cells=len(cells), points=words, data=low, arrays=content))


def grid_of_vtk() -> Any:
    core = pytest.importorskip("vtkmodules.vtkCommonDataModel")
    support = pytest.importorskip("vtkmodules.util.numpy_support")
    plain = pytest.importorskip("vtkmodules.vtkCommonCore")
    grid, points = core.vtkUnstructuredGrid(), plain.vtkPoints()
    points.SetData(support.numpy_to_vtk(POINTS.copy(), deep=True))
    grid.SetPoints(points)
    stream = [len(PRISM), *(word for face in PRISM for word in (len(face), *face))]
    for kind, nodes in ((12, BOX), (42, stream), (7, TOP)):
        ids = plain.vtkIdList()
        for node in nodes:
            ids.InsertNextId(node)
        grid.InsertNextCell(kind, ids)
    low = support.numpy_to_vtk((POINTS[:, 2] == 0).astype(np.uint8), deep=True)
    low.SetName("patch_low")
    grid.GetPointData().AddArray(low)
    return grid


def by_vtk(path: Path, version: int = 0) -> None:
    module, name = {
        ".vtu": ("vtkIOXML", "vtkXMLUnstructuredGridWriter"),
        ".vtk": ("vtkIOLegacy", "vtkUnstructuredGridWriter"),
        ".vtkhdf": ("vtkIOHDF", "vtkHDFWriter"),
    }[path.suffix]
    writer = getattr(pytest.importorskip(f"vtkmodules.{module}"), name)()
    if version:
        writer.SetFileVersion(version)
    writer.SetFileName(str(path))
    writer.SetInputData(grid_of_vtk())
    writer.Write()


BOTTOM = [5, 4, 3, 2, 1, 0]  # of the hexagon


def ensight(path: Path) -> None:
    """The hexagon and the box, and the bottom of both as a part with nodes of its own."""
    column = "".join(f"{value!r}\n" for value in POINTS.T.ravel().tolist())
    low = "".join(f"{value!r}\n" for value in POINTS[:8].T.ravel().tolist())
    faces = "".join(" ".join(str(node + 1) for node in face) + "\n" for face in PRISM)
    sizes = "".join(f"{len(face)}\n" for face in PRISM)
    hexagon, box = (" ".join(str(node + 1) for node in nodes) for nodes in (BOTTOM, BOX))
    path.write_text(
        f"a\nb\nnode id off\nelement id off\npart\n1\nfluid\ncoordinates\n16\n{column}"
        f"hexa8\n1\n{box}\nnfaced\n1\n{len(PRISM)}\n{sizes}{faces}"
        f"part\n2\nlow\ncoordinates\n8\n{low}quad4\n1\n1 7 8 2\nnsided\n1\n6\n{hexagon}\n"
    )


def med(path: Path) -> None:
    """The same as MEDCoupling writes it; the box is a polyhedron, too, and its bottom a polygon."""
    h5py = pytest.importorskip("h5py")
    sides = [[0, 6, 7, 1], [8, 9, 15, 14], [0, 8, 14, 6], [6, 14, 15, 7], [7, 15, 9, 1], [1, 9, 8, 0]]
    faces = PRISM + sides
    with h5py.File(path, "w") as file:
        step = file.create_group("ENS_MAA/m/-0000000000000000001-0000000000000000001")
        step.create_dataset("NOE/COO", data=POINTS.T.ravel()).attrs["NBR"] = len(POINTS)
        step["MAI/POE/NOD"] = np.concatenate(faces) + 1
        step["MAI/POE/INN"] = np.cumsum([1, *map(len, faces)])
        step["MAI/POE/IFN"] = np.cumsum([1, len(PRISM), len(sides)])
        step["MAI/POG/NOD"] = np.concatenate([BOTTOM, sides[0]]) + 1
        step["MAI/POG/INN"] = np.array([1, 7, 11])
        step["MAI/POG/FAM"] = np.array([-3, -3])
        family = file.create_group("FAS/m/ELEME/FAM_-3_low")
        family.attrs["NUM"] = -3
        family["GRO/NOM"] = np.frombuffer(b"low".ljust(80, b"\0"), np.int8)[None]


def med_nodes(path: Path) -> None:
    """The same, but the bottom is a group of nodes."""
    h5py = pytest.importorskip("h5py")
    med(path)
    with h5py.File(path, "r+") as file:
        step = file["ENS_MAA/m/-0000000000000000001-0000000000000000001"]
        del step["MAI/POG"]
        step["NOE/FAM"] = np.where(POINTS[:, 2] == 0, -3, 0)
        file["FAS/m"].move("ELEME", "NOEUD")


FILES: dict[str, Callable[[Path], None]] = {
    "old.vtu": old_vtu,
    "new.vtu": by_vtk,
    "old.vtk": lambda path: by_vtk(path, 42),
    "new.vtk": lambda path: by_vtk(path, 51),
    "new.vtkhdf": by_vtk,
    "ensight.geo": ensight,
    "faces.med": med,
    "nodes.med": med_nodes,
}


def total(mesh: MeshFile) -> float:
    return sum(float(of.sum()) for of in sizes(mesh).values())


@pytest.mark.parametrize("name", FILES)
def test_polyhedra_are_divided_and_keep_the_patches(tmp_path: Path, name: str) -> None:
    FILES[name](tmp_path / name)
    mesh = read_mesh(tmp_path / name)
    np.testing.assert_allclose(mesh.points[:16], POINTS, atol=1e-6 if name.endswith("vtk") else 0)
    np.testing.assert_allclose(
        mesh.points[16:], [[0, 0, 0], [0, 0, 1], [0, 0, 0.5]], atol=1e-6
    )  # two faces, the centre
    assert {kind: len(nodes) for kind, nodes in mesh.cells.items()} == {"tetra": 12, "pyramid": 6, "hexahedron": 1}
    assert total(mesh) == pytest.approx(AREA + 1.0)
    assert lists(mesh.patches) == {"low": [0, 1, 2, 3, 4, 5, 6, 7, 16]}


@pytest.mark.parametrize("sides", [5, 6])
def test_prisms_of_five_and_six_sides_are_divided(tmp_path: Path, sides: int) -> None:
    ring = [[float(np.cos(2 * np.pi * k / sides)), float(np.sin(2 * np.pi * k / sides))] for k in range(sides)]
    points = "".join(f"{x!r} {y!r} {z}\n" for z in (0, 2) for x, y in ring)
    nodes = " ".join(map(str, range(2 * sides)))
    head = f"# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS {2 * sides} double\n"
    cells = f"CELLS 1 {2 * sides + 1}\n{2 * sides} {nodes}\nCELL_TYPES 1\n{10 + sides}\n"
    (path := tmp_path / "m.vtk").write_text(head + points + cells)
    assert total(read_mesh(path)) == pytest.approx(sides * np.sin(2 * np.pi / sides))
    one_line(
        replaced(path, f"CELL_TYPES 1\n{10 + sides}", f"CELL_TYPES 1\n{31 - 10 - sides}"),
        "cell 0 is a prism of [56] sides, but has not 1[02] nodes",
    )


@pytest.mark.parametrize("name", FILES)
def test_polyhedra_come_back_with_moved_nodes(tmp_path: Path, name: str) -> None:
    FILES[name](tmp_path / name)
    mesh = read_mesh(tmp_path / name)
    write_mesh(tmp_path / f"moved-{name}", replace(mesh, points=mesh.points * 2))
    if name.endswith("vtu"):  # whole, not in pieces
        assert b'Name="face' in (tmp_path / f"moved-{name}").read_bytes()
    again = read_mesh(tmp_path / f"moved-{name}")
    np.testing.assert_array_equal(again.points[:16], mesh.points[:16] * 2)
    assert total(again) == pytest.approx(8 * (AREA + 1.0))
    assert lists(again.patches) == lists(mesh.patches)


def test_a_polygon_with_a_number_is_a_patch_with_the_node_in_its_middle(tmp_path: Path) -> None:
    old_vtu(path := tmp_path / "m.vtu")
    content = (
        path.read_text().replace("<CellData>", "<CellData>" + text("patch", [0, 0, 5])).replace("patch_low", "low")
    )
    path.write_text(content)
    assert lists(read_mesh(path).patches) == {"5": [*TOP, 17]}
    path.write_text(content.replace("42 12 7", "42 12 9"))  # not the polyhedron's face: a quadrilateral of its nodes
    assert lists(read_mesh(path).patches) == {"5": TOP}


@pytest.mark.parametrize("turned", [(0,), (1, 3), range(8)])
def test_faces_may_have_any_direction(tmp_path: Path, turned: Any) -> None:
    old_vtu(tmp_path / "m.vtu", [face[::-1] if k in turned else face for k, face in enumerate(PRISM)])
    assert total(read_mesh(tmp_path / "m.vtu")) == pytest.approx(AREA + 1.0)


def test_a_cell_whose_middle_does_not_see_all_faces_is_divided_about_another_point(tmp_path: Path) -> None:
    """The pyramid of an arrowhead, cut into triangles from its reflex corner to its tips."""
    base = [[0, 0], [2, -1], [0.5, 0], [2, 1]]
    points = np.pad(np.array([[*point, 0.0] for point in base] + [[*point, 0.1] for point in base]), ((0, 8), (0, 0)))
    sides = [[0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
    ends = [[2, 1, 0], [2, 0, 3], [4, 5, 6], [4, 6, 7]]
    old_vtu(tmp_path / "m.vtu", [*ends, *(half for a, b, c, d in sides for half in ([a, b, c], [a, c, d]))], points, ())
    mesh = read_mesh(tmp_path / "m.vtu")
    assert {kind: len(nodes) for kind, nodes in mesh.cells.items()} == {"tetra": 12}
    assert total(mesh) == pytest.approx(0.05)


def test_polygons_in_a_plane_are_divided_about_their_middle(tmp_path: Path) -> None:
    head = "# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 8 double\n"
    points = "\n".join(" ".join(map(repr, (*point, 0.0))) for point in FLAT.tolist())
    cells = "\nCELLS 3 15\n6 0 1 2 3 4 5\n4 0 6 7 1\n2 6 7\nCELL_TYPES 3\n7\n7\n3\n"
    (tmp_path / "m.vtk").write_text(
        head + points + cells + "CELL_DATA 3\nSCALARS patch int\nLOOKUP_TABLE default\n0\n0\n3\n"
    )
    mesh = read_mesh(tmp_path / "m.vtk")
    assert {kind: len(nodes) for kind, nodes in mesh.cells.items()} == {"triangle": 6, "quad": 1}
    np.testing.assert_allclose(mesh.points[8:], [[0.0, 0.0]], atol=1e-15)
    assert total(mesh) == pytest.approx(AREA + 1.0)
    assert lists(mesh.patches) == {"3": [6, 7]}


@pytest.mark.parametrize(
    ("export", "file"), [("foamToVTK", "VTK/*/internal.vtu"), ("foamToEnsight", "EnSight/case.case")]
)
def test_openfoam_s_own_export_has_the_cells_of_the_case(tmp_path: Path, export: str, file: str) -> None:
    case = foam.FoamCase.new(tmp_path / "case", foam.BOX)
    case.run("blockMesh")
    case.run("polyDualMesh", "75", "-overwrite")
    case.run(export, *(["-constant"] if export == "foamToVTK" else []))
    expected, mesh = read_mesh(case.folder), read_mesh(next(case.folder.glob(file)))
    count = case.checked()["points"]
    np.testing.assert_allclose(mesh.points[:count], expected.points[:count], atol=1e-6)
    assert {name: len(nodes) for name, nodes in mesh.cells.items()} == {
        name: len(nodes) for name, nodes in expected.cells.items()
    }
    assert total(mesh) == pytest.approx(total(expected))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"faces"', '"others"', "its Cells have no face_offsets"),
        (">45 -1 -1", ">40 -1 -1", "array 'faces': 45 values, but 40 are expected"),
        (">8 6 5 4", ">9 6 5 4", "the faces of a polyhedron go beyond their list"),
        (">8 6 5 4", ">8 2 5 4", "cell 0 has a face of 2 nodes"),
        (">8 6 5 4", ">8 6 5 99", "cell 0 names node 99, but there are the nodes 0 to 15"),
        ("42 12 7", "42 42 7", "the faces of a polyhedron go beyond their list"),
    ],
)
def test_damaged_faces_are_one_clear_line(tmp_path: Path, old: str, new: str, message: str) -> None:
    old_vtu(path := tmp_path / "m.vtu")
    one_line(replaced(path, old, new), message)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (f"nfaced\n1\n{len(PRISM)}\n", "nfaced\n1\n0\n", "polyhedron 1 has no faces"),
        ("nsided\n1\n6\n", "nsided\n1\n2\n", "6 numbers, expected 2"),
        ("nsided\n1\n6\n6 5 4 3 2 1", "nsided\n1\n2\n6 5", "face 1 has too few nodes"),
        ("nsided\n1\n6\n6", "nsided\n1\n6\n99", "part 'low', nsided: node 99, but its nodes are 1 to 8"),
        ("nfaced", "convex", "elements 'convex'; known are point, .*, nsided, nfaced"),
    ],
)
def test_damaged_faces_of_ensight_are_one_clear_line(tmp_path: Path, old: str, new: str, message: str) -> None:
    ensight(path := tmp_path / "m.geo")
    one_line(replaced(path, old, new), f"malformed EnSight geometry: .*({message})")


@pytest.mark.parametrize(
    ("name", "values", "message"),
    [
        ("POE/IFN", [1, 1, 15], "polyhedron 1 has no faces"),
        ("POE/IFN", [1, 8, 14], "the faces of the polyhedra do not fit their list"),
        ("POG/NOD", np.full(10, 99), "elements of type POG name node 99; the last one is 16"),
        ("POG/FAM", [-3], "2 elements, but 1 numbers of families"),
    ],
)
def test_damaged_faces_of_med_are_one_clear_line(tmp_path: Path, name: str, values: Any, message: str) -> None:
    h5py = pytest.importorskip("h5py")
    med(path := tmp_path / "m.med")
    with h5py.File(path, "r+") as file:
        elements = file["ENS_MAA/m/-0000000000000000001-0000000000000000001/MAI"]
        del elements[name]
        elements[name] = np.asarray(values)
    one_line(path, message)


def test_a_face_of_three_cells_is_refused(tmp_path: Path) -> None:
    old_vtu(path := tmp_path / "m.vtu", others=((12, BOX), (12, BOX)))
    one_line(path, r"the cells 0, 1, 2 have one face together; two can have it")


@pytest.mark.parametrize("name", FILES)
def test_damaged_bytes_never_more_than_one_line(tmp_path: Path, name: str) -> None:
    FILES[name](path := tmp_path / name)
    assert refused_when_damaged(path, path, 60, np.random.default_rng(2026)) > 5
