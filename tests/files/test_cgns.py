"""CGNS: files that Gmsh writes and VTK reads; every kind of section, in old and new form; damaged files in one clear
line.
"""

import multiprocessing
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import foam_cases as foam
import numpy as np
import pytest
from format_files import CELLS, PATCHES, POINTS
from mesh_files import lists, one_line, quiet_gmsh, refused_when_damaged, sizes
from mesh_motion_numerics.quality.orientation import oriented
from mesh_motion_protocol.errors import InvalidInput
from numpy.typing import NDArray
from python_runs import said_by_python

from mesh_motion_server.cases.check import check
from mesh_motion_server.files import MeshFile, read_mesh, write_mesh
from mesh_motion_server.files.openfoam.polymesh import read_face_mesh

h5py = pytest.importorskip("h5py")
from cgns_files import add_cells, add_node, new_cgns  # noqa: E402  (it needs h5py)

Ints = NDArray[np.int64]


def volumes(mesh: MeshFile) -> float:
    found = sizes(mesh)
    assert all((of > 0).all() for of in found.values())
    return sum(float(of.sum()) for of in found.values())


@pytest.mark.parametrize("order", [1, 2])
def test_gmsh_writes_the_same_mesh_as_msh_and_as_cgns(tmp_path: Path, order: int) -> None:
    with quiet_gmsh("Cgns") as gmsh:
        gmsh.model.occ.addRectangle(0, 0, 0, 1, 1)
        gmsh.model.occ.synchronize()
        gmsh.model.mesh.setTransfiniteSurface(1)
        gmsh.model.occ.extrude([(2, 1)], 0, 0, 0.5, [2], recombine=True)
        gmsh.model.occ.fragment([(3, 1)], [(3, gmsh.model.occ.addBox(0, 0, 0.5, 1, 1, 1))])
        gmsh.model.occ.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.4)
        faces = [tag for _, tag in gmsh.model.getBoundary(gmsh.model.getEntities(3), oriented=False)]
        gmsh.model.addPhysicalGroup(2, faces[:3], name="wet wall")
        gmsh.model.addPhysicalGroup(2, faces[3:], name="rest")
        gmsh.model.addPhysicalGroup(3, [tag for _, tag in gmsh.model.getEntities(3)], name="fluid")
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(order)
        for suffix in ("msh", "cgns"):
            gmsh.write(str(tmp_path / f"m.{suffix}"))
    ours, other = read_mesh(tmp_path / "m.cgns"), read_mesh(tmp_path / "m.msh")
    assert {name: len(nodes) for name, nodes in ours.cells.items()} == {
        name: len(nodes) for name, nodes in other.cells.items()
    }
    assert set(ours.patches) == {"wet wall", "rest"}
    for name in ours.patches:  # Gmsh numbers the nodes of the two files in different orders
        positions = [
            set(map(tuple, (mesh.points[mesh.patches[name]].round(9) + 0.0).tolist())) for mesh in (ours, other)
        ]
        assert positions[0] == positions[1]
    assert volumes(ours) == pytest.approx(1.5)
    assert check(tmp_path / "m.cgns").mesh.n_cells == ours.n_cells
    assert ours.notes == other.notes
    assert len(ours.notes) == order - 1


VTK_COUNTS = """
import sys
from vtkmodules.vtkIOCGNSReader import vtkCGNSReader
from vtkmodules.vtkCommonDataModel import vtkDataObject
reader = vtkCGNSReader()
reader.SetFileName(sys.argv[1])
reader.Update()
grid = reader.GetOutput().GetBlock(0).GetBlock(0)
types = [grid.GetCellType(i) for i in range(grid.GetNumberOfCells())]
print(grid.GetNumberOfPoints(), sorted((t, types.count(t)) for t in set(types)))
"""


def vtk_counts(path: Path) -> str:
    pytest.importorskip("vtkmodules.vtkIOCGNSReader")
    return said_by_python("-c", VTK_COUNTS, path, timeout=120).strip()


# --- files made node by node -----------------------------------------------------------------------------------------


