"""Meshes of OpenFOAM's programs: the cells that checkMesh counts, the volumes that it measures, the patches."""

import gzip
import shutil
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import foam_cases as foam
import numpy as np
import pytest
from mesh_files import one_line, quiet_gmsh, refused_when_damaged, sizes
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.cases.check import check
from mesh_motion_server.files import MeshFile, read_mesh, write_mesh
from mesh_motion_server.files.openfoam.foam_file import FoamFile, dictionaries
from mesh_motion_server.files.openfoam.polymesh import read_face_mesh
from mesh_motion_server.files.polyhedra.cells import find_cells
from mesh_motion_server.files.polyhedra.face_mesh import FaceMesh
from mesh_motion_server.files.polyhedra.pieces import divide

FILES = ("points", "faces", "owner", "neighbour", "boundary")


FINE = foam.BOX.replace("(6 4 5)", "(12 8 10)").replace("(2 1 3)", "(1 1 1)")


@pytest.fixture(scope="session")
def foam_case(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    made: dict[str, Path] = {}

    def make(name: str) -> Path:
        if name not in made:
            made[name] = MAKERS[name](tmp_path_factory.mktemp("foam") / name)
        return made[name]

    return make


def block_mesh(blocks: str, **options: str) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        foam.FoamCase.new(folder, blocks, **options).run("blockMesh")
        return folder

    return make


def castellated(folder: Path) -> Path:
    """Hexahedra refined around a ball: their neighbours are polyhedra."""
    case = foam.FoamCase.new(folder, FINE, form="binary")
    dictionary = folder / "system" / "snappyHexMeshDict"
    dictionary.write_text(dictionary.read_text().replace("snap true", "snap false"))
    case.run("blockMesh")
    case.run("snappyHexMesh", "-overwrite")
    return folder


def snapped(folder: Path) -> Path:
    case = foam.FoamCase.new(folder, FINE, form="binary")
    case.run("blockMesh")
    case.run("snappyHexMesh", "-overwrite")
    return folder


def dual(folder: Path) -> Path:
    case = foam.FoamCase.new(folder, foam.BOX)
    case.run("blockMesh")
    case.run("polyDualMesh", "75", "-overwrite")
    return folder


def mixed(folder: Path) -> Path:
    """Hexahedra, a layer of pyramids and tetrahedra, from Gmsh by gmshToFoam."""
    case = foam.FoamCase.new(folder)
    with quiet_gmsh() as gmsh:
        gmsh.model.occ.addRectangle(0, 0, 0, 1, 1)
        gmsh.model.occ.synchronize()
        gmsh.model.mesh.setTransfiniteSurface(1)
        gmsh.model.mesh.setRecombine(2, 1)
        gmsh.model.occ.extrude([(2, 1)], 0, 0, 0.5, [2], recombine=True)
        top = gmsh.model.occ.addBox(0, 0, 0.5, 1, 1, 1)
        gmsh.model.occ.fragment([(3, 1)], [(3, top)])
        gmsh.model.occ.synchronize()
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.4)
        faces = [tag for _, tag in gmsh.model.getBoundary(gmsh.model.getEntities(3), oriented=False)]
        gmsh.model.addPhysicalGroup(2, faces, name="skin")
        gmsh.model.addPhysicalGroup(3, [tag for _, tag in gmsh.model.getEntities(3)], name="fluid")
        gmsh.model.mesh.generate(3)
        gmsh.option.setNumber("Mesh.MshFileVersion", 2.2)
        gmsh.write(str(folder / "mixed.msh"))
    case.run("gmshToFoam", "mixed.msh")
    return folder


MAKERS: dict[str, Callable[[Path], Path]] = {
    "box": block_mesh(foam.BOX),
    "box-binary": block_mesh(foam.BOX, form="binary"),
    "box-gzip": block_mesh(foam.BOX, compression="on"),
    "prisms": block_mesh(foam.PRISMS, form="binary"),
    "strip": block_mesh(foam.STRIP),
    "wedge": block_mesh(foam.WEDGE),
    "castellated": castellated,
    "snapped": snapped,
    "dual": dual,
    "mixed": mixed,
}


