"""Dask workers as ranks: bitwise equal to one process after the death of any worker, and one clear error if no retry
helps.
"""

import importlib
import os
import signal
import subprocess
import sys
import threading
import time
from types import ModuleType

import numpy as np
import pytest
from mesh_motion_client import (
    Credentials,
    InvalidInput,
    Patch,
    QualityRefused,
    ResourceExhausted,
    SessionError,
    StepsLost,
    Unavailable,
    connect,
    dask_worker,
)
from mesh_motion_client.dask_ranks import open_on_workers
from mesh_motion_client.session import Session
from own_ranks import CORRECTED, ROLES, SETTINGS, as_client, as_file, assert_same_quality, bend, box_file, whole
from periodic_meshes import sector
from worker_processes import workers

from mesh_motion_server.files.partitions import write_partitions
from tests.faults.server_process import ServerProcess

MESHES = {"plane": ("quad", 20), "space": ("hexahedron", 10), "mixed": ("quad + triangle", 20)}
#: How far the body goes in each step: cells are bad.
STEPS = (16, 24)
PLAIN_STEPS = (2, 3)


@pytest.fixture(scope="module")
def expected(server):
    """For each mesh and settings, the answers of a session with the whole mesh: moved and points, step by step."""
    known = {}

    def find(mesh, settings):
        key = (mesh, settings["correction"])
        if key not in known:
            everything, found = whole(*MESHES[mesh]), []
            with connect(server.endpoint) as client, client.open(everything, settings) as session:
                for step in STEPS if settings is CORRECTED else PLAIN_STEPS:
                    moved = session.move(bend(everything.points[session.moving_nodes], step))
                    session.commit()
                    found.append((moved, session.points()))
            known[key] = found
        return known[key]

    return find


def motion(step):
    """Workers do not have the tests' modules, so the function is pickled with its code."""
    return lambda points: 0.01 * step * np.sin(3.0 * points[:, ::-1] + step)


def written(files, folder, session):
    """The coordinates that the workers write, by global id."""
    found = {}
    for file, path in zip(files, session.write(folder), strict=True):
        with np.load(file) as part:
            found |= dict(zip(part["global_ids"].tolist(), np.load(path).tolist(), strict=True))
    return np.array([found[node] for node in range(len(found))])


def assert_as_expected(moved, points, expected):
    whole_mesh, expected_points = expected
    np.testing.assert_array_equal(points, expected_points)
    assert moved.correction == whole_mesh.correction
    if not whole_mesh.correction["freed_nodes"]:  # otherwise judged where the server had not yet rounded the answer
        assert_same_quality(moved.quality["corrected"], whole_mesh.quality["corrected"])


@pytest.mark.parametrize("settings", [SETTINGS, CORRECTED], ids=["plain", "corrected"])
@pytest.mark.parametrize("partitions", [1, 2, 3, 5])
@pytest.mark.parametrize("mesh", MESHES)
def test_nodes_are_those_of_one_process(cluster, server, expected, tmp_path, mesh, partitions, settings):
    files = write_partitions(tmp_path / "parts", box_file(*MESHES[mesh]), partitions)
    with open_on_workers(server.endpoint, cluster, files, ROLES, settings) as session:
        assert len(set(session.workers)) == min(partitions, 3)
        steps = STEPS if settings is CORRECTED else PLAIN_STEPS
        for number, (step, wanted) in enumerate(zip(steps, expected(mesh, settings), strict=True), start=1):
            session.move(motion(0.5 * step))
            moved = session.move(motion(step))
            assert (moved.step, moved.iteration) == (number, 2)
            assert session.commit() == session.step == number
            assert_as_expected(moved, written(files, tmp_path / str(number), session), wanted)


def test_an_array_has_a_row_for_each_moving_node_of_the_whole_mesh(cluster, server, expected, tmp_path):
    files, everything = write_partitions(tmp_path / "parts", box_file(*MESHES["plane"]), 3), whole(*MESHES["plane"])
    with open_on_workers(server.endpoint, cluster, files, ROLES, CORRECTED) as session:
        np.testing.assert_array_equal(session.moving_ids, np.sort(everything.patches["body"].nodes))
        rows = bend(everything.points[session.moving_ids], STEPS[0])
        with pytest.raises(InvalidInput, match=rf"must have {len(rows)} rows, one a moving node, got {len(rows) - 1}"):
            session.move(rows[1:])
        moved = session.move(rows)
        session.commit()
        assert_as_expected(moved, written(files, tmp_path / "1", session), expected("plane", CORRECTED)[0])