def make(path: Path, points: NDArray[np.float64], fill: Callable[[Any, Any], None], dimension: int = 3) -> Path:
    """A file with one zone; ``fill`` adds sections to the zone and families to the base."""
    with new_cgns(path) as root:
        base = add_node(root, "Base", "CGNSBase_t", np.array([dimension, 3]))
        zone = add_node(base, "Zone", "Zone_t", np.array([[len(points)], [1], [0]]))
        add_node(zone, "ZoneType", "ZoneType_t", "Unstructured")
        grid = add_node(zone, "GridCoordinates", "GridCoordinates_t")
        for axis, values in zip("XYZ", points.T, strict=False):
            add_node(grid, f"Coordinate{axis}", "DataArray_t", np.ascontiguousarray(values))
        fill(base, zone)
    return path


def section(zone: Any, name: str, kind: int, first: int, last: int, connectivity: Any, offsets: Any = None) -> Any:
    node = add_node(zone, name, "Elements_t", np.array([kind, 0]))
    add_node(node, "ElementRange", "IndexRange_t", np.array([first, last]))
    add_node(node, "ElementConnectivity", "DataArray_t", np.array(connectivity, dtype=np.int64))
    if offsets is not None:
        add_node(node, "ElementStartOffset", "DataArray_t", np.array(offsets, dtype=np.int64))
    return node


def condition(zone: Any, name: str, listed: str, values: Any, location: str = "", family: str = "") -> None:
    conditions = zone["ZoneBC"] if "ZoneBC" in zone else add_node(zone, "ZoneBC", "ZoneBC_t")
    node = add_node(conditions, name, "BC_t", "BCWall")
    add_node(node, listed, "IndexArray_t", np.array([values], dtype=np.int64))
    if location:
        add_node(node, "GridLocation", "GridLocation_t", location)
    if family:
        add_node(node, "FamilyName", "FamilyName_t", family)


TWO = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 1], [0.5, 0.5, -1], [2, 0.5, 0.0]])
_WEDGE = np.array([[0, 0, 0], [1, 0, 0], [9, 9, 9], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1.0]])
#: a pyramid, a tetrahedron next to it, one face of each
MIXED = [12, 1, 2, 3, 4, 5, 10, 2, 7, 3, 5, 7, 1, 4, 3, 2, 5, 2, 7, 5]


@pytest.mark.parametrize("offsets", [None, [0, 6, 11, 16, 20]])
def test_mixed_sections_of_both_versions(tmp_path: Path, offsets: list[int] | None) -> None:
    def fill(base: Any, zone: Any) -> None:
        section(zone, "all", 20, 1, 4, MIXED, offsets)
        condition(zone, "BC 1", "PointList", [3], "FaceCenter", "floor")
        condition(zone, "BC 2", "ElementRange", [4, 4], family="floor")
        condition(zone, "corner", "PointList", [7])

    mesh = read_mesh(make(tmp_path / "m.cgns", TWO, fill))
    np.testing.assert_array_equal(mesh.cells["pyramid"], [[0, 1, 2, 3, 4]])
    np.testing.assert_array_equal(mesh.cells["tetra"], [[1, 6, 2, 4]])
    assert lists(mesh.patches) == {"floor": [0, 1, 2, 3, 4, 6], "corner": [6]}


@pytest.mark.parametrize(("kind", "head"), [(15, []), (21, [15])])
def test_version_3_0_has_other_numbers_of_types(tmp_path: Path, kind: int, head: list[int]) -> None:
    """A wedge, whose number is 14 in all other versions, in a section of its own and in a MIXED one."""
    wedge = [*head, 1, 2, 4, 5, 6, 7]
    path = make(tmp_path / "m.cgns", _WEDGE, lambda _, zone: section(zone, "cells", kind, 1, 1, wedge))
    with h5py.File(path, "r+") as file:
        file["CGNSLibraryVersion/ data"][...] = 3.0
    np.testing.assert_array_equal(read_mesh(path).cells["wedge"], [[0, 1, 3, 4, 5, 6]])


@pytest.mark.parametrize("listed", [False, True])
def test_sections_are_patches_where_there_are_no_conditions(tmp_path: Path, listed: bool) -> None:
    def fill(base: Any, zone: Any) -> None:
        section(zone, "cells", 7, 1, 1, [1, 2, 3, 4])
        section(zone, "south", 3, 2, 2, [1, 2])
        if listed:
            add_node(zone, "ZoneBC", "ZoneBC_t")

    mesh = read_mesh(make(tmp_path / "m.cgns", TWO[:4], fill, dimension=2))
    assert (mesh.dimension, mesh.patches["south"].tolist()) == (2, [0, 1])


