"""What we write comes back, in our readers to the bit and in those of other programs; moved files keep all else."""

from __future__ import annotations

import os
import re
import shutil
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import foam_cases as foam
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from mesh_motion_server.errors import InvalidInput, ResourceError
from mesh_motion_server.files import MeshFile, check_target, read_mesh, write_mesh, write_moved
from mesh_motion_server.files.patch_facets import FACET_TYPES
from mesh_motion_server.files.replace import require_file_place, require_folder_place
from mesh_motion_server.numerics.mesh.cell_facets import CellFacets
from mesh_motion_server.numerics.mesh.cells import CELL_TYPES, CellTable

SUFFIXES = [".npz", ".msh", ".su2", ".vtu", ".vtk", ".cgns", ""]
EXACT = [".npz", ".msh", ".su2", ".vtu", ".vtk", ".cgns"]
NAMES = ["wall", "moving wall", "Wände-2", "x"]

pytest.importorskip("h5py")
pytest.importorskip("meshio")


def grid(counts: list[int], split: list[bool], seed: int) -> tuple[NDArray[np.float64], dict[str, NDArray[np.int64]]]:
    """A jittered grid of quads, some of them split into triangles, perhaps extruded; its nodes in any order."""
    random = np.random.default_rng(seed)
    nx, ny = counts[:2]
    layers = counts[2:]
    axes = [np.arange(count + 1.0) for count in counts]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(counts))
    points += random.uniform(-0.05, 0.05, points.shape)
    number = np.arange(len(points)).reshape([count + 1 for count in counts])
    flat = number[..., 0] if layers else number
    quads, triangles = [], []
    for cell, is_split in zip(np.ndindex(nx, ny), split, strict=False):
        i, j = cell
        a, b, c, d = flat[i, j], flat[i + 1, j], flat[i + 1, j + 1], flat[i, j + 1]
        if is_split:
            triangles += [(a, b, c), (a, c, d)]
        else:
            quads.append((a, b, c, d))
    cells = {"triangle": np.array(triangles).reshape(-1, 3), "quad": np.array(quads).reshape(-1, 4)}
    if layers:
        lower = {name: np.concatenate([nodes + k for k in range(layers[0])]) for name, nodes in cells.items()}
        names = {"triangle": "wedge", "quad": "hexahedron"}
        cells = {names[name]: np.hstack([nodes, nodes + 1]) for name, nodes in lower.items()}
    order = random.permutation(len(points))
    place = np.argsort(order)
    return points[order], {name: place[nodes].astype(np.int64) for name, nodes in cells.items() if len(nodes)}


def with_patches(
    points: NDArray[np.float64], cells: dict[str, NDArray[np.int64]], names: list[str], seed: int
) -> MeshFile:
    """Each facet of the boundary in one of the patches."""
    boundary = CellFacets.of(CellTable.from_arrays(cells)).boundary
    chosen = np.random.default_rng(seed).integers(0, len(names), len(boundary))
    facets: dict[str, dict[str, NDArray[np.int64]]] = {}
    for number, name in enumerate(names):
        mine = boundary[chosen == number]
        sizes = (mine >= 0).sum(axis=1)
        of = {kind: mine[sizes == size, :size] for size, kind in FACET_TYPES.items() if (sizes == size).any()}
        if of:
            facets[name] = of
    patches = {name: np.unique(np.concatenate([n.ravel() for n in of.values()])) for name, of in facets.items()}
    return MeshFile(points, cells, patches, Path("made"), facets)


@st.composite
def meshes(draw: st.DrawFn, names: list[str]) -> MeshFile:
    counts = draw(st.lists(st.integers(1, 3), min_size=2, max_size=3))
    split = draw(st.lists(st.booleans(), min_size=9, max_size=9))
    seed = draw(st.integers(0, 2**32 - 1))
    points, cells = grid(counts, split, seed)
    scale = draw(st.sampled_from([1.0, 1e-7, 3.3e12]))
    chosen = draw(st.lists(st.sampled_from(names), min_size=1, max_size=3, unique=True))
    return with_patches(points * scale, cells, chosen, seed)