def test_nodes_slide_and_move_as_their_images(cluster, server, tmp_path):
    points, cells, patches = sector("hexahedron", 10)
    everything = as_client(
        points, cells, patches | {f"z{end}": Patch("slip", patches[f"z{end}"].nodes) for end in (0, 1)}
    )
    settings, shift = {}, [0.1, 0.2, 0.1]
    with connect(server.endpoint) as client, client.open(everything, settings, evaluation="client") as session:
        expected = session.move(np.tile(shift, (len(session.moving_nodes), 1)))
    files = write_partitions(tmp_path / "parts", as_file(everything), 3)
    roles = {name: patch.role for name, patch in everything.patches.items()}
    with open_on_workers(server.endpoint, cluster, files, roles, settings) as session:
        moved = session.move(lambda points: np.tile(shift, (len(points), 1)))
        session.commit()
        assert moved.correction["freed_nodes"] == expected.correction["freed_nodes"] > 0
        found = written(files, tmp_path / "1", session)
    np.testing.assert_array_equal(found, points + expected.displacement)


def dying(target, method, count):
    """A patch that kills a worker with SIGKILL when it calls a method for the ``count``-th time."""

    def install():
        module, name = target.split(":")
        owner, calls = getattr(importlib.import_module(f"mesh_motion_client.{module}"), name), []
        unharmed = getattr(owner, method)

        def deadly(*given, **named):
            calls.append(method)
            if len(calls) == count:
                os.kill(os.getpid(), signal.SIGKILL)
            return unharmed(*given, **named)

        setattr(owner, method, deadly)

    return install


#: The moments at which a worker of the second step dies: before it sends that request, or after its answer.
DEATHS = {
    "before MOVE": ("session:Session", "move", 1),
    "after MOVED": ("own_cells:OwnCells", "take_trial", 1),
    "before CORRECT": ("own_cells:OwnCells", "_correct", 1),
    "after CORRECTED": ("volume:Volume", "correct", 1),
    "before the second JUDGE": ("own_cells:OwnCells", "_judged", 2),
    "after the last JUDGED": ("dask_worker:Answer", "__init__", 1),
    "before COMMIT": ("session:Session", "commit", 1),
    "after COMMITTED": ("own_cells:OwnCells", "keep", 1),
    "before FETCH": ("session:Session", "points", 1),
    "after FETCHED": ("own_cells:OwnCells", "coordinates", 1),
}


#: Those that are tried each time, on a worker with two partitions: in the move, before the commit, after it; and by
#: night on one with a single partition.
OFTEN = ("after MOVED", "before COMMIT", "after COMMITTED", "after FETCHED")


@pytest.mark.parametrize(
    ("death", "victim"),
    [
        pytest.param(death, victim, marks=[pytest.mark.nightly] * (victim == 1 or death not in OFTEN))
        for death in DEATHS
        for victim in ((0, 1) if death in OFTEN else (0,))
    ],
)
def test_a_worker_killed_within_a_step_changes_nothing(fragile_cluster, server, expected, tmp_path, death, victim):
    files = write_partitions(tmp_path / "parts", box_file(*MESHES["plane"]), 3)
    with open_on_workers(server.endpoint, fragile_cluster, files, ROLES, CORRECTED) as session:
        for number, (step, wanted) in enumerate(zip(STEPS, expected("plane", CORRECTED), strict=True), start=1):
            if number == 2:
                lost = session.workers[victim]
                fragile_cluster.run(dying(*DEATHS[death]), workers=[lost])
            began = time.monotonic()
            moved = session.move(motion(step))
            assert session.commit() == number
            assert_as_expected(moved, written(files, tmp_path / str(number), session), wanted)
            assert time.monotonic() - began < 100.0  # no rank has waited 120 s for one that is gone
        assert lost not in session.workers
        assert session.move(motion(1)).step == 3  # no step was committed twice


def test_a_commit_that_is_carried_out_while_a_rank_joins_is_known_to_it(fragile_cluster, server, tmp_path):
    """A rank dies after it has sent its COMMIT; the other rank sends its COMMIT after the new rank has joined at the
    old step.
    """

    def dying_soon():
        unharmed = Session.commit

        def commit(session):
            threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGKILL)).start()
            return unharmed(session)

        Session.commit = commit

    def slow():
        late, rest = Session.commit, dask_worker._Rank.rest

        def commit(session):
            time.sleep(3.0)
            return late(session)

        def rest_later(rank, credentials):
            time.sleep(0.0 if rank._partition else 4.0)  # of the new one
            return rest(rank, credentials)

        Session.commit, dask_worker._Rank.rest = commit, rest_later

    files = write_partitions(tmp_path / "parts", box_file(*MESHES["plane"]), 2)
    with open_on_workers(server.endpoint, fragile_cluster, files, ROLES, SETTINGS) as session:
        session.move(motion(1))
        dies, stays = session.workers
        fragile_cluster.run(dying_soon, workers=[dies])
        fragile_cluster.run(slow, workers=[stays])
        assert session.commit() == 1
        assert session.workers == [stays, stays]
        assert session.move(motion(2)).step == 2


