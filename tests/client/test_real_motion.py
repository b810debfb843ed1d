"""The whole server with its real numerics: killed again and again, it ends bitwise where an undisturbed run ends."""

import signal

import numpy as np
import pytest
from mesh_motion_client import InvalidInput, Mesh, Patch, Timeout, connect

from proofs.server_process import ServerProcess

STEPS, ITERATIONS = 4, 2


@pytest.fixture
def command_line_server(tmp_path):
    with ServerProcess(tmp_path) as server:
        yield server


def square(count=8):
    x = np.linspace(0, 1, count)
    points = np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2)
    i = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).ravel()
    quads = np.stack([i, i + 1, i + count + 1, i + count], axis=1)
    sides = {
        "flap": Patch("moving", np.arange(count)),
        "wall": Patch("fixed", np.arange(count * (count - 1), count**2)),
    }
    return Mesh(points, {"quad": quads}, sides)


def restart(server, how):
    server.stop(how)
    server.start()


def play(server, mesh, disturb):
    """Step, iterate, commit; ``disturb(session, step)`` between the last move and the commit."""
    replies = []
    with connect(server.endpoint, timeout=60) as client, client.open(mesh, {"support_radius": 2.0}) as session:
        x = mesh.points[session.moving_nodes, 0]
        for step in range(STEPS):
            for iteration in range(ITERATIONS):
                bend = 0.05 * np.sin(np.pi * x) * (1 + iteration) + 0.02 * step * x
                moved = session.move(np.stack([0.3 * bend, bend], axis=1))
            replies.append(moved.displacement)
            disturb(session, step)
            session.commit()
        return replies, session.points(), session.step


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


@pytest.mark.nightly
def test_killed_again_and_again_it_ends_where_an_undisturbed_run_ends(command_line_server):
    server, mesh = command_line_server, square()
    replies, points, _ = play(server, mesh, lambda session, step: None)
    disturbances = [
        lambda session: server.kill_worker(session.credentials.session),
        lambda session: restart(server, signal.SIGKILL),
        lambda session: restart(server, signal.SIGTERM),
        lambda session: None,
    ]
    again, points_again, steps = play(server, mesh, lambda session, step: disturbances[step](session))
    assert steps == STEPS
    assert [r.tobytes() for r in again] == [r.tobytes() for r in replies]
    assert points_again.tobytes() == points.tobytes()