@pytest.mark.parametrize(
    ("cell", "side", "expected"),
    [
        (1, 2, [0, 1, 4]),  # of the pyramid 1, 2, 3, 4, 5
        (1, 5, [0, 3, 4]),
        (2, 2, [1, 4, 6]),  # of the tetrahedron 2, 7, 3, 5
        (2, 1, [1, 2, 6]),
        (3, 1, "element 3 of section 'wall' names node 0"),  # there is no such cell
        (1, 1, "element 3 of section 'wall' names node 0"),  # a side of four nodes
    ],
)
def test_faces_that_are_named_as_sides_of_cells_only(tmp_path: Path, cell: int, side: int, expected: Any) -> None:
    """As IOSS writes them: zeros instead of the nodes."""

    def fill(base: Any, zone: Any) -> None:
        section(zone, "cells", 20, 1, 2, MIXED[:11])
        faces = section(zone, "wall", 5, 3, 3, [0, 0, 0])
        add_node(faces, "ParentElements", "DataArray_t", np.array([[cell], [0]]))
        add_node(faces, "ParentElementsPosition", "DataArray_t", np.array([[side], [0]]))

    path = make(tmp_path / "m.cgns", TWO, fill)
    if isinstance(expected, str):
        one_line(path, expected)
    else:
        assert lists(read_mesh(path).patches) == {"wall": expected}


def test_another_number_of_cells_than_announced_is_named(tmp_path: Path) -> None:
    """``make`` announces one cell; these are two."""
    path = make(tmp_path / "m.cgns", TWO, lambda _, zone: section(zone, "cells", 10, 1, 2, [1, 2, 3, 5, 1, 3, 4, 5]))
    assert read_mesh(path).notes == ("zone 'Zone' announces 1 cells, but has 2",)


def test_conditions_may_list_single_nodes_as_elements_and_volumes_are_no_patches(tmp_path: Path) -> None:
    def fill(base: Any, zone: Any) -> None:
        section(zone, "cells", 7, 1, 1, [1, 2, 3, 4])
        section(zone, "points", 2, 2, 3, [4, 2])
        section(zone, "mixed", 20, 4, 5, [2, 3, 3, 1, 2])
        condition(zone, "pin", "PointList", [3, 4], "CellCenter")
        condition(zone, "south", "PointRange", [5, 5], "EdgeCenter")
        condition(zone, "fluid", "PointRange", [1, 1], "CellCenter")

    mesh = read_mesh(make(tmp_path / "m.cgns", TWO[:4], fill, dimension=2))
    assert lists(mesh.patches) == {"pin": [1, 2], "south": [0, 1]}


@pytest.mark.parametrize(
    ("listed", "values", "location", "wrong"),
    [
        ("PointList", [2, 77], "EdgeCenter", 77),
        ("PointRange", [2, 10**12], "EdgeCenter", 4),
        ("PointRange", [1, 3], "CellCenter", 1),
        ("PointList", [1], "EdgeCenter", 1),
        ("ElementRange", [1, 3], "", 1),
        ("ElementList", [-1, 2], "", -1),
    ],
)
def test_conditions_name_elements_of_the_boundary(
    tmp_path: Path, listed: str, values: list[int], location: str, wrong: int
) -> None:
    def fill(base: Any, zone: Any) -> None:
        section(zone, "cells", 7, 1, 1, [1, 2, 3, 4])
        section(zone, "edges", 3, 2, 3, [1, 2, 2, 3])
        condition(zone, "rim", listed, values, location)

    with pytest.raises(
        InvalidInput, match=f"rim: it names element {wrong}, which is not an element of lower dimension"
    ):
        read_mesh(make(tmp_path / "m.cgns", TWO[:4], fill, dimension=2))


#: two tetrahedra with a face in common: which nodes each face has, and which cells it points out of and into
PAIR = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1.0]])
FACES = [[2, 3, 4], [1, 3, 2], [1, 2, 4], [1, 4, 3], [2, 3, 5], [3, 4, 5], [4, 2, 5]]


def pair(zone: Any, numbers: list[list[int]], cells: int) -> None:
    """NGON_n sections that contain the faces alternately, with these numbers, and NFACE_n cells from another number
    on.
    """
    rows = iter(FACES)
    for k, of in enumerate(numbers):
        mine = [next(rows) for _ in of]
        section(zone, f"faces {k}", 22, of[0], of[-1], np.concatenate(mine), 3 * np.arange(len(mine) + 1))
    number = [n for of in numbers for n in of]
    listed = [number[0], *number[1:4], -number[0], *number[4:]]
    section(zone, "cells", 23, cells, cells + 1, listed, [0, 4, 8])


