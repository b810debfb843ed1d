"""A run's history as columns, from a session's folder or from a folder that ``mesh-motion play`` wrote."""

from __future__ import annotations

import csv
import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.method import KEYS
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.session.spec import SPEC, StoredSpec, spec_bytes
from mesh_motion_server.watch.observation.follow import events_in_brief
from mesh_motion_server.watch.observation.series import COLUMNS, PHASES, Columns, Series, of_metric, thinned
from mesh_motion_server.watch.terminal.text import plain

METRICS = tuple(str(choice) for choice in KEYS["quality_metric"].choices)
#: Metrics that every session records; the first is drawn for a played case.
_RECORDED = ("size-skew", "size", "skew")


@dataclass(frozen=True, eq=False)
class Run:
    """The history of a run."""

    label: str
    metric: str  # the metric of its qualities
    threshold: float | None  # the quality below which motions are corrected; None: unknown, or of another metric
    #: (s,) each. Values by committed step, with the names of
    #: :class:`~mesh_motion_server.watch.observation.series.Series`; NaN if unknown.
    columns: Columns
    refused: tuple[int, ...] = ()  # the steps for which a motion was refused

    @property
    def step(self) -> Floats:
        """(s,) the committed steps, ascending."""
        return self.columns["step"]

    def between(self, first: int | None, last: int | None) -> Run:
        """The run from step ``first`` to ``last`` (None: from the beginning, to the end).

        Raises InvalidInput if no step is left.
        """
        low = -math.inf if first is None else first
        high = math.inf if last is None else last
        kept = (self.step >= low) & (self.step <= high)
        if len(self.step) and not kept.any():
            raise InvalidInput(
                f"--steps: {self.label} has the steps {self.step[0]:.0f} to {self.step[-1]:.0f}, "
                f"none from {'the first' if first is None else first} to {'the last' if last is None else last}"
            )
        columns = {name: column[kept] for name, column in self.columns.items()}
        return replace(self, columns=columns, refused=tuple(step for step in self.refused if low <= step <= high))

    def thinned(self, most: int) -> Run:
        """The run in at most this many groups of steps; extremes stay visible."""
        return replace(self, columns=thinned(self.columns, most))


def read_runs(folders: Sequence[Path], metric: str | None = None) -> list[Run]:
    """The history of each run, labels made distinct.

    Raises InvalidInput if a folder is not a run, or has no history. Raises DataLoss if the ``spec.json`` of a session
    cannot be read.

    Parameters
    ----------
    metric : str, optional
        One of :data:`METRICS`; None: a session's own, size-skew of a played case.
    """
    check_metric(metric, METRICS)
    runs = [_read(folder, metric) for folder in folders]
    metrics = {run.metric for run in runs}
    if len(metrics) > 1:
        raise InvalidInput(
            f"the runs have different quality metrics: {', '.join(sorted(metrics))}",
            hint=f"--metric {_RECORDED[0]} draws a metric that all runs have",
        )
    counts = Counter(run.label for run in runs)
    return [
        replace(run, label=_distinct(run.label, folder)) if counts[run.label] > 1 else run
        for run, folder in zip(runs, folders, strict=True)
    ]


def _read(folder: Path, metric: str | None) -> Run:
    if is_played(folder):
        return read_played(folder, metric)
    if is_session(folder):
        return _read_recorded(folder, metric)
    raise no_run(folder)


def no_run(folder: Path) -> InvalidInput:
    """The error for a folder that is not a run; names the sessions in a state folder."""
    sessions = folder / "sessions"
    if sessions.is_dir():
        found = sorted(path.name for path in sessions.iterdir() if is_session(path))
        listed = ", ".join(found[:3]) + (" …" if len(found) > 3 else "") or "none"
        return InvalidInput(
            f"{folder}: a server's state folder, expected a session's; it has {listed}",
            hint=f"mesh-motion plot {sessions / (found[0] if found else 'SESSION')} …",
        )
    what = "neither a session's folder nor one that play wrote" if folder.is_dir() else "no such folder"
    return InvalidInput(f"{folder}: {what}", hint="a session's folder is STATE FOLDER/sessions/ID")


def check_metric(metric: str | None, known: Sequence[str]) -> None:
    """Raise InvalidInput for an unknown metric."""
    if metric is not None and metric not in known:
        raise InvalidInput(f"--metric: expected one of {', '.join(known)}, got {metric!r}")