@pytest.mark.parametrize("name", ["box", "box-binary", "box-gzip", "prisms", "castellated", "dual", "mixed", "snapped"])
def test_checkmesh_counts_and_measures_the_same(foam_case: Callable[..., Path], name: str) -> None:
    folder = foam_case(name)
    theirs = foam.FoamCase(folder).checked()
    mesh = read_face_mesh(folder / "constant" / "polyMesh")
    found = find_cells(mesh)
    counts = {kind: len(nodes) for kind, nodes in found.nodes.items()}
    assert counts.get("hexahedron", 0) == theirs["hexahedra"]
    assert counts.get("wedge", 0) == theirs["prisms"]
    assert counts.get("pyramid", 0) == theirs["pyramids"]
    assert counts.get("tetra", 0) == theirs["tetrahedra"]
    assert len(found.others) == theirs["polyhedra"] + theirs["wedges"] + theirs["tet wedges"]
    assert (mesh.n_cells, mesh.n_faces, mesh.n_inner) == (theirs["cells"], theirs["faces"], theirs["internal faces"])
    volumes = mesh.volumes_and_centres()[0]
    areas = np.linalg.norm(mesh.areas_and_centres[0], axis=1)
    assert volumes.sum() == pytest.approx(theirs["volume"], rel=1e-12)
    assert volumes.min() == pytest.approx(theirs["least volume"], rel=1e-12)
    assert areas.min() == pytest.approx(theirs["least area"], rel=1e-12)
    assert areas.max() == pytest.approx(theirs["greatest area"], rel=1e-12)


def test_all_forms_of_a_file_give_the_same_mesh(foam_case: Callable[..., Path]) -> None:
    first = read_mesh(foam_case("box"))
    assert first.points.shape == (210, 3)
    assert {name: len(nodes) for name, nodes in first.patches.items()} == {"low": 35, "high": 35, "sides": 120}
    np.testing.assert_array_equal(first.patches["low"], np.flatnonzero(first.points[:, 2] == 0))
    assert (sizes(first)["hexahedron"] > 0).all()
    assert {file.suffix for file in (foam_case("box-gzip") / "constant" / "polyMesh").iterdir()} == {"", ".gz"}
    for name in ("box-binary", "box-gzip"):
        other = read_mesh(foam_case(name))
        np.testing.assert_array_equal(other.points, first.points)
        np.testing.assert_array_equal(other.cells["hexahedron"], first.cells["hexahedron"])
        assert other.patches.keys() == first.patches.keys()


def test_a_mesh_is_named_by_its_case_its_folder_or_a_foam_file(foam_case: Callable[..., Path]) -> None:
    folder = foam_case("box")
    (folder / "box.foam").touch()
    for path in (folder, folder / "constant", folder / "constant" / "polyMesh", folder / "box.foam"):
        assert len(read_mesh(path).points) == 210
        assert check(path).mesh.n_cells == 120


@pytest.mark.parametrize("name", ["castellated", "dual", "snapped"])
def test_polyhedra_are_divided_about_their_centres(foam_case: Callable[..., Path], name: str) -> None:
    mesh, whole = read_mesh(foam_case(name)), read_face_mesh(foam_case(name) / "constant" / "polyMesh")
    found = find_cells(whole)
    np.testing.assert_array_equal(mesh.points[: len(whole.points)], whole.points)
    pieces = sizes(mesh)
    assert all((values > 0).all() for values in pieces.values())
    assert sum(values.sum() for values in pieces.values()) == pytest.approx(
        float(whole.volumes_and_centres()[0].sum()), rel=1e-3 if name == "snapped" else 1e-9
    )
    added = len(mesh.points) - len(whole.points) - len(found.others) - np.count_nonzero(whole.sizes > 4)
    assert added > 0 if name == "snapped" else added == 0  # middles of quadrilaterals, and of their hexahedra
    assert not check(foam_case(name)).warnings  # no gaps: every facet has a neighbour or a patch


