"""A mesh that only workers have moves as it would in one place, and nothing as large as itself travels."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path[:0] = [str(Path(__file__).parents[1] / folder) for folder in ("distributed", "numerics")]

from distributed_cases import MESHES, local_model, patches_of, waypoints  # noqa: E402
from worker_processes import connected, worker_processes  # noqa: E402

from benchmarks.distributed.partitioned import PartitionedMotion  # noqa: E402
from benchmarks.distributed.sources import FileSource, write_partitions  # noqa: E402
from mesh_motion_server.numerics.interpolation.factor_source import MakeEachTime  # noqa: E402
from mesh_motion_server.numerics.method import Method  # noqa: E402

METHODS = {"relative": Method(correction="none"), "two scales": Method(correction="none", quality_metric="skew")}


def together(mesh: Any, motion: PartitionedMotion, source: FileSource) -> np.ndarray:
    """Positions of all nodes, from those of the partitions."""
    points = np.full_like(mesh.points, np.nan)
    for number, own in enumerate(motion.positions()):
        part = source.make(number)().mesh
        points[part.nodes[part.own]] = own
    return points


@pytest.mark.nightly
@pytest.mark.slow  # starts worker processes
def test_every_step_is_that_of_one_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with worker_processes(2) as cluster, connected(cluster) as connection:
        for (name, method), mesh in zip(METHODS.items(), MESHES, strict=True):
            if name == "two scales":
                monkeypatch.setattr("mesh_motion_server.numerics.interpolation.two_scale.plans.AUTOMATIC_FROM", 0)
            body = MESHES[mesh]()
            local, here = local_model(body, method), body.points
            boundary = np.flatnonzero(body.held)
            source = write_partitions(tmp_path / name, body.points, body.cells, boundary, 3)
            motion = PartitionedMotion(source, patches_of(body), method, connection)
            assert motion.method.support_radius == local.method.support_radius
            for targets in waypoints(body):
                before = motion.crew.traffic.copy()
                summary, expected = motion.move(targets, MakeEachTime()).summary, local.move(here, targets)
                here = expected.points
                assert summary.worst == expected.corrected.worst
                assert summary.inverted == expected.corrected.inverted
                for number in ("min", "p1", "p5", "p50"):
                    assert getattr(summary.metric, number) == getattr(expected.corrected.metric, number)
                wire = motion.crew.traffic.since(before)
                assert wire.received.keys() == {"summaries"}
                assert wire.received["summaries"] < 3 * 3 * 6 * 2048 + 3 * 3000
                np.testing.assert_array_equal(together(body, motion, source), here)
            motion.close()
