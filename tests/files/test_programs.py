"""UGRID, Nastran, Netgen, Plot3D and AVS UCD: their variants, read by their programs again, refused in one line."""

import re
from collections.abc import Callable
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from format_files import CELLS, FACES, PATCHES, POINTS, netgen, rows, ugrid_binary, ugrid_text
from mesh_files import lists, one_line, quiet_gmsh, refused_when_damaged, replaced
from mesh_motion_numerics.quality.metrics import cell_quality, reference_sizes
from mesh_motion_numerics.quality.orientation import oriented
from numpy.typing import NDArray

from mesh_motion_server.files import MeshFile, read_mesh, write_mesh

_OUTER = [face for face in FACES if face.patch]
_NUMBERS = {name: number for number, name in enumerate(PATCHES, start=1)}


def moved_and_read(path: Path, mesh: MeshFile) -> MeshFile:
    """The mesh of the file that is written with moved nodes."""
    target = path.with_name(f"moved_{path.name}")
    write_mesh(target, replace(mesh, points=mesh.points * 1.25 + np.pi))
    after = read_mesh(target)
    assert lists(after.patches) == lists(mesh.patches)
    assert lists(after.cells) == lists(mesh.cells)
    return after


def lowest_skew(mesh: MeshFile) -> float:
    """Relative to no other mesh; a cell with nodes out of order has a negative one."""
    cells = oriented(mesh.points, mesh.cell_table).cells
    return float(cell_quality(mesh.points, cells, reference_sizes(mesh.points, cells)).skew.min())


# UGRID


@pytest.mark.parametrize(("order", "width", "records"), list(product("<>", (8, 4), (False, True))))
def test_ugrid_in_every_binary_layout(tmp_path: Path, order: str, width: int, records: bool) -> None:
    """The layout is found by the size, whatever the name; records behind the cells are kept."""
    ugrid_binary(tmp_path / "box.lb8.ugrid")
    data = (tmp_path / "box.lb8.ugrid").read_bytes()
    counts, points = np.frombuffer(data, "<i4", 7), np.frombuffer(data, "<f8", 3 * len(POINTS), 28)
    rest = np.frombuffer(data, "<i4", offset=28 + points.nbytes)
    parts = [counts.astype(f"{order}i4").tobytes(), points.astype(f"{order}f{width}").tobytes()]
    parts = [parts[0], parts[1] + rest.astype(f"{order}i4").tobytes() + np.array([3], f"{order}i4").tobytes()]
    marks = [np.array(len(part), f"{order}i4").tobytes() * records for part in parts]
    path = tmp_path / "any.ugrid"
    path.write_bytes(b"".join(mark + part + mark for mark, part in zip(marks, parts, strict=True)))
    mesh = read_mesh(path)
    np.testing.assert_array_equal(mesh.points, POINTS.astype(f"f{width}"))
    assert sorted(mesh.patches) == ["10", "20", "30"]  # no .mapbc of its name
    after = moved_and_read(path, mesh)
    np.testing.assert_allclose(after.points, mesh.points * 1.25 + np.pi, rtol=0.0 if width == 8 else 1e-6)
    assert (tmp_path / "moved_any.ugrid").read_bytes()[-8:] == path.read_bytes()[-8:]


def test_ugrid_pyramids_and_wedges_are_in_its_order(tmp_path: Path) -> None:
    """A cube of a pyramid and two wedges on its base; AFLR3 begins and ends a pyramid's base around its tip."""
    points = "-0 0 0  1 0 0  1 1 0  0 1 0  .5 .5 1  0 0 -1  1 0 -1  1 1 -1  0 1 -1"
    pyramid, wedges = "2 1 5 3 4", "1 2 3 6 7 8\n1 3 4 6 8 9"
    (tmp_path / "m.ugrid").write_text(f"9 2 0 0 1 2 0\n{points}\n1 2 5\n2 3 5\n7\n7\n{pyramid}\n{wedges}\n")
    mesh = read_mesh(tmp_path / "m.ugrid")
    assert lists(mesh.patches) == {"7": [0, 1, 2, 4]}
    assert lowest_skew(mesh) > 0.3