def arrowhead(reflex: float, height: float = 1.0) -> FaceMesh:
    """A hexahedron: an arrowhead with its reflex corner at (0, ``reflex``), extruded to height 1, its tip to
    ``height``.
    """
    plane = np.array([[-1.0, -1.0], [0.0, reflex], [1.0, -1.0], [0.0, 2.0]])
    points = np.concatenate([np.column_stack([plane, np.full(4, z)]) for z in (0.0, 1.0)])
    points[7, 2] = height
    faces = np.array([[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]])
    none = np.empty(0, dtype=np.int64)
    return FaceMesh(Path("arrowhead"), points, 4 * np.arange(7), faces.ravel(), np.zeros(6, np.int64), none, ())


@pytest.mark.parametrize(
    ("reflex", "expected"), [(0.0, {"tetra": 8, "pyramid": 4}), (1.5, {"tetra": 24})], ids=["seen", "not seen"]
)
def test_a_hexahedron_with_a_reflex_corner_is_divided(reflex: float, expected: dict[str, int]) -> None:
    """Divided around its centroid, or around another point if the centroid is outside."""
    mesh = arrowhead(reflex)
    pieces = divide(mesh, find_cells(mesh))
    assert {name: len(nodes) for name, nodes in pieces.cells.items()} == expected
    found = sizes(MeshFile(pieces.points, pieces.cells, {}, mesh.path))
    assert all((values > 0.0).all() for values in found.values())
    assert sum(values.sum() for values in found.values()) == pytest.approx(2.0 - reflex)
    between = [0.0, 1.0 + reflex / 2.0, 0.0]  # the reflex corner and the tip
    np.testing.assert_allclose(pieces.points[pieces.middles[0]], between)


def test_a_polyhedron_of_triangles_is_divided_about_a_point_that_sees_them() -> None:
    quads = arrowhead(1.5)
    faces = quads.nodes.reshape(-1, 4)
    faces[0], faces[1] = [3, 2, 1, 0], [5, 6, 7, 4]  # cut from the reflex corner to the tip
    triangles = np.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]])
    owner, starts = np.zeros(12, np.int64), 3 * np.arange(13)
    mesh = FaceMesh(quads.path, quads.points, starts, triangles.ravel(), owner, quads.neighbour, ())
    pieces = divide(mesh, find_cells(mesh))
    volumes = sizes(MeshFile(pieces.points, pieces.cells, {}, mesh.path))["tetra"]
    assert len(volumes) == 12
    assert volumes.min() > 0.0
    assert volumes.sum() == pytest.approx(0.5)


def test_a_cell_of_which_no_point_sees_all_is_named() -> None:
    mesh = arrowhead(0.0, height=-3.0)
    with pytest.raises(InvalidInput, match=r"cell 0 at \(.*\) cannot be judged: no point in it") as caught:
        divide(mesh, find_cells(mesh))
    assert set(caught.value.details) == {"cell", "face"}


def test_one_layer_between_empty_patches_is_a_plane(foam_case: Callable[..., Path]) -> None:
    mesh = read_mesh(foam_case("strip"))
    assert mesh.dimension == 2
    assert {name: len(nodes) for name, nodes in mesh.cells.items()} == {"quad": 24}
    assert {name: len(nodes) for name, nodes in mesh.patches.items()} == {"inlet": 5, "outlet": 5, "walls": 14}
    assert sizes(mesh)["quad"].sum() == pytest.approx(5.0)
    assert (sizes(mesh)["quad"] > 0).all()