def facet_sets(mesh: MeshFile) -> dict[str, Counter[tuple[int, ...]]]:
    return {
        name: Counter(tuple(sorted(row)) for nodes in of.values() for row in nodes.tolist())
        for name, of in mesh.facets.items()
    }


def shapes(mesh: MeshFile) -> dict[str, Counter[tuple[int, ...]]]:
    """The cells by their nodes, in whatever order."""
    return {name: Counter(tuple(sorted(row)) for row in nodes.tolist()) for name, nodes in mesh.cells.items()}


def orientation(mesh: MeshFile) -> dict[str, bool]:
    found = {}
    for name, nodes in mesh.cells.items():
        corners = mesh.points[nodes[:, CELL_TYPES[name].corner_array]]
        found[name] = bool((np.linalg.det(corners[:, :, 1:] - corners[:, :, :1]) > 0).all())
    return found


def same(mesh: MeshFile, again: MeshFile, *, exactly: bool) -> None:
    """The same points to the bit, cells (of a polyMesh from whichever node they begin) and patches."""
    np.testing.assert_array_equal(again.points, mesh.points)
    assert again.patches.keys() == mesh.patches.keys()
    for name, nodes in mesh.patches.items():
        np.testing.assert_array_equal(again.patches[name], nodes)
    if exactly:
        assert again.cells.keys() == mesh.cells.keys()
        for name, nodes in mesh.cells.items():
            np.testing.assert_array_equal(again.cells[name], nodes)
    assert shapes(again) == shapes(mesh)
    assert orientation(again) == orientation(mesh)


