"""The tutorial case, a 2D mesh: the Python client's result, ranks, restarts, faults.

The case that adapters/openfoam/README.md begins with.
"""

import os
import re
import shutil
import signal
import time

import numpy as np
import pytest
from mesh_motion_client import Mesh, Patch, connect
from scipy.spatial import cKDTree

from mesh_motion_server.security.key_folder import admit, make_client_keys, make_server_keys
from tests.faults.server_process import ServerProcess

PATIENCE = 240.0
STEP, AMPLITUDE, ORIGIN = 0.05, 0.7, np.array([0.85, 0.5])


def plane_of(case):
    """The front plane as a mesh for the Python client; its points, and those of the back plane."""
    points, faces = case.numbers("constant/polyMesh/points", 3), case.faces()
    front, back = np.flatnonzero(points[:, 2] > 0.05), np.flatnonzero(points[:, 2] < 0.05)
    behind = back[cKDTree(points[back, :2]).query(points[front, :2])[1]]
    number = dict(zip(front.tolist(), range(len(front)), strict=True))
    quads = [[number[p] for p in faces[i]] for i in case.patch("frontAndBack") if faces[i][0] in number]
    roles = {"plate": "moving", "inlet": "fixed", "outlet": "fixed", "walls": "slip"}
    patches = {
        name: Patch(role, np.unique([number[p] for i in case.patch(name) for p in faces[i] if p in number]))
        for name, role in roles.items()
    }
    return Mesh(points[front, :2], {"quad": np.array(quads)}, patches), front, behind


def turned(points, moment):
    """Positions that the boundary condition gives to points of the plate."""
    angle = AMPLITUDE * np.sin(2 * np.pi * moment)
    matrix = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return (points - ORIGIN) @ matrix.T + ORIGIN - points


def test_the_mesh_is_that_of_the_python_client(make_case, mesh_motion_server):
    case = make_case()
    case.method("correction_target threshold;")  # a descent towards the shape at rest multiplies rounding by a hundred
    output = case.run("moveDynamicMesh")
    assert output.count("iteration 3: least quality") == 4  # the outer correctors of PIMPLE
    mesh, front, behind = plane_of(case)
    with (
        connect(mesh_motion_server.endpoint) as server,
        server.open(mesh, {"correction_target": "threshold"}) as session,
    ):
        start = mesh.points[session.moving_nodes]
        for step in range(1, 5):
            for _ in range(3):
                session.move(turned(start, step * STEP), frame="reference")
            session.commit()
            if step % 2 == 0:
                moved = case.points(f"{step * STEP:g}")
                np.testing.assert_allclose(moved[front, :2], session.points(), rtol=0, atol=1e-11)
                np.testing.assert_allclose(moved[front, :2], moved[behind, :2], rtol=0, atol=1e-14)
                assert np.ptp(moved[front, 2]) < 1e-15
        session.close("discard")
    displacement = case.numbers("0.2/pointDisplacement", 3)
    start = case.numbers("constant/polyMesh/points", 3)
    np.testing.assert_allclose(start + displacement, case.points("0.2"), rtol=0, atol=1e-14)


def test_two_ranks_move_the_mesh_as_one(make_case):
    serial, parallel = make_case("serial", steps=2), make_case("parallel", steps=2)
    serial.run("moveDynamicMesh")
    parallel.run("decomposePar")
    parallel.run("moveDynamicMesh", ranks=2)
    parallel.check_ranks("0.1", serial.points("0.1"))


def test_a_quadrilateral_with_a_concave_corner_is_judged_in_triangles(make_case):
    """Like some faces of snappyHexMesh: a point crosses a diagonal of a neighbouring face."""
    serial, parallel = make_case("serial", steps=2), make_case("parallel", steps=2)
    for case in (serial, parallel):
        points, faces = case.numbers("constant/polyMesh/points", 3), case.faces()
        plane = [faces[i] for i in case.patch("frontAndBack") if points[faces[i][0], 2] > 0.05]
        corners = points[min(plane, key=lambda face: np.abs(points[face, :2].mean(axis=0) - [1.5, 0.2]).sum()), :2]
        moved = np.linalg.norm(points[:, :2] - corners[0], axis=1) < 1e-9
        points[moved, :2] += 0.6 * (corners[2] - corners[0])
        path = case.folder / "constant/polyMesh/points"
        head = path.read_text().partition(f"\n{len(points)}\n")[0]
        rows = "\n".join(f"({x!r} {y!r} {z!r})" for x, y, z in points.tolist())
        path.write_text(f"{head}\n{len(points)}\n(\n{rows}\n)\n")
    serial.run("moveDynamicMesh")
    parallel.run("decomposePar")
    parallel.run("moveDynamicMesh", ranks=2)
    parallel.check_ranks("0.1", serial.points("0.1"))


