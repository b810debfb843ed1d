"""A session's history as columns by step, for charts."""

import math
from collections.abc import Iterable, Mapping
from contextlib import suppress
from itertools import pairwise
from typing import Any

import numpy as np
from mesh_motion_numerics.arrays import Floats

from mesh_motion_server.watch.observation.fold import Place, StepFold, number_of

#: Statistics of a distribution.
QUALITY = ("min", "p1", "p5", "p50", "mean")
#: The phases of a Move.
PHASES = ("solve", "predict", "correct", "displace")

COLUMNS = (
    "step",
    "at",
    *(f"predicted_{name}" for name in QUALITY),
    "standard_min",
    *(f"actual_{name}" for name in QUALITY),
    "threshold",
    "inverted",
    "reached",
    "iterations",
    "enrichment_points",
    "freed_nodes",
    "refusals",
    "rollbacks",
    *(f"seconds_{name}" for name in PHASES),
    "seconds_total",
    "non_orthogonality",
)
#: How thinning combines a group of steps: counts are summed, other columns take the worst value; otherwise a step of
#: forty iterations would be visible only by chance.
_SUMS = ("refusals", "rollbacks")
_LARGEST = ("iterations", "inverted", *(f"seconds_{name}" for name in PHASES), "seconds_total", "non_orthogonality")
_LEAST = ("predicted_min", "standard_min", "reached")

Columns = dict[str, Floats]


class Series:
    """Columns by committed step, filled with events.

    ``predicted_*``: the quality metric of the corrected mesh, as predicted by the step's last Move; ``standard_min``:
    the minimum predicted without a correction; ``actual_*``: the metric of the committed coordinates; NaN if not
    recorded. Percentiles are those of the first Move of a step, so that ``predicted_p1`` may lie below the
    ``predicted_min`` of a later one. ``iterations``, ``seconds_*``, ``refusals`` (of Moves) and ``rollbacks`` are sums
    over all Moves of the step, including those that were rolled back. ``at`` is Unix time, ``reached`` 1 or 0,
    ``non_orthogonality`` the largest value of the faces, degrees, if the step's last Move requested it.

    Steps that were lost in a crash (``relaxed``) are removed when the session resumes before them.

    Attributes
    ----------
    metric : str
        Name of the quality metric; empty until it is known.
    enrichment_points : list
        Rows of coordinates, from the last Move.
    """

    def __init__(self, events: Iterable[Mapping[str, Any]] = ()) -> None:
        self.metric = ""
        self.enrichment_points: list[list[float]] = []
        self._table = np.empty((64, len(COLUMNS)))
        self._count = 0
        self._open = _empty_step()
        self._fold = StepFold()
        for event in events:
            self.add(event)

    def __len__(self) -> int:
        return self._count

    def add(self, event: Mapping[str, Any]) -> None:
        """Add an event; skip unknown events, and incomplete ones, which another version may have written."""
        with suppress(KeyError, TypeError, ValueError, AttributeError):
            self._add(event)

    def _add(self, event: Mapping[str, Any]) -> None:
        self._turn(self._fold.take(event))
        take = {
            "moved": self._moved,
            "committed": self._committed,
            "refused": self._refused,
            "rolled_back": self._rolled_back,
        }.get(str(event["event"]))
        if take is not None:
            take(event)

    @property
    def open_refusals(self) -> int:
        """Number of refused Moves of the step that is not committed yet, which is in no column."""
        return int(self._open["refusals"])

    def columns(self, most: int | None = None, *, first: int | None = None) -> Columns:
        """Columns of one length, by name.

        Parameters
        ----------
        first : int, optional
            Steps before it are left out.
        most : int, optional
            See :func:`thinned`.
        """
        steps = self._table[: self._count, 0]
        begin = 0 if first is None else int(np.searchsorted(steps, first))
        table = self._table[begin : self._count].copy()  # later events overwrite rows of steps that were repeated
        columns = {name: table[:, number] for number, name in enumerate(COLUMNS)}
        return columns if most is None else thinned(columns, most)

    # --- events ----------------------------------------------------------------------------------------------------

    def _turn(self, place: Place) -> None:
        """Drop the data that are no longer valid."""
        if place.is_fresh:
            self._open = _empty_step()
        if place.undone:
            self._count = int(np.searchsorted(self._table[: self._count, 0], place.undone))

    def _moved(self, event: Mapping[str, Any]) -> None:
        quality, correction, row = event["quality"], event["correction"], self._open
        self.metric = quality["metric"]
        self.enrichment_points = event.get("enrichment_points", [])
        if event["iteration"] == 1:
            for name in QUALITY:
                row[f"predicted_{name}"] = math.nan
        for name, value in quality["corrected"].get("metric", {}).items():
            row[f"predicted_{name}"] = number_of(value)
        row["standard_min"] = number_of(quality["standard"].get("metric", {}).get("min"))
        row["threshold"] = quality["threshold"]
        row["reached"] = float(correction["reached"])
        row["non_orthogonality"] = number_of(event.get("faces", {}).get("after", {}).get("max_non_orthogonality"))
        row["enrichment_points"], row["freed_nodes"] = correction["enrichment_points"], correction["freed_nodes"]
        row["iterations"] += 1
        row["seconds_total"] += event.get("seconds_total", 0.0)
        for phase in PHASES:
            row[f"seconds_{phase}"] += event["seconds"].get(phase, 0.0)

    def _committed(self, event: Mapping[str, Any]) -> None:
        row = self._open | {"step": event["step"], "at": event["at"], "inverted": event["quality"]["inverted"]}
        for name, value in event["quality"].get("metric", {}).items():
            row[f"actual_{name}"] = number_of(value)
        row["seconds_total"] += event.get("seconds_total", 0.0)
        if self._count == len(self._table):
            self._table = np.concatenate([self._table, np.empty_like(self._table)])
        self._table[self._count] = [float(row[name]) for name in COLUMNS]
        self._count += 1
        self._open = _empty_step()

    def _refused(self, event: Mapping[str, Any]) -> None:
        self._open["refusals"] += event["request"] == "MOVE"

    def _rolled_back(self, event: Mapping[str, Any]) -> None:
        del event
        self._open["rollbacks"] += 1


