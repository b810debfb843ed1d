"""A mesh that only workers have moves as it would in one place, and nothing as large as itself travels."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from distributed_cases import MESHES, local_model, patches_of, waypoints
from worker_processes import connected

from mesh_motion_server.distributed import motion as motion_module
from mesh_motion_server.distributed.connection import Connection
from mesh_motion_server.distributed.held import HeldPartition
from mesh_motion_server.distributed.motion import PartitionedMotion
from mesh_motion_server.distributed.sources import FileSource, MeshSource, write_partitions
from mesh_motion_server.errors import InvalidInput, NumericalError, SessionError
from mesh_motion_server.numerics.mesh.roles import Patch
from mesh_motion_server.numerics.method import Method

METHODS = {
    "relative": Method(correction="none"),
    "absolute": Method(correction="none", displacement="absolute", support_radius=1.5),
    "two scales": Method(correction="none", quality_metric="skew"),
}


def source_of(mesh: Any, folder: Path | None, count: int = 3) -> Any:
    nodes = np.flatnonzero(mesh.held)
    if folder is None:
        return MeshSource(mesh.points, mesh.cells, nodes, count)
    return write_partitions(folder, mesh.points, mesh.cells, nodes, count)


def together(mesh: Any, motion: PartitionedMotion, source: Any, count: int = 3) -> np.ndarray:
    """Positions of all nodes, from those of the partitions."""
    points = np.full_like(mesh.points, np.nan)
    for number, own in enumerate(motion.positions()):
        made = source.make(number)
        part = (made if isinstance(made, HeldPartition) else made()).mesh
        points[part.nodes[part.own]] = own
    return points


@pytest.mark.parametrize("files", [False, True], ids=["cut out here", "from files"])
@pytest.mark.parametrize("mesh", MESHES)
@pytest.mark.parametrize("method", METHODS)
def test_every_step_is_that_of_one_machine(
    cluster: Any, tmp_path: Path, files: bool, mesh: str, method: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if method == "two scales":
        monkeypatch.setattr("mesh_motion_server.numerics.interpolation.two_scale.plans.AUTOMATIC_FROM", 0)
    body = MESHES[mesh]()
    local, here = local_model(body, METHODS[method]), body.points
    source = source_of(body, tmp_path / "mesh" if files else None)
    with connected(cluster) as connection:
        motion = PartitionedMotion(source, patches_of(body), METHODS[method], connection)
        assert motion.method.support_radius == local.method.support_radius
        for targets in waypoints(body):
            trial, expected = motion.move(targets), local.move(here, targets)
            motion.commit()
            here = expected.points
            assert trial.summary.worst == expected.corrected.worst
            assert trial.summary.inverted == expected.corrected.inverted
            for name in ("min", "p1", "p5", "p50"):
                assert getattr(trial.summary.metric, name) == getattr(expected.corrected.metric, name)
            np.testing.assert_array_equal(together(body, motion, source), here)
        motion.close()


def test_per_step_only_what_the_boundary_decides_travels(cluster: Any, tmp_path: Path) -> None:
    body = MESHES["cube"]()
    with connected(cluster) as connection:
        motion = PartitionedMotion(source_of(body, tmp_path), patches_of(body), METHODS["relative"], connection)
        for targets in waypoints(body):
            before = motion.traffic.copy()
            motion.move(targets)
            motion.commit()
            wire = motion.traffic.since(before)
            assert wire.sent["mesh"] == 0
            assert wire.sent["coefficients"] < 3 * 110 * np.count_nonzero(body.held)
            assert wire.received.keys() == {"summaries"}
            assert wire.received["summaries"] < 3 * 3 * 6 * 2048 + 3 * 3000
        motion.close()


@pytest.mark.slow  # workers that are killed and waited for
def test_a_rebuilt_partition_repeats_the_steps_or_starts_from_a_checkpoint(
    fragile_cluster: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    body = MESHES["cube"]()
    local, here, method = local_model(body, METHODS["relative"]), body.points, METHODS["relative"]
    source = source_of(body, tmp_path / "mesh")
    (tmp_path / "checkpoints").mkdir()
    monkeypatch.setattr(motion_module, "_HISTORY", 2)
    with connected(fragile_cluster, patience=30.0) as connection:
        motion = PartitionedMotion(source, patches_of(body), method, connection, checkpoints=tmp_path / "checkpoints")
        for step, targets in enumerate(waypoints(body, 5)):
            if step in (1, 4):  # after one step to repeat; after the second checkpoint
                _kill_one(connection)
            motion.move(targets)
            motion.commit()
            here = local.move(here, targets).points
            np.testing.assert_array_equal(together(body, motion, source), here)
        assert motion.traffic.rebuilt >= 2
        assert len(list((tmp_path / "checkpoints").iterdir())) == 3
        motion.close()


def _kill_one(connection: Connection) -> None:
    client = connection.client()
    os.kill(min(client.run(os.getpid).values()), signal.SIGKILL)


def test_an_inverted_mesh_is_refused_and_the_trial_before_it_stays(cluster: Any) -> None:
    body = MESHES["cube"]()
    with connected(cluster) as connection:
        motion = PartitionedMotion(source_of(body, None), patches_of(body), METHODS["relative"], connection)
        with pytest.raises(SessionError, match="no trial to commit"):
            motion.commit()
        good = next(waypoints(body))
        motion.move(good)
        with pytest.raises(NumericalError, match="no valid mesh found") as caught:
            motion.move(good + np.array([0.6, 0.0, 0.0]))
        assert caught.value.cells
        motion.commit()
        np.testing.assert_array_equal(motion.boundary[motion.roles.moving], good)
        motion.close()


@pytest.mark.parametrize(
    ("method", "role", "says"),
    [
        (Method(), "fixed", "correction = 'none', got 'optimised'"),
        (Method(correction="none", displacement="reanchored"), "fixed", "'relative' or 'absolute', got 'reanchored'"),
        (Method(correction="none", boundary_layer_thickness=0.1), "fixed", "boundary_layer_thickness = None"),
        (Method(correction="none"), "slip", "role moving or fixed, got 'slip'"),
    ],
)
def test_what_needs_the_mesh_in_one_place_is_refused(method: Method, role: str, says: str) -> None:
    body = MESHES["block"]()
    patches = {"body": Patch("moving", body.body), "outer": Patch(role, body.outer)}
    with pytest.raises(InvalidInput, match=says):
        PartitionedMotion(source_of(body, None), patches, method, Connection("tcp://127.0.0.1:9"))


def test_boundary_nodes_are_those_with_a_role() -> None:
    body = MESHES["block"]()
    connection, method = Connection("tcp://127.0.0.1:9"), METHODS["relative"]
    with pytest.raises(InvalidInput, match="has a role and is not among"):
        PartitionedMotion(MeshSource(body.points, body.cells, body.body, 2), patches_of(body), method, connection)
    every = np.arange(len(body.points))
    with pytest.raises(InvalidInput, match=r"boundary nodes, .* of them have a role"):
        PartitionedMotion(MeshSource(body.points, body.cells, every, 2), patches_of(body), method, connection)


def test_a_folder_that_holds_no_partitions_is_named(tmp_path: Path) -> None:
    with pytest.raises(InvalidInput, match="expected a folder of partitions"):
        FileSource(tmp_path)
    source = source_of(MESHES["block"](), tmp_path)
    (tmp_path / "partition-00001.npz").unlink()
    with pytest.raises(InvalidInput, match=r"partition-00001.npz: the worker cannot read.*every worker"):
        source.make(1)()
