"""TANGENT and COTANGENT: the motion's derivative times velocities of the boundary, and its transpose times weights."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_protocol.errors import InvalidInput
from mesh_motion_protocol.messages import Cotangent, CotangentFound, Tangent, TangentFound

from mesh_motion_server.service.rows import check_values
from mesh_motion_server.session.field_slope import FieldCotangent
from mesh_motion_server.session.session import Session
from mesh_motion_server.session.state import Operation


def check_tangent(session: Session, request: Tangent) -> Tangent:
    """Check state, method, shape and finiteness of one partition's velocities.

    Raises SessionError: FAILED_PRECONDITION.STATE. Raises InvalidInput, which names the
    key, if the method has no derivative; or the node, if a value is wrong.
    """
    session.require_slope(Operation.TANGENT, request.what)
    _check(session, "velocity", request.velocity, session.mesh.moving_local[request.partition], request.partition)
    return request


def check_cotangent(session: Session, request: Cotangent) -> Cotangent:
    """The same for weights of all nodes."""
    session.require_slope(Operation.COTANGENT, request.what)
    nodes = np.arange(len(session.mesh.node_maps[request.partition]))
    _check(session, "weights", request.weights, nodes, request.partition)
    if session.spec.evaluation == "client":
        _check_of_field(session, request)
    return request


def tangent(session: Session, requests: Sequence[Tangent]) -> list[TangentFound]:
    """Reply with the velocities of all nodes."""
    given = [np.asarray(one.velocity, dtype=np.float64) for one in requests]
    if session.spec.evaluation == "client":
        return _tangent_of_field(session, requests, given)
    found = session.tangent(requests[0].what, given)
    return [TangentFound(**_at(session, one), velocity=rows) for one, rows in zip(requests, found, strict=True)]


def cotangent(session: Session, requests: Sequence[Cotangent]) -> list[CotangentFound]:
    """Reply with the weights of the moving nodes."""
    given = [np.asarray(one.weights, dtype=np.float64) for one in requests]
    if session.spec.evaluation == "client":
        found = session.field_cotangent(requests[0].what, _of_field(session, requests, given))
    else:
        found = session.cotangent(requests[0].what, given)
    return [CotangentFound(**_at(session, one), weights=rows) for one, rows in zip(requests, found, strict=True)]


def _tangent_of_field(session: Session, requests: Sequence[Tangent], given: list[Floats]) -> list[TangentFound]:
    """Velocities of the uploaded nodes, the field of all others, and the nodes that the correction frees."""
    found = session.field_tangent(requests[0].what, given)
    return [
        TangentFound(
            **_at(session, one),
            velocity=session.mesh.scatter(found.velocity, one.partition),
            coefficients=found.coefficients[session.field_rows(one.partition)],
            freed=found.freed,
            freed_velocity=found.of_freed,
        )
        for one in requests
    ]


def _of_field(session: Session, requests: Sequence[Cotangent], given: list[Floats]) -> FieldCotangent:
    """Add up the arrays that the partitions send."""
    first, mesh = requests[0], session.mesh
    rows = [session.field_rows(one.partition) for one in requests]
    whole = session.field("reference")
    assert whole is not None
    coefficients = np.zeros((len(whole.coefficients), given[0].shape[1]))
    ids, weights = [], []
    for one, own in zip(requests, rows, strict=True):
        assert one.coefficients is not None
        coefficients[own] += one.coefficients
        if one.region is not None and one.region_weights is not None:
            ids.append(one.region)
            weights.append(one.region_weights)
    nothing = np.empty((0, first.weights.shape[1]))
    of_ids = np.concatenate([nothing, *weights])
    return FieldCotangent(
        mesh.gather_sums(given), coefficients, np.concatenate([np.empty(0, dtype=np.int64), *ids]), of_ids
    )


def _check_of_field(session: Session, request: Cotangent) -> None:
    """Check the weights of the nodes that only the client has."""
    if request.coefficients is None:
        raise InvalidInput(
            "evaluation = 'client': COTANGENT has no coefficients",
            code="INVALID_ARGUMENT.VALUE",
            hint="send what the nodes that were not uploaded count for the field's coefficients",
            details={"field": "coefficients"},
        )
    own, columns = session.field_rows(request.partition), request.weights.shape[1]
    ids = np.empty(0, dtype=np.int64) if request.region is None else request.region
    _check(session, "coefficients", request.coefficients, np.arange(len(own)), request.partition)
    of_ids = np.empty((0, columns)) if request.region_weights is None else request.region_weights
    _check(session, "region_weights", of_ids, ids, request.partition)
    for name, rows in (("coefficients", request.coefficients), ("region_weights", of_ids)):
        if rows.shape[1] != columns:
            raise InvalidInput(
                f"{name} of partition {request.partition}: expected {columns} columns, as weights has, "
                f"got {rows.shape[1]}",
                code="INVALID_ARGUMENT.SHAPE",
                details={"partition": request.partition, "expected": columns, "got": rows.shape[1]},
            )


def _at(session: Session, request: Tangent | Cotangent) -> dict[str, Any]:
    """The fields of a reply that name the state of the derivative."""
    iteration = session.iteration if request.what == "trial" else 0
    return {"client": request.client, "sequence": request.sequence, "step": session.step, "iteration": iteration}


def _check(session: Session, name: str, values: Floats, nodes: Integers, partition: int) -> None:
    """Check that there is one row per node, of whole vectors, with usable values."""
    values, d = np.asarray(values), session.spec.dimension
    if values.ndim != 2 or len(values) != len(nodes) or values.shape[1] % d or not values.shape[1]:
        raise InvalidInput(
            f"{name} of partition {partition}: expected shape ({len(nodes)}, {d} c), the {d} components of c vectors "
            f"one after the other, got {values.shape}",
            code="INVALID_ARGUMENT.SHAPE",
            details={"partition": partition, "expected": [len(nodes), d], "got": list(values.shape)},
        )
    check_values(name, partition, values, nodes)
