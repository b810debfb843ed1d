"""TANGENT and COTANGENT: the motion's derivative times velocities of the boundary, and its transpose times weights."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from mesh_motion_protocol.messages import Cotangent, CotangentFound, Tangent, TangentFound

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.arrays import Floats, Integers
from mesh_motion_server.session.session import Session
from mesh_motion_server.session.state import Operation

__all__ = ["check_cotangent", "check_tangent", "cotangent", "tangent"]


def check_tangent(session: Session, request: Tangent) -> None:
    """Check state, method, shape and finiteness of one partition's velocities.

    Raises
    ------
    SessionError
        FAILED_PRECONDITION.STATE.
    InvalidInput
        If the method has no derivative; the error names the key. If a value is wrong; it names the node.
    """
    session.require_slope(Operation.TANGENT, request.what)
    _check(session, "velocity", request.velocity, session.mesh.moving_local[request.partition], request.partition)


def check_cotangent(session: Session, request: Cotangent) -> None:
    """The same for weights of all nodes."""
    session.require_slope(Operation.COTANGENT, request.what)
    nodes = np.arange(len(session.mesh.node_maps[request.partition]))
    _check(session, "weights", request.weights, nodes, request.partition)


def tangent(session: Session, requests: Sequence[Tangent]) -> list[TangentFound]:
    """Velocities of all nodes."""
    found = session.tangent(requests[0].what, [np.asarray(one.velocity, dtype=np.float64) for one in requests])
    return [TangentFound(**_at(session, one), velocity=rows) for one, rows in zip(requests, found, strict=True)]


def cotangent(session: Session, requests: Sequence[Cotangent]) -> list[CotangentFound]:
    """Weights of the moving nodes."""
    found = session.cotangent(requests[0].what, [np.asarray(one.weights, dtype=np.float64) for one in requests])
    return [CotangentFound(**_at(session, one), weights=rows) for one, rows in zip(requests, found, strict=True)]


def _at(session: Session, request: Tangent | Cotangent) -> dict[str, Any]:
    """The fields of a reply that say where the derivative is."""
    iteration = session.iteration if request.what == "trial" else 0
    return {"client": request.client, "sequence": request.sequence, "step": session.step, "iteration": iteration}


def _check(session: Session, name: str, values: Floats, nodes: Integers, partition: int) -> None:
    """Check that there is one finite row per node, of whole vectors."""
    values, d = np.asarray(values), session.spec.dimension
    if values.ndim != 2 or len(values) != len(nodes) or values.shape[1] % d or not values.shape[1]:
        raise InvalidInput(
            f"{name} of partition {partition}: expected shape ({len(nodes)}, {d} c), the {d} components of c vectors "
            f"one after the other, got {values.shape}",
            code="INVALID_ARGUMENT.SHAPE",
            details={"partition": partition, "expected": [len(nodes), d], "got": list(values.shape)},
        )
    bad = np.argwhere(~np.isfinite(values))
    if len(bad):
        row, column = (int(i) for i in bad[0])
        raise InvalidInput(
            f"{name} of partition {partition}, row {row} (node {nodes[row]}): column {column} is {values[row, column]}",
            code="INVALID_ARGUMENT.NONFINITE",
            details={"partition": partition, "row": row, "node": int(nodes[row]), "value": str(values[row, column])},
        )