def test_ugrid_names_and_symmetry_planes_of_fun3d(tmp_path: Path) -> None:
    ugrid_text(tmp_path / "box.ugrid")
    assert read_mesh(tmp_path / "box.ugrid").marked == {"sides": "symmetry"}
    (tmp_path / "box.mapbc").write_text("2\n10 5000\n20 4000 a wall\n")
    assert sorted(read_mesh(tmp_path / "box.ugrid").patches) == ["10", "30", "a wall"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("27 0 24", "28 0 24", "275 numbers by its first line, but 272"),
        ("27 0 24 0 0 0 8", "27 0 24 0 0 0 0", r"it is a surface: mesh the space around it"),
        ("1 4 13 10", "1 4 13 100", r"node 100 is named, but there are 1 to 27"),
    ],
)
def test_ugrid_files_that_do_not_fit(tmp_path: Path, old: str, new: str, message: str) -> None:
    ugrid_text(tmp_path / "m.ugrid")
    one_line(replaced(tmp_path / "m.ugrid", old, new, 1), message)


def test_ugrid_that_is_cut_off(tmp_path: Path) -> None:
    ugrid_binary(tmp_path / "m.lb8.ugrid")
    (tmp_path / "m.lb8.ugrid").write_bytes((tmp_path / "m.lb8.ugrid").read_bytes()[:-4])
    one_line(tmp_path / "m.lb8.ugrid", "no byte order and precision fits its size: it is not such a file, or cut off")


# Nastran


def nastran(path: Path, form: str) -> None:
    """A deck in one form of fields, with names of HyperMesh, an executive section and cards of an analysis."""
    forms: dict[str, Callable[..., str]] = {"small": _small, "large": _large, "free": _free}
    card = forms[form]
    lines = [card("GRID", 100 + k, "", *xyz) for k, xyz in enumerate(POINTS.round(4).tolist())]
    lines += [card("CHEXA", k, 7, *cell) for k, cell in enumerate((CELLS + 100).tolist(), start=1)]
    lines += [
        card("CQUAD4", 50 + k, _NUMBERS[face.patch], *(node + 100 for node in face.nodes))
        for k, face in enumerate(_OUTER)
    ]
    names = "".join(f'$HMNAME PROP {number:>19}"{name}" 4\n' for name, number in _NUMBERS.items())
    path.write_text(
        f"SOL 101\nCEND\nGRID = ALL\nBEGIN BULK\n$ by hand\n{names}MAT1    1       2.1+5           0.3\n"
        f"{''.join(lines)}ENDDATA\nCHEXA, 9\n"
    )


def _small(name: str, *fields: object, width: int = 8, mark: str = "+") -> str:
    words, many = [f"{_short(field):<{width}}" for field in fields], 64 // width
    lines = ["".join(words[k : k + many]) for k in range(0, len(words), many)]
    return f"{name:<8}" + f"\n{mark:<8}".join(lines) + "\n"


def _large(name: str, *fields: object) -> str:
    return _small(f"{name}*", *fields, width=16, mark="*")


def _free(name: str, *fields: object) -> str:
    words = [_short(field) for field in fields]
    lines = [",".join(words[k : k + 8]) for k in range(0, len(words), 8)]
    return f"{name}," + ",\n,".join(lines) + " $ a comment\n"


def _short(field: object) -> str:
    """A number as Nastran may have it: .35 and 1.23-2 for 0.35 and 0.0123."""
    if not isinstance(field, float):
        return str(field)
    return f"{field * 100:.2f}-2" if 0 < field < 0.05 else f"{field:.4f}".removeprefix("0")


