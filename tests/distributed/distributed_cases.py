"""Meshes with their motions, moved by workers and by this process."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from box_meshes import box_mesh
from correction_cases import BodyMesh, stored

from mesh_motion_server.distributed.connection import Connection
from mesh_motion_server.distributed.model import DistributedModel
from mesh_motion_server.numerics.mesh.roles import Patch
from mesh_motion_server.numerics.method import Method
from mesh_motion_server.numerics.motion.motion import MotionModel
from mesh_motion_server.numerics.motion.motion_found import Motion

MESHES = {"block": lambda: stored("thesis_block"), "cube": lambda: box_mesh("tetra", 10)}


def patches_of(mesh: BodyMesh) -> dict[str, Patch]:
    return {"body": Patch("moving", mesh.body), "outer": Patch("fixed", mesh.outer)}


def local_model(mesh: BodyMesh, method: Method) -> MotionModel:
    return MotionModel.build(mesh.points, mesh.cells, patches_of(mesh), method)


def distributed_model(mesh: BodyMesh, method: Method, connection: Connection, **options: Any) -> DistributedModel:
    return DistributedModel.build(
        mesh.points, mesh.cells, patches_of(mesh), method, connection=connection, **{"partitions": 3} | options
    )


def waypoints(mesh: BodyMesh, count: int = 3) -> Iterator[np.ndarray]:
    """Where the body is after each of some steps: it swims and bends."""
    body = mesh.points[np.sort(mesh.body)]
    centre = body.mean(axis=0)
    for step in range(1, count + 1):
        arm = body - centre
        bent = (
            arm
            + 0.5 * step * arm[:, ::-1] ** 2
            - 0.04 * step * arm[:, ::-1] * np.array([1.0, -1.0, 0.5][: arm.shape[1]])
        )
        yield centre + bent + 0.01 * step


def assert_same(found: Motion, expected: Motion) -> None:
    """Bitwise, except for the means."""
    np.testing.assert_array_equal(found.points, expected.points)
    for summary in ("standard", "corrected"):
        one, other = getattr(found, summary), getattr(expected, summary)
        assert (one.inverted, one.cells, one.worst) == (other.inverted, other.cells, other.worst)
        for name in ("metric", "size", "skew", "size_skew"):
            a, b = getattr(one, name), getattr(other, name)
            assert (a.min, a.p1, a.p5, a.p50) == (b.min, b.p1, b.p5, b.p50)
            assert abs(a.mean - b.mean) < 1e-14
