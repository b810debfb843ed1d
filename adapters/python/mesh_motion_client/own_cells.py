"""The cells of a partition whose client evaluates the field: judged, and corrected where the server says so."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from mesh_motion_protocol.messages import Correct, Corrected, Fetched, Judge, Judged, Moved

from mesh_motion_client.courier import Courier
from mesh_motion_client.volume import Floats, Volume

__all__ = ["OwnCells"]


class OwnCells:
    """What follows a MOVE, and a FETCH, of such a session.

    Parameters
    ----------
    volume : Volume
    courier : Courier
        Repeats what was sent about a trial, where a worker's end has lost it.
    """

    def __init__(self, volume: Volume, courier: Courier) -> None:
        self.volume = volume
        self._courier = courier
        self._corrected: dict[int, Corrected] = {}  # by step: of the trial, and of the committed state

    def take_trial(self, moved: Moved, seconds: float) -> dict[str, Any]:
        """Move the nodes, judge the cells, correct them where the server says so; what changes of the answer."""
        displacement, metric = self.volume.displacement(moved), moved.quality["metric"]
        self._corrected.pop(moved.step, None)
        judged = self._judged(moved.step, self.volume.judge(displacement, metric), seconds)
        if judged.region:
            corrected = self._correct(moved, moved.step, judged.region, "trial", seconds)
            self._corrected[moved.step] = corrected
            self.volume.correct(displacement, corrected)
            judged = self._judged(moved.step, self.volume.judge(displacement, metric), seconds)
        return {
            "displacement": displacement,
            "quality": judged.quality,
            "correction": (judged.correction or moved.correction) | {"reached": judged.reached},
            "warnings": [*moved.warnings, *judged.warnings],
        }

    def keep(self, step: int) -> None:
        """The trial is committed: its correction is that of the committed state."""
        self._corrected = {known: found for known, found in self._corrected.items() if known == step}

    def forget(self) -> None:
        """Know no correction any more: the next :meth:`coordinates` asks for it, with all other partitions."""
        self._corrected.clear()

    def coordinates(self, fetched: Fetched, seconds: float) -> Floats:
        """(n, d) coordinates of all nodes; where they were corrected before a resume, with all other partitions."""
        corrected = None
        if fetched.region:
            corrected = self._corrected.get(fetched.step)
            if corrected is None:
                corrected = self._correct(fetched, fetched.step + 1, fetched.region, "committed", seconds)
                self._corrected[fetched.step] = corrected
        return self.volume.coordinates(fetched, corrected)

    def _judged(self, step: int, fields: Callable[[list[dict[str, Any]]], dict[str, Any]], seconds: float) -> Judged:
        """Send the quality of this partition's cells, until the server asks for nothing more."""
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
    ) -> Corrected:
        """Send the bad cells and those about them until the server has corrected them."""
        around = np.empty(0, dtype=np.int64)
        while True:
            fields = self.volume.region(reply, region, around)
            correct = Correct(**self._courier.address, step=step, what=what, **fields)
            corrected = self._courier.deliver(correct, Corrected, seconds)
            if not corrected.region:
                if what == "trial":
                    self._courier.trial = (*self._courier.trial, correct)
                return corrected
            region, around = corrected.region, corrected.nodes