@pytest.mark.parametrize("suffix", EXACT)
@settings(
    max_examples=settings.default.max_examples // 16 + 3, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(mesh=meshes(NAMES))
def test_files_come_back_to_the_bit(tmp_path: Path, suffix: str, mesh: MeshFile) -> None:
    path = tmp_path / f"mesh{suffix}"
    if suffix in (".vtk", ".su2") and "moving wall" in mesh.patches:
        with pytest.raises(InvalidInput, match=r"no name for an array|no name for a marker"):
            write_mesh(path, mesh)
        return
    write_mesh(path, mesh)
    again = read_mesh(path)
    same(mesh, again, exactly=True)
    if suffix in (".msh", ".su2", ".cgns"):
        assert facet_sets(again) == facet_sets(mesh)
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


@settings(
    max_examples=settings.default.max_examples // 9 + 3, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(mesh=meshes(["wall", "outlet", "x"]))
def test_a_polymesh_comes_back(tmp_path: Path, mesh: MeshFile) -> None:
    shutil.rmtree(tmp_path / "case", ignore_errors=True)
    write_mesh(tmp_path / "case", mesh)
    again = read_mesh(tmp_path / "case")
    same(mesh, again, exactly=mesh.dimension == 2)
    assert facet_sets(again) == facet_sets(mesh)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_all_solids_come_back(tmp_path: Path, suffix: str, all_solids: tuple[Any, Any]) -> None:
    mesh = with_patches(*all_solids, ["one", "two"], 5)
    write_mesh(tmp_path / f"mesh{suffix}", mesh)
    same(mesh, read_mesh(tmp_path / f"mesh{suffix}"), exactly=bool(suffix))


@pytest.mark.parametrize("suffix", [".msh", ".su2", ".cgns", ".vtu", ".vtk", ".npz"])
def test_nodes_on_no_facet_stay_in_their_patch(tmp_path: Path, suffix: str) -> None:
    points, cells = grid([3, 3], [True, False] * 5, 1)
    mesh = MeshFile(points, cells, {"pin": np.array([4]), "pair": np.array([1, 7])}, Path("made"))
    write_mesh(tmp_path / f"m{suffix}", mesh)
    same(mesh, read_mesh(tmp_path / f"m{suffix}"), exactly=True)


def test_patches_of_nodes_become_faces_each_in_one_patch(tmp_path: Path) -> None:
    """A channel one cell high: the edge at its inlet has its nodes on the walls, too."""
    points = np.array([[0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1]], dtype=np.float64)
    cells = {"quad": np.array([[0, 1, 4, 3], [1, 2, 5, 4]])}
    patches = {"walls": np.arange(6), "inlet": np.array([0, 3]), "outlet": np.array([2, 5])}
    mesh = MeshFile(points, cells, patches, Path("made"))
    write_mesh(tmp_path / "case", mesh)
    again = read_mesh(tmp_path / "case")
    same(mesh, again, exactly=True)
    assert {name: len(of["line"]) for name, of in again.facets.items()} == {"walls": 4, "inlet": 1, "outlet": 1}


def test_a_link_stays_a_link(tmp_path: Path) -> None:
    points, cells = grid([2, 2], [False] * 4, 0)
    mesh = with_patches(points, cells, ["a"], 0)
    (tmp_path / "real").mkdir()
    (tmp_path / "link.su2").symlink_to(Path("real", "m.su2"))  # nothing is there yet
    for content in (mesh, MeshFile(points * 2, cells, mesh.patches, mesh.path, mesh.facets)):
        write_mesh(tmp_path / "link.su2", content)
        assert (tmp_path / "link.su2").is_symlink()
        np.testing.assert_array_equal(read_mesh(tmp_path / "real" / "m.su2").points, content.points)
    assert [file.name for file in (tmp_path / "real").iterdir()] == ["m.su2"]


# --- moved files keep all else ---------------------------------------------------------------------------------------


def moved(mesh: MeshFile) -> NDArray[np.float64]:
    return mesh.points + 0.01 * np.sin(7 * mesh.points[:, ::-1]) / 3


SU2 = """% a comment
NDIME= 2
NELEM= 2 % two
5 0 1 2 0
5 0 2 3 1
NPOIN= 4 4
 0.0 0.0 0
1.0\t0.0 1 % the corner

1.0 1.0 2
0.0 1.0 3
NMARK= 1
MARKER_TAG= wall
MARKER_ELEMS= 1
SEND_RECV= 0
3 0 1
FFD_NBOX= 1
"""


def test_a_moved_su2_file_differs_in_its_coordinates_only(tmp_path: Path) -> None:
    path = tmp_path / "mesh.su2"
    path.write_text(SU2.replace("SEND_RECV= 0\n", ""))
    mesh = read_mesh(path)
    new = moved(mesh)
    write_moved(tmp_path / "moved.su2", mesh, new)
    same(MeshFile(new, mesh.cells, mesh.patches, path), read_mesh(tmp_path / "moved.su2"), exactly=True)
    before, after = (f.read_text().splitlines() for f in (path, tmp_path / "moved.su2"))
    changed = [n for n, (a, b) in enumerate(zip(before, after, strict=True)) if a != b]
    assert changed == [6, 7, 9, 10]
    assert after[7].endswith("1 % the corner")
    write_moved(tmp_path / "same.su2", mesh, mesh.points)
    assert [line.split() for line in (tmp_path / "same.su2").read_text().splitlines()] == [
        line.split() for line in before
    ]


@pytest.mark.parametrize("version", [2.2, 4.1])
@pytest.mark.parametrize("binary", [0, 1])
def test_a_moved_gmsh_file_is_what_gmsh_reads(tmp_path: Path, version: float, binary: int) -> None:
    gmsh = pytest.importorskip("gmsh", exc_type=OSError)
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.occ.addDisk(0, 0, 0.25, 1, 1)
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(1, [1], name="rim")
        gmsh.model.addPhysicalGroup(2, [1], name="disk")
        gmsh.model.mesh.generate(2)
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        gmsh.option.setNumber("Mesh.Binary", binary)
        gmsh.option.setNumber("Mesh.SaveParametric", int(version == 4.1))
        gmsh.write(str(tmp_path / "disk.msh"))
        mesh = read_mesh(tmp_path / "disk.msh")
        new = moved(mesh)
        write_moved(tmp_path / "moved.msh", mesh, new)
        same(MeshFile(new, mesh.cells, mesh.patches, mesh.path), read_mesh(tmp_path / "moved.msh"), exactly=True)
        gmsh.clear()
        gmsh.open(str(tmp_path / "moved.msh"))
        theirs = gmsh.model.mesh.getNodes()[1].reshape(-1, 3)
        assert set(map(tuple, theirs.tolist())) == {(x, y, 0.25) for x, y in new.tolist()}
        assert {gmsh.model.getPhysicalName(d, t) for d, t in gmsh.model.getPhysicalGroups()} == {"rim", "disk"}
    finally:
        gmsh.finalize()
    write_moved(tmp_path / "same.msh", mesh, mesh.points)
    if binary:
        assert (tmp_path / "same.msh").read_bytes() == (tmp_path / "disk.msh").read_bytes()


def test_a_big_endian_gmsh_file_stays_one(tmp_path: Path) -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], dtype=">f8")
    rows = np.array([(n + 1, p) for n, p in enumerate(points)], dtype=[("tag", ">i4"), ("xyz", ">f8", 3)])
    element = np.array([2, 1, 2, 1, 1, 1, 1, 2, 3], dtype=">i4").tobytes()
    path = tmp_path / "big.msh"
    path.write_bytes(
        b"$MeshFormat\n2.2 1 8\n" + np.array([1], ">i4").tobytes() + b"\n$EndMeshFormat\n$Nodes\n3\n" + rows.tobytes()
        + b"\n$EndNodes\n$Elements\n1\n" + element + b"\n$EndElements\n"
    )  # fmt: skip
    mesh = read_mesh(path)
    write_moved(tmp_path / "moved.msh", mesh, mesh.points * 2)
    np.testing.assert_array_equal(read_mesh(tmp_path / "moved.msh").points, mesh.points * 2)
    write_moved(path, mesh, mesh.points * 3)  # in place
    np.testing.assert_array_equal(read_mesh(path).points, mesh.points * 3)