@pytest.mark.parametrize("form", ["small", "large", "free"])
def test_nastran_in_every_form_of_fields(tmp_path: Path, form: str) -> None:
    path = tmp_path / "box.bdf"
    nastran(path, form)
    mesh = read_mesh(path)
    np.testing.assert_allclose(mesh.points, POINTS.round(4), rtol=1e-14)
    assert lists(mesh.patches) == {name: nodes.tolist() for name, nodes in PATCHES.items()}
    assert lists(mesh.cells) == {"hexahedron": CELLS.tolist()}
    after = moved_and_read(path, mesh)
    np.testing.assert_allclose(after.points, mesh.points * 1.25 + np.pi, rtol=1e-13)  # 16 characters
    written = (tmp_path / "moved_box.bdf").read_text().splitlines()
    kept = [line for line in path.read_text().splitlines() if not re.match(r"GRID\*? *,?1|\*  ", line)]
    assert [line for line in written if line in kept] == kept
    assert max(map(len, written)) <= 80


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("GRID,101,,", "GRID,101,3,", r"nodes in the coordinate system 3, which no CORD1 or CORD2 \(R, C, S\) defines"),
        ("GRID,101,,", "GRDSET,,3\nGRID,101,,", r"nodes in the coordinate system 3, which no CORD1 or CORD2"),
        ("GRID,101,,", "CORD1R,3,8,102,900\nGRID,101,3,", "coordinate system 3: node 8 is named, but does not exist"),
        ("GRID,101,,", "CORD1R,3,101,102,103\nGRID,101,3,", "the coordinate system 3, which no"),
        ("GRID,101,,", "=,*1\nGRID,101,,", "line 11: '=,[*]1' repeats a card; write each card in full"),
        ("GRID,101,,", "CORD2R,3,3,0.,0.,0.,0.,0.,1.,\n,1.\nGRID,101,3,", "the coordinate system 3, which no"),
        ("GRID,101,,", "CORD2R,3,,0.,0.,0.,0.,0.,1.,\n,\nGRID,101,3,", "the coordinate system 3 are on a line"),
        ("CHEXA,1,7,100,", "CHEXA,1,7,,", r"CHEXA in line \d+: nodes \[0, .*\], expected 8 numbers from 1"),
        ("CHEXA,1,7,100,", "CHEXA,1,7,1,", "hexahedron: node 1 is named, but does not exist"),
        ("GRID,101,,", "INCLUDE 'a.bdf'\nGRID,101,,", "INCLUDE of 'a.bdf', which is not a file in the deck's folder"),
        ("GRID,101,,", "INCLUDE '../m.\nnas'\nGRID,101,,", "INCLUDE of '../m.nas', which is not a file in the deck's"),
        ("GRID,101,,", "INCLUDE 'm.nas'\nGRID,101,,", "INCLUDE of 'm.nas', which includes itself"),
        ("GRID,101,,", "GRID,100,,", "node 100 appears twice"),
        ("GRID,101,,.0000", "GRID,101,,.0000x", r"GRID in line \d+: could not convert string to float"),
    ],
)
def test_nastran_decks_that_do_not_fit(tmp_path: Path, old: str, new: str, message: str) -> None:
    nastran(tmp_path / "m.nas", "free")
    one_line(replaced(tmp_path / "m.nas", old, new, 1), message)


@pytest.mark.parametrize(
    ("comment", "name"),
    [
        ("$ANSA_NAME_COMMENT;1;PSHELL;wet wall;;NO;NO;", "wet wall"),
        ("$ Femap Property 1 : wet wall", "wet wall"),
        ("$ nothing", "1"),
    ],
)
def test_nastran_in_the_plane_with_names_of_properties(tmp_path: Path, comment: str, name: str) -> None:
    """A quadrilateral of second order without one of its middles, and a bar; no executive section."""
    grid = "".join(
        f"GRID,{k},,{x},{y}\n" for k, (x, y) in enumerate([(0, 0), (1, 0), (1, 1), (0, 1), (0.5, 0), (1, 0.5)], 1)
    )
    (tmp_path / "m.bdf").write_text(f"{comment}\n{grid}CQUAD8,1,9,1,2,3,4,5,6\nCBAR,2,1,1,2,0.,0.,1.\n")
    mesh = read_mesh(tmp_path / "m.bdf")
    assert lists(mesh.patches) == {name: [0, 1]}
    assert lists(mesh.cells) == {"quad": [[0, 1, 2, 3]]}
    assert "by their corners" in mesh.notes[0]
    np.testing.assert_allclose(moved_and_read(tmp_path / "m.bdf", mesh).points, mesh.points * 1.25 + np.pi, rtol=1e-14)