def test_a_plane_across_y_keeps_its_cells_upright(foam_case: Callable[..., Path], tmp_path: Path) -> None:
    """The strip's axes in another order: x and z are the plane, and anticlockwise changes."""
    folder = shutil.copytree(foam_case("strip") / "constant" / "polyMesh", tmp_path / "turned")
    points = read_face_mesh(folder).points[:, [0, 2, 1]] * [1, 1, -1]
    rows = "\n".join("(" + " ".join(map(repr, row)) + ")" for row in points.tolist())
    head = (folder / "points").read_text().partition("}")[0]
    (folder / "points").write_text(f"{head}}}\n{len(points)}\n(\n{rows}\n)\n")
    mesh = read_mesh(folder)
    assert sizes(mesh)["quad"].sum() == pytest.approx(5.0)
    assert mesh.points[:, 1].min() == -2.0


def test_one_layer_between_wedge_patches_is_a_plane(foam_case: Callable[..., Path]) -> None:
    """The motion solver moves two coordinates in the plane, and has the axis as a separate patch; so does this form."""
    mesh = read_mesh(foam_case("wedge"))
    assert {name: len(nodes) for name, nodes in mesh.cells.items()} == {"quad": 12}
    assert {name: len(nodes) for name, nodes in mesh.patches.items()} == {"rest": 11, "back": 5}
    np.testing.assert_array_equal(mesh.patches["back"], np.flatnonzero(mesh.points[:, 1] == 0.0))
    assert mesh.marked == {"back": "symmetry"}
    assert sizes(mesh)["quad"].sum() == pytest.approx(1.0)
    assert (sizes(mesh)["quad"] > 0).all()


def test_other_planes_are_refused(foam_case: Callable[..., Path], tmp_path: Path) -> None:
    # blockMesh puts faces without a patch into one of type empty
    folder = block_mesh(foam.PRISMS.partition("boundary")[0] + "boundary ();")(tmp_path / "case")
    with pytest.raises(InvalidInput, match=r"leave 0 dimension\(s\)"):
        read_mesh(folder)
    one_sided = shutil.copytree(foam_case("wedge") / "constant" / "polyMesh", tmp_path / "wedge")
    (one_sided / "boundary").write_text((one_sided / "boundary").read_text().replace("wedge;", "wall;", 1))
    with pytest.raises(InvalidInput, match="there must be two such patches, one on each side"):
        read_mesh(one_sided)


# --- damaged files ---------------------------------------------------------------------------------------------------

HEAD = "FoamFile {{ version 2.0; format ascii; class {kind}; object x; }}\n"
TETRA = {
    "points": ("vectorField", "4 ((0 0 0) (1 0 0) (0 1 0) (0 0 1))"),
    "faces": ("faceList", "4 (3(0 2 1) 3(0 1 3) 3(1 2 3) 3(0 3 2))"),
    "owner": ("labelList", "4{0}"),
    "neighbour": ("labelList", "0()"),
    "boundary": ("polyBoundaryMesh", "1 ( wall { type wall; inGroups 1(wall); nFaces 4; startFace 0; } )"),
}


def tetra(folder: Path, **changes: str) -> Path:
    """A polyMesh of one tetrahedron, with the content of some files replaced."""
    folder.mkdir(exist_ok=True)
    for name, (kind, text) in TETRA.items():
        (folder / name).write_text(HEAD.format(kind=kind) + "// * * //\n" + changes.get(name, text) + "\n// end\n")
    return folder


def test_one_tetrahedron_written_by_hand(tmp_path: Path) -> None:
    mesh = read_mesh(tetra(tmp_path))
    assert sizes(mesh)["tetra"] == pytest.approx([1 / 6])
    np.testing.assert_array_equal(mesh.patches["wall"], [0, 1, 2, 3])
    compact = "5 (0 3 6 9 12) 12 (0 2 1 0 1 3 1 2 3 0 3 2)"
    path = tetra(tmp_path) / "faces"
    path.write_text(HEAD.format(kind="faceCompactList") + compact)
    np.testing.assert_array_equal(read_mesh(tmp_path).cells["tetra"], mesh.cells["tetra"])


