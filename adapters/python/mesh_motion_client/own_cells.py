"""The cells of a partition whose client evaluates the field: the client judges them, and corrects them on request."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from mesh_motion_protocol.messages import Correct, Corrected, Fetched, Judge, Judged, Moved

from mesh_motion_client.courier import Courier
from mesh_motion_client.volume import Floats, Ints, Volume

__all__ = ["OwnCells"]

#: No node was corrected, and none was sent.
_NOTHING = None, np.empty(0, dtype=np.int64)


class OwnCells:
    """The further steps after a MOVE, and after a FETCH, in such a session.

    Parameters
    ----------
    courier : Courier
        Sends the requests of a trial again if the trial was lost with its worker.
    """

    def __init__(self, volume: Volume, courier: Courier) -> None:
        self.volume = volume
        self._courier = courier
        # by step, for the trial and the committed state; with the global ids of the nodes that were sent for it
        self._corrected: dict[int, tuple[Corrected | None, Ints]] = {}

    def take_trial(self, moved: Moved, seconds: float) -> dict[str, Any]:
        """Move the nodes, judge the cells, correct them on request; return the changed fields of the answer."""
        displacement, metric = self.volume.displacement(moved), moved.quality["metric"]
        self._corrected[moved.step] = _NOTHING
        judged = self._judged(moved.step, self.volume.judge(displacement, metric), seconds)
        if judged.region:
            self._corrected[moved.step] = self._correct(moved, moved.step, judged.region, "trial", seconds)
            corrected = self._corrected[moved.step][0]
            assert corrected is not None
            self.volume.correct(displacement, corrected)
            judged = self._judged(moved.step, self.volume.judge(displacement, metric), seconds)
        return {
            "displacement": displacement,
            "quality": judged.quality,
            "correction": (judged.correction or moved.correction) | {"reached": judged.reached},
            "warnings": [*moved.warnings, *judged.warnings],
        }

    def keep(self, step: int) -> None:
        """Keep the committed trial's correction as that of the committed state."""
        self._corrected = {known: found for known, found in self._corrected.items() if known == step}

    def forget(self) -> None:
        """Forget all corrections: all partitions must make the next call of :meth:`coordinates` together."""
        self._corrected.clear()

    def coordinates(self, fetched: Fetched, seconds: float) -> Floats:
        """(n, d) coordinates of all nodes.

        If they were corrected before a resume, all partitions must call this together.
        """
        if fetched.step not in self._corrected:
            self._corrected[fetched.step] = _NOTHING
            if fetched.region:
                found = self._correct(fetched, fetched.step + 1, fetched.region, "committed", seconds)
                self._corrected[fetched.step] = found
        return self.volume.coordinates(fetched, self._corrected[fetched.step][0] if fetched.region else None)

    def knows(self, step: int) -> bool:
        """Whether the correction of a trial, or of the committed state, is known."""
        return step in self._corrected

    def counted(self, weights: Floats, step: int) -> dict[str, Floats | Ints]:
        """COTANGENT's fields for weights (n, c d) of all nodes, at a trial or the committed state."""
        return self.volume.counted(weights, self._corrected[step][1])

    def _judged(self, step: int, fields: Callable[[list[dict[str, Any]]], dict[str, Any]], seconds: float) -> Judged:
        """Send the quality of this partition's cells until the server asks no more questions."""
        questions: list[dict[str, Any]] = []
        while True:
            judge = Judge(**self._courier.address, step=step, **fields(questions))
            judged = self._courier.deliver(judge, Judged, seconds)
            if not judged.questions:
                self._courier.trial = (*self._courier.trial, judge)
                return judged
            questions += judged.questions

    def _correct(
        self,
        reply: Moved | Fetched,
        step: int,
        region: dict[str, Any],
        what: Literal["trial", "committed"],
        seconds: float,
    ) -> tuple[Corrected, Ints]:
        """Send the bad cells and their neighbours until the server has corrected them.

        Return the server's reply and the nodes that were sent last.
        """
        around = np.empty(0, dtype=np.int64)
        while True:
            fields = self.volume.region(reply, region, around)
            correct = Correct(**self._courier.address, step=step, what=what, **fields)
            corrected = self._courier.deliver(correct, Corrected, seconds)
            if not corrected.region:
                if what == "trial":
                    self._courier.trial = (*self._courier.trial, correct)
                return corrected, fields["nodes"][:, 0]
            region, around = corrected.region, corrected.nodes
