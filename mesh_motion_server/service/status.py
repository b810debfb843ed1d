"""STATUS: reports the state of the session."""

from __future__ import annotations

import resource
from dataclasses import replace

import msgpack
from mesh_motion_protocol.messages import Status, StatusReport

from mesh_motion_server.session.session import Session
from mesh_motion_server.session.state import Operation


def answer(session: Session, request: Status, waiting_for: list[int], counts: dict[str, int]) -> StatusReport:
    """State, step, iteration and a report.

    Parameters
    ----------
    waiting_for : list of int
        Partitions that a collective request is still waiting for.
    counts : dict
        Requests answered so far, by reply type.
    """
    session.admit(Operation.STATUS)
    report = {
        "epoch": session.epoch,
        "label": session.spec.label,
        "durability": session.spec.durability,
        "replies": counts,
        "caches": session.factors.report(),
        "peak_memory_bytes": 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss,
        "upload_bytes": session.upload.nbytes,
    }
    if session.commits:
        receipt = msgpack.unpackb(session.commits[-1].receipt)
        report |= {name: receipt[name] for name in ("quality", "final_step") if name in receipt}
    return StatusReport(
        client=request.client,
        sequence=request.sequence,
        state=str(session.state),
        step=session.step,
        durable_step=session.durable_step,
        iteration=session.iteration,
        waiting_for=waiting_for,
        report=report,
    )


def without_places(reply: StatusReport) -> StatusReport:
    """The report without the worst cells, which have coordinates: it shows the quality, but no part of the mesh."""
    quality = {key: value for key, value in reply.report.get("quality", {}).items() if key != "worst"}
    return replace(reply, report=reply.report | ({"quality": quality} if quality else {}))