def test_older_forms_are_read(tmp_path: Path) -> None:
    """Faces of the boundary with the neighbour -1, and a list of patches without its length."""
    plain = read_mesh(tetra(tmp_path / "plain"))
    boundary = TETRA["boundary"][1].lstrip("0123456789")
    older = read_mesh(tetra(tmp_path / "older", neighbour="4(-1 -1 -1 -1)", boundary=boundary))
    np.testing.assert_array_equal(older.cells["tetra"], plain.cells["tetra"])
    assert list(older.patches) == list(plain.patches)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"points": "4 ((0 0 0) (1 0 0) (0 1 0) (0 0"}, "points: the list does not end"),
        ({"points": "4 ((0 0 0) (1 0 0) (0 1 0) (0 0 one))"}, "points: not a list of numbers: .*'one'"),
        ({"points": "5 ((0 0 0) (1 0 0) (0 1 0) (0 0 1))"}, "points: 15 numbers were announced, 12 follow"),
        ({"points": "4 ((0 0 0) (1 0 0) (0 1 0) (0 nan 1))"}, "node 3 has y = nan"),
        ({"points": "99999999999999{0}"}, "numbers were announced"),
        ({"points": ""}, "expected the number of entries"),
        ({"faces": "4 (3(0 2 1) 3(0 1 3) 3(1 2 3) 3(0 3))"}, "face 3 has no count"),
        ({"faces": "4 (3(0 2 1) 3(0 1 3) 3(1 2 3) 3(0 3 9))"}, "face 3 names point 9, but there are the points 0 to 3"),
        ({"faces": "4 ((0 2 1) (0 1 3) (1 2 3) (0 3 2))"}, "face 0 has no count"),
        ({"faces": "9 (3(0 2 1) 3(0 1 3) 3(1 2 3) 3(0 3 2))"}, "a list of 9 faces, but 4 are written"),
        ({"owner": "4(0 0 -1 0)"}, "the owner of face 2 is cell -1, which is negative"),
        ({"owner": "4(0 0 999999999999 0)"}, "owner of face 2 is cell 999999999999, which is too large"),
        ({"owner": "4(0 0 99999999999999999999 0)"}, "owner: not a list of numbers"),
        ({"owner": "3(0 0 0)"}, "4 faces, but 3 owners"),
        ({"owner": "900000000000{0}"}, "owner: a list of 900000000000 entries, but at most 4"),
        ({"neighbour": "1(0)"}, "face 0 has the cell 0 on both sides"),
        ({"boundary": "1 ( wall { type wall; nFaces 5; startFace 0; } )"}, "patch 'wall' has 5 faces from face 0 on"),
        ({"boundary": "1 ( wall { type wall; nFaces -5; startFace 0; } )"}, "nFaces is '-5'"),
        ({"boundary": "1 ( wall { type wall; nFaces 4;"}, "the list of patches does not end"),
        ({"boundary": "wall"}, "expected the number of patches"),
        ({"boundary": "1 ( a { nFaces 3; startFace 0; } )"}, "face 3 of the boundary is in no patch"),
        ({"boundary": "1 ( a { nFaces 3; startFace 1; } )"}, "face 0 of the boundary is in no patch"),
        (
            {"boundary": "2 ( a { nFaces 1; startFace 0; } b { nFaces 2; startFace 2; } )"},
            "face 1 of the boundary is in no patch",
        ),
        (
            {"boundary": "2 ( a { nFaces 3; startFace 0; } b { nFaces 2; startFace 2; } )"},
            "face 2 is in patch 'b' and in another",
        ),
        (
            {"boundary": "2 ( a { nFaces 4; startFace 0; } b { nFaces 4; startFace 0; } )"},
            "face 0 is in patch 'b' and in another",
        ),
        ({"boundary": "1 ( p { type processor; nFaces 4; startFace 0; } )"}, "type processor.*reconstructParMesh"),
    ],
)
def test_damaged_files_give_one_clear_line(tmp_path: Path, changes: dict[str, str], message: str) -> None:
    folder = tetra(tmp_path / "mesh", **changes)
    one_line(folder, message)


