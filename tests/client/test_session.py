"""A session through real sockets: the calls of a driver, and its errors."""

import os
import signal
from functools import partial

import numpy as np
import pytest
from mesh_motion_client import InvalidInput, Mesh, Patch, QualityRefused, Timeout, connect
from mesh_motion_protocol.digests import state_digest

from tests.faults.waiting import wait_until

UP = np.array([[0.0, 0.25]] * 4)


def test_open_says_what_is_needed(session):
    assert session.moving_nodes.tolist() == [0, 4, 8, 12]
    assert (session.step, session.iteration, session.dimension) == (0, 0, 2)
    assert session.settings["support_radius"] == 1.0
    assert session.mesh_report["nodes"] == 16


def test_move_and_commit(session, mesh):
    moved = session.move(UP)
    assert moved.displacement.tolist() == [[0.0, 0.25]] * 16
    assert (moved.step, moved.iteration, session.iteration) == (1, 1, 1)
    assert moved.warnings == ["a warning"]
    assert set(moved.quality) == {"metric", "threshold", "standard", "corrected"}
    committed = session.commit()
    assert (committed.step, committed.durable_step, session.step, session.iteration) == (1, 1, 1, 0)
    assert (session.points() == mesh.points + moved.displacement).all()
    assert (session.points("reference") == mesh.points).all()
    assert committed.digest == state_digest(1, session.points())


def test_displacements_by_patch(session):
    assert session.move({"left": UP}).displacement.tolist() == [[0.0, 0.25]] * 16
    with pytest.raises(InvalidInput, match=r"must name the moving patches \['left'\], got \['right'\] \(or give rows"):
        session.move({"right": UP})
    with pytest.raises(InvalidInput, match=r"got \['lefd'\] \(did you mean 'left'\?\)"):
        session.move({"lefd": UP})
    with pytest.raises(InvalidInput, match=r"patch 'left' must have shape \(4, 2\), got \(3, 2\)"):
        session.move({"left": UP[:3]})


def two_patches(mesh):
    """The moving side as two patches that share a node and move it to different positions."""
    patches = {name: patch for name, patch in mesh.patches.items() if name != "left"}
    patches |= {"low": Patch("moving", [4, 0]), "high": Patch("moving", [12, 4, 8])}
    return Mesh(mesh.points, mesh.cells, patches)


def test_two_patches_may_differ_by_a_rounding_where_they_meet(client, mesh):
    low, high = np.array([[0.1, 0.2], [0.3, 0.4]]), np.array([[0.5, 0.6], [np.nextafter(0.1, 1), 0.2], [0.7, 0.8]])
    with client.open(two_patches(mesh)) as session:
        rows = session.move({"low": low, "high": high}).displacement[session.moving_nodes]
        assert rows.tobytes() == session.move({"high": high, "low": low}).displacement[session.moving_nodes].tobytes()
        assert rows.tolist() == [[0.3, 0.4], [np.nextafter(0.1, 1), 0.2], [0.7, 0.8], [0.5, 0.6]]
        high[1, 0] = 0.1 + 0.8e-7  # the mesh is 0.75 wide
        words = r"node 4 lies on the patches 'low' and 'high', which move it to different places: by \[0.1, 0.2\] and "
        with pytest.raises(InvalidInput, match=words):
            session.move({"low": low, "high": high})
        session.close("discard")


def test_a_resumed_session_knows_its_patches(server, client, mesh):
    first = client.open(two_patches(mesh))
    rows = {"low": np.array([[0.1, 0.2], [0.3, 0.4]]), "high": np.array([[0.5, 0.6], [0.1 + 7e-10, 0.2], [0.7, 0.8]])}
    moved = first.move(rows).displacement.tobytes()
    first.leave()
    os.kill(server.worker_of(first.credentials.session), signal.SIGKILL)  # the next one has the journal only
    resumed = client.resume(first.credentials)
    assert resumed.move(rows).displacement.tobytes() == moved
    with pytest.raises(InvalidInput, match=r"must name the moving patches \['high', 'low'\], got \['left'\]"):
        resumed.move({"left": UP})
    resumed.close("discard")


