"""A boundary layer in a mesh of two partitions, over the wire: carried as in one mesh."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import mesh_motion_client as client
import numpy as np
from frame_meshes import rotation, square_frame

from mesh_motion_server.numerics.method import Method
from mesh_motion_server.numerics.motion import MotionModel

SETTINGS = {"support_radius": 0.5, "displacement": "absolute", "boundary_layer_thickness": 0.08}


def part(chosen: np.ndarray) -> client.Mesh:
    """The chosen cells with their nodes, numbered locally."""
    points, cells, patches = square_frame(30, kind="quad")
    (block,) = cells
    ids = np.unique(block.nodes[chosen])
    local = np.full(len(points), -1)
    local[ids] = np.arange(len(ids))
    own = {name: client.Patch(p.role, local[np.intersect1d(p.nodes, ids)]) for name, p in patches.items()}
    return client.Mesh(points[ids], {"quad": local[block.nodes[chosen]]}, own, global_ids=ids)


def test_a_layer_across_partitions_moves_as_in_one_mesh() -> None:
    points, cells, patches = square_frame(30, kind="quad")
    model = MotionModel.build(points, cells, patches, Method(**SETTINGS))
    goal = (points - 0.5) @ rotation(15.0).T + 0.5
    expected = model.move(points, goal[model.roles.moving])
    assert expected.correction.method == "none"
    low = np.arange(len(cells)) < len(cells) // 2
    parts = [part(low), part(~low)]

    def drive(rank: int, session) -> np.ndarray:
        with session:
            own = parts[rank].global_ids[session.moving_nodes]
            session.move(goal[own] - points[own])
            session.commit()
            return np.asarray(session.points())

    with client.connect() as server, client.connect(server.endpoint) as second, ThreadPoolExecutor(2) as pool:
        joined = []

        def announce(credentials) -> None:
            joined.append(pool.submit(lambda: drive(1, second.join(credentials, parts[1], partition=1))))

        pieces = [drive(0, server.open(parts[0], SETTINGS, partitions=2, announce=announce))]
        pieces.append(joined[0].result(60))
    found = np.empty_like(points)
    for piece, place in zip(parts, pieces, strict=True):
        found[piece.global_ids] = place
    np.testing.assert_allclose(found, expected.points, atol=1e-12)
    layer = model.standard_motion.layer
    assert layer is not None
    np.testing.assert_allclose(found[layer.nodes], goal[layer.nodes], atol=1e-12)