def kill(cluster, worker):
    os.kill(cluster.run(os.getpid, workers=[worker])[worker], signal.SIGKILL)


def test_a_worker_killed_between_two_calls_changes_nothing(fragile_cluster, server, expected, tmp_path):
    files, (first, second) = write_partitions(tmp_path / "parts", box_file(*MESHES["space"]), 2), STEPS
    with open_on_workers(server.endpoint, fragile_cluster, files, ROLES, CORRECTED) as session:
        kill(fragile_cluster, session.workers[1])
        moved = session.move(motion(first))
        kill(fragile_cluster, session.workers[0])
        assert session.commit() == 1
        kill(fragile_cluster, session.workers[1])
        assert_as_expected(moved, written(files, tmp_path / "1", session), expected("space", CORRECTED)[0])
        moved = session.move(motion(second))
        session.commit()
        assert_as_expected(moved, written(files, tmp_path / "2", session), expected("space", CORRECTED)[1])


def test_without_a_worker_there_is_one_error_and_the_session_goes_on(server, expected, tmp_path):

    files = write_partitions(tmp_path / "parts", box_file(*MESHES["plane"]), 2)
    with (
        workers(1) as cluster,
        open_on_workers(server.endpoint, cluster, files, ROLES, CORRECTED, patience=1.0) as session,
    ):
        moved = session.move(motion(STEPS[0]))
        cluster.cluster.scale(0)
        with pytest.raises(Unavailable, match=r"the Dask cluster has had no worker for 1 s \(start workers"):
            session.commit()
        cluster.cluster.scale(1)
        cluster.wait_for_workers(1, timeout=60)
        assert session.commit() == 1
        assert_as_expected(moved, written(files, tmp_path / "1", session), expected("plane", CORRECTED)[0])


def test_a_partition_that_takes_every_worker_with_it_is_an_error(fragile_cluster, server, tmp_path):
    files = write_partitions(tmp_path / "parts", box_file(*MESHES["plane"]), 2)

    def deadly(points):
        os.kill(os.getpid(), signal.SIGKILL)

    with open_on_workers(server.endpoint, fragile_cluster, files, ROLES, SETTINGS) as session:
        with pytest.raises(Unavailable, match="one call has lost 5 workers"):
            session.move(deadly)
        session.move(motion(1))
        assert session.commit() == 1


def test_a_server_that_dies_goes_on_with_the_same_bits(cluster, expected, tmp_path):
    files = write_partitions(tmp_path / "parts", box_file(*MESHES["plane"]), 2)
    with ServerProcess(tmp_path / "state") as server:
        with open_on_workers(server.endpoint, cluster, files, ROLES, CORRECTED) as session:
            first = session.move(motion(STEPS[0]))
            server.stop(signal.SIGKILL)
            server.start()
            assert session.commit() == 1
            assert_as_expected(first, written(files, tmp_path / "1", session), expected("plane", CORRECTED)[0])
            kept = session.credentials
        with open_on_workers(server.endpoint, cluster, files, ROLES, credentials=kept) as session:
            assert session.step == 1
            assert_as_expected(first, written(files, tmp_path / "again", session), expected("plane", CORRECTED)[0])
            moved = session.move(motion(STEPS[1]))
            session.commit()
            assert_as_expected(moved, written(files, tmp_path / "2", session), expected("plane", CORRECTED)[1])


PATCHES = {"points": np.zeros((3, 2)), **{f"patch_{name}": [0] for name in ROLES}}


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda file: file.unlink(), "partition-001.npz: cannot be read: No such file"),
        (lambda file: file.write_bytes(b"mesh"), "partition-001.npz: not readable as an .npz archive"),
        (lambda file: np.savez(file, nodes=np.zeros(3)), "partition-001.npz: expected 'points', 'cells_<type>'"),
        (lambda file: np.savez(file, **PATCHES, cells_triangle=[[0, 1, 2]]), "001.npz: expected a parti"),
        (lambda file: np.savez(file, **PATCHES, cells_triangle=[[0, 1, 3]]), "001.npz: cells of type"),
        (lambda file: np.savez(file, points=np.zeros((3, 2)), patch_flag=[0]), "patch 'flag' has no role"),
    ],
)
def test_a_file_that_cannot_be_used_is_named_with_its_worker(cluster, server, tmp_path, spoil, says):
    files = write_partitions(tmp_path, box_file(*MESHES["plane"]), 2)
    spoil(files[1])
    with pytest.raises(InvalidInput, match=says) as refused:
        open_on_workers(server.endpoint, cluster, files, ROLES, SETTINGS)
    assert refused.value.__notes__ == [f"partition 1, {files[1]}, worker {sorted(cluster.nthreads())[1]}"]


