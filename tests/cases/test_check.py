import re
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest
from frame_meshes import tensor_grid
from mesh_motion_client import QualityRefused
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.cases.check import check
from mesh_motion_server.cases.play import play
from mesh_motion_server.files import MeshFile, read_mesh, write_npz


def test_a_good_case_is_described(make_case) -> None:
    report = check(make_case())
    mesh = report.mesh
    assert report.roles == {"block": "moving", "outer": "fixed"}
    counts = {"moving": len(mesh.patches["block"]), "fixed": len(mesh.patches["outer"]), "sliding": 0, "periodic": 0}
    assert report.counts == counts
    assert report.pairs == []
    assert report.support_radius == 0.6
    assert report.suggested.support_radius > 0
    assert report.warnings == []
    assert 0 < report.quality["minimum skew"] <= report.quality["mean skew"] <= 1


def test_a_mesh_without_patches_is_usable_but_odd(make_case) -> None:
    path = make_case().parent / "mesh.npz"
    write_npz(path, replace(read_mesh(path), patches={}))
    assert any("no patches" in warning for warning in check(path).warnings)


def test_an_odd_mesh_gets_warnings(make_case) -> None:
    path = make_case(("0.6", "0.05"), ('outer = "fixed"', 'outer = "moving"'))
    mesh = read_mesh(path.parent / "mesh.npz")
    write_npz(mesh.path, replace(mesh, points=np.vstack([mesh.points, [[9.0, 9.0]]])))
    warnings = " | ".join(check(path).warnings)
    for part in ("'outer' is moving, but no motion is given", "belongs to no cell", "little more than the spacing"):
        assert part in warnings


def spoil(mesh, kind: str):
    triangles = mesh.cells["triangle"].copy()
    points = mesh.points.copy()
    if kind == "inverted":
        held = np.concatenate(list(mesh.patches.values()))
        points[np.setdiff1d(triangles, held)[0]] += 10.0  # a node inside leaves the domain
    elif kind == "repeated":
        triangles[3, 1] = triangles[3, 0]
    elif kind == "flat":
        points[triangles[3, 2]] = points[triangles[3, :2]].mean(axis=0)
    return replace(mesh, points=points, cells={"triangle": triangles})


@pytest.mark.parametrize(
    ("kind", "message"),
    [("inverted", "inverted"), ("repeated", "names a node twice"), ("flat", "inverted or degenerate|flat")],
)
@pytest.mark.parametrize("of_the_mesh", [False, True])
def test_an_unusable_mesh_is_refused_by_its_first_offender(
    make_case, kind: str, message: str, of_the_mesh: bool
) -> None:
    path = make_case()
    mesh = read_mesh(path.parent / "mesh.npz")
    write_npz(mesh.path, spoil(mesh, kind))
    with pytest.raises(InvalidInput, match=message) as caught:
        check(mesh.path if of_the_mesh else path)
    assert "\n" not in str(caught.value)
    assert "mesh.npz" in str(caught.value)


def su2_text(mesh: MeshFile) -> str:
    lines = ["NDIME= 2", f"NELEM= {mesh.n_cells}"]
    lines += [f"5 {a} {b} {c}" for a, b, c in mesh.cells["triangle"].tolist()]
    lines += [f"NPOIN= {len(mesh.points)}", *(f"{x!r} {y!r}" for x, y in mesh.points.tolist())]
    for name, nodes in mesh.patches.items():
        lines += [f"MARKER_TAG= {name}", f"MARKER_ELEMS= {len(nodes)}", *(f"1 {node}" for node in nodes.tolist())]
    return "\n".join(lines) + "\n"


def test_a_case_chooses_one_zone_of_its_mesh(make_case) -> None:
    path = make_case(('file = "mesh.npz"', 'file = "mesh.su2"\nzone = "2"'))
    mesh = read_mesh(path.parent / "mesh.npz")
    text = su2_text(mesh)
    both = f"NZONE= 2\nIZONE= 1\n{text.replace('block', 'other')}IZONE= 2\n{text}"
    (path.parent / "mesh.su2").write_text(both, encoding="utf-8")
    report = check(path)
    assert report.roles == {"block": "moving", "outer": "fixed"}
    with pytest.raises(InvalidInput, match=r"mesh\.su2: 2 zones: 1, 2"):
        check(path.parent / "mesh.su2")
    assert list(check(path.parent / "mesh.su2", "1").mesh.patches) == ["other", "outer"]


@pytest.mark.parametrize("of_the_mesh", [False, True])
def test_meshes_that_solvers_accept_are_accepted_with_a_line_for_each_oddity(make_case, of_the_mesh: bool) -> None:
    path = make_case()
    mesh = read_mesh(path.parent / "mesh.npz")
    triangles, block = mesh.cells["triangle"].copy(), mesh.patches["block"]
    triangles[::3] = triangles[::3, ::-1]
    patches = {**mesh.patches, "block": np.append(block, len(mesh.points))}
    points = np.vstack([mesh.points, mesh.points[block[:1]]])
    write_npz(mesh.path, replace(mesh, points=points, cells={"triangle": triangles}, patches=patches))
    warnings = check(mesh.path if of_the_mesh else path).warnings
    assert [line for line in warnings if "triangles were listed clockwise" in line]
    assert [line for line in warnings if "are at the same place; they are interpolated as one" in line]
    assert [line for line in warnings if "1 node belongs to no cell" in line]