def test_nastran_in_several_files(tmp_path: Path) -> None:
    """The nodes in another file come back in one file with the deck."""
    nastran(tmp_path / "whole.bdf", "large")
    head, body = (tmp_path / "whole.bdf").read_text().split("BEGIN BULK\n")
    first = body.index("CHEXA*")
    (tmp_path / "nodes.bdf").write_text(body[:first])
    (tmp_path / "m.bdf").write_text(f"{head}BEGIN BULK\ninclude 'nodes\n.bdf' $ the nodes\n{body[first:]}")
    mesh = read_mesh(tmp_path / "m.bdf")
    assert lists(mesh.patches) == lists(read_mesh(tmp_path / "whole.bdf").patches)
    (tmp_path / "other").mkdir()
    write_mesh(tmp_path / "other" / "moved.bdf", replace(mesh, points=POINTS + 1))
    after = read_mesh(tmp_path / "other" / "moved.bdf")
    np.testing.assert_allclose(after.points, POINTS + 1, rtol=1e-14)
    assert lists(after.patches) == lists(mesh.patches)


@pytest.mark.parametrize(("usual", "first"), [("", "1"), ("GRDSET,,1\n", ""), ("GRDSET,,2\n", "1")])
def test_nastran_coordinate_systems(tmp_path: Path, usual: str, first: str) -> None:
    """Four nodes of a tetrahedron in a turned system, and in a cylinder and a sphere within it."""
    (tmp_path / "m.bdf").write_text(
        "CORD2R,1,,1.,2.,3.,1.,3.,3.,\n,1.,2.,4.\n"  # z along y, x along z, so y along x
        "CORD2C,2,1,0.,0.,0.,0.,0.,1.,\n,1.,0.,0.\nCORD2S,3,1,0.,0.,0.,0.,0.,1.,\n,1.,0.,0.\n"
        f"{usual}GRID,1,{first},0.,0.,0.\nGRID,2,{first},2.,0.,0.\nGRID,3,2,2.,90.,0.,7\nGRID,4,3,2.,0.,0.\nCTETRA,1,1,1,2,3,4\n"
    )
    mesh = read_mesh(tmp_path / "m.bdf")
    np.testing.assert_allclose(mesh.points, [[1, 2, 3], [1, 2, 5], [3, 2, 3], [1, 4, 3]], rtol=1e-15)
    after = moved_and_read(tmp_path / "m.bdf", mesh)
    np.testing.assert_allclose(after.points, mesh.points * 1.25 + np.pi, rtol=1e-14)
    assert re.search(r"GRID\*   3 +0 .*\n\* {7}.{16}7\n", (tmp_path / "moved_m.bdf").read_text())  # its own directions


def test_nastran_coordinate_systems_of_nodes(tmp_path: Path) -> None:
    """Three nodes make the system: z along y, x along z; the second one is a cylinder."""
    (tmp_path / "m.bdf").write_text(
        "GRID,1,,1.,2.,3.\nGRID,2,,1.,3.,3.\nGRID,3,,1.,2.,4.\nGRID,4,5,0.,2.,0.\nGRID,5,6,2.,90.,0.\n"
        "CORD1R,5,1,2,3\nCORD1C,6,1,2,3\nCTETRA,1,1,1,3,4,2\n"
    )
    mesh = read_mesh(tmp_path / "m.bdf")
    np.testing.assert_allclose(mesh.points[3:], [[3, 2, 3], [3, 2, 3]], rtol=1e-15)
    after = moved_and_read(tmp_path / "m.bdf", mesh)
    np.testing.assert_allclose(after.points, mesh.points * 1.25 + np.pi, rtol=1e-14)


@pytest.mark.parametrize("value", [0.0, -1.0, 1.5e-300, -1.23456789012345678e-5, 123456789.123456789, 1e16, -0.1 / 3])
def test_nastran_numbers_have_sixteen_characters(tmp_path: Path, value: float) -> None:
    (tmp_path / "m.bdf").write_text("GRID,1\nGRID,2,,1.\nGRID,3,,,1.\nCTRIA3,1,1,1,2,3\n")
    points = np.array([[value, 0.0], [value + abs(value) + 1.0, 0.0], [value, 1.0]])
    write_mesh(tmp_path / "n.bdf", replace(read_mesh(tmp_path / "m.bdf"), points=points))
    np.testing.assert_allclose(read_mesh(tmp_path / "n.bdf").points, points, rtol=1e-11)
    assert "0.0" not in (tmp_path / "n.bdf").read_text()