def test_pimple_foam_with_outer_correctors(make_case):
    case = make_case(steps=2)
    case.set("system/controlDict", deltaT="0.01", endTime="0.02")
    output = case.run("pimpleFoam")
    assert re.findall(r"step (\d), iteration (\d)", output) == [(s, i) for s in "12" for i in "123"]
    case.run("checkMesh", "-latestTime")
    assert "Mesh OK." in case.output


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kept", "ranks"),
    [(False, 1), pytest.param(True, 1, marks=pytest.mark.nightly), pytest.param(True, 2, marks=pytest.mark.nightly)],
)
def test_a_restart_goes_on_as_if_it_had_not_been(make_case, kept, ranks):
    whole, parts = make_case("whole"), make_case("parts")
    # without enrichment and with a radius given, a session that begins with the deformed mesh goes the same way
    for case in (whole, parts):
        case.method("correction none; support_radius 0.5;")
        case.set("system/controlDict", writePrecision="17")
    whole.run("moveDynamicMesh")
    parts.set("system/controlDict", endTime="0.1")
    if ranks == 2:
        parts.run("decomposePar")
    parts.run("moveDynamicMesh", ranks=ranks)
    master = parts.folder / ("processor0" if ranks == 2 else ".")
    credentials = master / "0.1/uniform/remoteMeshMotion/credentials"
    assert credentials.stat().st_mode & 0o777 == 0o600
    if not kept:
        shutil.rmtree(credentials.parent)
    parts.set("system/controlDict", endTime="0.2")
    output = parts.run("moveDynamicMesh", ranks=ranks)
    assert ("goes on after step 2" in output) == kept
    assert ("a new session" in output) != kept
    if ranks == 2:
        parts.check_ranks("0.2", whole.points("0.2"))
    else:
        # a kept session is the same to the bit, OpenFOAM's time and boundary condition only to rounding
        allowed = 1e-14 if kept else 1e-12
        np.testing.assert_allclose(parts.points("0.2"), whole.points("0.2"), rtol=0, atol=allowed)


@pytest.mark.nightly
def test_a_restart_from_an_earlier_time_begins_a_new_session(make_case):
    case = make_case()
    case.run("moveDynamicMesh")
    shutil.rmtree(case.folder / "0.2")
    output = case.run("moveDynamicMesh")
    assert "cannot be resumed: it has continued since" in output
    assert "a new session" in output
    case.run("checkMesh", "-latestTime")
    assert "Mesh OK." in case.output
    (case.folder / "0.2/uniform/remoteMeshMotion/credentials").unlink()
    assert "its credentials were deleted" in case.run("moveDynamicMesh")


@pytest.mark.parametrize(
    ("was", "becomes", "words"),
    [
        ("plate   moving;", "plat    moving;", ["there is no patch plat", "(plate inlet outlet walls frontAndBack)"]),
        ("walls   slip;", "", ["patch walls has no role", "moving fixed slip"]),
        ("walls   slip;", "walls sliding;", ["patch walls of type wall cannot have the role sliding"]),
        ("plate   moving;", "plate fixed;", ["no patch has the role moving"]),
        ("walls   slip;", "walls moving;", ["patch walls has the role moving, but its boundary condition slip"]),
        ("inlet   fixed;", "inlet fixed; frontAndBack slip;", ["frontAndBack of type empty cannot have the role slip"]),
        ("quality_threshold 0.3;", "quality_treshold 0.3;", ["quality_treshold", "hint"]),
    ],
)
def test_faults_of_the_dictionary_are_named(make_case, was, becomes, words):
    case = make_case()
    path = case.folder / "constant" / "dynamicMeshDict"
    assert was in path.read_text()
    path.write_text(path.read_text().replace(was, becomes))
    case.run("moveDynamicMesh", expect=1)
    assert "FOAM FATAL" in case.output
    for word in words:
        assert word in case.output


def test_a_motion_that_is_refused(make_case):
    case = make_case()
    case.set("0/pointDisplacement", amplitude="3", omega="31.4")
    case.method("correction none; sub_steps never;")
    case.run("moveDynamicMesh", expect=1)
    assert "FOAM FATAL ERROR" in case.output
    assert "FAILED_PRECONDITION.QUALITY" in case.output
    assert re.search(r"worst cells: \d+", case.output)
    assert "% of the displacement would be acceptable" in case.output


