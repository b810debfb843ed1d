"""Meshes come from Gmsh, meshio and PyVista, and go to PyVista, with their patches."""

import sys
import types

import gmsh
import meshio
import numpy as np
import pytest
from mesh_motion_client import InvalidInput, Mesh, Patch
from mesh_motion_client.exchange import _NUMBERS, _TYPES, to_pyvista
from mesh_motion_client.mesh import CELL_NODES
from mesh_motion_numerics.mesh.cells import CELL_TYPES
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkUnstructuredGrid
from vtkmodules.vtkFiltersVerdict import vtkCellSizeFilter

from mesh_motion_server.files import MeshFile, write_mesh
from mesh_motion_server.files.gmsh.mesh import _TYPES as GMSH_TYPES
from mesh_motion_server.files.vtk.reading import NUMBERED_PATCH_ARRAYS

ROLES = {"bottom": "moving", "top": "fixed"}
CUBE = np.array([[x, y, z] for z in (0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0)])
#: A unit cube as two wedges.
WEDGES = Mesh(
    CUBE,
    {"wedge": [[0, 1, 2, 4, 5, 6], [1, 3, 2, 5, 7, 6]]},
    {name: Patch(role, np.arange(4) + 4 * k) for k, (name, role) in enumerate(ROLES.items())},
)


class Grid:
    """The used part of ``pyvista.UnstructuredGrid``, on VTK's grid."""

    def __init__(self, cells, kinds, points):
        self.vtk, self.points, self.point_data, self.cell_data = vtkUnstructuredGrid(), points, {}, {}
        held, blocks, at = vtkCellArray(), {}, 0
        for kind in kinds:
            nodes = cells[at + 1 : at + 1 + cells[at]]
            held.InsertNextCell(len(nodes), nodes.tolist())
            blocks.setdefault(kind, []).append(nodes)
            at += 1 + cells[at]
        corners = vtkPoints()
        corners.SetData(numpy_to_vtk(points, deep=True))
        self.vtk.SetPoints(corners)
        self.vtk.SetCells(kinds.tolist(), held)
        self.celltypes = kinds
        self.cells_dict = {kind: np.array(rows) for kind, rows in blocks.items()}

    def cast_to_unstructured_grid(self):
        return self

    def volumes(self):
        measured = vtkCellSizeFilter()
        measured.SetInputData(self.vtk)
        measured.Update()
        return vtk_to_numpy(measured.GetOutput().GetCellData().GetArray("Volume"))


@pytest.fixture
def pyvista(monkeypatch):
    """VTK's grid under PyVista's name, because PyVista is not installed for the tests."""
    monkeypatch.setitem(sys.modules, "pyvista", types.SimpleNamespace(UnstructuredGrid=Grid))


def same(one, other):
    np.testing.assert_allclose(one.points, other.points, rtol=0, atol=1e-14)  # a text file may round
    assert {name: nodes.tolist() for name, nodes in one.cells.items()} == {
        name: nodes.tolist() for name, nodes in other.cells.items()
    }
    assert {name: (patch.role, patch.nodes.tolist()) for name, patch in one.patches.items()} == {
        name: (patch.role, patch.nodes.tolist()) for name, patch in other.patches.items()
    }


def test_the_types_are_those_of_the_client_the_server_and_gmsh():
    assert set(_TYPES) == set(CELL_NODES)
    assert {name: kind[0] for name, kind in _TYPES.items()} == {n: kind.dimension for n, kind in CELL_TYPES.items()}
    assert {kind[2]: name for name, kind in _TYPES.items()} == GMSH_TYPES


