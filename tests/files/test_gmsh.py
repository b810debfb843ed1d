"""Files that Gmsh writes: every version and form gives the same mesh, in the file's node order."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mesh_files import one_line, quiet_gmsh
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.files import read_mesh, write_mesh

gmsh = pytest.importorskip("gmsh", exc_type=OSError)

FORMS = [(version, binary) for version in (2.2, 4.1) for binary in (0, 1)]


@pytest.fixture
def model() -> Iterator[Any]:
    with quiet_gmsh() as gmsh:
        gmsh.model.add("test")
        yield gmsh.model


def save(path: Path, version: float, binary: int) -> Path:
    gmsh.option.setNumber("Mesh.MshFileVersion", version)
    gmsh.option.setNumber("Mesh.Binary", binary)
    gmsh.write(str(path))
    return path


def square(model: Any, *, recombine: bool = False) -> None:
    left = model.occ.addRectangle(0, 0, 0, 0.5, 1)
    right = model.occ.addRectangle(0.5, 0, 0, 0.5, 1)
    model.occ.fragment([(2, left)], [(2, right)])
    model.occ.synchronize()
    if recombine:
        model.mesh.setRecombine(2, right)
    curves = {tuple(np.round(model.occ.getCenterOfMass(1, tag)[:2], 6)): tag for _, tag in model.getEntities(1)}
    model.addPhysicalGroup(1, [curves[0.25, 0.0], curves[0.75, 0.0]], name="bottom")
    model.addPhysicalGroup(1, [curves[0.0, 0.5], curves[1.0, 0.5]], name="sides")
    model.addPhysicalGroup(1, [curves[0.0, 0.5]], tag=77)  # a curve in two groups, one without a name
    model.addPhysicalGroup(2, [left, right], name="fluid")
    model.mesh.setSize(model.getEntities(0), 0.2)
    model.mesh.generate(2)


@pytest.mark.parametrize(("version", "binary"), FORMS)
def test_mixed_2d_mesh_with_overlapping_groups(model: Any, tmp_path: Path, version: float, binary: int) -> None:
    square(model, recombine=True)
    mesh = read_mesh(save(tmp_path / "square.msh", version, binary))
    assert mesh.dimension == 2
    assert set(mesh.cells) == {"triangle", "quad"}
    assert set(mesh.patches) == {"bottom", "sides", "77"}
    x, y = mesh.points.T
    np.testing.assert_array_equal(mesh.patches["bottom"], np.flatnonzero(y == 0))
    np.testing.assert_array_equal(mesh.patches["sides"], np.flatnonzero((x == 0) | (x == 1)))
    np.testing.assert_array_equal(mesh.patches["77"], np.flatnonzero(x == 0))
    area = sum(_areas(mesh.points[nodes]).sum() for nodes in mesh.cells.values())
    assert area == pytest.approx(1.0, rel=1e-12)


def _areas(polygons: np.ndarray) -> np.ndarray:
    x, y = polygons[..., 0], polygons[..., 1]
    return 0.5 * (x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y).sum(axis=1)


@pytest.mark.parametrize(("version", "binary"), FORMS)
def test_same_nodes_cells_and_patches_as_gmsh_and_meshio(
    model: Any, tmp_path: Path, version: float, binary: int
) -> None:
    meshio = pytest.importorskip("meshio")
    box = model.occ.addBox(0, 0, 0, 1, 2, 3)
    model.occ.synchronize()
    faces = [tag for _, tag in model.getEntities(2)]
    model.addPhysicalGroup(2, faces[:2], name="moving wall")
    model.addPhysicalGroup(2, faces[2:], name="outer")
    model.addPhysicalGroup(3, [box], name="fluid")
    model.mesh.setSize(model.getEntities(0), 0.8)
    model.mesh.generate(3)
    path = save(tmp_path / "box.msh", version, binary)
    mesh = read_mesh(path)
    theirs = meshio.read(path)
    np.testing.assert_array_equal(mesh.points, theirs.points)  # the order of the file, to the bit
    np.testing.assert_array_equal(mesh.cells["tetra"], theirs.cells_dict["tetra"])
    tag, _ = theirs.field_data["moving wall"]
    physical = theirs.cell_data_dict["gmsh:physical"]["triangle"]
    np.testing.assert_array_equal(
        mesh.patches["moving wall"], np.unique(theirs.cells_dict["triangle"][physical == tag])
    )


@pytest.mark.parametrize("binary", [0, 1])
def test_elements_without_a_group_and_those_in_groups(model: Any, tmp_path: Path, binary: int) -> None:
    """SaveAll writes every element; version 2.2 then has no groups at all, as Gmsh documents."""
    gmsh.option.setNumber("Mesh.SaveAll", 1)
    square(model)
    mesh = read_mesh(save(tmp_path / "all.msh", 4.1, binary))
    assert set(mesh.patches) == {"bottom", "sides", "77"}
    assert _areas(mesh.points[mesh.cells["triangle"]]).sum() == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize(("version", "binary"), FORMS)
def test_second_order_cells_are_read_by_their_corners(model: Any, tmp_path: Path, version: float, binary: int) -> None:
    square(model)
    flat = read_mesh(save(tmp_path / "flat.msh", version, binary))
    model.mesh.setOrder(2)
    mesh = read_mesh(save(tmp_path / "square.msh", version, binary))
    assert mesh.notes == (
        f"{mesh.n_cells} cells of higher order are moved and judged by their corners; their other nodes move along",
    )
    assert mesh.n_cells == flat.n_cells
    assert _areas(mesh.points[mesh.cells["triangle"]]).sum() == pytest.approx(1.0, rel=1e-12)
    assert len(mesh.patches["bottom"]) == 2 * len(flat.patches["bottom"]) - 1


@pytest.mark.parametrize(("version", "binary"), FORMS)
def test_without_groups_the_curves_of_the_geometry_are_patches(
    model: Any, tmp_path: Path, version: float, binary: int
) -> None:
    model.occ.addRectangle(0, 0, 0, 1, 1)
    model.occ.synchronize()
    model.mesh.generate(2)
    mesh = read_mesh(save(tmp_path / "m.msh", version, binary))
    assert sorted(mesh.patches) == ["1", "2", "3", "4"]
    assert (mesh.points[mesh.patches["1"], 1] == 0.0).all()
    assert mesh.notes == ("it has no physical groups: the curves of its geometry are the patches, by their numbers",)


@pytest.mark.parametrize("binary", [0, 1])
def test_names_of_groups_are_not_given_to_curves_with_the_same_number(model: Any, tmp_path: Path, binary: int) -> None:
    """With Mesh.SaveAll, version 2.2 has the names of the groups, but no element is in them."""
    square(model)
    gmsh.option.setNumber("Mesh.SaveAll", 1)
    mesh = read_mesh(save(tmp_path / "m.msh", 2.2, binary))
    assert sorted(mesh.patches) == [str(tag) for _, tag in model.getEntities(1)]
    (note,) = mesh.notes
    assert note.startswith("no element is in its group ")
    assert "(Mesh.SaveAll?): the curves of its geometry are the patches" in note


def numbers(path: Path) -> list[float | str]:
    return [float(word) if word[-1:].isdigit() else word for word in path.read_text().split()]


@pytest.mark.parametrize(("version", "binary"), FORMS)
def test_a_file_comes_back_with_moved_nodes(model: Any, tmp_path: Path, version: float, binary: int) -> None:
    """Gmsh itself reads the written file."""
    square(model)
    mesh = read_mesh(save(tmp_path / "m.msh", version, binary))
    write_mesh(tmp_path / "moved.msh", replace(mesh, points=mesh.points * 1.1 + 1 / 3))
    np.testing.assert_array_equal(read_mesh(tmp_path / "moved.msh").points, mesh.points * 1.1 + 1 / 3)
    write_mesh(tmp_path / "back.msh", mesh)
    if binary:
        assert (tmp_path / "back.msh").read_bytes() == (tmp_path / "m.msh").read_bytes()
    else:
        assert numbers(tmp_path / "back.msh") == numbers(tmp_path / "m.msh")
    gmsh.open(str(tmp_path / "moved.msh"))
    _, xyz, _ = model.mesh.getNodes()
    np.testing.assert_allclose(np.reshape(xyz, (-1, 3))[:, :2].min(axis=0), 1 / 3)


def test_a_surface_in_space_is_refused(model: Any, tmp_path: Path) -> None:
    model.occ.addSphere(0, 0, 0, 1)
    model.occ.synchronize()
    model.mesh.generate(2)
    with pytest.raises(InvalidInput, match="coordinate z varies"):
        read_mesh(save(tmp_path / "sphere.msh", 4.1, 1))


def test_sparse_unordered_tags_big_endian_and_wedges(tmp_path: Path) -> None:
    """A file no Gmsh on this machine writes: version 4.1, big-endian, sparse tags in no order, parametric nodes."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1]], dtype=">f8")
    tags = np.array([10**12, 7, 500, 3, 9, 8], dtype=">u8")

    def ints(*values: int) -> bytes:
        return np.array(values, dtype=">i4").tobytes()

    def sizes(*values: int) -> bytes:
        return np.array(values, dtype=">u8").tobytes()

    parametric = np.hstack([points, np.full((6, 2), 0.5)]).astype(">f8")
    path = tmp_path / "big.msh"
    path.write_bytes(
        b"$MeshFormat\n4.1 1 8\n" + ints(1) + b"\n$EndMeshFormat\n$Comments\nhello $ there\n$EndComments\n"
        b"$Nodes\n" + sizes(1, 6, 3, 10**12) + ints(2, 1, 1) + sizes(6) + tags.tobytes() + parametric.tobytes()
        + b"\n$EndNodes\n$Elements\n" + sizes(1, 1, 1, 1) + ints(3, 1, 6) + sizes(1) + sizes(1) + tags.tobytes()
        + b"\n$EndElements\n"
    )  # fmt: skip
    mesh = read_mesh(path)
    np.testing.assert_array_equal(mesh.points, points)
    np.testing.assert_array_equal(mesh.cells["wedge"], [[0, 1, 2, 3, 4, 5]])
    assert mesh.patches == {}


