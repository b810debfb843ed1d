"""BUILD: the mesh is complete; check it, make it durable, become READY."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from mesh_motion_numerics.arrays import Floats
from mesh_motion_protocol.messages import Build, Built

from mesh_motion_server.service.reports import mesh_report, summary_report
from mesh_motion_server.session.session import Session
from mesh_motion_server.session.state import Operation


def check(session: Session, request: Build) -> Build:
    """Check that the state allows it."""
    session.admit(Operation.BUILD)
    return request


def run(session: Session, requests: Sequence[Build]) -> list[Built]:
    """Build; reply to each partition which of its nodes it must move, or request the cells near moving walls."""
    reaches = [request.reach for request in requests if request.reach is not None]
    if len(reaches) == len(requests):  # a partition that sends no such cells gets a session without layers
        session.require_client_evaluation()
        needed, wall = session.needed_for_layers(reaches)
        if needed:
            return [_asking(request, needed, wall) for request in requests]
    warnings = _without_layers(session, [request.reach for request in requests])
    session.build()
    settings, mesh = session.model.method.as_dict(), mesh_report(session, [*session.mesh_warnings(), *warnings])
    quality = {}
    if session.spec.evaluation == "server":
        quality = summary_report(session.model.summary(session.coordinates("committed")), session.mesh)
    return [
        Built(
            client=request.client,
            sequence=request.sequence,
            step=session.step,
            settings=settings,
            mesh=mesh,
            quality=quality,
            derivatives=session.model.why_no_slope() is None,
            moving_nodes=moving,
        )
        for request, moving in zip(requests, session.mesh.moving_local, strict=True)
    ]


def _without_layers(session: Session, reaches: Sequence[float | None]) -> list[str]:
    """A warning if no layer can be carried because a partition does not send its cells; it may have an older client."""
    spec = session.spec
    if spec.evaluation == "server" or spec.dimension == 1 or spec.settings.to_method().correction != "smooth":
        return []
    found = session.upload.without_layers(reaches)
    return [
        f"partition {partition} has sent no {'cells near moving walls' if reaches[partition] is None else 'facets'}: "
        "no layer of thin cells moves with its wall, in any partition; this version's clients send them"
        for partition in found[:1]
    ]


def _asking(request: Build, reach: float, wall: Floats) -> Built:
    """A reply without a build: the cells at nodes within a reach of the wall (f, d, d) are needed."""
    return Built(
        client=request.client,
        sequence=request.sequence,
        step=0,
        settings={},
        mesh={},
        quality={},
        reach=reach,
        wall=wall.reshape(len(wall), -1),
        moving_nodes=np.empty(0, dtype=np.int64),
    )