@pytest.mark.usefixtures("pyvista")
def test_to_pyvista_and_back():
    grid = WEDGES.to_pyvista()
    assert grid.volumes().tolist() == pytest.approx([0.5, 0.5])  # a wedge in another order of nodes is negative
    assert grid.point_data["patch_top"].tolist() == [0] * 4 + [1] * 4
    same(Mesh.from_pyvista(grid, ROLES), WEDGES)
    flat = Mesh(CUBE[:4, :2], {"quad": [[0, 1, 3, 2]]}, {"low": Patch("moving", [0, 1])})
    assert to_pyvista(flat, flat.points + 1).points[:, 2].tolist() == [0.0] * 4
    same(Mesh.from_pyvista(flat.to_pyvista(), {"low": "moving"}), flat)
    with pytest.raises(
        InvalidInput, match=r"patch 'botom' is not among the arrays and numbers .*did you mean 'bottom'"
    ):
        Mesh.from_pyvista(grid, {"botom": "moving"})


@pytest.mark.parametrize(
    ("cells", "kinds", "name", "expected"),
    [
        ([8, *range(8)], [11], "hexahedron", [[0, 1, 3, 2, 4, 5, 7, 6]]),
        ([4, 0, 1, 2, 3], [8], "quad", [[0, 1, 3, 2]]),
        ([1, 0, 4, 0, 1, 3, 2, 4, 0, 1, 2, 3], [1, 9, 8], "quad", [[0, 1, 3, 2]] * 2),
    ],
)
def test_cells_of_images_are_quads_and_hexahedra(cells, kinds, name, expected):
    corners = CUBE if name == "hexahedron" else CUBE[:4]
    mesh = Mesh.from_pyvista(Grid(np.array(cells), np.array(kinds), corners), {})
    assert mesh.cells[name].tolist() == expected
    assert list(mesh.cells) == [name]


def test_numbers_of_cells_are_patches_as_in_files():
    """The client cannot import the reader's list: neither may know an array of cells that the other does not."""
    assert [name for name in NUMBERED_PATCH_ARRAYS if name != "point_tags"] == [*_NUMBERS]


def test_from_pyvista_by_arrays_of_cells():
    """As pyvista.read makes it of a file of Gmsh: faces with numbers among the cells."""
    cells = [6, 0, 1, 2, 4, 5, 6, 4, 0, 1, 3, 2, 6, 1, 3, 2, 5, 7, 6, 4, 4, 5, 7, 6, 2, 0, 1]
    grid = Grid(np.array(cells), np.array([13, 9, 13, 9, 3]), CUBE)
    grid.cell_data = {"gmsh:physical": np.array([1, 7, 1, 8, 7]), "patch_lid": np.array([0, 0, 0, 1, 0])}
    mesh = Mesh.from_pyvista(grid, {"7": "moving", "lid": "fixed", "8": "fixed", "curve_7": "fixed"})
    assert {name: patch.nodes.tolist() for name, patch in mesh.patches.items()} == {
        "7": [0, 1, 2, 3], "lid": [4, 5, 6, 7], "8": [4, 5, 6, 7], "curve_7": [0, 1]
    }  # fmt: skip
    assert mesh.cells["wedge"].tolist() == WEDGES.cells["wedge"].tolist()


@pytest.mark.parametrize(
    ("kind", "shape"), [(6, "triangle strips"), (7, "polygons"), (42, "polyhedra"), (29, "curved")]
)
def test_cells_of_other_shapes_are_named_with_the_way_in(kind, shape):
    grid = Grid(np.array([4, 0, 1, 3, 2]), np.array([9]), CUBE[:4])
    grid.celltypes, grid.cells_dict = np.array([kind]), None  # which PyVista does not make of polyhedra
    with pytest.raises(InvalidInput, match=rf"VTK's type {kind} \(.*{shape}\); .*triangulate\(\)"):
        Mesh.from_pyvista(grid, {})


@pytest.mark.usefixtures("pyvista")
def test_a_moved_mesh_goes_to_pyvista_with_its_displacement(session):
    moved = session.move({"left": [[0.0, 0.25]] * 4})
    grid = moved.to_pyvista()
    assert (grid.points[:, :2] == moved.mesh.points + moved.displacement).all()
    assert grid.point_data["displacement"].tolist() == [[0.0, 0.25, 0.0]] * 16