def test_a_refused_motion_says_how_far_one_can_go(session):
    with pytest.raises(QualityRefused, match="too far") as caught:
        session.move(1000 * UP)
    error = caught.value
    assert (error.best, error.fraction, error.hint) == (-0.5, 0.25, "move less")
    assert [set(cell) for cell in error.worst] == [{"partition", "type", "cell"}] * 2
    assert session.move(UP).iteration == 1


def test_the_caller_may_reuse_its_array(session):
    displacements = UP.copy()
    moved = session.move(displacements)
    displacements[:] = 7.0
    assert session.commit().step == 1
    assert moved.displacement[0, 1] == 0.25


def test_a_closed_session_is_kept_or_discarded(server, client, mesh):
    kept, dropped = client.open(mesh), client.open(mesh)
    kept.close()
    kept.close()
    dropped.close("discard")

    def known():
        return {entry["session"] for entry in client.sessions()}

    wait_until(lambda: dropped.credentials.session not in known(), "the discarded one is gone")
    assert kept.credentials.session in known()


def test_wrong_settings_name_the_key(client, mesh):
    def known():
        return {entry["session"] for entry in client.sessions()}

    before = known()
    with pytest.raises(InvalidInput, match="unknown setting 'radius'"):
        client.open(mesh, {"radius": 1.0})
    with pytest.raises(InvalidInput, match="support_radius"):
        client.open(mesh, {"support_radius": -1.0})
    with pytest.raises(InvalidInput, match=r"settings must be a dict, .* got list \(as"):
        client.open(mesh, ["support_radius"])
    assert known() <= before  # sessions of earlier tests may still come to rest, or go


def test_things_of_another_kind_are_named_with_what_to_give(client):
    with pytest.raises(InvalidInput, match=r"mesh must be a Mesh, got str \(.*Mesh.load"):
        client.open("mesh.npz")
    for call in (client.resume, partial(client.join, partition=0)):
        with pytest.raises(InvalidInput, match=r"credentials must be Credentials, got str \(.*Credentials.load"):
            call("mesh-motion.session")
    with pytest.raises(InvalidInput, match="timeout must be a number of seconds, got '2'"):
        connect("tcp://127.0.0.1:1", timeout="2")
    with pytest.raises(InvalidInput, match="compute_timeout must be a number of seconds, got nan"):
        connect("tcp://127.0.0.1:1", compute_timeout=float("nan"))


def test_an_error_inside_the_block_is_not_hidden(client, mesh):
    with pytest.raises(ZeroDivisionError), client.open(mesh) as session:
        session.move(UP / (1 // 0))
    assert session.credentials.session


def test_sessions_in_1d_and_3d(client):
    line = Mesh(
        np.arange(5.0),
        {"line": np.stack([np.arange(4), np.arange(1, 5)], axis=1)},
        {"end": Patch("moving", [0]), "wall": Patch("fixed", [4])},
    )
    with client.open(line) as session:
        assert session.move(np.array([0.5])).displacement.shape == (5, 1)
    cube = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
    tetra = Mesh(cube, {"tetra": [[0, 1, 2, 3]]}, {"tip": Patch("moving", [3]), "base": Patch("fixed", [0, 1, 2])})
    with client.open(tetra) as session:
        assert session.move([[0.0, 0.0, 0.5]]).displacement.shape == (4, 3)


def square(count):
    x = np.linspace(0, 1, count)
    points = np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2)
    i = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).ravel()
    quads = np.stack([i, i + 1, i + count + 1, i + count], axis=1)
    sides = {
        "flap": Patch("moving", np.arange(count)),
        "wall": Patch("fixed", np.arange(count * (count - 1), count**2)),
    }
    return Mesh(points, {"quad": quads}, sides)


def test_the_caller_limits_the_computing():
    mesh = square(24)
    with connect() as client, client.open(mesh, {"support_radius": 2.0}) as session:
        x = mesh.points[session.moving_nodes, 0]
        bump = np.stack([0 * x, 0.95 * np.sin(np.pi * x)], axis=1)  # takes a correction, 30 times the limit
        with pytest.raises(Timeout, match=r"within the 0\.001 s"):
            session.move(bump, compute_limit=0.001)
        assert session.iteration == 0
        with pytest.raises(InvalidInput, match="compute_limit"):
            session.move(bump, compute_limit=-1.0)
        session.move(bump)
        assert session.iteration == 1
