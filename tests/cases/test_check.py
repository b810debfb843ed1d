from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mesh_motion_server.cases.check import check, estimate_costs
from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.files import MeshFile, read_mesh, write_npz


def test_a_good_case_is_described(make_case) -> None:
    report = check(make_case())
    mesh = report.mesh
    assert report.roles == {"block": "moving", "outer": "fixed"}
    counts = {"moving": len(mesh.patches["block"]), "fixed": len(mesh.patches["outer"]), "sliding": 0, "periodic": 0}
    assert report.counts == counts
    assert report.pairs == []
    assert report.support_radius == 0.6
    assert report.suggested_radius > 0
    assert report.warnings == []
    assert 0 < report.quality["minimum skew"] <= report.quality["mean skew"] <= 1


def test_a_mesh_alone_is_checked_too(make_case) -> None:
    report = check(make_case().parent / "mesh.npz")
    assert report.roles == {}
    assert report.support_radius is None


def test_a_mesh_without_patches_is_usable_but_odd(make_case) -> None:
    path = make_case().parent / "mesh.npz"
    write_npz(path, replace(read_mesh(path), patches={}))
    assert any("no patches" in warning for warning in check(path).warnings)


def test_what_is_odd_becomes_a_warning(make_case) -> None:
    path = make_case(("0.6", "0.05"), ('outer = "fixed"', 'outer = "moving"'))
    mesh = read_mesh(path.parent / "mesh.npz")
    write_npz(mesh.path, replace(mesh, points=np.vstack([mesh.points, [[9.0, 9.0]]])))
    warnings = " | ".join(check(path).warnings)
    for part in ("'outer' is moving but has no motion", "belongs to no cell", "little more than the spacing"):
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
    [
        ("inverted", "inverted"),
        ("repeated", "names a node twice"),
        ("flat", "inverted or degenerate|flat"),
    ],
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
    """Triangles, and each node of a patch as a vertex of its marker."""
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
def test_what_solvers_accept_is_accepted_with_a_line_for_each(make_case, of_the_mesh: bool) -> None:
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
    path = make_case(("0.6", '0.6\nsolver = "dense"'))
    mesh = read_mesh(path.parent / "mesh.npz")
    patches = {**mesh.patches, "block": np.append(mesh.patches["block"], len(mesh.points))}
    points = np.vstack([mesh.points, mesh.points[mesh.patches["block"][:1]]])
    write_npz(mesh.path, replace(mesh, points=points, patches=patches))
    with pytest.raises(InvalidInput, match=r"are at the same place, \[.*\]: solver = 'dense' needs distinct ones"):
        check(path)


def test_an_unknown_basis_and_a_missing_file(make_case, tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="wendland-c9"):
        check(make_case(("0.6", '0.6\nbasis = "wendland-c9"')))
    with pytest.raises(InvalidInput, match="cannot be read"):
        check(tmp_path / "none.toml")
    with pytest.raises(InvalidInput, match="no such mesh file"):
        check(tmp_path / "none.msh")


def test_costs_follow_the_solver_that_would_be_chosen() -> None:
    rng = np.random.default_rng(0)
    points = rng.random((2000, 3))
    few = estimate_costs(points, points[:500], 10_000, 1.0)
    sparse = estimate_costs(points, points, 10_000, 0.1)
    dense = estimate_costs(points, points[:900], 10_000, 1.0)
    assert (few.solver, sparse.solver, dense.solver) == ("dense", "sparse", "dense")
    assert few.factorize_seconds < dense.factorize_seconds
    assert sparse.evaluate_seconds < dense.evaluate_seconds
    many = estimate_costs(points, rng.random((12_000, 3)), 10_000, 1.0)
    assert many.solver == "two-scale"
    assert many.memory_bytes < dense.memory_bytes
