"""MOVE: one coupling iteration; boundary displacements in, displacements of all nodes out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from mesh_motion_numerics.stopwatch import time_limit
from mesh_motion_protocol.errors import InvalidInput
from mesh_motion_protocol.messages import Message, Move, Moved
from numpy.typing import NDArray

from mesh_motion_server.failpoints import failpoint
from mesh_motion_server.service.reports import correction_report, faces_report, headroom_report, move_quality, shortened
from mesh_motion_server.service.rows import check_values
from mesh_motion_server.session.session import Session
from mesh_motion_server.session.state import Operation
from mesh_motion_server.session.values import MoveOutcome, VelocityAsked

#: Displacements count from the committed state, or from the reference mesh.
FRAMES = ("committed", "reference")
_WITH_HEADROOM = ("faces", "headroom")
#: Limit of a displacement in extents of the mesh: beyond it cells are lost in rounding, and still larger ones overflow.
_FARTHEST = 1e12


def check(session: Session, request: Move) -> Move:
    """Check state, step, frame, shape, finiteness and size of one partition's displacements.

    Raises SessionError: FAILED_PRECONDITION.STATE or .STEP. Raises InvalidInput; the error names the partition, its
    node and the value.
    """
    session.admit(Operation.MOVE)
    session.require_next_step(request.step)
    if request.frame not in FRAMES:
        raise InvalidInput(
            f"frame: expected one of {', '.join(FRAMES)}, got {request.frame!r}",
            code="INVALID_ARGUMENT.VALUE",
            details={"frame": str(request.frame)},
        )
    if session.spec.evaluation == "client":
        _check_at_client(request)
    _check_rows(session, request, "displacement", request.displacement)
    session.require_later(request.time)
    _check_velocity(session, request)
    _check_headroom(request)
    _check_swept_faces(session, request)
    return request


def run(session: Session, requests: Sequence[Move]) -> list[Moved]:
    """Compute the trial and return the displacements of each partition's nodes."""
    boundary_displacements = [np.asarray(request.displacement, dtype=np.float64) for request in requests]
    report = "faces" if any(request.report == "faces" for request in requests) else ""
    scheme, time = requests[0].velocity, requests[0].time  # the same in all: the requests agree
    boundary = [np.asarray(one.boundary_velocity, dtype=np.float64) for one in requests if scheme == "tangent"]
    velocity = VelocityAsked(scheme, time, boundary) if scheme else None
    shortest = min((request.compute_limit_ms for request in requests if request.compute_limit_ms), default=math.inf)
    with time_limit(shortest / 1000.0):
        outcome = session.move(requests[0].frame, boundary_displacements, report=report, time=time, velocity=velocity)
    failpoint("request.moved")
    motion = outcome.motion
    quality, correction = move_quality(motion, session), correction_report(motion)
    faces = faces_report(outcome.faces, session.mesh)
    ways = {request.headroom_along for request in requests if request.report in _WITH_HEADROOM}
    headroom = {
        way: headroom_report(session.headroom(way, outcome.velocity), session.mesh) | {"along": way} for way in ways
    }
    return [
        Moved(
            client=request.client,
            sequence=request.sequence,
            step=outcome.step,
            iteration=outcome.iteration,
            quality=quality,
            correction=correction,
            caches={**motion.caches, "bytes": session.factors.held()},
            seconds={name: float(value) for name, value in motion.seconds.items()},
            warnings=shortened(list(motion.warnings)),
            faces=faces if request.report == "faces" else {},
            headroom=headroom[request.headroom_along] if request.report in _WITH_HEADROOM else {},
            displacement=outcome.displacements[request.partition],
            velocity=None if outcome.velocity is None else session.mesh.scatter(outcome.velocity, request.partition),
            swept=session.swept(request.partition, request.swept_faces) if request.report == "swept" else None,
            enrichment_points=np.ascontiguousarray(motion.correction.enrichment_points, dtype=np.float64),
            **_field_of(session, outcome, request),
        )
        for request in requests
    ]


def of_all(replies: Sequence[Message]) -> Message:
    """One reply for all partitions: the first one; for MOVED with the requested reports of any partition.

    A headroom in steps is preferred, because alerts use it.
    """
    moved = [reply for reply in replies if isinstance(reply, Moved)]
    if not moved:
        return replies[0]
    faces = [reply.faces for reply in moved if reply.faces]
    headroom = sorted((reply.headroom for reply in moved if reply.headroom), key=lambda one: one["along"] != "step")
    return replace(moved[0], faces=next(iter(faces), {}), headroom=next(iter(headroom), {}))


def _field_of(session: Session, outcome: MoveOutcome, request: Move) -> dict[str, Any]:
    """The data of the field that the partition needs, if the client evaluates the field."""
    field = session.field_part(outcome.field, request.partition)
    if field is None:
        return {}
    return {"coefficients": field.coefficients} if request.field_known else vars(field)