def _not_recorded(folder: Path, metric: str | None, known: Sequence[str]) -> InvalidInput:
    listed = ", ".join(dict.fromkeys(known))
    return InvalidInput(f"--metric: the run in {folder} has not recorded {metric}", hint=f"it has {listed}")


def _distinct(label: str, folder: Path) -> str:
    """A label that distinguishes runs of the same name."""
    return folder.name if folder.name != label else str(folder)


# --- sessions --------------------------------------------------------------------------------------------------------


def is_session(folder: Path) -> bool:
    """Whether the folder has a stored session."""
    return (folder / SPEC).is_file()


def label_of(folder: Path) -> str:
    """The label of a stored session, or the beginning of its id."""
    return plain(StoredSpec.from_bytes(spec_bytes(folder)).label) or folder.name[:8]


def _read_recorded(folder: Path, metric: str | None) -> Run:
    """The run of a stored session, from its history."""
    series, refused, own = Series(), [], ""
    for event in events_in_brief(folder):
        own = own or event.get("quality", {}).get("metric", "") if event["event"] == "moved" else own
        if event["event"] == "refused" and isinstance(event.get("step"), int):
            refused.append(event["step"])
        with suppress(KeyError, TypeError, AttributeError):  # another version may have written it
            series.add(of_metric(event, metric) if metric and metric != own else event)
    if not len(series):
        raise InvalidInput(
            f"{folder}: its history has no committed step",
            hint="sessions of a server with history_bytes = 0, or of an older one, have no history",
        )
    if metric not in (None, own, *_RECORDED):
        raise _not_recorded(folder, metric, (own, *_RECORDED))
    columns = series.columns()
    known = columns["threshold"][np.isfinite(columns["threshold"])]
    threshold = float(known[-1]) if metric in (None, own) and len(known) else None
    return Run(label_of(folder), metric or own, threshold, columns, tuple(refused))


# --- played cases ----------------------------------------------------------------------------------------------------


def is_played(folder: Path) -> bool:
    """Whether the folder has results of ``mesh-motion play``."""
    return (folder / "steps.csv").is_file()


def read_played(folder: Path, metric: str | None = None) -> Run:
    """Read the run whose results ``mesh-motion play`` wrote to a folder.

    Raises InvalidInput if its ``steps.csv`` is not valid.

    Parameters
    ----------
    metric : str, optional
        Name in the columns of ``steps.csv``; None: the run's own metric.
    """
    table, summary = _read_steps(folder / "steps.csv"), _read_summary(folder / "summary.json")
    method = summary.get("method", {})
    own = method.get("quality_metric", _RECORDED[0])
    metric = metric or own
    name, is_own = metric.replace("-", "_"), own == metric
    threshold = method.get("quality_threshold")
    if f"min_{name}" not in table:
        raise _not_recorded(folder, metric, [key[4:].replace("_", "-") for key in table if key.startswith("min_")])
    taken = {"step": "step", "actual_min": f"min_{name}", "actual_mean": f"mean_{name}"}
    taken |= {"predicted_min": "predicted_min", "standard_min": "predicted_standard"} if is_own else {}
    taken |= {"seconds_total": "seconds", "non_orthogonality": "max_non_orthogonality"}
    taken |= {same: same for same in ("iterations", "enrichment_points", *(f"seconds_{phase}" for phase in PHASES))}
    unknown = np.full(len(table["step"]), np.nan)
    return Run(
        label=Path(str(summary.get("case", folder.name))).parent.name or folder.name,
        metric=metric,
        threshold=float(threshold) if is_own and isinstance(threshold, int | float) else None,
        columns={column: table.get(taken.get(column, ""), unknown) for column in COLUMNS},
    )


def _read_steps(path: Path) -> dict[str, Floats]:
    """The columns of steps.csv."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        names = list(rows[0]) if rows else []
        table = {name: np.array([float(row[name]) for row in rows]) for name in names}
    except (OSError, ValueError, TypeError, csv.Error) as error:
        raise InvalidInput(f"{path}: not readable as a file that play writes: {error}") from None
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
    except (OSError, ValueError, RecursionError):
        return {}
    return summary if isinstance(summary, dict) else {}
