"""TANGENT and COTANGENT with the real numerics: any number of partitions, nothing changed, wrong input refused."""

from typing import Any

import numpy as np
import pytest
from mesh_motion_protocol.messages import Commit, Cotangent, ErrorReply, Move, Tangent
from real_sessions import boxed, bulge, new_session

from mesh_motion_server.service.dispatch import SessionHost
from tests.faults.driver import SESSION, TOKEN
from tests.faults.stand_in import split_mesh


def asked(driver: Any, kind: Any, name: str, rows: list[np.ndarray], what: str = "trial") -> list[Any]:
    return [
        reply
        for partition, values in enumerate(rows)
        for reply in driver.send(driver.request(kind, partition, what=what, **{name: values}))
    ]


def velocities(driver: Any) -> list[np.ndarray]:
    """Two vectors of each partition's moving nodes."""
    places = [mesh.points[own] for mesh, own in zip(driver.meshes, driver.moving, strict=True)]
    return [np.hstack([np.sin(5.0 * x + 1.0), np.cos(3.0 * x[:, ::-1])]) for x in places]


@pytest.fixture
def whole(store: Any) -> Any:
    driver = new_session(store, [boxed(12)], support_radius=0.8)
    assert driver.open()[0].derivatives
    driver.all(Move, bulge(driver, 0.15), step=1)
    yield driver
    driver.host.close()


def test_partitions_get_what_one_gets(store: Any, whole: Any) -> None:
    many = new_session(store, split_mesh(boxed(12), 3), "3" * 32, support_radius=0.8)
    assert many.open()[0].derivatives
    many.all(Move, bulge(many, 0.15), step=1)
    (one,) = asked(whole, Tangent, "velocity", velocities(whole))
    parts = asked(many, Tangent, "velocity", velocities(many))
    assert (one.step, one.iteration) == (0, 1)
    for part, mesh in zip(parts, many.meshes, strict=True):
        np.testing.assert_allclose(part.velocity, one.velocity[mesh.global_ids], rtol=0, atol=1e-12)
    # the weights of a node that several partitions hold are divided among them
    holders = np.bincount(np.concatenate([mesh.global_ids for mesh in many.meshes]))
    weights = np.sin(7.0 * whole.meshes[0].points)
    (one,) = asked(whole, Cotangent, "weights", [weights])
    shares = [(weights / holders[:, None])[mesh.global_ids] for mesh in many.meshes]
    place = {int(node): row for row, node in enumerate(whole.moving[0])}
    for part, mesh, own in zip(asked(many, Cotangent, "weights", shares), many.meshes, many.moving, strict=True):
        rows = [place[int(node)] for node in mesh.global_ids[own]]
        np.testing.assert_allclose(part.weights, one.weights[rows], rtol=0, atol=1e-12)
    many.host.close()


def test_a_committed_state_has_the_derivative_of_its_trial_also_when_resumed(store: Any, whole: Any) -> None:
    (trial,) = asked(whole, Tangent, "velocity", velocities(whole))
    whole.all(Commit, step=1)
    (committed,) = asked(whole, Tangent, "velocity", velocities(whole), "committed")
    whole.host.close()
    whole.host = SessionHost.resume(SESSION, TOKEN, store)
    whole.join()
    (resumed,) = asked(whole, Tangent, "velocity", velocities(whole), "committed")
    assert trial.velocity.tobytes() == committed.velocity.tobytes() == resumed.velocity.tobytes()
    assert committed.iteration == 0
    (refused,) = asked(whole, Tangent, "velocity", velocities(whole))
    assert (refused.code, refused.retryable) == ("ABORTED.TRIAL_LOST", False)


def test_wrong_rows_are_refused_by_the_first_of_them(whole: Any) -> None:
    good = velocities(whole)[0]
    (refused,) = asked(whole, Tangent, "velocity", [good[:, :3]])
    assert refused.code == "INVALID_ARGUMENT.SHAPE"
    assert "(12, 2 c)" in refused.message
    good[3, 1] = np.nan
    (refused,) = asked(whole, Tangent, "velocity", [good])
    assert refused.code == "INVALID_ARGUMENT.NONFINITE"
    assert refused.details["node"] == whole.moving[0][3]
    good[3, 1], good[5, 0] = 0.0, 1e300  # their products with the derivative overflow
    (refused,) = asked(whole, Tangent, "velocity", [good])
    assert (refused.code, refused.details["node"]) == ("INVALID_ARGUMENT.VALUE", whole.moving[0][5])
    (refused,) = asked(whole, Cotangent, "weights", [np.full((144, 2), -1e76)])
    assert "row 0 (node 0): component 0 is -1e+76, expected at most 1e+75" in refused.message
    good[5, 0] = 1e75
    (found,) = asked(whole, Tangent, "velocity", [good])
    assert np.isfinite(found.velocity).all()


def test_partitions_that_disagree_are_refused(store: Any) -> None:
    driver = new_session(store, split_mesh(boxed(12), 3), "5" * 32, support_radius=0.8)
    driver.open()
    rows = velocities(driver)
    rows[1] = rows[1] + 1e-3
    refused = asked(driver, Tangent, "velocity", rows, "committed")
    assert {reply.code for reply in refused} == {"INVALID_ARGUMENT.PARTITION"}
    driver.host.close()


@pytest.mark.parametrize("kind", [Tangent, Cotangent])
def test_partitions_that_give_different_numbers_of_vectors_are_refused(store: Any, kind: Any) -> None:
    driver = new_session(store, split_mesh(boxed(12), 2), "7" * 32, support_radius=0.8)
    driver.open()
    name = "velocity" if kind is Tangent else "weights"
    rows = velocities(driver) if kind is Tangent else [np.ones((len(mesh.points), 4)) for mesh in driver.meshes]
    refused = asked(driver, kind, name, [rows[0], rows[1][:, :2]], "committed")
    assert [reply.code for reply in refused] == ["INVALID_ARGUMENT.PARTITION"] * 2
    assert "columns 4, partition 1 for" in refused[0].message
    assert all(type(reply) is not ErrorReply for reply in asked(driver, kind, name, rows, "committed"))
    driver.host.close()
