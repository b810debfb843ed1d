"""JUDGE: a client's ranks send the quality of their cells; the session adds up, and accepts or refuses the trial."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

from mesh_motion_numerics.distributed.judging import RankReport, Unanswered, as_plain, read_report, summary_of
from mesh_motion_protocol.messages import Judge, Judged

from mesh_motion_server.service.reports import quality_frame, region_correction_report, shortened, summary_report
from mesh_motion_server.session.session import Session
from mesh_motion_server.session.state import Operation


def check(session: Session, request: Judge) -> tuple[Judge, RankReport]:
    """Check the step and the state, and that the session's cells are with the client.

    Raises SessionError: FAILED_PRECONDITION.STATE or .STEP; ABORTED.TRIAL_LOST. Raises InvalidInput if the fields are
    inconsistent.
    """
    session.require_client_evaluation()
    session.admit(Operation.JUDGE)
    session.require_next_step(request.step)
    number = partial(session.mesh.cell_number, request.partition)
    return request, read_report(vars(request), number, partition=request.partition)


def run(session: Session, reports: Sequence[tuple[Judge, RankReport]]) -> list[Judged]:
    """Add up the parts of all partitions, and judge the trial; or request more data."""
    mesh, method = session.mesh, session.model.method
    reply: dict[str, Any] = {"questions": [], "quality": {}, "reached": False, "warnings": []}
    try:
        found = summary_of([report for _, report in reports], method.quality_metric)
    except Unanswered as unknown:
        reply["questions"] = as_plain(unknown.questions)
    else:
        verdict = session.judge(found)
        standard, corrected = (summary_report(each, mesh) for each in (verdict.standard, found))
        reply["quality"] = quality_frame(method) | {"standard": standard, "corrected": corrected}
        reply |= {"reached": found.metric.min >= method.quality_threshold, "warnings": shortened(verdict.warnings)}
        done = verdict.correction
        reply["correction"] = {} if done is None else region_correction_report(done, session)
        reply["region"] = {} if verdict.extent is None else verdict.extent.as_plain()
    return [Judged(client=one.client, sequence=one.sequence, step=one.step, **reply) for one, _ in reports]