@pytest.mark.parametrize(("order", "quads"), [(1, 0), (2, 0), (2, 1)])
@pytest.mark.parametrize("form", [0, 1, 2])
def test_gmsh_writes_nastran(tmp_path: Path, form: int, order: int, quads: int) -> None:
    """A peer: the same cells and the same nodes on surfaces as in its own file."""
    with quiet_gmsh() as gmsh:
        if quads:
            gmsh.model.occ.addRectangle(0, 0, 0, 1, 1)
            gmsh.model.occ.extrude([(2, 1)], 0, 0, 1, numElements=[2], recombine=True)
        else:
            gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
        gmsh.model.occ.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.5)
        gmsh.option.setNumber("Mesh.RecombineAll", quads)
        gmsh.option.setNumber("Mesh.BdfFieldFormat", form)
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(order)
        for suffix in ("msh", "bdf"):
            gmsh.write(str(tmp_path / f"m.{suffix}"))
    ours, other = read_mesh(tmp_path / "m.bdf"), read_mesh(tmp_path / "m.msh")
    np.testing.assert_allclose(ours.points, other.points, atol=1e-6)
    assert lists(ours.cells) == lists(other.cells)
    assert lists(ours.patches) == lists(other.patches)


# Netgen


def test_netgen_writes_the_names_of_its_surfaces(tmp_path: Path) -> None:
    """A peer, in first and second order, and in the plane, where the middles of edges are only in the cells."""
    csg, geom2d = pytest.importorskip("netgen.csg"), pytest.importorskip("netgen.geom2d")
    box = csg.OrthoBrick(csg.Pnt(0, 0, 0), csg.Pnt(1, 1, 1)).bc("far")
    space = csg.CSGeometry()
    space.Add(box - csg.Sphere(csg.Pnt(0.5, 0.5, 0.5), 0.2).bc("ball"))
    plane = geom2d.SplineGeometry()
    plane.AddRectangle((0, 0), (2, 1), bcs=["bottom", "right", "top", "left"])
    plane.AddCircle((0.7, 0.5), 0.1, leftdomain=0, rightdomain=1, bc="ring")
    for geometry, names in ((space, {"far", "ball"}), (plane, {"bottom", "right", "top", "left", "ring"})):
        mesh = geometry.GenerateMesh(maxh=0.5)
        for order in (1, 2):
            mesh.Save(str(tmp_path / "m.vol"))
            ours = read_mesh(tmp_path / "m.vol")
            assert set(ours.patches) == names
            assert ours.n_cells == len(mesh.Elements3D() if geometry is space else mesh.Elements2D())
            hole = ours.points[ours.patches["ball" if geometry is space else "ring"]]
            centre, radius = ((0.5, 0.5, 0.5), 0.2) if geometry is space else ((0.7, 0.5), 0.1)
            np.testing.assert_allclose(np.linalg.norm(hole - centre, axis=1), radius, rtol=1e-6)
            if geometry is plane:
                count = int((np.abs(ours.points[:, 1]) < 1e-12).sum())
                assert len(ours.patches["bottom"]) == count  # also between the corners
            assert oriented(ours.points, ours.cell_table).mirrored.size == 0
            moved = moved_and_read(tmp_path / "m.vol", ours)
            np.testing.assert_array_equal(moved.points, ours.points * 1.25 + np.pi)
            if order == 1:
                mesh.SecondOrder()


def test_netgen_edges_of_older_files(tmp_path: Path) -> None:
    (tmp_path / "m.vol").write_text(
        "mesh3d\ndimension\n2\nsurfaceelementsgi\n1\n 1 1 0 0 3 1 2 3 0 0 0\nvolumeelements\n0\n"
        "edgesegmentsgi2\n2\n 4 0 1 2 -1 -1 1 0 1 0 1 1\n 7 0 2 3 -1 -1 1 0 2 0 2 1\n"
        "points\n3\n 0 0 0\n 1 0 0\n 0 1 0\nbcnames\n1\n4 the floor\nendmesh\n"
    )
    assert lists(read_mesh(tmp_path / "m.vol").patches) == {"the floor": [0, 1], "7": [1, 2]}


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("volumeelements\n8\n1 8 ", "volumeelements\n8\n1 7 ", "row 1 of volumeelements has 7 nodes"),
        ("points\n27", "points\n99", "99 points, but 33 rows follow"),
        ("1 8 1 10", "1 8 1 28", "node 28 is named, but there are 1 to 27"),
        ("points\n27", "points\nmany", "invalid literal for int"),
    ],
)
def test_netgen_files_that_do_not_fit(tmp_path: Path, old: str, new: str, message: str) -> None:
    netgen(tmp_path / "m.vol")
    one_line(replaced(tmp_path / "m.vol", old, new, 1), message)


