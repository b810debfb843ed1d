"""Unusual but right inputs against a session: each has to be taken, and answered as exactly as its row says.

The moving nodes always go, bitwise, to their prescribed positions, no library warns, and the step can be committed.
The rows are in :mod:`tests.faults.inputs.extremes`.
"""

import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from mesh_motion_protocol.messages import Built, ErrorReply, Message, Moved

from mesh_motion_server.session.store import SessionStore
from tests.faults.bad_inputs import Verdicts
from tests.faults.inputs.drafts import DRAFTS, Draft
from tests.faults.inputs.extremes import EXTREMES, Extreme, Outcome
from tests.faults.inputs.rig import Rig, opened


class _Refused(Exception):
    """A request of a right session was refused, or a library warned."""


def prove_extreme_inputs(rows: Sequence[Extreme] = EXTREMES) -> Verdicts:
    """Run a session for each row, in this process; nothing in it is drawn at random."""
    verdicts = Verdicts(seed=0)
    with tempfile.TemporaryDirectory() as folder:
        store = SessionStore(Path(folder))
        known = {name: _outcome(DRAFTS[name](), store, number) for number, name in enumerate({r.draft for r in rows})}
        for number, row in enumerate(rows, len(known)):
            verdicts.cases += 1
            draft = DRAFTS[row.draft]()
            row.change(draft)
            try:
                complaint = row.judge(_outcome(draft, store, number), known[row.draft])
            except _Refused as error:
                complaint = str(error)
            if complaint:
                verdicts.wrong[row.name] = complaint
    return verdicts


def _outcome(draft: Draft, store: SessionStore, number: int) -> Outcome:
    """What a whole session answers."""
    rig = opened(draft, store, f"{number:032x}")
    if isinstance(rig, ErrorReply):
        raise _Refused(f"OPEN: {rig.code}: {rig.message}")
    try:
        return _session(rig, draft)
    finally:
        rig.host.close()


def _session(rig: Rig, draft: Draft) -> Outcome:
    refused = rig.upload_all(draft)
    if refused is not None:
        raise _Refused(f"UPLOAD: {refused.code}: {refused.message}")
    built, moved = _only(rig.collective("BUILD")), _only(rig.move(draft))
    _only(rig.collective("COMMIT", step=1))
    if rig.noise:
        raise _Refused(f"a library warned of {rig.noise[0]}")
    assert isinstance(built, Built)  # errors are raised above
    assert isinstance(moved, Moved)
    prescribed = draft.moved.astype(np.float64)
    if moved.displacement[built.moving_nodes].tobytes() != prescribed.tobytes():
        raise _Refused("a moving node is not at its prescribed position")
    return Outcome(
        moved.displacement, prescribed, built.moving_nodes, moved.quality["corrected"], list(built.mesh["warnings"])
    )


def _only(replies: list[Message]) -> Message:
    """The reply of the only partition."""
    if isinstance(replies[0], ErrorReply):
        raise _Refused(f"{replies[0].code}: {replies[0].message}")
    return replies[0]