HEADER = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n"
TRIANGLE = "$Nodes\n3\n1 0 0 {z}\n2 1 0 0\n3 0 1 0\n$EndNodes\n$Elements\n1\n1 2 2 7 7 1 2 3\n$EndElements\n"


@pytest.mark.parametrize("version", ["2", "2.0", "2.1", "2.000000"])  # the last one is Netgen's
def test_earlier_versions_of_format_2(tmp_path: Path, version: str) -> None:
    (tmp_path / "m.msh").write_text(HEADER.replace("2.2", version) + TRIANGLE.format(z=0))
    assert read_mesh(tmp_path / "m.msh").n_cells == 1


def test_comments_before_the_header(tmp_path: Path) -> None:
    comments = "$Comments\nby $MeshFormat's program\n$EndComments\n"
    (tmp_path / "m.msh").write_text(comments + HEADER + TRIANGLE.format(z=0))
    mesh = read_mesh(tmp_path / "m.msh")
    assert mesh.points.tolist() == [[0, 0], [1, 0], [0, 1]]
    write_mesh(tmp_path / "moved.msh", replace(mesh, points=mesh.points + 0.25))
    assert (tmp_path / "moved.msh").read_text().startswith(comments + HEADER)
    assert read_mesh(tmp_path / "moved.msh").points.tolist() == [[0.25, 0.25], [1.25, 0.25], [0.25, 1.25]]