@pytest.mark.parametrize("array", ["gmsh:physical", "cell_tags", "medit:ref", "netgen:index", "gmsh:geometrical"])
def test_from_meshio_by_numbers(array):
    """As in files; a curve with the number of a surface has a name of its own, and 0 is none."""
    sides = [("quad", [[0, 1, 3, 2]]), ("quad", [[4, 5, 7, 6]]), ("line", [[0, 1], [1, 3], [4, 5]])]
    numbers = [[1, 1], [-7 if array == "cell_tags" else 7654321], [8], [8, 0, 9]]
    mesh = meshio.Mesh(CUBE, [("wedge", WEDGES.cells["wedge"]), *sides], cell_data={array: numbers, "other": numbers})
    found = Mesh.from_meshio(mesh, {str(numbers[1][0]): "fixed", "8": "moving", "curve_8": "fixed", "9": "fixed"})
    assert {name: patch.nodes.tolist() for name, patch in found.patches.items()} == {
        str(numbers[1][0]): [0, 1, 2, 3], "8": [4, 5, 6, 7], "curve_8": [0, 1], "9": [4, 5]
    }  # fmt: skip
    with pytest.raises(
        InvalidInput, match=r"patch '0' is not among the sets of points and cells \['-?7[0-9]*', '8', '9', 'cu"
    ):
        Mesh.from_meshio(mesh, {"0": "fixed"})


def test_the_most_similar_patch_without_a_role_is_meant(tmp_path):
    """Not the first one without a role."""
    nodes = np.arange(4)
    np.savez(
        tmp_path / "m.npz",
        points=CUBE,
        cells_wedge=WEDGES.cells["wedge"],
        patch_Outer=nodes,
        **{"patch_Outer.Left": nodes},
    )
    with pytest.raises(
        InvalidInput, match=r"patch 'Outer' has no role.*'Outer.Lef' is not a patch: did you mean 'Outer.Left'"
    ):
        Mesh.load(tmp_path / "m.npz", {"Outer.Lef": "moving"})


def test_from_meshio_by_sets_and_by_names_of_physical_groups():
    lower, upper = (("quad", [[0, 1, 3, 2]]), ("quad", [[4, 5, 7, 6]]))
    cells = [("wedge", WEDGES.cells["wedge"]), lower, upper]
    by_cells = meshio.Mesh(CUBE, cells, point_sets={"top": [4, 5, 6, 7]}, cell_sets={"bottom": [[], [0], []]})
    same(Mesh.from_meshio(by_cells, ROLES), WEDGES)
    groups = {"bottom": np.array([7, 2]), "top": np.array([8, 2])}
    by_groups = meshio.Mesh(CUBE, cells, cell_data={"gmsh:physical": [[1, 1], [7], [8]]}, field_data=groups)
    same(Mesh.from_meshio(by_groups, ROLES), WEDGES)
    with pytest.raises(InvalidInput, match=r"cells of type triangle6; expected .*save curved cells by their corners"):
        Mesh.from_meshio(meshio.Mesh(CUBE, [("triangle6", [[0, 1, 2, 3, 4, 5]])]), {})
    with pytest.raises(InvalidInput, match="cells are 2D, but the coordinate z varies"):
        Mesh.from_meshio(meshio.Mesh(CUBE, [lower, upper]), {})
    rounded = np.add(CUBE[:4], [[0, 0, 1e-8], [0, 0, 0], [0, 0, 0], [0, 0, 0]])
    assert Mesh.from_meshio(meshio.Mesh(rounded, [lower]), {}).points.tolist() == rounded[:, :2].tolist()