# Plot3D


def block(*counts: int) -> NDArray[np.float64]:
    """(axes, n) coordinates of a block of unit size, the first direction fastest."""
    axes = [np.linspace(0.0, 1.0, count) for count in counts]
    return np.stack([of.T.ravel() for of in np.meshgrid(*axes, indexing="ij")])


def plot3d(
    path: Path, blocks: list[NDArray[np.float64]], counts: list[tuple[int, ...]], kind: str = "", **more: bool
) -> None:
    """A grid as text, or in binary: ``<f4``, ``>f8``, …; ``records``, ``single``, ``blanks``."""
    blanks = [np.ones((1, of.shape[1]), int) for of in blocks] if more.get("blanks") else [np.zeros((0, 0), int)] * 2
    head = ([] if more.get("single") else [np.array([len(blocks)])]) + [np.array(counts).ravel()]
    if not kind:
        parts = [" ".join(map(str, of.tolist())) for of in head]
        parts += [rows(of) + rows(blank) for of, blank in zip(blocks, blanks, strict=False)]
        path.write_text("\n".join(parts))
        return
    whole = f"{kind[0]}i4"
    records = [of.astype(whole).tobytes() for of in head]
    records += [of.astype(kind).tobytes() + b.astype(whole).tobytes() for of, b in zip(blocks, blanks, strict=False)]
    marks = [np.array(len(record), whole).tobytes() * bool(more.get("records")) for record in records]
    path.write_bytes(b"".join(mark + record + mark for mark, record in zip(marks, records, strict=True)))


