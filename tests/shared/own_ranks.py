"""Test data for clients that move and judge their own cells: settings, boxes whole and cut, and their bending."""

import signal
import threading
from pathlib import Path

import numpy as np
import pytest
from box_meshes import box_mesh
from mesh_motion_client import Mesh, Patch, connect

from mesh_motion_server.files.mesh_file import MeshFile
from mesh_motion_server.files.partitions import partitions
from tests.faults.server_process import ServerProcess
from tests.faults.waiting import PATIENCE

SETTINGS = {"displacement": "absolute", "correction": "none", "sub_steps": "never"}
CORRECTED = SETTINGS | {"correction": "optimised", "correction_target": "threshold", "quality_threshold": 0.5}
ROLES = {"body": "moving", "outer": "fixed"}


def box_file(kind, count):
    box = box_mesh(kind, count)
    cells = {block.type.name: np.asarray(block.nodes, dtype=np.int64) for block in box.cells}
    patches = {"body": np.unique(box.body), "outer": np.unique(box.outer)}
    return MeshFile(box.points, cells, patches, Path(f"{kind} {count}"))


def mesh_of(file):
    """A mesh, or a partition of one, in the client's form."""
    patches = {name: Patch(ROLES[name], nodes) for name, nodes in file.patches.items()}
    return Mesh(file.points, file.cells, patches, file.global_ids)


def whole(kind, count):
    return mesh_of(box_file(kind, count))


def cut(kind, count, ranks):
    return [mesh_of(part) for part in partitions(box_file(kind, count), ranks)]


def pieces(kind, count, ranks):
    """The mesh in several pieces: only the first piece with a patch node lists it, but others have it too."""
    return listed_once(cut(kind, count, ranks))


def listed_once(parts):
    """Partitions in which a patch node is listed only by the first one that has it; others have the node too."""
    found, listed = [], set()
    for part in parts:
        patches = {}
        for name, patch in part.patches.items():
            nodes = [int(node) for node in patch.nodes if (name, int(part.global_ids[node])) not in listed]
            listed |= {(name, int(part.global_ids[node])) for node in nodes}
            patches |= {name: Patch(patch.role, np.array(nodes))} if nodes else {}
        found.append(Mesh(part.points, part.cells, patches, part.global_ids))
    return found


def as_client(points, cells, patches):
    """A mesh of the numerics in one piece, in the client's form."""
    table = {block.type.name: np.asarray(block.nodes, dtype=np.int64) for block in cells}
    return Mesh(points, table, {name: Patch(patch.role, patch.nodes) for name, patch in patches.items()})


def as_file(mesh):
    return MeshFile(mesh.points, mesh.cells, {n: np.sort(p.nodes) for n, p in mesh.patches.items()}, Path("whole"))


def in_pieces(mesh, ranks):
    """Such a mesh in several pieces, made by :func:`pieces`."""
    parts = []
    for part in partitions(as_file(mesh), ranks):
        patches = {name: Patch(mesh.patches[name].role, nodes) for name, nodes in part.patches.items()}
        parts.append(Mesh(part.points, part.cells, patches, part.global_ids))
    return listed_once(parts)


def bend(points, step):
    """A bending that grows with the steps."""
    return 0.01 * step * np.sin(3.0 * points[:, ::-1] + step)


def assert_same_quality(found, expected):
    """Check that qualities are bitwise equal.

    Exceptions are means, whose sums have another order, and the choice among equally bad cells.
    """
    for name in ("metric", "size", "skew", "size_skew"):
        one, other = ({k: v for k, v in quality[name].items() if k != "mean"} for quality in (found, expected))
        assert one == other
        assert abs(found[name]["mean"] - expected[name]["mean"]) <= 1e-13 * abs(expected[name]["mean"])
    assert_same_worst(found, expected)


def assert_same_worst(found, expected):
    """Check the report of a step's later move: bitwise equal, except the choice among equally bad cells."""
    assert found["metric"]["min"] == expected["metric"]["min"]
    assert (found["cells"], found["inverted"]) == (expected["cells"], expected["inverted"])
    assert [cell["metric"] for cell in found["worst"]] == [cell["metric"] for cell in expected["worst"]]