@pytest.mark.parametrize(("numbers", "cells"), [([[1], [2, 3, 4, 5, 6, 7]], 8), ([[1], [4, 5, 6, 7, 8, 9]], 2),
                                                ([[9], [3, 4, 5], [6, 7, 8]], 1)])  # fmt: skip
def test_faces_may_be_numbered_before_and_after_the_cells(tmp_path: Path, numbers: list[list[int]], cells: int) -> None:
    def fill(base: Any, zone: Any) -> None:
        pair(zone, numbers, cells)
        condition(zone, "one", "PointList", [numbers[-1][-1]], "FaceCenter")
        condition(zone, "fluid", "PointRange", [cells, cells + 1], "CellCenter")

    mesh = read_mesh(make(tmp_path / "m.cgns", PAIR, fill))
    assert {name: len(nodes) for name, nodes in mesh.cells.items()} == {"tetra": 2}
    assert lists(mesh.patches) == {"one": [1, 3, 4]}
    assert volumes(mesh) == pytest.approx(0.5)


def test_sections_of_boundary_faces_are_patches_where_there_are_no_conditions(tmp_path: Path) -> None:
    mesh = read_mesh(make(tmp_path / "m.cgns", PAIR, lambda b, z: pair(z, [[1], [2, 3, 4], [5, 6, 7]], 8)))
    assert lists(mesh.patches) == {"faces 1": [0, 1, 2, 3], "faces 2": [1, 2, 3, 4]}
    mesh = read_mesh(make(tmp_path / "n.cgns", PAIR, lambda b, z: pair(z, [[1, 2, 3, 4], [5, 6, 7]], 8)))
    assert list(mesh.patches) == ["faces 1"]


@pytest.mark.parametrize(
    ("numbers", "patch", "message"),
    [
        ([[1], [2, 3, 4], [4, 5, 6]], [], "two of its NGON_n faces are element 4"),
        ([[1, 2], [2, 3], [5, 6, 7]], [], "two of its NGON_n faces are element 2"),  # seven, from 1 to 7
        ([[1], [2, 3, 4, 5, 6, 7]], [7, 1], "patch: it names element 1, which is not a face of the boundary"),
        ([[1], [2, 3, 4, 5, 6, 7]], [2, 10], "patch: it names element 10, which is not a face of the boundary"),
    ],
)
def test_faces_that_are_not_there_are_refused(
    tmp_path: Path, numbers: list[list[int]], patch: list[int], message: str
) -> None:
    def fill(base: Any, zone: Any) -> None:
        pair(zone, numbers, 8)
        if patch:
            condition(zone, "patch", "PointList", patch, "FaceCenter")

    with pytest.raises(InvalidInput, match=message):
        read_mesh(make(tmp_path / "m.cgns", PAIR, fill))


def polyhedral(path: Path, source: Path, form: str) -> Path:
    """The faces and cells of a polyMesh as NGON_n and NFACE_n, or with parents only."""
    mesh = read_face_mesh(source)
    faces = [mesh.face(f) + 1 for f in range(mesh.n_faces)]
    cells = []
    for cell in range(mesh.n_cells):
        of = mesh.cell_faces[mesh.cell_starts[cell] : mesh.cell_starts[cell + 1]]
        cells.append(np.where(mesh.owner[of] == cell, of + 1, -(of + 1)))

    def listed(zone: Any, name: str, kind: int, first: int, rows: list[Ints]) -> Any:
        last = first + len(rows) - 1
        if form == "old":
            return section(zone, name, kind, first, last, np.concatenate([[len(row), *row] for row in rows]))
        starts = np.concatenate([[0], np.cumsum([len(row) for row in rows])])
        return section(zone, name, kind, first, last, np.concatenate(rows), starts)

    def fill(base: Any, zone: Any) -> None:
        ngon = listed(zone, "faces", 22, 1, faces)
        if form == "parents":
            second = np.zeros(mesh.n_faces, dtype=np.int64)
            second[: mesh.n_inner] = mesh.neighbour + 1 + mesh.n_faces
            parents = np.array([mesh.owner + 1 + mesh.n_faces, second])
            add_node(ngon, "ParentElements", "DataArray_t", parents)
        else:
            listed(zone, "cells", 23, mesh.n_faces + 1, cells)
        for patch in mesh.patches:
            if patch.count:
                span = [patch.start + 1, patch.start + patch.count]
                condition(zone, f"BC {patch.name}", "PointRange", span, "FaceCenter", patch.name)

    return make(path, mesh.points, fill)


