"""A periodic mesh in two partitions over the wire: a pair's nodes may be on different ranks."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import mesh_motion_client as client
import numpy as np
import pytest
from periodic_meshes import periodic_box, sector

from mesh_motion_server.numerics.method import Method
from mesh_motion_server.numerics.motion import MotionModel

SETTINGS = {"support_radius": 0.8, "displacement": "absolute", "correction_target": "maximum"}


def part(mesh, chosen: np.ndarray) -> client.Mesh:
    """The chosen cells with their nodes, numbered locally."""
    points, cells, patches = mesh
    (block,) = cells
    ids = np.unique(block.nodes[chosen])
    local = np.full(len(points), -1)
    local[ids] = np.arange(len(ids))
    own = {name: client.Patch(p.role, local[np.intersect1d(p.nodes, ids)]) for name, p in patches.items()}
    own = {name: p for name, p in own.items() if len(p.nodes)}
    return client.Mesh(points[ids], {block.type.name: local[block.nodes[chosen]]}, own, global_ids=ids)


@pytest.mark.parametrize(("make", "threshold"), [(periodic_box, 0.8), (sector, 0.2)])
def test_pairs_across_partitions_move_as_in_one_mesh(make, threshold: float) -> None:
    mesh, settings = make("quad", 10, ends="slip"), {**SETTINGS, "quality_threshold": threshold}
    model = MotionModel.build(*mesh, Method(**settings))
    shift = np.array([0.1, 0.25])
    expected = model.move(mesh[0], mesh[0][model.roles.moving] + shift).points
    low = np.arange(len(mesh[1])) < len(mesh[1]) // 2
    parts = [part(mesh, low), part(mesh, ~low)]

    def drive(rank: int, session) -> np.ndarray:
        with session:
            session.move(np.tile(shift, (len(session.moving_nodes), 1)))
            session.commit()
            return np.asarray(session.points())

    with client.connect() as server, client.connect(server.endpoint) as second, ThreadPoolExecutor(2) as pool:
        joined = []

        def announce(credentials) -> None:
            joined.append(pool.submit(lambda: drive(1, second.join(credentials, parts[1], partition=1))))

        first = drive(0, server.open(parts[0], settings, partitions=2, announce=announce))
        pieces = [first, joined[0].result(60)]
    found = np.empty_like(mesh[0])
    for piece, place in zip(parts, pieces, strict=True):
        found[piece.global_ids] = place
    # the mesh is merged in another order of its cells, and a descent ends where little is gained
    np.testing.assert_allclose(found, expected, atol=1e-12 if threshold == 0.2 else 1e-3)
    periodic = model.standard_motion.periodic
    assert periodic is not None
    assert np.abs(periodic.tied(found, model.roles.moving) - found).max() <= 1e-15