@pytest.mark.parametrize("suffix", [".vtu", ".vtk"])
def test_a_moved_vtk_file_keeps_its_arrays(tmp_path: Path, suffix: str) -> None:
    import meshio  # noqa: PLC0415

    points = np.random.default_rng(0).random((5, 3)) * [1, 1, 0]
    cells = [("triangle", np.array([[0, 1, 2]])), ("line", np.array([[0, 1]])), ("triangle", np.array([[2, 1, 3]]))]
    data = {"patch": [np.array([0]), np.array([4]), np.array([0])], "p": [np.ones(1), np.ones(1) * 2, np.ones(1) * 3]}
    meshio.Mesh(points, cells, {"t": np.arange(5.0)}, data).write(tmp_path / f"m{suffix}")
    mesh = read_mesh(tmp_path / f"m{suffix}")
    write_moved(tmp_path / f"n{suffix}", mesh, mesh.points + 1)
    before, after = meshio.read(tmp_path / f"m{suffix}"), meshio.read(tmp_path / f"n{suffix}")
    np.testing.assert_array_equal(after.points, before.points + np.array([1, 1, 0]))
    assert [block.type for block in after.cells] == [block.type for block in before.cells]
    np.testing.assert_array_equal(after.point_data["t"], before.point_data["t"])
    assert np.concatenate([np.ravel(v) for v in after.cell_data["p"]]).tolist() == [1, 2, 3]


