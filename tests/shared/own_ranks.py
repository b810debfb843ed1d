"""What clients that move and judge their own cells are tested with: settings, boxes whole and cut, how they bend."""

import threading
from pathlib import Path

import numpy as np
from box_meshes import box_mesh
from mesh_motion_client import Mesh, Patch, connect

from mesh_motion_server.files.mesh_file import MeshFile
from mesh_motion_server.files.partitions import partitions
from tests.faults.waiting import PATIENCE

SETTINGS = {
    "displacement": "absolute",
    "correction": "none",
    "sub_steps": "never",
}
CORRECTED = SETTINGS | {"correction": "optimised", "correction_target": "threshold", "quality_threshold": 0.5}
ROLES = {"body": "moving", "outer": "fixed"}


def box_file(kind, count):
    """A box as if it were read from a file."""
    box = box_mesh(kind, count)
    cells = {block.type.name: np.asarray(block.nodes, dtype=np.int64) for block in box.cells}
    patches = {"body": np.unique(box.body), "outer": np.unique(box.outer)}
    return MeshFile(box.points, cells, patches, Path(f"{kind} {count}"))


def mesh_of(file):
    """A mesh, or a partition of one, as the client takes it."""
    patches = {name: Patch(ROLES[name], nodes) for name, nodes in file.patches.items()}
    return Mesh(file.points, file.cells, patches, file.global_ids)


def whole(kind, count):
    return mesh_of(box_file(kind, count))


def cut(kind, count, ranks):
    return [mesh_of(part) for part in partitions(box_file(kind, count), ranks)]


def pieces(kind, count, ranks):
    """The mesh in several: a node of a patch is listed by the first that has it only, others hold it too."""
    return listed_once(cut(kind, count, ranks))


def listed_once(parts):
    """Partitions where a node of a patch is listed by the first that has it only; others hold it too."""
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
    """A mesh of the numerics in one piece, as the client takes it."""
    table = {block.type.name: np.asarray(block.nodes, dtype=np.int64) for block in cells}
    return Mesh(points, table, {name: Patch(patch.role, patch.nodes) for name, patch in patches.items()})


def as_file(mesh):
    """Such a mesh as if it were read from a file."""
    return MeshFile(mesh.points, mesh.cells, {n: np.sort(p.nodes) for n, p in mesh.patches.items()}, Path("whole"))


def in_pieces(mesh, ranks):
    """Such a mesh in several, as :func:`pieces`."""
    parts = []
    for part in partitions(as_file(mesh), ranks):
        patches = {name: Patch(mesh.patches[name].role, nodes) for name, nodes in part.patches.items()}
        parts.append(Mesh(part.points, part.cells, patches, part.global_ids))
    return listed_once(parts)


def bend(points, step):
    """It grows with the steps."""
    return 0.01 * step * np.sin(3.0 * points[:, ::-1] + step)


def assert_same_quality(found, expected):
    """Bitwise but for means, which are sums in another order, and for which of equally bad cells are named."""
    for name in ("metric", "size", "skew", "size_skew"):
        one, other = ({k: v for k, v in quality[name].items() if k != "mean"} for quality in (found, expected))
        assert one == other
        assert abs(found[name]["mean"] - expected[name]["mean"]) <= 1e-13 * abs(expected[name]["mean"])
    assert_same_worst(found, expected)


def assert_same_worst(found, expected):
    """What the report of a step's later move has: bitwise, but for which of equally bad cells are named."""
    assert found["metric"]["min"] == expected["metric"]["min"]
    assert (found["cells"], found["inverted"]) == (expected["cells"], expected["inverted"])
    assert [cell["metric"] for cell in found["worst"]] == [cell["metric"] for cell in expected["worst"]]


def on_ranks(server, parts, work, settings=SETTINGS):
    """``work(session, mesh)`` on each rank, in a thread of its own."""
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
