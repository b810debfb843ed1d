"""Meshes are checked before anything is sent."""

import numpy as np
import pytest
from mesh_motion_client import InvalidInput, Mesh, Patch
from mesh_motion_client.mesh import CELL_NODES, ROLES
from mesh_motion_numerics.mesh.cells import CELL_TYPES
from mesh_motion_numerics.mesh.roles import ROLES as SERVER_ROLES

POINTS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
AT = {"session": "s", "epoch": 1}
GIVEN = {"wall": "fixed", "flag": "moving"}


def test_cell_types_and_roles_are_the_servers():
    assert {name: kind.n_nodes for name, kind in CELL_TYPES.items()} == CELL_NODES
    assert ROLES == SERVER_ROLES


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Mesh(np.zeros((0, 2)), {}), "with n > 0"),
        (lambda: Mesh(np.zeros((2, 2, 2)), {}), "must be a table"),
        (lambda: Mesh("x", {}), "points must be numbers"),
        (lambda: Mesh(np.ma.masked_greater(POINTS, 0.5), {}), r"points must be numbers: entry \[1, 0\] is masked"),
        (
            lambda: Mesh(POINTS, {"triangle": np.ma.masked_equal([[0, 1, 2]], 1)}),
            r"triangle .*: entry \[0, 1\] is masked",
        ),
        (lambda: Patch("moving", np.ma.masked_equal([0, 1], 0)), r"a patch's nodes .*: entry \[0\] is masked"),
        (lambda: Mesh(POINTS, {"triangles": [[0, 1, 2]]}), r"got 'triangles' \(did you mean 'triangle'\?\)"),
        (lambda: Mesh.load("m.npz", ["moving"]), r"roles must be a dict, .* got \['moving'\] \(as roles="),
        (lambda: Mesh.from_pyvista(None, "moving"), "roles must be a dict, .* got 'moving'"),
        (lambda: Mesh.from_meshio(None, None), "roles must be a dict, .* got None"),
        (lambda: Mesh.from_gmsh(["moving"]), "roles must be a dict"),
        (lambda: Mesh.load(3, GIVEN), "path must be the path of a mesh file, got 3"),
        (lambda: Mesh(POINTS, {}, global_ids=[1, 2]), "one number for each point, got 2 for 3 points"),
    ],
)
def test_a_wrong_mesh_is_refused_by_the_first_error(build, message):
    with pytest.raises(InvalidInput, match=message):
        build()


def test_the_upload_has_every_part():
    mesh = Mesh(POINTS, {"triangle": [[0, 1, 2]]}, {"a": Patch("moving", [0]), "b": Patch("fixed", [])}, [5, 6, 7])
    parts = list(mesh.parts(**AT))
    assert [(p.item, p.name, p.role, p.rows.shape) for p in parts] == [
        ("nodes", "", "", (3, 2)),
        ("global_ids", "", "", (3, 1)),
        ("cells", "triangle", "", (1, 3)),
        ("patch", "a", "moving", (1, 1)),
        ("patch", "b", "fixed", (0, 1)),
    ]


def test_a_large_mesh_goes_in_parts():
    points = np.random.default_rng(0).random((3_000_000, 2))
    parts = list(Mesh(points, {}).parts(**AT))
    assert len(parts) == 2
    assert (np.concatenate([part.rows for part in parts]) == points).all()


def test_the_mesh_keeps_copies():
    points = POINTS.copy()
    mesh = Mesh(points, {})
    points[:] = 9.0
    assert (mesh.points == POINTS).all()


