"""A session that needs more memory than its worker may use: other sessions continue."""

from typing import Any

import numpy as np
import pytest
from mesh_motion_client import Mesh, MeshMotionError, Patch, connect
from served import small_mesh

from tests.faults.waiting import wait_until


def strip(nodes: int) -> Mesh:
    """Two rows of nodes: nearly all of them are on the boundary, so a dense factorization is large."""
    x = np.linspace(0, 1, nodes)
    points = np.concatenate([np.stack([x, np.zeros(nodes)], axis=1), np.stack([x, np.full(nodes, 1 / nodes)], axis=1)])
    i = np.arange(nodes - 1)
    triangles = np.concatenate([np.stack([i, i + 1, i + nodes], 1), np.stack([i + 1, i + nodes + 1, i + nodes], 1)])
    return Mesh(
        points,
        {"triangle": triangles},
        {"lower": Patch("moving", np.arange(nodes)), "upper": Patch("fixed", np.arange(nodes, 2 * nodes))},
    )


@pytest.mark.slow
def test_a_session_beyond_its_workers_memory_is_refused_and_others_go_on(serve: Any) -> None:
    server = serve(real=True, worker_memory_bytes=256 << 20)
    mesh, greedy_mesh = small_mesh(), strip(5000)
    with connect(server.endpoint, timeout=90) as client:
        modest = client.open(mesh, {"support_radius": 1.0})
        rows = 0.01 * mesh.points[modest.moving_nodes]
        modest.move(rows)
        modest.commit()
        settings = {"support_radius": 1.0, "basis": "tps", "correction": "none"}  # 10 000 unknowns: 800 MB
        with client.open(greedy_mesh, settings) as greedy:
            with pytest.raises(MeshMotionError) as refused:
                greedy.move(np.zeros((len(greedy.moving_nodes), 2)) + 1e-6)
            assert refused.value.code == "RESOURCE_EXHAUSTED.MEMORY"
            assert greedy.status().state == "READY"  # nothing has changed
            np.testing.assert_array_equal(greedy.points(), greedy_mesh.points)
        modest.move(rows, frame="reference")
        assert modest.commit().step == 2
        modest.close()
    counted = ("refused_total", "RESOURCE_EXHAUSTED.MEMORY")
    wait_until(lambda: server.metrics().get(counted) == 1, "the refusal is counted")
    assert not [line for line in server.events("worker_ended") if line["code"] != 0]