@pytest.mark.parametrize("form", ["old", "new", "parents"])
def test_polyhedra_are_those_of_the_polymesh(tmp_path: Path, form: str) -> None:
    case = foam.FoamCase.new(tmp_path / "case", foam.BOX)
    case.run("blockMesh")
    case.run("polyDualMesh", "75", "-overwrite")
    expected = read_mesh(case.folder)
    mesh = read_mesh(polyhedral(tmp_path / "m.cgns", case.folder / "constant" / "polyMesh", form))
    np.testing.assert_array_equal(mesh.points, expected.points)
    assert volumes(mesh) == pytest.approx(3.0)
    for name, nodes in expected.cells.items():
        np.testing.assert_array_equal(np.sort(mesh.cells[name]), np.sort(nodes))
    for name, nodes in expected.patches.items():
        np.testing.assert_array_equal(mesh.patches[name], nodes)
    if form == "new":
        theirs = vtk_counts(tmp_path / "m.cgns")
        assert theirs == f"{len(read_face_mesh(case.folder / 'constant' / 'polyMesh').points)} [(42, 210)]"


# --- damaged files ---------------------------------------------------------------------------------------------------


def tetra(base: Any, zone: Any) -> None:
    section(zone, "cells", 10, 1, 1, [1, 2, 3, 4])


def broken(change: Callable[[Any, Any], None]) -> Callable[[Any, Any], None]:
    def fill(base: Any, zone: Any) -> None:
        tetra(base, zone)
        change(base, zone)

    return fill


def swell(node: Any) -> None:
    """Give the node an array that takes no room in the file."""
    del node[" data"]
    node.create_dataset(" data", shape=(10**9,), dtype="f8", chunks=(1 << 20,), compression="gzip")


@pytest.mark.parametrize(
    ("fill", "message"),
    [
        (lambda b, z: None, "the mesh has no cells"),
        (broken(lambda b, z: add_node(b, "Zone 2", "Zone_t", np.array([[1], [1], [0]]))), "2 zones: Zone, Zone 2"),
        (broken(lambda b, z: add_node(b.parent, "Base 2", "CGNSBase_t", np.array([3, 3]))), "2 bases: Base, Base 2"),
        (lambda b, z: section(z, "s", 10, 1, 1, [1, 2, 3, 5]), "section 's' names node 5, .* nodes 1 to 4"),
        (lambda b, z: section(z, "s", 10, 1, 1, [0, 2, 3, 4]), "element 1 of section 's' names node 0"),
        (lambda b, z: section(z, "s", 10, 1, 2, [1, 2, 3, 4]), "2 elements of 4 nodes, but a connectivity of 4"),
        (lambda b, z: section(z, "s", 10, 5, 1, [1, 2, 3, 4]), "elements 5 to 1"),
        (lambda b, z: section(z, "s", 10, 1, 10**12, [1, 2, 3, 4]), "elements 1 to 1000000000000"),
        (lambda b, z: section(z, "s", 25, 1, 1, range(1, 10)), "CGNS' type 25; known are .* first and second order"),
        (lambda b, z: section(z, "s", 20, 1, 2, [10, 1, 2, 3, 4, 25]), "element 1 of the section is of CGNS' type 25"),
        (lambda b, z: section(z, "s", 20, 1, 1, [10, 1, 2, 3, 4], [0, 4]), "ElementStartOffset does not increase"),
        (lambda b, z: section(z, "s", 22, 1, 1, [3, 1, 2, 3]), "NGON_n faces without NFACE_n cells"),
        (lambda b, z: section(z, "s", 23, 1, 1, [3, 1, 2, 3]), "NFACE_n cells without NGON_n faces"),
        (broken(lambda b, z: condition(z, "c", "PointList", [9])), "c: it names node 9, .* nodes 1 to 4"),
        (broken(lambda b, z: condition(z, "c", "PointRange", [4, 2])), "a PointRange of 4, 2; expected"),
        (broken(lambda b, z: condition(z, "c", "Nothing", [4, 2])), "c: neither PointList nor PointRange"),
        (broken(lambda b, z: z["ZoneType"].pop(" data")), "it has no data|Structured|a zone of type"),
        (broken(lambda b, z: z["GridCoordinates"].pop("CoordinateX")), "coordinates CoordinateY, Coo"),
        (broken(lambda b, z: swell(z["GridCoordinates"]["CoordinateX"])), "0 bytes that hold 8000000000 or more"),
    ],
)  # fmt: skip
def test_a_wrong_file_is_refused_in_one_line(tmp_path: Path, fill: Any, message: str) -> None:
    path = make(tmp_path / "m.cgns", np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]), fill)
    one_line(path, message)


