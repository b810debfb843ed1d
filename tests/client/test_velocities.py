"""Velocities and swept volumes through the client, and through the asynchronous client."""

import numpy as np
import pytest
from client_square import bulge, square
from mesh_motion_client import InvalidInput, connect

TIMES = (1.0, 1.25, 1.5, 2.5)


@pytest.fixture(scope="module")
def server():
    with connect() as opened:
        yield opened


@pytest.fixture
def session(server):
    with server.open(square(), time=TIMES[0], time_levels="bdf2") as opened:
        yield opened


def test_times_and_velocities_through_a_resume(server, session):
    assert session.time == TIMES[0]
    x = [session.points()]
    for step in (1, 2):
        moved = session.move(bulge(0.1 * step), time=TIMES[step], velocity="bdf2")
        session.commit()
        assert session.time == TIMES[step]
        x.append(session.points())
    np.testing.assert_allclose(moved.velocity, (1.5 * x[2] - 2.0 * x[1] + 0.5 * x[0]) / 0.25, atol=1e-12)
    before = session.move(bulge(0.3), time=TIMES[3], velocity="bdf2").velocity
    session.close("keep")
    with server.resume(session.credentials) as again:
        assert again.time == TIMES[2]
        assert (again.move({"left": bulge(0.3)}, time=TIMES[3], velocity="bdf2").velocity == before).all()
        again.commit(time=TIMES[3])
        assert again.time == TIMES[3]
        again.close("discard")


def test_a_tangent_with_the_move_is_that_of_the_trial(session):
    v = bulge(1.0)
    moved = session.move(bulge(0.1), velocity="tangent", boundary_velocity={"left": v})
    assert (moved.velocity == moved.tangent(v)).all()


def test_swept_volumes_by_cells_and_of_faces(session):
    mesh = square()
    moved = session.move(bulge(0.2), report="swept")
    swept = moved.swept_of_cells()["quad"]
    change = quad_areas((mesh.points + moved.displacement)[mesh.cells["quad"]]) - quad_areas(
        mesh.points[mesh.cells["quad"]]
    )
    np.testing.assert_allclose(swept.sum(axis=1), change, rtol=0, atol=1e-16)
    left = mesh.cells["quad"][:8, [3, 0]]
    one = session.move(bulge(0.2), report="swept", swept_faces=left)
    assert (one.swept == swept[:8, 3]).all()
    with pytest.raises(InvalidInput, match="without swept_faces"):
        one.swept_of_cells()
    with pytest.raises(InvalidInput, match="row 0: column 1 is 900"):
        session.move(bulge(0.2), report="swept", swept_faces=[[0, 900]])


def quad_areas(x):
    a, b = x[:, 2] - x[:, 0], x[:, 3] - x[:, 1]
    return 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
