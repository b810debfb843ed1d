"""BUILD: the mesh is complete; check it, make it durable, become READY."""

from __future__ import annotations

from collections.abc import Sequence

from mesh_motion_protocol.messages import Build, Built

from mesh_motion_server.service.reports import mesh_report, summary_report
from mesh_motion_server.session.session import Session
from mesh_motion_server.session.state import Operation

__all__ = ["check", "run"]


def check(session: Session, request: Build) -> Build:
    """Check that the state allows it."""
    session.admit(Operation.BUILD)
    return request


def run(session: Session, requests: Sequence[Build]) -> list[Built]:
    """Build, and send each partition which of its nodes it has to move."""
    session.build()
    settings, mesh = session.model.method.as_dict(), mesh_report(session)
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