def test_one_zone_of_several_is_chosen(tmp_path: Path) -> None:
    def fill(base: Any, zone: Any) -> None:
        tetra(base, zone)
        base.copy(zone, base, "Wake")

    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    path = make(tmp_path / "m.cgns", points, fill)
    for zone in ("Wake", "2"):
        mesh = read_mesh(path, zone)
        assert mesh.zone == "Wake"
        np.testing.assert_array_equal(mesh.points, points)


def large_plane(folder: Path) -> Path:
    """Tetrahedra in a cloud of a hundred thousand nodes; the arrays are 0.8 MB each."""
    return make(folder / "m.cgns", np.random.default_rng(0).random((100_000, 3)), tetra)


def repacked(path: Path, axis: str, values: NDArray[np.generic], **how: Any) -> Any:
    """Store other coordinates in another way; return the file and the dataset."""
    file = h5py.File(path, "r+")
    group = file[f"Base/Zone/GridCoordinates/Coordinate{axis}"]
    del group[" data"]
    return file, group.create_dataset(" data", data=values, **how)


def test_packed_coordinates_are_read(tmp_path: Path) -> None:
    path = large_plane(tmp_path)
    expected = read_mesh(path).points
    for how in (
        {"compression": "gzip"},
        {"compression": "gzip", "shuffle": True, "fletcher32": True, "chunks": (30_000,)},
        {"compression": "lzf"},
    ):
        file, _ = repacked(path, "X", expected[:, 0], **how)
        file.close()
        np.testing.assert_array_equal(read_mesh(path).points, expected)


def test_other_files_are_recognised(tmp_path: Path) -> None:
    path = tmp_path / "m.cgns"
    path.write_bytes(b"\xc0\xa8\xa3\xa9ADF Database Version A02011>" + b" " * 100)
    with pytest.raises(InvalidInput, match=r"old ADF format \(adf2hdf m\.cgns"):
        read_mesh(path)
    for content in (b"hello", b"\x89HDF\r\n\x1a\n" + b"\0" * 50):
        path.write_bytes(content)
        with pytest.raises(InvalidInput, match="malformed or damaged CGNS file"):
            read_mesh(path)


def _read_all_damaged(path: Path) -> None:
    """Ends with status 0 if InvalidInput was the only error; a crash of HDF5 is a signal."""
    sys.exit(0 if refused_when_damaged(path, path, 150, np.random.default_rng(11)) > 15 else 3)


@pytest.mark.slow
def test_damaged_bytes_give_invalid_input_only(tmp_path: Path, all_solids: tuple[Any, Any]) -> None:
    points, cells = all_solids
    path = make(tmp_path / "m.cgns", points, lambda base, zone: add_cells(zone, cells))
    process = multiprocessing.get_context("spawn").Process(target=_read_all_damaged, args=(path,))
    process.start()
    process.join(200)
    assert process.exitcode == 0


