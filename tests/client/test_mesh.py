"""Meshes are checked before anything is sent."""

import numpy as np
import pytest
from mesh_motion_client import InvalidInput, Mesh, Patch
from mesh_motion_client.mesh import CELL_NODES, ROLES

from mesh_motion_server.numerics.mesh.cells import CELL_TYPES
from mesh_motion_server.numerics.mesh.roles import ROLES as SERVER_ROLES

POINTS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
AT = {"session": "s", "epoch": 1}


def test_cell_types_and_roles_are_the_servers():
    assert {name: kind.n_nodes for name, kind in CELL_TYPES.items()} == CELL_NODES
    assert ROLES == SERVER_ROLES


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Mesh(np.zeros((0, 2)), {}), "with n > 0"),
        (lambda: Mesh(np.zeros((2, 2, 2)), {}), "must be a table"),
        (lambda: Mesh("x", {}), "points must be numbers"),
        (lambda: Mesh(POINTS, {}, global_ids=[1, 2]), "one number a point, got 2 for 3 points"),
    ],
)
def test_what_is_wrong_is_named(build, message):
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