def test_nodes_at_the_same_place_are_refused_where_only_distinct_ones_will_do(make_case) -> None:
    path = make_case(("0.6", '0.6\nreduction = "greedy"'))
    mesh = read_mesh(path.parent / "mesh.npz")
    patches = {**mesh.patches, "block": np.append(mesh.patches["block"], len(mesh.points))}
    points = np.vstack([mesh.points, mesh.points[mesh.patches["block"][:1]]])
    write_npz(mesh.path, replace(mesh, points=points, patches=patches))
    with pytest.raises(InvalidInput, match=r"are at the same place, \[.*\]: reduction = 'greedy' needs distinct ones"):
        check(path)


# --- the motion ------------------------------------------------------------------------------------------------------


MOTION = "translation = [0.05, 0.02], rotation = 10.0, centre = [0.5, 0.5]"


def test_a_motion_that_is_accepted(make_case) -> None:
    report = check(make_case(), seconds=60.0)
    assert (report.steps, report.refused, report.warnings) == (2, "", [])
    assert check(make_case()).steps == 0


def test_the_refused_step_is_the_one_that_play_refuses(make_case, tmp_path: Path) -> None:
    path = make_case(
        (MOTION, "translation = [0.03, 0.01], rotation = 90.0, centre = [0.5, 0.5]"), ("count = 2", "count = 9")
    )
    report = check(path, seconds=60.0)
    with pytest.raises(QualityRefused) as refused:
        play(path, tmp_path / "out")
    assert 0 < report.steps < 9
    step = f"step {report.steps + 1} of 9"
    assert report.refused == refused.value.message.replace(step, f"{step} will be refused", 1)
    assert "; the worst cell is triangle " in report.refused


def test_steps_below_the_threshold_are_counted_and_time_is_kept(make_case) -> None:
    low = ('"none"', '"none"\nquality_metric = "size-skew"\nquality_threshold = 0.99')
    (warning,) = check(make_case(low), seconds=60.0).warnings
    assert warning.startswith("2 of 2 steps stay below the threshold 0.99, the first is step 1; lowest minimum 0.")
    report = check(make_case(("count = 2", "count = 1000")), seconds=1e-9)
    assert (report.steps, report.refused) == (1, "")
    assert report.warnings == ["steps 2 to 1000 were not tried in 1e-09 s: --seconds allows more time"]


@pytest.mark.parametrize(
    ("motion", "part"),
    [
        (
            "translation = [50.0, 20.0]",
            r"largest displacement is 53\.9 and the mesh's extent 1\.41: do both have the same unit",
        ),
        ("translation = [5e-6, 2e-6]", "do both have the same unit"),
        ("translation = [0.6, 0.0]", r"the body leaves the domain in step 2: node \d+ comes to \(1\.\d+, "),
    ],
)
def test_a_motion_that_cannot_be_meant(make_case, motion: str, part: str) -> None:
    (warning,) = check(make_case((MOTION, motion))).warnings
    assert re.search(part, warning)


def test_a_patch_of_the_outer_boundary_may_bulge(make_case) -> None:
    path = make_case((MOTION, "translation = [-0.2, 0.0]"))
    mesh = read_mesh(path.parent / "mesh.npz")
    wall = mesh.points[:, 0] == 0.0
    patches = {
        "block": np.flatnonzero(wall),
        "outer": np.setdiff1d(np.concatenate([*mesh.patches.values()]), wall.nonzero()),
    }
    write_npz(mesh.path, replace(mesh, patches=patches))
    assert check(path).warnings == []


def test_a_file_of_lines_is_recognised(tmp_path: Path) -> None:
    """A file of Gmsh with only the group of a straight wall."""
    straight = np.c_[np.linspace(0.0, 1.0, 5), np.zeros((5, 2))]
    lines = np.c_[np.arange(4), np.arange(1, 5)]
    meshio.write(tmp_path / "wall.vtu", meshio.Mesh(straight, [("line", lines)]))
    assert (
        "it has lines only: was the group of its surface or volume not saved?"
        in check(tmp_path / "wall.vtu").warnings[0]
    )
    bent = straight + np.c_[np.zeros(5), np.arange(5.0) % 2, np.zeros(5)]
    meshio.write(tmp_path / "bent.vtu", meshio.Mesh(bent, [("line", lines)]))
    with pytest.raises(InvalidInput, match="save the physical group of the surface"):
        check(tmp_path / "bent.vtu")


def test_a_far_field_is_suggested_its_basis_and_radius(tmp_path: Path) -> None:
    axis = np.arange(-13.0, 14.0)
    points, quads = tensor_grid(axis, axis)
    quads = quads[np.abs(points[quads].mean(axis=1)).max(axis=1) > 1.0]
    block, outer = (np.flatnonzero(np.abs(points).max(axis=1) == size) for size in (1.0, 13.0))
    path = tmp_path / "far.npz"
    write_npz(path, MeshFile(points, {"quad": quads}, {"block": block, "outer": outer}, path))
    case = tmp_path / "case.toml"
    case.write_text(
        '[mesh]\nfile = "far.npz"\n[patches]\nblock = "moving"\nouter = "fixed"\n'
        '[[motion]]\npatch = "block"\nrigid = { translation = [0.1, 0.0] }\n[steps]\ncount = 1\n'
    )
    suggested = check(case).suggested
    assert (suggested.basis, suggested.support_radius) == ("wendland-c2-multiscale", 20.0)