def blocks(path: Path, *, linked: bool, names: tuple[str, str] = ("right", "right")) -> Path:
    """The box of eight hexahedra in two structured zones, as pyHyp writes them; the second counts y down, z, then x.

    ``names`` of the second zone and of the donor of the first one.
    """
    root = new_cgns(path)
    base = add_node(root, "Base", "CGNSBase_t", np.array([3, 3]))
    for name in ("wall", "far"):
        family = add_node(base, f"family_{name}", "Family_t")
        add_node(family, "FamilyBC", "FamilyBC_t", "BCWall")
    lattice = POINTS.reshape(3, 3, 3, 3)  # x, y, z
    left, right = lattice[:2], lattice[1:, ::-1].transpose(1, 2, 0, 3)
    for name, points in (("left", left), (names[0], right)):
        sizes = np.array(points.shape[:3])
        zone = add_node(base, name, "Zone_t", np.stack([sizes, sizes - 1, 0 * sizes]))
        add_node(zone, "ZoneType", "ZoneType_t", "Structured")
        grid = add_node(zone, "GridCoordinates", "GridCoordinates_t")
        for axis in range(3):
            values = np.ascontiguousarray(points[..., axis].transpose(2, 1, 0))
            add_node(grid, f"Coordinate{'XYZ'[axis]}", "DataArray_t", values)
        conditions = add_node(zone, "ZoneBC", "ZoneBC_t")
        z = 2 if name == "left" else 1
        for patch, index in (("wall", 1), ("far", 3)):
            low, high = np.ones(3, int), sizes.copy()
            low[z] = high[z] = index
            faces = patch == "far"  # by faces, which end one earlier
            bc = add_node(conditions, patch, "BC_t", "BCWall")
            add_node(bc, "FamilyName", "FamilyName_t", f"family_{patch}")
            add_node(bc, "PointRange", "IndexRange_t", np.stack([low, high - (np.arange(3) != z) * faces]))
            if faces:
                add_node(bc, "GridLocation", "GridLocation_t", "IJK"[z] + "FaceCenter")
        if linked and name == "left":  # x = 2 there, y and z of the left are -i and j of the right, its k = 1
            links = add_node(zone, "ZoneGridConnectivity", "ZoneGridConnectivity_t")
            link = add_node(links, "to right", "GridConnectivity1to1_t", names[1])
            add_node(link, "PointRange", "IndexRange_t", np.array([[2, 1, 1], [2, 3, 3]]))
            add_node(link, "PointRangeDonor", "IndexRange_t", np.array([[3, 1, 1], [1, 3, 1]]))
            add_node(link, "Transform", '"int[IndexDimension]"', np.array([3, -1, 2]))
    root.close()
    return path


@pytest.mark.parametrize("linked", [False, True])
def test_structured_zones_are_one_mesh_and_come_back(tmp_path: Path, linked: bool) -> None:
    mesh = read_mesh(blocks(tmp_path / "m.cgns", linked=linked))
    (block,) = oriented(mesh.points, mesh.cell_table).cells
    assert volumes(replace(mesh, cells={"hexahedron": block.nodes})) == pytest.approx(0.343, rel=1e-3)
    assert len(mesh.points) == 27
    assert "9 nodes were in several" in mesh.notes[0]
    place = {tuple(row): k for k, row in enumerate(POINTS.tolist())}
    number = np.array([place[tuple(row)] for row in mesh.points.tolist()])
    assert sorted(map(sorted, number[mesh.cells["hexahedron"]].tolist())) == sorted(map(sorted, CELLS.tolist()))
    for name in ("wall", "far"):
        np.testing.assert_array_equal(np.sort(number[mesh.patches[f"family_{name}"]]), PATCHES[name])
    write_mesh(tmp_path / "moved.cgns", replace(mesh, points=mesh.points / 3))
    after = read_mesh(tmp_path / "moved.cgns")
    np.testing.assert_array_equal(after.points, mesh.points / 3)
    np.testing.assert_array_equal(after.cells["hexahedron"], mesh.cells["hexahedron"])
    assert len(read_mesh(tmp_path / "m.cgns", "left").points) == 18


def test_a_zone_that_gmsh_names_with_and_without_a_blank_is_one(tmp_path: Path) -> None:
    """Gmsh 4.15: the zone fluid_S00002, which the connections call "fluid S00002"."""
    mesh = read_mesh(blocks(tmp_path / "m.cgns", linked=True, names=("the_right", "the right")))
    assert len(mesh.points) == 27
    mesh = read_mesh(blocks(tmp_path / "m.cgns", linked=True, names=("right", "other")))
    assert len(mesh.points) == 36
    assert mesh.notes[-1] == "the connection 'to right' is a boundary: no zone 'other' is read"


def test_a_connection_to_what_is_not_there_is_refused(tmp_path: Path) -> None:
    path = blocks(tmp_path / "m.cgns", linked=True)
    with h5py.File(path, "r+") as file:
        file["Base/left/ZoneGridConnectivity/to right/PointRangeDonor/ data"][0, 0] = 4
    with pytest.raises(InvalidInput, match=r"right: it names node \[4, 1, 1\] of \[3, 3, 2\]"):
        read_mesh(path)