def test_a_file_is_read_with_its_numbers_and_the_roles_that_are_given(tmp_path):
    arrays = {"points": np.zeros((3, 2)), "cells_triangle": [[0, 1, 2]], "patch_wall": [2, 0], "global_ids": [4, 5, 9]}
    np.savez(tmp_path / "part.npz", **arrays)
    mesh = Mesh.load(tmp_path / "part.npz", GIVEN)
    assert mesh.cells["triangle"].tolist() == [[0, 1, 2]]
    assert {name: (patch.role, patch.nodes.tolist()) for name, patch in mesh.patches.items()} == {
        "wall": ("fixed", [2, 0])
    }
    assert mesh.global_ids.tolist() == [4, 5, 9]
    del arrays["global_ids"]
    np.savez(tmp_path / "whole.npz", **arrays)
    assert Mesh.load(str(tmp_path / "whole.npz"), {"wall": "fixed"}).global_ids is None
    with pytest.raises(InvalidInput, match=r"whole\.npz: there is no patch 'flag'; the mesh has \['wall'\]"):
        Mesh.load(tmp_path / "whole.npz", GIVEN)
    assert Mesh.load(tmp_path / "whole.npz", {"wall": "free"}).patches == {}
    for roles, hint in (
        ({"wal": "fixed"}, r"'wal' is not a patch: did you mean 'wall'\?"),
        ({}, "add 'wall': 'moving' or 'fixed', or 'free' to leave it out"),
    ):
        with pytest.raises(InvalidInput, match=rf"patch 'wall' has no role; .* \({hint}\)"):
            Mesh.load(tmp_path / "whole.npz", roles)


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"cells_triangle": [[0, 1, 2]]}, r"part.npz: expected 'points', .*got \['cells_triangle'\]"),
        ({"points": np.zeros((3, 2)), "roles": [1]}, r"got \['points', 'roles'\] \(mesh-motion convert"),
        ({"points": np.zeros((3, 2)), "patch_flap": [1]}, "patch 'flap' has no role; roles are given of .*flag"),
        (
            {"points": np.zeros((3, 2)), "cells_triangle": [[0, 1, 3]], "global_ids": [1, 2, 3]},
            "part.npz: cells of type triangle must name",
        ),
        ({"points": np.zeros((3, 2)), "global_ids": [1]}, "part.npz: global_ids must have one number for each point"),
        ({"points": np.array([{}], dtype=object)}, "part.npz: not readable as an .npz archive of plain arrays"),
    ],
)
def test_a_file_with_something_else_is_named(tmp_path, arrays, message):
    np.savez(tmp_path / "part.npz", **arrays)
    with pytest.raises(InvalidInput, match=message):
        Mesh.load(tmp_path / "part.npz", GIVEN)


def test_a_file_that_is_missing_or_none_is_named(tmp_path):
    (tmp_path / "text.npz").write_text("points")
    np.save(tmp_path / "points.npy", np.zeros(3))
    for name, message in (
        ("none.npz", "none.npz: cannot be read: No such file"),
        ("text.npz", "text.npz: not readable"),
        ("points.npy", "points.npy: unknown kind of mesh file"),
    ):
        with pytest.raises(InvalidInput, match=message):
            Mesh.load(tmp_path / name, GIVEN)


def test_a_small_file_that_would_fill_the_memory_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("mesh_motion_client.mesh._UNPACKED_BYTES", 1 << 20)
    np.savez_compressed(tmp_path / "m.npz", points=np.zeros((1 << 18, 2)))
    with pytest.raises(InvalidInput, match=r"m\.npz: \d+ bytes that hold \d+, expected at most"):
        Mesh.load(tmp_path / "m.npz", GIVEN)


def test_a_name_that_no_message_holds_is_refused_at_once() -> None:
    points, cells = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), {"triangle": np.array([[0, 1, 2]])}
    for name in ("a" * 256, "é" * 128):
        Mesh(points, cells, {name: Patch("moving", [0, 1, 2])})
    for name in ("a" * 257, "é" * 129, "a" * 10_000):
        with pytest.raises(InvalidInput, match=r"at most 256 bytes in UTF-8, got \d+: '\w{40}'") as caught:
            Mesh(points, cells, {name: Patch("moving", [0, 1, 2])})
        assert caught.value.hint == "give the patch a shorter name"
        assert len(str(caught.value)) < 200