def test_text_between_sections_is_left_out_as_in_gmsh(tmp_path: Path) -> None:
    between = HEADER + "\n// $Nodes follow\n" + TRIANGLE.format(z=0).replace("$Elements", "a word\n\n $Elements")
    (tmp_path / "m.msh").write_text("# by hand\n" + between)
    mesh = read_mesh(tmp_path / "m.msh")
    assert (mesh.points.tolist(), mesh.n_cells) == ([[0, 0], [1, 0], [0, 1]], 1)
    write_mesh(tmp_path / "moved.msh", mesh)
    assert read_mesh(tmp_path / "moved.msh").points.tolist() == mesh.points.tolist()


def test_a_plane_mesh_may_have_rounding_in_its_third_coordinate(tmp_path: Path) -> None:
    (tmp_path / "m.msh").write_text(HEADER + TRIANGLE.format(z="-4e-8"))
    assert read_mesh(tmp_path / "m.msh").points.tolist() == [[0, 0], [1, 0], [0, 1]]
    (tmp_path / "m.msh").write_text(HEADER + TRIANGLE.format(z="4e-6"))
    with pytest.raises(InvalidInput, match="the coordinate z varies between 0 and 4e-06"):
        read_mesh(tmp_path / "m.msh")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "an empty file, which is not read"),
        ("hello", "neither a Gmsh mesh nor"),
        ("$MeshFormat\n4.0 0 8\n$EndMeshFormat\n", "version 4.0"),
        (HEADER, "no cells"),
        (HEADER + "$Nodes\n2\n1 0 0 0\n2 1 0 0\n", "section \\$Nodes does not end"),
        (HEADER + "$Nodes\n3\n1 0 0 0\n2 1 0 0\n$EndNodes\n", "ends before"),
        (HEADER + "$Nodes\n1\n1 0 zero 0\n$EndNodes\n", "malformed"),
        (HEADER + "$Nodes\n2\n1 0 0 0\n1 1 0 0\n$EndNodes\n", "node 1 appears twice"),
        (HEADER + "$Nodes\n1\n1 0 0 0\n$EndNodes\n$Elements\n1\n1 2 0 1 5 6\n$EndElements\n", "names node 5"),
        (HEADER + "$Nodes\n1\n1 0 0 0\n$EndNodes\n$Elements\n1\n1 2 0 1 1\n$EndElements\n", "ends before"),
        (HEADER + "$Nodes\n1\n1 nan 0 0\n$EndNodes\n$Elements\n1\n1 2 0 1 1 1\n$EndElements\n", "node 0 has x = nan"),
        ("$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$PartitionedEntities\n$EndPartitionedEntities\n", "partitioned"),
    ],
)
def test_damaged_files_give_one_clear_line(tmp_path: Path, content: str, message: str) -> None:
    (tmp_path / "damaged.msh").write_text(content)
    one_line(tmp_path / "damaged.msh", message)