def on_ranks(server, parts, work, settings=SETTINGS):
    """Call ``work(session, mesh)`` for each rank, in its own thread."""
    opened, results, failures = threading.Event(), [None] * len(parts), []
    shared = []

    def announce(credentials):
        shared.append(credentials)
        opened.set()

    def run(rank):
        try:
            with connect(server.endpoint) as client:
                if not rank:
                    options = {"evaluation": "client", "partitions": len(parts), "announce": announce}
                    session = client.open(parts[0], settings, **options)
                else:
                    assert opened.wait(PATIENCE)
                    session = client.join(shared[0], parts[rank], partition=rank)
                with session:
                    results[rank] = work(session, parts[rank])
        except BaseException as failure:
            failures.append(failure)
            opened.set()

    threads = [threading.Thread(target=run, args=(rank,)) for rank in range(len(parts))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(2 * PATIENCE)
    if failures:
        raise failures[0]
    return results


def assert_as_the_whole_mesh(server, whole, two_steps):
    """Check that two steps of a mesh on its own rank, without and with a correction, are those of the server.

    Returns
    -------
    The replies and the positions after both steps.
    """
    with connect(server.endpoint) as client, client.open(whole) as session:
        expected = two_steps(session, whole)
    (one,) = on_ranks(server, [whole], two_steps, {})
    for (moved, points), (reply, there), most in zip(one, expected, (1e-12, 1e-9), strict=True):
        assert np.abs(points - there).max() < most
        assert moved.correction["method"] == reply.correction["method"]
        corrected, other = (found.quality["corrected"]["metric"]["min"] for found in (moved, reply))
        assert corrected == pytest.approx(other, rel=1e-7)
    assert [moved.correction["method"] for moved, _ in one] == ["none", "smooth"]
    return one


def assert_same_derivatives(server, whole, ranks, motion):
    """Check a move by ``motion(points)`` on one rank and on several: the results are those of a session with the whole
    mesh.
    """
    weights, holders = np.random.default_rng(1).normal(size=whole.points.shape), np.ones(len(whole.points))

    def drive(session, part):
        ids = np.arange(len(part.points)) if part.global_ids is None else part.global_ids
        assert session.derivatives
        moving = part.points[session.moving_nodes]
        session.move(motion(moving))
        found = session.tangent(np.sin(5.0 * moving)), session.cotangent(weights[ids] / holders[ids, None])
        return *found, ids, ids[session.moving_nodes]

    with connect(server.endpoint) as client, client.open(whole) as session:
        velocity, expected, _, moving = drive(session, whole)
    for parts in ([whole], in_pieces(whole, ranks)):
        if len(parts) > 1:
            holders = np.bincount(np.concatenate([part.global_ids for part in parts]))
        for found, back, ids, own in on_ranks(server, parts, drive, {}):
            # the iterations start from different values, and the minimum is found to 1e-9
            np.testing.assert_allclose(found, velocity[ids], rtol=0.0, atol=1e-7 * np.abs(velocity).max())
            rows = expected[np.searchsorted(moving, own)]
            np.testing.assert_allclose(back, rows, rtol=0.0, atol=1e-6 * np.abs(expected).max())


def assert_kept_after_kill_9(folder, whole, drive, durability):
    """Check that the nodes after ``drive(session, mesh)`` are those of the next server, which continues with the same
    bits.
    """
    with ServerProcess(folder) as server, connect(server.endpoint) as client:
        session = client.open(whole, evaluation="client", durability=durability)
        points = drive(session, whole)[-1][1]
        server.stop(signal.SIGKILL)
        server.start()
        with client.resume(session.credentials, whole) as resumed:
            np.testing.assert_array_equal(resumed.points(), points)
            np.testing.assert_array_equal(drive(resumed, whole)[-1][1], points)
        session.leave()