@pytest.mark.parametrize("name", FILES)
def test_a_missing_file_and_one_without_a_header(tmp_path: Path, name: str) -> None:
    folder = tetra(tmp_path)
    (folder / name).write_text("hello")
    with pytest.raises(InvalidInput, match=f"{name}: not an OpenFOAM file"):
        read_mesh(folder)
    (folder / name).unlink()
    with pytest.raises(InvalidInput, match=f"no file '{name}'"):
        read_mesh(folder)
    (folder / f"{name}.gz").write_bytes(gzip.compress(b"x" * 1000)[:-9])
    with pytest.raises(InvalidInput, match=rf"{name}(\.gz: damaged gzip|')"):
        read_mesh(folder)


def test_a_packed_file_that_would_fill_the_memory_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mesh_motion_server.files.packages._UNPACKED_BYTES", 1 << 20)
    folder = tetra(tmp_path)
    (folder / "points").unlink()
    (folder / "points.gz").write_bytes(gzip.compress(bytes(1 << 24)))
    with pytest.raises(InvalidInput, match=r"points\.gz: \d+ bytes that hold \d+ or more"):
        read_mesh(folder)


def test_no_case_at_all(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="neither an OpenFOAM case"):
        read_mesh(tmp_path)
    (tmp_path / "constant" / "air" / "polyMesh").mkdir(parents=True)
    with pytest.raises(InvalidInput, match=r"its meshes are those of regions: give one, .*/constant/air"):
        read_mesh(tmp_path)
    (tmp_path / "processors2").mkdir()  # collated
    with pytest.raises(InvalidInput, match="reconstructParMesh"):
        read_mesh(tmp_path)


def test_a_damaged_byte_never_gives_more_than_one_line(tmp_path: Path, foam_case: Callable[..., Path]) -> None:
    random, refused = np.random.default_rng(7), 0
    for name in ("box-binary", "prisms", "box"):
        folder = Path(shutil.copytree(foam_case(name) / "constant" / "polyMesh", tmp_path / name))
        refused += sum(refused_when_damaged(folder, folder / file, 16, random) for file in FILES)
    assert refused > 50


def test_check_warns_of_cyclic_patches_without_their_role(tmp_path: Path) -> None:
    mesh = tetra(tmp_path / "mesh", boundary="1 ( side { type cyclic; nFaces 4; startFace 0; } )")
    warning = "patch 'side' is one side of a period in the mesh file: give it the role periodic"
    assert warning in check(mesh).warnings
    assert read_mesh(mesh).marked == {"side": "periodic"}
    plane = tetra(tmp_path / "plane", boundary="1 ( side { type symmetryPlane; nFaces 4; startFace 0; } )")
    assert read_mesh(plane).marked == {"side": "symmetry"}
    assert warning not in check(tetra(tmp_path / "other")).warnings


def test_empty_patches_lie_anywhere(tmp_path: Path) -> None:
    patches = "3 ( a { nFaces 0; startFace 0; } b { nFaces 4; startFace 0; } c { nFaces 0; startFace 2; } )"
    assert list(read_mesh(tetra(tmp_path, boundary=patches)).patches) == ["b"]


def test_an_error_shows_no_more_of_a_file_than_can_be_read(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="points: not a list of numbers") as caught:
        read_mesh(tetra(tmp_path, points=f"4 ({'junk' * 100})"))
    assert len(str(caught.value)) < len(str(tmp_path)) + 130