def test_a_long_ascii_file_of_changing_types_is_read_in_runs(tmp_path: Path) -> None:
    """Version 2.2 has no blocks: 700 triangles in runs of all lengths, between lines of another type."""
    rows, triangles = [], 0
    for run in range(37):
        for _ in range(run):
            triangles += 1
            rows.append(f"{len(rows) + 1} 2 2 5 1 1 2 3")
        rows.append(f"{len(rows) + 1} 1 2 6 1 1 2")
    text = (
        HEADER + '$PhysicalNames\n1\n1 6 "edge"\n$EndPhysicalNames\n$Nodes\n3\n1 0 0 0\n2 1 0 0\n3 0 1 0\n$EndNodes\n'
    )
    path = tmp_path / "runs.msh"
    path.write_text(text + f"$Elements\n{len(rows)}\n" + "\n".join(rows) + "\n$EndElements\n")
    mesh = read_mesh(path)
    assert len(mesh.cells["triangle"]) == triangles == 666
    np.testing.assert_array_equal(mesh.patches["edge"], [0, 1])


def box_with_one_number_twice(model: Any) -> None:
    """A box: the surface x = 0 and a curve at x = 1 are both group 1 of their dimension, a corner is point 1."""
    model.occ.addBox(0, 0, 0, 1, 1, 1)
    model.occ.synchronize()
    places = {tuple(np.round(model.occ.getCenterOfMass(d, t), 6)): t for d in (1, 2) for _, t in model.getEntities(d)}
    model.addPhysicalGroup(2, [places[0.0, 0.5, 0.5]], tag=1)
    model.addPhysicalGroup(1, [places[1.0, 0.5, 0.0]], tag=1)
    model.addPhysicalGroup(0, [model.getEntities(0)[0][1]], tag=1)
    model.addPhysicalGroup(3, [1], tag=1)
    model.mesh.setSize(model.getEntities(0), 0.5)
    model.mesh.generate(3)