@pytest.mark.parametrize("kind", ["", "<f4", "<f8", ">f4", ">f8"])
@pytest.mark.parametrize("blanks", [False, True])
@pytest.mark.parametrize("records", [False, True])
def test_plot3d_in_every_layout(tmp_path: Path, kind: str, blanks: bool, records: bool) -> None:
    """Two blocks that touch, and one alone, in space and in the plane."""
    path = tmp_path / "m.xyz"
    for counts in ((3, 4, 2), (3, 4)):
        first = block(*counts)
        second = first + np.eye(len(counts))[:, :1]
        plot3d(path, [first, second], [counts, counts], kind, blanks=blanks, records=records)
        mesh = read_mesh(path)
        n = int(np.prod(counts))
        assert (mesh.n_cells, len(mesh.points)) == (2 * 6, 2 * n - n // 3)
        assert "block1_imax" not in mesh.patches
        assert lists(mesh.patches)["block1_imin"] == list(range(0, n, 3))
        assert mesh.points[mesh.patches["block2_imax"], 0].tolist() == [2.0] * (n // 3)
        after = moved_and_read(path, mesh)
        np.testing.assert_allclose(after.points, mesh.points * 1.25 + np.pi, rtol=1e-6 if "4" in kind else 0.0)
        plot3d(path, [first], [counts], kind, single=True, blanks=blanks, records=records)
        assert sorted(read_mesh(path).patches)[:2] == ["imax", "imin"]


def test_plot3d_cuts_and_wakes_are_no_patches(tmp_path: Path) -> None:
    """An O-grid and a C-grid in one block, in a text with Fortran's repeats."""
    angle, radius = np.linspace(0, 2 * np.pi, 13), np.linspace(1, 2, 4)
    ring = np.stack([np.outer(radius, np.cos(angle)), np.outer(radius, np.sin(angle))])
    ring[:, :, -1] = ring[:, :, 0]
    flat = " ".join(map(repr, ring.reshape(2, -1).ravel().tolist()))
    (tmp_path / "o.x").write_text(f"1,\n13, 4, 1\n{flat.replace('e', 'D')} 52*0.0\n")
    mesh = read_mesh(tmp_path / "o.x")
    assert {name: len(nodes) for name, nodes in mesh.patches.items()} == {"jmin": 12, "jmax": 12}
    assert (mesh.dimension, mesh.n_cells, len(mesh.points)) == (2, 36, 48)
    moved_and_read(tmp_path / "o.x", mesh)
    wake = np.array([[3.0, 2, 1, 0, 1, 2, 3], [0.0, 0, 0.3, 0, -0.3, 0, 0]])
    far = np.array([[3.0, 2, 1, -2, 1, 2, 3], [2.0, 2, 2, 0, -2, -2, -2]])
    plot3d(tmp_path / "c.p3d", [np.hstack([wake, far])], [(7, 2)], single=True)
    patches = lists(read_mesh(tmp_path / "c.p3d").patches)
    assert patches["jmin"] == [1, 2, 3, 4]  # the body, without its wake
    assert sorted(patches) == ["imax", "imin", "jmax", "jmin"]


def test_plot3d_files_that_do_not_fit(tmp_path: Path) -> None:
    (tmp_path / "m.xyz").write_text("3\nwater\nO 0 0 0\nH 0 0 1\nH 0 1 0\n")
    one_line(tmp_path / "m.xyz", "not readable as a Plot3D grid: no numbers of blocks and nodes fit its size")
    (tmp_path / "m.xyz").write_text("1\n2 2 2\n999999999999*0.0\n")
    one_line(tmp_path / "m.xyz", r"bytes that hold \d+ or more")
    holes = block(3, 3)
    plot3d(tmp_path / "m.xyz", [holes], [(3, 3)], blanks=True)
    text = (tmp_path / "m.xyz").read_text()
    (tmp_path / "m.xyz").write_text(text[: text.rindex("1")] + "0\n")
    assert read_mesh(tmp_path / "m.xyz").notes == ("1 nodes are marked as holes; they are moved with the others",)


@pytest.mark.parametrize(
    ("turns", "axes", "cells", "patches"),
    [
        (0.5, 3, {"hexahedron": 8, "wedge": 8}, {"imax": 15, "jmin": 9, "jmax": 9, "kmin": 11, "kmax": 11}),
        (1.0, 3, {"hexahedron": 8, "wedge": 8}, {"imax": 12, "kmin": 9, "kmax": 9}),
        (0.5, 2, {"quad": 4, "triangle": 4}, {"imax": 5, "jmin": 3, "jmax": 3}),
    ],
)
def test_plot3d_around_an_axis(
    tmp_path: Path, turns: float, axes: int, cells: dict[str, int], patches: dict[str, int]
) -> None:
    """The side imin of half a cylinder, a whole one or half a disc has no area: it is not a patch."""
    angle = np.linspace(0.0, 2.0 * np.pi * turns, 5)[: 4 if turns == 1.0 else 5]
    angle = np.append(angle, angle[:1])[:5]
    radius, height = np.arange(3.0), np.arange(3.0) if axes == 3 else np.zeros(1)
    z, a, r = (of.ravel() for of in np.meshgrid(height, angle, radius, indexing="ij"))
    counts = (3, 5, 3)[:axes]
    plot3d(tmp_path / "m.xyz", [np.stack([r * np.cos(a), r * np.sin(a), z])[:axes]], [counts], single=True)
    mesh = read_mesh(tmp_path / "m.xyz")
    assert {name: len(nodes) for name, nodes in mesh.cells.items()} == cells
    assert {name: len(nodes) for name, nodes in mesh.patches.items()} == patches
    assert lowest_skew(mesh) > 0.3
    assert f"{sum(cells.values()) // 2} cells name a node twice: they are read as cells of simpler types" in mesh.notes
    after = moved_and_read(tmp_path / "m.xyz", mesh)
    np.testing.assert_array_equal(after.points, mesh.points * 1.25 + np.pi)


@pytest.mark.parametrize("kind", ["", "<f4", ">f8"])
def test_vtk_reads_plot3d_that_is_written_back(tmp_path: Path, kind: str) -> None:
    parallel = pytest.importorskip("vtkmodules.vtkIOParallel")
    numpy_support = pytest.importorskip("vtkmodules.util.numpy_support")
    first = block(3, 4, 3)
    plot3d(tmp_path / "m.xyz", [first, first + np.eye(3)[:, :1]], [(3, 4, 3)] * 2, kind)
    mesh = read_mesh(tmp_path / "m.xyz")
    moved = moved_and_read(tmp_path / "m.xyz", mesh).points
    reader = parallel.vtkMultiBlockPLOT3DReader()
    reader.SetFileName(str(tmp_path / "moved_m.xyz"))
    reader.SetMultiGrid(True)
    reader.SetBinaryFile(bool(kind))
    reader.SetDoublePrecision("8" in kind)
    reader.SetByteOrder(">" not in kind)
    reader.Update()
    found = [
        numpy_support.vtk_to_numpy(reader.GetOutput().GetBlock(k).GetPoints().GetData()).astype(np.float32)
        for k in range(2)
    ]
    np.testing.assert_allclose(found[0], moved[:36], rtol=1e-6)
    np.testing.assert_allclose(np.unique(np.concatenate(found), axis=0), np.unique(moved.astype("f4"), axis=0))


# AVS UCD


def ucd(path: Path) -> None:
    """The numbers of the patches as materials of the faces, and data on the nodes."""
    cells = [f"0 hex {' '.join(map(str, cell))}" for cell in (CELLS + 1).tolist()]
    cells += [f"{_NUMBERS[face.patch]} quad {' '.join(str(node + 1) for node in face.nodes)}" for face in _OUTER]
    lines = "".join(f"{number} {cell}\n" for number, cell in enumerate(cells, start=1))
    path.write_text(f"# by hand\n{len(POINTS)} {len(cells)} 1 0 0\n{rows(POINTS, first=1)}{lines}1 1\np, Pa\n1 0.5\n")


def test_ucd_has_the_materials_of_faces_as_patches(tmp_path: Path) -> None:
    path = tmp_path / "box.inp"
    ucd(path)
    mesh = read_mesh(path)
    np.testing.assert_array_equal(mesh.points, POINTS)
    assert lists(mesh.cells) == {"hexahedron": CELLS.tolist()}
    assert lists(mesh.patches) == {str(_NUMBERS[name]): nodes.tolist() for name, nodes in PATCHES.items()}
    after = moved_and_read(path, mesh)
    np.testing.assert_array_equal(after.points, POINTS * 1.25 + np.pi)
    write_mesh(tmp_path / "back.inp", replace(after, points=POINTS))
    assert (tmp_path / "back.inp").read_text() == path.read_text()


def test_ucd_pyramids_begin_with_their_tip(tmp_path: Path) -> None:
    (tmp_path / "m.ucd").write_text("5 1 0 0 0\n1 .5 .5 1\n2 0 0 0\n3 1 0 0\n4 1 1 0\n5 0 1 0\n1 0 pyr 1 2 3 4 5\n")
    assert lists(read_mesh(tmp_path / "m.ucd").cells) == {"pyramid": [[1, 2, 3, 4, 0]]}


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("27 32 1", "27 99 1", "27 nodes and 99 cells, but 62 rows follow"),
        (" hex 1 ", " hexa 1 ", "cell 1 is a 'hexa' of 8 nodes; known are line, tri"),
        (" hex 1 ", " hex ", "cell 1 is a 'hex' of 7 nodes"),
        (" hex 1 ", " hex 28 ", "hex: node 28 is named, but does not exist"),
    ],
)
def test_ucd_files_that_do_not_fit(tmp_path: Path, old: str, new: str, message: str) -> None:
    ucd(tmp_path / "m.ucd")
    one_line(replaced(tmp_path / "m.ucd", old, new, 1), message)


# all of them


def _plot3d_of_two(path: Path) -> None:
    plot3d(path, [block(3, 3, 3), block(3, 3, 3) + 1], [(3, 3, 3)] * 2, (path.suffix == ".p3d" and "<f8") or "")


@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("m.ugrid", ugrid_text),
        ("m.lb8.ugrid", ugrid_binary),
        ("m.vol", netgen),
        ("m.bdf", lambda path: nastran(path, "small")),
        ("m.xyz", _plot3d_of_two),
        ("m.p3d", _plot3d_of_two),
        ("m.ucd", ucd),
    ],
)
def test_damaged_files_are_refused_in_one_line(tmp_path: Path, name: str, write: Callable[[Path], Any]) -> None:
    write(tmp_path / name)
    assert refused_when_damaged(tmp_path / name, tmp_path / name, 150, np.random.default_rng(5)) > 15