def test_a_moved_cgns_file_keeps_everything_else(tmp_path: Path) -> None:
    import h5py  # noqa: PLC0415

    points, cells = grid([2, 2, 2], [True, False, True, False], 3)
    mesh = with_patches(points, cells, ["a", "b"], 1)
    path = tmp_path / "m.cgns"
    write_mesh(path, mesh)
    with h5py.File(path, "r+") as file:
        file["Base/Zone"].create_group("mine").attrs["label"] = np.bytes_(b"UserDefinedData_t")
        single = file["Base/Zone/GridCoordinates/CoordinateX"]
        values = single[" data"][:].astype(np.float32)
        del single[" data"]
        single[" data"] = values
        single.attrs.modify("type", np.bytes_(b"R4"))
    mesh = read_mesh(path)
    write_moved(tmp_path / "n.cgns", mesh, moved(mesh))
    same(MeshFile(moved(mesh), mesh.cells, mesh.patches, path), read_mesh(tmp_path / "n.cgns"), exactly=True)
    with h5py.File(tmp_path / "n.cgns") as file:
        assert "mine" in file["Base/Zone"]
        assert file["Base/Zone/GridCoordinates/CoordinateX"].attrs["type"] == b"R8"


@pytest.mark.parametrize("form", ["ascii", "binary", "gzip"])
@pytest.mark.parametrize("blocks", ["BOX", "STRIP"])
def test_moved_points_of_a_case_are_what_checkmesh_measures(tmp_path: Path, form: str, blocks: str) -> None:
    options = {"ascii": {}, "binary": {"form": "binary"}, "gzip": {"compression": "on"}}[form]
    case = foam.FoamCase.new(tmp_path / "case", getattr(foam, blocks), **options)
    case.run("blockMesh")
    before = case.checked()
    mesh = read_mesh(case.folder)
    stretched = mesh.points * ([2.0, 1.0, 1.0] if mesh.dimension == 3 else [2.0, 1.0])
    write_moved(tmp_path / "copy", mesh, stretched)
    shutil.copytree(case.folder / "system", tmp_path / "copy" / "system")
    after = foam.FoamCase(tmp_path / "copy").checked()
    assert after["volume"] == pytest.approx(2 * before["volume"], rel=1e-12)
    assert {name: after[name] for name in ("points", "cells", "faces")} == {
        name: before[name] for name in ("points", "cells", "faces")
    }
    np.testing.assert_array_equal(read_mesh(tmp_path / "copy").points, stretched)
    names = {file.name for file in (tmp_path / "copy" / "constant" / "polyMesh").iterdir()}
    assert names == {file.name for file in (case.folder / "constant" / "polyMesh").iterdir()}
    write_moved(case.folder / "0.5" / "polyMesh", mesh, stretched)  # a time of the same case: the points alone
    (points,) = (case.folder / "0.5" / "polyMesh").iterdir()
    copied = tmp_path / "copy" / "constant" / "polyMesh" / points.name
    assert points.read_bytes() == copied.read_bytes()
    text = case.run("checkMesh", "-time", "0.5")
    assert float(text.partition("Total volume = ")[2].split()[0].rstrip(".")) == pytest.approx(after["volume"])
    write_moved(case.folder, mesh, stretched)  # in place
    np.testing.assert_array_equal(read_mesh(case.folder).points, stretched)


def test_moved_polyhedra_take_their_corners_along(tmp_path: Path) -> None:
    case = foam.FoamCase.new(tmp_path / "case", foam.BOX)
    case.run("blockMesh")
    case.run("polyDualMesh", "75", "-overwrite")
    mesh = read_mesh(case.folder)
    write_moved(case.folder, mesh, mesh.points * 0.5)
    np.testing.assert_allclose(read_mesh(case.folder).points, mesh.points * 0.5, rtol=1e-12)


# --- other programs --------------------------------------------------------------------------------------------------


