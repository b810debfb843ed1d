"""A worker that dies takes nothing with it: its partitions are rebuilt and the step completes."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from distributed_cases import MESHES, assert_same, distributed_model, local_model, waypoints
from worker_processes import connected

from mesh_motion_server.distributed import evaluator as evaluator_module
from mesh_motion_server.distributed.connection import Connection
from mesh_motion_server.errors import ResourceError
from mesh_motion_server.numerics.method import Method

pytestmark = pytest.mark.slow  # workers that are started, killed and waited for

METHOD = Method(support_radius=2.0, correction="none")


def killing(task: Any, mark: Path) -> Any:
    """The task, but the first worker that begins it dies of SIGKILL."""

    def deadly(held: Any, *arguments: Any) -> Any:
        try:
            os.close(os.open(mark, os.O_CREAT | os.O_EXCL))
        except FileExistsError:
            return task(held, *arguments)
        os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(60)
        return None

    return deadly


@pytest.mark.parametrize("name", ["displace", "judge", "questioned"])
def test_a_worker_killed_within_a_step_changes_nothing(
    fragile_cluster: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, name: str
) -> None:
    body = MESHES["cube"]()
    local, here = local_model(body, METHOD), body.points
    with connected(fragile_cluster, patience=30.0) as connection:
        model = distributed_model(body, METHOD, connection, partitions=4)
        there = here
        for step, targets in enumerate(waypoints(body)):
            if step == 1:
                deadly = killing(getattr(evaluator_module, name), tmp_path / "killed")
                monkeypatch.setattr(evaluator_module, name, deadly)
            expected, found = local.move(here, targets), model.move(there, targets)
            assert_same(found, expected)
            here, there = expected.points, found.points
            assert found.caches["partitions_rebuilt"] == (2 if step == 1 else 0)
        assert (tmp_path / "killed").exists()
        model.close()


def test_without_workers_there_is_one_error_and_the_session_goes_on_when_they_are_back(fragile_cluster: Any) -> None:
    body = MESHES["cube"]()
    local, (first, second, _) = local_model(body, METHOD), waypoints(body)
    with connected(fragile_cluster, patience=1.0) as connection:
        model = distributed_model(body, METHOD, connection)
        points = model.move(body.points, first).points
        fragile_cluster.scale(0)
        begin = time.monotonic()
        with pytest.raises(ResourceError, match=r"no Dask worker has answered at tcp://127.* for 1 s \(start workers"):
            model.move(points, second)
        assert time.monotonic() - begin < 15.0
        fragile_cluster.scale(1)
        fragile_cluster.wait_for_workers(1, timeout=30)
        assert_same(model.move(points, second), local.move(points, second))
        model.close()


def test_the_operator_may_have_it_computed_here_meanwhile(fragile_cluster: Any) -> None:
    body = MESHES["cube"]()
    local = local_model(body, METHOD)
    first, second, third = waypoints(body)
    with connected(fragile_cluster, patience=1.0) as connection:
        model = distributed_model(body, METHOD, connection, fallback="local")
        points = model.move(body.points, first).points
        fragile_cluster.scale(0)
        found = model.move(points, second)
        np.testing.assert_array_equal(found.points, local.move(points, second).points)
        assert found.corrected == local.summary(found.points)
        assert_same(model.move(found.points, third), local.move(found.points, third))
        model.close()


def test_a_scheduler_that_does_not_answer_is_one_clear_error() -> None:
    pytest.importorskip("distributed")
    body = MESHES["cube"]()
    model = distributed_model(body, METHOD, Connection("tcp://127.0.0.1:9", patience=0.5))
    with pytest.raises(
        ResourceError, match=r"scheduler at tcp://127.0.0.1:9 does not answer.*dask scheduler"
    ) as caught:
        model.summary(body.points)
    assert caught.value.code == "UNAVAILABLE"
    model.close()
