"""Counts executed requests for the operator: number, duration and quality, without the client's identity."""

from __future__ import annotations

import math

from mesh_motion_protocol.messages import Built, Committed, Message, Moved

from mesh_motion_server.operation.tally import TALLY

__all__ = ["count_executed"]

#: Number of steps for a headroom that is left out because it is larger.
_BEYOND = 100.0
#: Name of the operation in the metrics, by the type of its reply.
_NAMES = {Built.type: "build", Moved.type: "move", Committed.type: "commit"}


def count_executed(reply: Message, seconds: float) -> None:
    """Count an operation by its reply; for several partitions by the reply of :func:`.move.of_all`.

    Parameters
    ----------
    seconds : float
        Duration of the operation.
    """
    name = _NAMES.get(reply.type)
    if name is None:
        return
    TALLY.count(f"{name}s")
    TALLY.observe(f"{name}_seconds", seconds)
    if isinstance(reply, Moved) and "standard" in reply.quality:
        _count_motion(reply)


def _count_motion(moved: Moved) -> None:
    """Count the predicted quality and the result of the correction."""
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