def test_an_unusable_cell_is_refused_at_once_although_other_ranks_wait(cluster, server, tmp_path):
    files = write_partitions(tmp_path, box_file(*MESHES["plane"]), 2)
    with np.load(files[1]) as file:
        arrays = dict(file)
    arrays["cells_quad"][0, 1] = arrays["cells_quad"][0, 3]
    np.savez(files[1], **arrays)
    began = time.monotonic()
    with pytest.raises(InvalidInput, match=r"cell 0 \(quad\) names a node twice") as refused:
        open_on_workers(server.endpoint, cluster, files, ROLES, SETTINGS)
    assert "partition-001.npz" in refused.value.__notes__[0]
    assert time.monotonic() - began < 100.0  # they wait for 120 s


def test_a_refusal_by_one_rank_or_all_leaves_the_session_usable(cluster, server, tmp_path):
    files = write_partitions(tmp_path / "parts", box_file(*MESHES["plane"]), 3)

    def broken(points):
        if points.mean() > 0.5:  # on some of the workers
            raise ZeroDivisionError("a motion of its own")
        return points

    def endless(points):
        try:
            return endless(points)
        finally:
            points += 1.0

    settings = SETTINGS | {"refuse_below_threshold": True, "quality_threshold": 0.9}
    with open_on_workers(server.endpoint, cluster, files, ROLES, settings) as session:
        with pytest.raises(SessionError, match="there is no trial to commit"):
            session.commit()
        began = time.monotonic()
        with pytest.raises(ZeroDivisionError, match="a motion of its own"):
            session.move(broken)
        with pytest.raises(RecursionError, match="maximum recursion depth exceeded"):  # also when it is sent
            session.move(endless)
        with pytest.raises(QualityRefused):
            session.move(motion(24))
        session.move(motion(0.1))
        session.rollback()
        with pytest.raises(SessionError, match="there is no trial to commit"):
            session.commit()
        assert session.move(motion(0.1)).step == 1
        assert session.commit() == 1
        (tmp_path / "file").touch()
        with pytest.raises(ResourceExhausted, match=r"partition-00.*cannot be written"):
            session.write(tmp_path / "file")
        assert session.move(motion(0.2)).step == 2
        assert time.monotonic() - began < 100.0  # none has waited for 120 s


def test_a_motion_that_the_workers_cannot_load_is_reported(cluster, server, tmp_path, monkeypatch):
    files = write_partitions(tmp_path, box_file(*MESHES["plane"]), 2)
    module = ModuleType("on_no_worker")
    exec("def moved(points): return points", vars(module))
    monkeypatch.setitem(sys.modules, "on_no_worker", module)
    with open_on_workers(server.endpoint, cluster, files, ROLES, SETTINGS) as session:
        with pytest.raises(InvalidInput, match=r"cannot be asked: .*on_no_worker.*modules that the workers have"):
            session.move(module.moved)
        assert session.move(motion(0.1)).step == 1


def test_a_session_that_loses_steps_says_so(cluster, tmp_path):
    files = write_partitions(tmp_path / "parts", box_file(*MESHES["plane"]), 2)
    with (
        ServerProcess(tmp_path / "state", durability=["relaxed"]) as server,
        open_on_workers(server.endpoint, cluster, files, ROLES, SETTINGS, durability="relaxed") as session,
    ):
        session.move(motion(0.1))
        session.commit()
        session.step = 2  # as if a second one had been answered, and not stored
        server.stop(signal.SIGKILL)
        server.start()
        with pytest.raises(StepsLost, match="step 2 was committed, but after a restart the session stands at step"):
            session.move(motion(0.2))
        step = session.step
        session.move(motion(0.2))
        assert session.commit() == step + 1


def test_no_files_no_server_and_wrong_settings(cluster, server, tmp_path):
    files = write_partitions(tmp_path, box_file(*MESHES["plane"]), 2)
    with pytest.raises(InvalidInput, match="the file of one partition at least"):
        open_on_workers(server.endpoint, cluster, [], ROLES)
    with pytest.raises(InvalidInput, match="expected displacement = 'absolute'"):
        open_on_workers(server.endpoint, cluster, files, ROLES, SETTINGS | {"displacement": "relative"})
    with pytest.raises(SessionError, match="session"):
        open_on_workers(server.endpoint, cluster, files, ROLES, credentials=Credentials("0" * 32, b"0" * 32))


def test_the_client_needs_dask_for_its_workers_alone():
    script = "import sys, mesh_motion_client.dask_ranks; print({'dask', 'distributed', 'scipy'} & set(sys.modules))"
    printed = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert printed.stdout == "set()\n"