def test_a_server_that_is_not_there(make_case, tmp_path):
    case = make_case(endpoint=f"ipc://{tmp_path}/no-server")
    case.method("", "timeout 1;")
    case.run("moveDynamicMesh", expect=1)
    assert "FOAM FATAL ERROR" in case.output
    assert "no server answers at ipc://" in case.output


@pytest.mark.slow
@pytest.mark.parametrize(
    ("waits", "ranks"),
    [(False, 1), pytest.param(True, 1, marks=pytest.mark.nightly), pytest.param(True, 2, marks=pytest.mark.nightly)],
)
def test_a_server_that_is_killed(make_case, waits, ranks, own_server):
    case = make_case(endpoint=own_server.endpoint)
    # one that is to fail has 2000 steps: a busy machine may make forty before the server is killed
    steps = {"endTime": "0.08", "writeInterval": "40"} if waits else {"endTime": "4", "writeInterval": "4000"}
    case.set("system/controlDict", deltaT="0.002", writePrecision="17", **steps)
    case.method("", f"timeout 2; computeTimeout 5; onServerLoss {'wait 200' if waits else 'fail'};")
    command = ["moveDynamicMesh"]
    if ranks == 2:
        case.run("decomposePar")
        command = ["mpirun", "--oversubscribe", "-np", "2", *command, "-parallel"]
    log = case.folder / "log"
    with log.open("w") as out:
        solver = case.start(*command, log=out)
        case.wait_for(solver, "step 3, iteration 1")
        own_server.stop(signal.SIGKILL)
        if waits:
            case.wait_for(solver, "waiting 200 s for the server", 0.05)
            own_server.start()
        assert (solver.wait(PATIENCE) == 0) == waits, log.read_text()[-3000:]
    if waits:
        assert "step 40, iteration 3" in log.read_text()
        other = make_case("undisturbed", endpoint=own_server.endpoint)
        shutil.copy(case.folder / "system/controlDict", other.folder / "system/controlDict")
        other.method("")
        other.run("moveDynamicMesh")
        if ranks == 2:
            case.check_ranks("0.08", other.points("0.08"))
        else:
            np.testing.assert_array_equal(case.points("0.08"), other.points("0.08"))
    else:
        assert "FOAM FATAL ERROR" in log.read_text()
        assert re.search(r"the mesh-motion server at ipc://\S+ could not be asked", log.read_text())
        waits_for = "no server answers; waiting 2 s for the server at ipc://"
        assert waits_for in log.read_text() or "(UNAVAILABLE" in log.read_text()  # its gateway may die last
        assert "asking for" not in log.read_text()  # the library's half an hour
        assert "hint: with the entry 'onServerLoss wait 600;'" in log.read_text()


@pytest.mark.slow
def test_a_server_that_is_killed_within_a_move(make_case, own_server):
    """The run ends after `timeout`, long before `computeTimeout`."""
    case = make_case(endpoint=own_server.endpoint)
    case.set("system/controlDict", deltaT="0.002", endTime="4", writeInterval="4000")
    case.method("", "timeout 3;")
    log = case.folder / "log"
    with log.open("w") as out:
        solver = case.start("moveDynamicMesh", log=out)
        case.wait_for(solver, "step 3, iteration 1")
        for worker in own_server.workers():
            os.kill(worker, signal.SIGSTOP)
        time.sleep(1.0)  # the run asks, and nothing answers
        own_server.stop(signal.SIGKILL)
        assert solver.wait(60.0) != 0
    assert "FOAM FATAL ERROR" in log.read_text()
    assert re.search(r"server at ipc://\S+ could not be asked to go on: .+", log.read_text())


def test_a_server_with_keys(make_case, tmp_path):
    make_server_keys(tmp_path / "keys")
    make_client_keys("solver", tmp_path)
    admit(str(tmp_path / "solver.public"), tmp_path / "keys")
    with ServerProcess(tmp_path / "served", keys_folder=str(tmp_path / "keys")) as server:
        case = make_case(endpoint=server.endpoint, steps=1)
        case.method("", "timeout 2;")
        case.run("moveDynamicMesh", expect=1)
        assert "FOAM FATAL ERROR" in case.output
        case.environment["KEYS"] = str(tmp_path)
        case.method("", 'secretKey "$KEYS/solver.secret"; serverKey "$KEYS/keys/server.public";')
        assert "step 1, iteration 3" in case.run("moveDynamicMesh")