def _empty_step() -> dict[str, float]:
    """A step without data: qualities are NaN, counts 0."""
    counted = ("iterations", "refusals", "rollbacks")
    return {name: 0.0 if name in counted or name.startswith("seconds_") else math.nan for name in COLUMNS}


def thinned(columns: Columns, most: int) -> Columns:
    """Combine more than ``most`` steps into that many groups of consecutive steps.

    The step with the lowest actual (else predicted) minimum represents its group; refusals and rollbacks are summed
    over the group; iterations, seconds and inverted cells are its maxima, predicted minima its lowest. Extremes stay
    visible.
    """
    count = len(columns["step"])
    if count <= most:
        return columns
    lowest = np.where(np.isnan(columns["actual_min"]), columns["predicted_min"], columns["actual_min"])
    lowest = np.where(np.isnan(lowest), np.inf, lowest)
    edges = np.linspace(0, count, most + 1).astype(int)
    kept = np.array([a + int(np.argmin(lowest[a:b])) for a, b in pairwise(edges)])
    thin = {name: column[kept] for name, column in columns.items()}
    for names, over in ((_SUMS, np.add), (_LARGEST, np.fmax), (_LEAST, np.fmin)):
        thin |= {name: over.reduceat(columns[name], edges[:-1]) for name in names}
    return thin


def of_metric(event: Mapping[str, Any], metric: str) -> Mapping[str, Any]:
    """The event with another metric's numbers instead of those of the session's metric."""
    key = metric.replace("-", "_")
    if event["event"] == "committed":
        return {**event, "quality": {**event["quality"], "metric": event["quality"].get(key, {})}}
    if event["event"] == "moved":
        quality = event["quality"]
        others = {
            which: {**quality[which], "metric": quality[which].get(key, {})} for which in ("standard", "corrected")
        }
        return {**event, "quality": {**quality, **others}}
    return event
