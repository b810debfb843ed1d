"""Records each request in the session's history, and counts it for the operator: made from the replies themselves, once
for all partitions. Counts have the number, duration and quality of the executed requests, not the client's identity.

A repeat that gets its stored reply is not recorded. Two kinds of refusals are not recorded either: refusals of a peer
that has not joined the session, such as the previous holder; and refusals of the same code in a row beyond a limit,
when a client repeats a refused request.
"""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

import msgpack
from mesh_motion_protocol.messages import Built, Committed, ErrorReply, Judged, Message, Moved, RolledBack

from mesh_motion_server import __version__
from mesh_motion_server.operation.tally import TALLY
from mesh_motion_server.service.reports import mesh_report
from mesh_motion_server.session.journal.ledger import Commit
from mesh_motion_server.session.replay import maker
from mesh_motion_server.session.session import Session
from mesh_motion_server.session.state import State

#: Steps of a headroom that is left out, since it takes more.
_BEYOND = 100.0
#: Name of the operation in the metrics, by the type of its reply.
_NAMES = {Built.type: "build", Moved.type: "move", Committed.type: "commit"}
#: How many refusals of one code in a row are recorded, with nothing executed in between; others are only counted.
_MOST_REFUSALS = 100
#: States that are recorded when they are first seen, because no request reports them.
_TROUBLE = {State.FAILED: "failed", State.FROZEN: "frozen"}


class Recorder:
    """Records the answers in the history."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._history = session.history
        self._refusals: Counter[str] = Counter()
        self._recorded_trouble = self._session.state
        self._unjudged: dict[str, Any] = {}

    def executed(self, reply: Message, seconds: float, iteration: int) -> None:
        """Count and record a request that took effect.

        Parameters
        ----------
        reply : Message
            The reply to one of the partitions, of several what :func:`.move.of_all` makes.
        seconds : float
            Duration of the request.
        iteration : int
            The trial's iteration before the request.
        """
        _count(reply, seconds)
        self._history.attempt(lambda: self._executed(reply, seconds, iteration))

    def refused(self, request: Message, reply: ErrorReply, *, by_holder: bool = True) -> None:
        """Record a refused request; ``by_holder``: the peer has joined."""
        self._history.attempt(lambda: self._refused(request, reply, by_holder))

    def resumed(self) -> None:
        """Record a new holder; first add from the journal the events that a crash kept out of the history."""
        self._history.begin_again()
        self._history.attempt(self._resumed)

    def suspended(self) -> None:
        """Record the end of the lease."""
        self._trouble("the disk failed when the lease ended")
        if self._session.state is State.SUSPENDED:
            self._record("suspended", step=self._session.step)

    def joined(self) -> None:
        """Record that a client has joined again."""
        self._record("joined", step=self._session.step)

    def closed(self) -> None:
        """Record that the session was closed and kept."""
        self._record("closed", step=self._session.step)

    # --- inside ----------------------------------------------------------------------------------------------------

    def _executed(self, reply: Message, seconds: float, iteration: int) -> None:
        if isinstance(reply, Moved):
            moved = _motion(reply) | {"seconds_total": seconds}
            if reply.coefficients is not None:
                self._unjudged = moved  # recorded after the client has judged it
            else:
                self._record("moved", **moved)
        elif isinstance(reply, Judged):
            if reply.quality and not reply.region and self._unjudged:
                judged = {"quality": reply.quality, "warnings": reply.warnings}
                done = {"correction": reply.correction} if reply.correction else {}
                self._record("moved", **self._unjudged | judged | done)
                self._unjudged = {}
        elif isinstance(reply, Committed):
            self._committed(self._session.commits[-1], seconds_total=seconds)
        elif isinstance(reply, RolledBack):
            self._record("rolled_back", step=reply.step + 1, iteration=iteration)
        elif isinstance(reply, Built):
            self._built(reply.mesh, reply.settings, quality=reply.quality, seconds_total=seconds)

    def _refused(self, request: Message, reply: ErrorReply, by_holder: bool) -> None:
        self._refusals[reply.code] += by_holder
        if by_holder and self._refusals[reply.code] <= _MOST_REFUSALS:
            step = getattr(request, "step", self._session.step + 1)
            refusal = {name: getattr(reply, name) for name in ("code", "message", "hint", "details")}
            self._history.record("refused", request=request.type, step=step, **refusal)
        self._trouble(reply.message)

    def _trouble(self, message: str) -> None:
        """Record FAILED or FROZEN once."""
        state = self._session.state
        if state in _TROUBLE and state is not self._recorded_trouble:
            self._record(_TROUBLE[state], step=self._session.step, message=message)
        self._recorded_trouble = state

    def _resumed(self) -> None:
        session = self._session
        begun, step = self._history.last_step()
        if session.is_built and not begun:
            settings = session.model.method.as_dict()
            self._built(mesh_report(session, warnings=[]), settings, seconds_total=0.0, recovered=True)
        for entry in session.commits:
            if entry.step > step:
                self._committed(entry, seconds_total=0.0, recovered=True)
        self._history.take_up(session.step, session.commits[-1].digest if session.step else b"")
        self._record("resumed", step=session.step, epoch=session.epoch, version=__version__, maker=maker())

    def _record(self, event: str, **values: Any) -> None:
        untold = sum(max(0, count - _MOST_REFUSALS) for count in self._refusals.values())
        self._refusals.clear()
        self._history.record(event, **values, **({"untold": untold} if untold else {}))

    def _committed(self, entry: Commit, **further: Any) -> None:
        self._history.record_outcome(entry.step, entry.digest)
        receipt = msgpack.unpackb(entry.receipt)
        further |= {name: receipt[name] for name in ("final_step",) if name in receipt}
        self._record("committed", step=entry.step, quality=receipt["quality"], digest=entry.digest.hex(), **further)

    def _built(self, mesh: dict[str, Any], settings: dict[str, Any], **further: Any) -> None:
        self._record("built", **mesh, settings=settings, version=__version__, maker=maker(), **further)


def _count(reply: Message, seconds: float) -> None:
    """Count an operation that took so many ``seconds``."""
    name = _NAMES.get(reply.type)
    if name is None:
        return
    TALLY.count(f"{name}s")
    TALLY.observe(f"{name}_seconds", seconds)
    if isinstance(reply, Moved) and "standard" in reply.quality:
        _count_motion(reply)


def _count_motion(moved: Moved) -> None:
    """Count the predicted quality and the correction's work."""
    inverted = moved.quality["standard"]["inverted"]
    if inverted:
        TALLY.count("predicted_inverted_cells", inverted)
    lowest = moved.quality["corrected"].get("metric", {}).get("min")
    if lowest is not None and math.isfinite(lowest):
        TALLY.observe("move_min_quality", lowest)
    if moved.headroom.get("along") == "step":
        TALLY.observe("move_headroom_steps", moved.headroom.get("inversion", _BEYOND))
    if moved.correction["iterations"]:
        TALLY.count("corrections", label=moved.correction["method"])


def _motion(moved: Moved) -> dict[str, Any]:
    """The content of MOVED, without the displacements and the worst faces."""
    names = ("step", "iteration", "quality", "correction", "caches", "seconds", "warnings")
    values = {name: getattr(moved, name) for name in names} | {"enrichment_points": moved.enrichment_points.tolist()}
    faces = {name: {key: said[key] for key in said if key != "worst"} for name, said in moved.faces.items()}
    asked = {"faces": faces, "headroom": moved.headroom}
    return values | {name: found for name, found in asked.items() if found}