@pytest.mark.parametrize(("version", "binary"), FORMS)
def test_groups_of_two_dimensions_with_one_number_are_two_patches(
    model: Any, tmp_path: Path, version: float, binary: int
) -> None:
    box_with_one_number_twice(model)
    mesh = read_mesh(save(tmp_path / "box.msh", version, binary))
    assert set(mesh.patches) == {"1", "curve_1", "point_1"}
    np.testing.assert_array_equal(mesh.patches["1"], np.flatnonzero(mesh.points[:, 0] == 0.0))
    x, _, z = mesh.points.T
    np.testing.assert_array_equal(mesh.patches["curve_1"], np.flatnonzero((x == 1.0) & (z == 0.0)))
    assert len(mesh.patches["point_1"]) == 1


@pytest.mark.parametrize(("version", "binary"), FORMS)
def test_nodes_with_parameters_are_the_same_nodes(model: Any, tmp_path: Path, version: float, binary: int) -> None:
    box_with_one_number_twice(model)
    plain = read_mesh(save(tmp_path / "plain.msh", version, binary))
    gmsh.option.setNumber("Mesh.SaveParametric", 1)
    mesh = read_mesh(save(tmp_path / "parametric.msh", version, binary))
    gmsh.option.setNumber("Mesh.SaveParametric", 0)
    np.testing.assert_array_equal(mesh.points, plain.points)
    assert {name: len(rows) for name, rows in mesh.cells.items()} == {k: len(v) for k, v in plain.cells.items()}
    assert (tmp_path / "parametric.msh").stat().st_size > (tmp_path / "plain.msh").stat().st_size


def test_more_nodes_or_cells_than_announced_are_refused_and_unknown_sections_named(tmp_path: Path) -> None:
    head, path = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n", tmp_path / "m.msh"
    nodes = "$Nodes\n{}\n1 0 0 0\n2 1 0 0\n3 1 1 0\n4 0 1 0\n$EndNodes\n"
    cells = "$Elements\n{}\n1 2 2 1 1 1 2 3\n2 2 2 1 1 1 3 4\n$EndElements\n"
    path.write_text(head + nodes.format(4) + cells.format(2) + "$Strange\n1\n$EndStrange\n")
    assert read_mesh(path).notes == ("its section $Strange is not read",)
    path.write_text(head + nodes.format(4) + cells.format(1))
    with pytest.raises(InvalidInput, match="it announces 1 elements, but has 2"):
        read_mesh(path)
    path.write_text(head + nodes.format(3) + cells.format(2))
    with pytest.raises(InvalidInput, match=r"section \$Nodes has 4 more values than it announces"):
        read_mesh(path)


@pytest.mark.parametrize(("version", "binary"), FORMS)
@pytest.mark.parametrize("on_it", [False, True])
def test_one_name_of_a_surface_and_a_curve_is_said_where_they_are_apart(
    model: Any, tmp_path: Path, version: float, binary: int, on_it: bool
) -> None:
    model.occ.addBox(0, 0, 0, 1, 1, 1)
    model.occ.synchronize()
    places = {tuple(np.round(model.occ.getCenterOfMass(d, t), 6)): t for d in (1, 2) for _, t in model.getEntities(d)}
    model.addPhysicalGroup(2, [places[0.0, 0.5, 0.5]], name="wall")
    model.addPhysicalGroup(1, [places[0.0 if on_it else 1.0, 0.5, 0.0]], name="wall")
    model.addPhysicalGroup(3, [1], name="fluid")
    model.mesh.setSize(model.getEntities(0), 0.5)
    model.mesh.generate(3)
    mesh = read_mesh(save(tmp_path / "box.msh", version, binary))
    x, _, z = mesh.points.T
    curve = (x == 1.0) & (z == 0.0) & (not on_it)
    np.testing.assert_array_equal(mesh.patches["wall"], np.flatnonzero((x == 0.0) | curve))
    said = [note for note in mesh.notes if note.startswith("'wall' is the name of a surface and of a curve with ")]
    assert len(said) == (not on_it)
    assert on_it or f"with {np.count_nonzero(curve)} other nodes" in said[0]
