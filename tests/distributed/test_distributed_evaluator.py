"""Moves with partitions on worker processes: the same answers as on one machine, and what travels for them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from distributed_cases import MESHES, assert_same, distributed_model, local_model, waypoints
from worker_processes import connected

from mesh_motion_server.numerics.method import Method
from mesh_motion_server.session.factors import FactorCache

METHODS = {
    "relative": Method(support_radius=2.0, correction="none"),
    "absolute": Method(support_radius=2.0, correction="none", displacement="absolute"),
    "re-anchored": Method(support_radius=2.0, correction="none", displacement="reanchored"),
    "two scales": Method(support_radius=2.0, correction="none"),
    "corrected": Method(support_radius=2.0, quality_threshold=0.75),
    "reduced": Method(support_radius=2.0, correction="none", reduction="multilevel-subspace"),
    "layer": Method(support_radius=2.0, correction="none", boundary_layer_thickness=0.05),
}


@pytest.mark.parametrize("mesh", MESHES)
@pytest.mark.parametrize("method", METHODS)
def test_every_step_is_that_of_one_machine(
    cluster: Any, mesh: str, method: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if method == "two scales":
        monkeypatch.setattr("mesh_motion_server.numerics.interpolation.two_scale.plans.AUTOMATIC_FROM", 0)
    body, chosen = MESHES[mesh](), METHODS[method]
    local, here = local_model(body, chosen), body.points
    with connected(cluster) as connection:
        distributed = distributed_model(body, chosen, connection)
        there = here
        for targets in waypoints(body):
            expected, found = local.move(here, targets), distributed.move(there, targets)
            assert_same(found, expected)
            here, there = expected.points, found.points
        distributed.close()


def test_only_the_boundary_and_the_answer_travel(cluster: Any) -> None:
    body = MESHES["cube"]()
    with connected(cluster) as connection:
        model = distributed_model(body, METHODS["relative"], connection)
        here, factors = body.points, FactorCache(1 << 28)
        for step, targets in enumerate(waypoints(body)):
            before = model.evaluator.crew.traffic.copy()
            motion = model.move(here, targets, factors)
            wire = model.evaluator.crew.traffic.since(before)
            here = motion.points
            assert motion.caches["bytes_to_workers"] == wire.sent.total()
            assert motion.caches["bytes_from_workers"] == wire.received.total()
            if step:
                boundary = np.count_nonzero(body.held)
                assert wire.sent["mesh"] == 0
                assert wire.sent["coefficients"] < 3 * 70 * boundary
                assert wire.sent["positions"] < 2 * 32 * boundary + 1000
                assert wire.received["displacements"] < 24 * len(here) + 200
        model.close()


def test_an_iteration_and_a_rollback_send_no_positions_again(cluster: Any) -> None:
    body = MESHES["cube"]()
    local = local_model(body, METHODS["relative"])
    first, second, third = waypoints(body)
    with connected(cluster) as connection:
        model = distributed_model(body, METHODS["relative"], connection)
        committed = model.move(body.points, first).points
        model.move(committed, second)
        before = model.evaluator.crew.traffic.copy()
        assert_same(model.move(committed, third), local.move(committed, third))
        assert model.evaluator.crew.traffic.since(before).sent["coefficients"] < 3 * 70 * np.count_nonzero(body.held)
        assert_same(model.move(body.points, first), local.move(body.points, first))
        model.close()


def test_positions_that_their_owner_changes_later_are_not_taken_for_known(cluster: Any) -> None:
    body = MESHES["cube"]()
    with connected(cluster) as connection:
        model = distributed_model(body, METHODS["relative"], connection)
        points = body.points.copy()
        points[np.flatnonzero(~body.held)[:50]] += 1e-3
        model.summary(points)
        points[np.flatnonzero(~body.held)[50:90]] -= 2e-3
        assert model.summary(points).worst == local_model(body, METHODS["relative"]).summary(points).worst
        model.close()


def test_two_sessions_share_the_workers_and_free_them(cluster: Any) -> None:
    body, other = MESHES["cube"](), MESHES["block"]()
    with connected(cluster) as one, connected(cluster) as two, connected(cluster) as watching:
        models = [distributed_model(body, METHODS["relative"], one), distributed_model(other, METHODS["absolute"], two)]
        for model, mesh in zip(models, (body, other), strict=True):
            targets = next(waypoints(mesh))
            assert_same(model.move(mesh.points, targets), local_model(mesh, model.method).move(mesh.points, targets))
        assert len(_held(watching)) == 6
        models[0].close()
        assert len(_held(watching)) == 3
        models[1].close()
        assert not _held(watching)


def _held(connection: Any) -> set[str]:
    """What lies on the workers once they have been told of what nobody wants."""
    client = connection.client()
    client.run(lambda: None)
    return {key for keys in client.has_what().values() for key in keys if key.startswith("mesh-motion-")}


def test_small_meshes_are_not_cut_into_crumbs(cluster: Any) -> None:
    with connected(cluster) as connection:
        model = distributed_model(MESHES["block"](), METHODS["relative"], connection, partitions=None)
        model.summary(model.model.points)
        assert model.evaluator.partitions == 1
        model.close()