def test_from_gmsh_as_its_file_is_read(tmp_path):
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        with pytest.raises(InvalidInput, match=r"no mesh .*gmsh.model.mesh.generate"):
            Mesh.from_gmsh({})
        square = gmsh.model.occ.addRectangle(0, 0, 0, 1, 1)
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(2, [square], name="fluid")
        gmsh.model.addPhysicalGroup(1, [1], name="bottom")
        gmsh.model.addPhysicalGroup(1, [3], 9)
        gmsh.model.mesh.generate(2)
        gmsh.write(str(tmp_path / "square.msh"))
        roles = {"bottom": "moving", "9": "fixed"}
        same(Mesh.from_gmsh(roles), Mesh.load(tmp_path / "square.msh", roles))
        with pytest.raises(InvalidInput, match="Gmsh's model: patch '9' has no role"):
            Mesh.from_gmsh({"bottom": "moving"})
    finally:
        gmsh.finalize()


@pytest.mark.parametrize("version", [2.2, 4.1])
def test_groups_of_gmsh_with_one_number_or_name_as_its_file_is_read(tmp_path, version):
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
        gmsh.model.occ.synchronize()
        for dimension, entities, number, name in (
            (3, [1], 1, "fluid"),
            (2, [1], 1, ""),
            (2, [2, 3], 2, "walls"),
            (2, [4, 5, 6], 3, ""),
            (1, [1], 1, ""),
            (1, [12], 2, "walls"),
        ):
            gmsh.model.addPhysicalGroup(dimension, entities, number, name)
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.5)
        gmsh.model.mesh.generate(3)
        gmsh.write(str(tmp_path / "box.msh"))
        roles = {"1": "moving", "walls": "fixed", "3": "fixed", "curve_1": "fixed"}
        same(Mesh.from_gmsh(roles), Mesh.load(tmp_path / "box.msh", roles))
        gmsh.model.mesh.setOrder(2)
        with pytest.raises(InvalidInput, match=r"cells of the type Line 3; expected line, .*setOrder\(1\)"):
            Mesh.from_gmsh(roles)
    finally:
        gmsh.finalize()


def test_load_reads_what_the_server_reads(tmp_path):
    path, cells = tmp_path / "cube.vtu", {"hexahedron": np.array([[0, 1, 3, 2, 4, 5, 7, 6]])}
    write_mesh(path, MeshFile(CUBE, cells, {name: patch.nodes for name, patch in WEDGES.patches.items()}, path))
    same(Mesh.load(path, ROLES), Mesh(CUBE, cells, WEDGES.patches))
    with pytest.raises(InvalidInput, match=r"there is no patch 'tpo'; .*did you mean 'top'"):
        Mesh.load(path, {"bottom": "moving", "top": "fixed", "tpo": "fixed"})
    (tmp_path / "a.stl").write_bytes(bytes(84))
    with pytest.raises(InvalidInput, match=r"a\.stl: a surface \(STL\), which is not read"):
        Mesh.load(tmp_path / "a.stl", {})
    with pytest.raises(InvalidInput, match="has no zones"):
        Mesh.load(path, ROLES, zone="1")


@pytest.mark.parametrize(
    ("package", "call"),
    [("pyvista", WEDGES.to_pyvista), ("gmsh", lambda: Mesh.from_gmsh(ROLES)), ("matplotlib", WEDGES.plot)],
)
def test_a_package_that_is_missing_is_named_with_the_way_to_it(monkeypatch, package, call):
    monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.setattr("mesh_motion_client.display.find_spec", lambda name: None)
    with pytest.raises(InvalidInput, match=rf"this needs {package}, which cannot be .* \(pip install {package}\)"):
        call()


@pytest.mark.parametrize("read", [Mesh.from_pyvista, Mesh.from_meshio])
def test_an_object_of_another_package_is_named(read):
    with pytest.raises(InvalidInput, match=r"expected a .*, got str \(.*Mesh.load of a file"):
        read("wing.vtu", ROLES)


def test_a_missing_file_is_said_before_a_missing_package(tmp_path):
    with pytest.raises(InvalidInput, match=r"no.su2: cannot be read: there is no such file$"):
        Mesh.load(tmp_path / "no.su2", ROLES)


def test_a_role_with_a_slip_of_the_pen():
    with pytest.raises(InvalidInput, match=r"got 'movng' \(did you mean 'moving'\?\)"):
        Patch("movng", [0])