def complaints(output: str) -> list[str]:
    """What checkMesh has against a mesh, but for its determinant: a cell with one inner face or two has a small one."""
    found = [line.strip() for line in output.splitlines() if line.strip().startswith("*")]
    others = [line for line in found if "Cells with small determinant" not in line]
    failed = re.search(r"Failed (\d+) mesh checks", output)
    if "Mesh OK." not in output and (failed is None or int(failed[1]) > len(found)):
        others.append("more checks failed than lines say so, or none was made")
    return others


@pytest.mark.parametrize("wrong", ["mirrored", "turned", "torn"])
def test_checkmesh_finds_what_is_wrong(tmp_path: Path, wrong: str) -> None:
    points, cells = grid([3, 2, 2], [True, False] * 3, 2)
    case = foam.FoamCase.new(tmp_path / "case")
    mesh = with_patches(points, cells, ["a", "b"], 3)
    write_mesh(case.folder, mesh)
    faces = case.folder / "constant" / "polyMesh" / "faces"
    if wrong == "mirrored":
        write_moved(case.folder, read_mesh(case.folder), mesh.points * [-1, 1, 1])
    elif wrong == "turned":  # one face points the other way
        faces.write_text(re.sub(r"4\((\d+) (\d+) (\d+) (\d+)\)", r"4(\4 \3 \2 \1)", faces.read_text(), count=1))
    else:  # one node far away
        moved = mesh.points.copy()
        moved[0] += 3.0
        write_moved(case.folder, read_mesh(case.folder), moved)
    assert complaints(case.run("checkMesh", "-constant", "-allGeometry", "-allTopology"))


@pytest.mark.parametrize("dimension", [2, 3])
def test_checkmesh_accepts_what_we_write(tmp_path: Path, dimension: int, all_solids: tuple[Any, Any]) -> None:
    points, cells = grid([4, 3, 3][:dimension], [True, False] * 6, 2)
    case = foam.FoamCase.new(tmp_path / "case")
    mesh = with_patches(points, cells, ["a", "b", "c"], 3)
    write_mesh(case.folder, mesh)
    found = case.checked()
    assert complaints(case.output) == [], case.output
    if dimension == 2:
        assert (found["hexahedra"], found["prisms"]) == (len(mesh.cells["quad"]), len(mesh.cells["triangle"]))
        return
    assert (found["hexahedra"], found["prisms"]) == (len(mesh.cells["hexahedron"]), len(mesh.cells["wedge"]))
    solids = foam.FoamCase.new(tmp_path / "solids")
    write_mesh(solids.folder, with_patches(*all_solids, ["skin"], 0))
    found = solids.checked()
    assert complaints(solids.output) == [], solids.output
    assert [found[k] for k in ("hexahedra", "prisms", "pyramids", "tetrahedra", "polyhedra")] == [1, 1, 1, 1, 0]


@pytest.mark.parametrize("suffix", [".msh", ".cgns"])
def test_gmsh_reads_what_we_write(tmp_path: Path, suffix: str) -> None:
    gmsh = pytest.importorskip("gmsh", exc_type=OSError)
    points, cells = grid([3, 2, 2], [True, False] * 3, 4)
    mesh = with_patches(points, cells, ["a", "b"], 3)
    write_mesh(tmp_path / f"m{suffix}", mesh)
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(tmp_path / f"m{suffix}"))
        assert len(gmsh.model.mesh.getNodes()[0]) == len(points)
        kinds, tags, _ = gmsh.model.mesh.getElements(3)
        counts = dict(zip(kinds.tolist(), map(len, tags), strict=True))
        assert counts == {5: len(cells["hexahedron"]), 6: len(cells["wedge"])}
        if suffix == ".msh":
            names = {gmsh.model.getPhysicalName(d, t) for d, t in gmsh.model.getPhysicalGroups(2)}
            assert names == {"a", "b"}
    finally:
        gmsh.finalize()