@pytest.mark.parametrize("gap", [" ", "\t", "    \t "])
@pytest.mark.parametrize("end", ["\n", "\r\n", " ", " // how it is written\n", " /* a { b; */ "])
def test_headers_may_have_tabs_and_any_line_ends(tmp_path: Path, gap: str, end: str) -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], ">f4")
    entries = [("version", "2.0"), ("format", "binary"), ("class", "vectorField"), ("arch", '"MSB;label=64;scalar=32"')]
    head = f"FoamFile\n{{{end}" + "".join(f"{gap}{key}{gap}{value};{end}" for key, value in entries) + "}\n"
    folder = tetra(tmp_path)
    (folder / "points").write_bytes(head.encode() + b"4(" + points.tobytes() + b")")
    np.testing.assert_array_equal(read_mesh(folder).points, points)


@pytest.mark.parametrize(("label", "scalar"), [(32, 32), (64, 64), (64, 32)])
@pytest.mark.parametrize("order", ["<", ">"])
def test_every_width_and_byte_order_of_binary_files(tmp_path: Path, label: int, scalar: int, order: str) -> None:
    arch = f"{'LSB' if order == '<' else 'MSB'};label={label};scalar={scalar}"

    def ints(*values: int) -> bytes:
        return f"\n{len(values)}\n(".encode() + np.array(values, f"{order}i{label // 8}").tobytes() + b")"

    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], f"{order}f{scalar // 8}")
    bodies = {
        "points": b"4(" + points.tobytes() + b")",
        "faces": ints(0, 3, 6, 9, 12) + ints(0, 2, 1, 0, 1, 3, 1, 2, 3, 0, 3, 2),
        "owner": ints(0, 0, 0, 0),
        "neighbour": b"\n0\n",
        "boundary": TETRA["boundary"][1].encode(),
    }
    for name, body in bodies.items():
        kind = "faceCompactList" if name == "faces" else TETRA[name][0]
        head = f'FoamFile\n{{\n    version 2.0;\n    format  binary;\n    class {kind};\n    arch "{arch}";\n}}\n// *\n'
        (tmp_path / name).write_bytes(head.encode() + body)
    np.testing.assert_array_equal(read_mesh(tmp_path).points, points)
    cut = (tmp_path / "owner").read_bytes()[:-3]
    (tmp_path / "owner").write_bytes(cut)
    with pytest.raises(InvalidInput, match=r"owner: a binary list of 4 entries .* the file is cut"):
        read_mesh(tmp_path)


def test_a_long_entry_of_a_patch_is_read_in_linear_time(tmp_path: Path) -> None:
    """100 000 words took minutes when each copy contained all words before it."""
    (tmp_path / "boundary").write_bytes(b"FoamFile{class a;} 1(a{type wall; x %s;})" % (b"( " * 100_000))
    began = time.process_time()
    assert dictionaries(FoamFile.find(tmp_path, "boundary"))[0][1]["type"] == "wall"
    assert time.process_time() - began < 5


@pytest.mark.parametrize("name", ["box", "box-binary", "box-gzip", "strip", "castellated"])
def test_a_polymesh_comes_back_with_moved_points(foam_case: Callable[..., Path], tmp_path: Path, name: str) -> None:
    """In 2D both planes move alike; the added centres of polyhedra are not points of the file."""
    mesh = read_mesh(foam_case(name))
    write_mesh(tmp_path / "moved", replace(mesh, points=mesh.points * 1.5 + 0.1))
    before, after = read_face_mesh(foam_case(name) / "constant" / "polyMesh"), read_face_mesh(tmp_path / "moved")
    expected = before.points * 1.5 + 0.1
    if mesh.dimension == 2:
        thin = int(np.argmin(np.abs(after.points - before.points).max(axis=0)))
        expected[:, thin] = before.points[:, thin]
    np.testing.assert_allclose(after.points, expected, rtol=1e-15, atol=1e-15)
    np.testing.assert_array_equal(after.nodes, before.nodes)
    with pytest.raises(InvalidInput, match="exists already"):
        write_mesh(tmp_path / "moved", mesh)


def test_an_axisymmetric_mesh_does_not_come_back(foam_case: Callable[..., Path], tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="axisymmetric"):
        write_mesh(tmp_path / "moved", read_mesh(foam_case("wedge")))
    assert not (tmp_path / "moved").exists()