def _check_at_client(request: Move) -> None:
    """Check that the MOVE requests nothing for which the volume or the way to the committed state is needed."""
    for name, expected, way_out in (
        ("frame", "reference", "send the total displacement, since the reference mesh"),
        ("report", "", "compute the report in the client, which has the cells"),
        ("velocity", "", "compute velocities in the client from the nodes' positions"),
    ):
        got = getattr(request, name)
        if got != expected:
            raise InvalidInput(
                f"evaluation = 'client': expected {name} {expected!r}, got {got!r}",
                code="INVALID_ARGUMENT.VALUE",
                hint=way_out,
                details={"field": name, "value": got},
            )


def _check_velocity(session: Session, request: Move) -> None:
    """Check that the scheme has the data that it needs, and no other data."""
    if request.velocity:
        session.require_velocity(request.velocity, request.time)
    given, wanted = request.boundary_velocity is not None, request.velocity == "tangent"
    if given != wanted:
        text = "takes the velocities of the moving nodes" if wanted else "takes no boundary_velocity"
        raise InvalidInput(
            f"velocity = {request.velocity!r} {text}",
            code="INVALID_ARGUMENT.VALUE",
            hint="send boundary_velocity with velocity = 'tangent', and only with it",
            details={"field": "boundary_velocity"},
        )
    if request.boundary_velocity is not None:
        _check_rows(session, request, "boundary_velocity", request.boundary_velocity)


def _check_headroom(request: Move) -> None:
    """Check that a way to continue is named only with a headroom, and that the way "velocity" has a velocity."""
    along = request.headroom_along
    if along == "step":
        return
    if request.report not in _WITH_HEADROOM:
        needed, way_out = f"report 'headroom', got {request.report!r}", "ask for the report 'headroom'"
    elif along == "velocity" and not request.velocity:
        needed, way_out = "a velocity, got ''", "ask for a velocity: 'tangent' with the boundary_velocity"
    else:
        return
    raise InvalidInput(
        f"headroom_along = {along!r}: expected {needed}",
        code="INVALID_ARGUMENT.VALUE",
        hint=f"{way_out}, or leave headroom_along out",
        details={"field": "headroom_along"},
    )


def _check_swept_faces(session: Session, request: Move) -> None:
    """Check that faces are given only with swept volumes, each with nodes of the partition."""
    faces = request.swept_faces
    if faces is None:
        return
    d, count = session.spec.dimension, len(session.mesh.node_maps[request.partition])
    if request.report != "swept":
        raise InvalidInput(
            f"swept_faces: expected report 'swept', got {request.report!r}",
            code="INVALID_ARGUMENT.VALUE",
            hint="ask for the report 'swept', or leave swept_faces out",
            details={"field": "swept_faces"},
        )
    columns = faces.shape[1]
    if columns != d and (d < 3 or columns < 3):
        expected = "a node", "the two nodes of an edge", "3 nodes or more, the last columns filled up with -1"
        raise InvalidInput(
            f"swept_faces of partition {request.partition}: expected {expected[d - 1]} in each row, got {columns} "
            "columns",
            code="INVALID_ARGUMENT.SHAPE",
            details={"partition": request.partition, "expected": d, "got": list(faces.shape)},
        )
    # −1 fills the end of a row only, and each face has at least d nodes
    filled = np.logical_and.accumulate(faces[:, ::-1] == -1, axis=1)[:, ::-1] if d == 3 else np.zeros(faces.shape, bool)
    filled[:, :d] = False
    bad = np.argwhere(~filled & ((faces < 0) | (faces >= count)))
    if len(bad):
        row, column = (int(i) for i in bad[0])
        raise InvalidInput(
            f"swept_faces of partition {request.partition}, row {row}: column {column} is {faces[row, column]}, "
            f"expected a node 0 … {count - 1}",
            code="INVALID_ARGUMENT.VALUE",
            details={"partition": request.partition, "row": row, "value": int(faces[row, column])},
        )


def _check_rows(session: Session, request: Move, name: str, values: NDArray[np.floating]) -> None:
    """Check that there is one finite row of plausible size for each moving node of the partition."""
    displacement, nodes = np.asarray(values), session.mesh.moving_local[request.partition]
    expected = (len(nodes), session.spec.dimension)
    if displacement.shape != expected or displacement.dtype.kind != "f":
        raise InvalidInput(
            f"{name} of partition {request.partition}: expected floats of shape {expected}, one row per node of "
            f"BUILT.moving_nodes, got {displacement.dtype} of shape {displacement.shape}",
            code="INVALID_ARGUMENT.SHAPE" if displacement.dtype.kind == "f" else "INVALID_ARGUMENT.DTYPE",
            details={"partition": request.partition, "expected": list(expected), "got": list(displacement.shape)},
        )
    if name == "displacement":  # huge finite numbers mark a missing value
        times = f", {_FARTHEST:.0e} times the extent of the mesh"
        check_values(name, request.partition, displacement, nodes, _FARTHEST * session.mesh.extent, times)
    else:
        check_values(name, request.partition, displacement, nodes)