@pytest.mark.parametrize("suffix", [".su2", ".vtu", ".vtk"])
def test_meshio_reads_what_we_write(tmp_path: Path, suffix: str) -> None:
    import meshio  # noqa: PLC0415

    points, cells = grid([3, 2, 2], [True, False] * 3, 4)
    mesh = with_patches(points, cells, ["a", "b"], 3)
    write_mesh(tmp_path / f"m{suffix}", mesh)
    theirs = meshio.read(tmp_path / f"m{suffix}")
    np.testing.assert_array_equal(theirs.points, points)
    for name, nodes in cells.items():
        np.testing.assert_array_equal(theirs.cells_dict[name], nodes)


# --- refusals --------------------------------------------------------------------------------------------------------


def test_what_a_format_cannot_hold_is_refused(tmp_path: Path) -> None:
    points, cells = grid([2, 2], [False] * 4, 0)
    mesh = with_patches(points, cells, ["a"], 0)

    def named(name: str) -> MeshFile:
        return MeshFile(points, cells, {name: mesh.patches["a"]}, Path("made"), {name: mesh.facets["a"]})

    def checked(path: Path, mesh: MeshFile) -> None:
        check_target(path, replace(mesh, path=Path("made.npz")))

    pinned = MeshFile(points, cells, {"pin": np.array([4])}, Path("made"))
    twice = MeshFile(
        points, cells, dict.fromkeys("ab", mesh.patches["a"]), Path("made"), dict.fromkeys("ab", mesh.facets["a"])
    )
    refused = [
        ("m.stl", mesh, "unknown kind"),
        ("m.su2", named(" a"), "no name for a marker"),
        ("m.su2", named("a b"), "no name for a marker"),
        ("m.msh", named('a"b'), "no name for a group"),
        ("m.cgns", named("a/b"), "no name for a family"),
        ("m.cgns", named("a" * 33), "no name for a family"),
        ("case", named("a b"), "no word of OpenFOAM"),
        ("case", pinned, "node 4 of patch 'pin' is on none of its faces"),
        ("case", twice, "patches 'a' and 'b' share a face"),
        ("m.vtk", named("a b"), "no name for an array"),
    ]
    for name, bad, message in refused:
        for refuse in (write_mesh, checked):
            with pytest.raises(InvalidInput, match=message):
                refuse(tmp_path / name, bad)
    assert not [file for file in tmp_path.rglob("*") if file.is_file()]
    write_mesh(tmp_path / "case", mesh)
    for refuse in (write_mesh, checked):
        with pytest.raises(InvalidInput, match="there is a mesh already"):
            refuse(tmp_path / "case", mesh)
    with pytest.raises(InvalidInput, match=r"shape \(9, 2\) for made, got an array of float64 of shape \(9, 3\)"):
        write_moved(tmp_path / "m.npz", mesh, np.zeros((9, 3)))
    with pytest.raises(InvalidInput, match="not all finite"):
        write_moved(tmp_path / "m.npz", mesh, points * np.nan)
    with pytest.raises(InvalidInput, match="there is no folder"):
        write_mesh(tmp_path / "none" / "m.su2", mesh)


@pytest.mark.parametrize("name", ["m.su2", "case", "new/case"])
def test_a_folder_that_may_not_be_written_is_told_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """The system is asked about the folder that is there already, whoever runs the test."""
    asked = []

    def refuse(path: Path, mode: int) -> bool:
        asked.append((path, mode))
        return False

    monkeypatch.setattr(os, "access", refuse)
    with pytest.raises(ResourceError, match=f"{name}.*: .* cannot be written by this user") as caught:
        check_target(tmp_path / name)
    assert asked == [(tmp_path, os.W_OK | os.X_OK)]
    assert "\n" not in str(caught.value)


def test_a_folder_in_the_place_of_a_file_is_told_before(tmp_path: Path) -> None:
    (tmp_path / "report.json").mkdir()
    with pytest.raises(InvalidInput, match=r"report\.json: a folder, where a file is to be written"):
        require_file_place(tmp_path / "report.json")
    require_folder_place(tmp_path / "report.json")
