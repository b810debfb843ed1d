"""A run's history as columns, from any kind of folder."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.arrays import Floats, Integers, Marks
from mesh_motion_server.watch.observation.series import PHASES

__all__ = ["METRICS", "Quality", "Refused", "Run", "is_played", "read_played"]


METRICS = ("size-skew", "size", "skew")


@dataclass(frozen=True)
class Refused:
    """A motion that was refused: the step it was for, its code, and why."""

    step: int
    code: str
    message: str = ""


@dataclass(frozen=True, eq=False)
class Quality:
    """The cells' quality after each step; NaN where unknown.

    Attributes
    ----------
    minimum, p1, p5, p50, mean : (s,) arrays
    """

    minimum: Floats
    mean: Floats
    p1: Floats
    p5: Floats
    p50: Floats

    def rows(self, chosen: Integers | slice | Marks) -> Quality:
        """The quality of some steps."""
        return Quality(*(getattr(self, name)[chosen] for name in ("minimum", "mean", "p1", "p5", "p50")))


@dataclass(frozen=True, eq=False)
class Run:
    """The history of a run.

    Attributes
    ----------
    metric : str
        The metric of ``actual`` and ``predicted``.
    threshold : float or None
        The quality below which motions are corrected; None: unknown, or of another metric.
    step : (s,) int64 array
        Committed steps, ascending.
    actual, predicted : Quality
        Quality of the committed coordinates; prediction of the server before any node moved.
    standard : (s,) array
        The minimum predicted for the motion without its correction.
    iterations, enrichment_points : (s,) arrays
    seconds : dict of str to (s,) arrays
        Seconds of each phase, summed over all iterations.
    total_seconds : (s,) array
    non_orthogonality : (s,) array
        The largest of all faces, degrees; NaN where unknown.
    """

    label: str
    metric: str
    threshold: float | None
    step: Integers
    actual: Quality
    predicted: Quality
    standard: Floats
    iterations: Floats
    enrichment_points: Floats
    seconds: dict[str, Floats]
    total_seconds: Floats
    non_orthogonality: Floats
    refused: tuple[Refused, ...] = field(default=())

    def between(self, first: int | None, last: int | None) -> Run:
        """The run from step ``first`` to ``last`` (None: from the beginning, to the end).

        Raises
        ------
        InvalidInput
            If no step is left.
        """
        low = -math.inf if first is None else first
        high = math.inf if last is None else last
        kept = (self.step >= low) & (self.step <= high)
        if len(self.step) and not kept.any():
            raise InvalidInput(
                f"--steps: {self.label} has the steps {self.step[0]} to {self.step[-1]}, "
                f"none from {'the first' if first is None else first} to {'the last' if last is None else last}"
            )
        return replace(self._rows(kept), refused=tuple(r for r in self.refused if low <= r.step <= high))

    def thinned(self, bins: int) -> Run:
        """At most some ``5 bins`` steps: of each bin the first, the worst, the slowest, those of most iterations and of
        the least orthogonal faces.

        Extremes stay, so that the picture of a long run does not hide what happened in one step.
        """
        if len(self.step) <= 5 * bins:
            return self
        edges = np.linspace(0, len(self.step), bins + 1).astype(np.int64)
        worst = np.nan_to_num(self.actual.minimum, nan=np.inf)
        chosen = [edges[:-1], np.array([len(self.step) - 1])]
        for values in (-worst, *map(np.nan_to_num, (self.total_seconds, self.iterations, self.non_orthogonality))):
            chosen.append(np.array([a + np.argmax(values[a:b]) for a, b in pairwise(edges)]))
        return self._rows(np.unique(np.concatenate(chosen)))

    def _rows(self, chosen: Integers | Marks) -> Run:
        """The columns of some steps."""
        names = ("step", "standard", "iterations", "enrichment_points", "total_seconds", "non_orthogonality")
        return replace(
            self,
            **{name: getattr(self, name)[chosen] for name in names},
            actual=self.actual.rows(chosen),
            predicted=self.predicted.rows(chosen),
            seconds={phase: values[chosen] for phase, values in self.seconds.items()},
        )


def is_played(folder: Path) -> bool:
    """Whether the folder has results of ``mesh-motion play``."""
    return (folder / "steps.csv").is_file()


def read_played(folder: Path, metric: str | None = None) -> Run:
    """Read the run whose results ``mesh-motion play`` wrote to a folder.

    Parameters
    ----------
    metric : str, optional
        One of :data:`METRICS`; None: size-skew.

    Raises
    ------
    InvalidInput
        If its ``steps.csv`` is not valid.
    """
    metric = metric or METRICS[0]
    table = _read_steps(folder / "steps.csv")
    summary = _read_summary(folder / "summary.json")
    method = summary.get("method", {})
    is_own = method.get("quality_metric", METRICS[0]) == metric
    unknown = np.full(len(table["step"]), np.nan)
    name = metric.replace("-", "_")
    return Run(
        label=Path(str(summary.get("case", folder.name))).parent.name or folder.name,
        metric=metric,
        threshold=_number(method.get("quality_threshold")) if is_own else None,
        step=table["step"].astype(np.int64),
        actual=Quality(table[f"min_{name}"], table.get(f"mean_{name}", unknown), unknown, unknown, unknown),
        predicted=Quality(table["predicted_min"] if is_own else unknown, unknown, unknown, unknown, unknown),
        standard=table["predicted_standard"] if is_own else unknown,
        iterations=table["iterations"],
        enrichment_points=table["enrichment_points"],
        seconds={phase: table[f"seconds_{phase}"] for phase in PHASES},
        total_seconds=table["seconds"],
        non_orthogonality=table.get("max_non_orthogonality", unknown),
    )


def _read_steps(path: Path) -> dict[str, Floats]:
    """The columns of steps.csv."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        names = list(rows[0]) if rows else []
        table = {name: np.array([float(row[name]) for row in rows]) for name in names}
    except (OSError, ValueError, TypeError, csv.Error) as error:
        raise InvalidInput(f"{path}: not readable as what play writes: {error}") from None
    needed = {"step", "min_size_skew", "predicted_min", "predicted_standard", "iterations", "seconds"}
    if not rows or not needed <= set(table):
        missing = ", ".join(sorted(needed - set(table)))
        raise InvalidInput(
            f"{path}: expected the steps that play writes, " + (f"found no {missing}" if rows else "found none"),
            hint="play the case again: mesh-motion play CASE.toml --out DIR",
        )
    return table


def _read_summary(path: Path) -> Mapping[str, Any]:
    """Read summary.json, or return nothing: the steps are enough for a picture."""
    try:
        summary = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return summary if isinstance(summary, dict) else {}


def _number(value: Any) -> float | None:
    return float(value) if isinstance(value, int | float) else None
