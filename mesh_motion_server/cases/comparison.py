"""Compares a recorded session with its replay: one column for each, and whether the states are bitwise equal."""

import json
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from mesh_motion_numerics.arrays import Floats

from mesh_motion_server.cases.recorded import Recorded
from mesh_motion_server.session.history.events import finite
from mesh_motion_server.session.replay import maker
from mesh_motion_server.watch.observation.series import PHASES, Columns
from mesh_motion_server.watch.terminal.console import Table


@dataclass(frozen=True, eq=False)
class Replayed:
    """A replay."""

    changes: dict[str, Any]  # the settings that differ from the recorded session
    #: (s,) each. The computed steps, from step 1 on, as in :class:`Series`; quality is size-skew.
    columns: Columns
    digests: dict[int, bytes]  # digests of the states
    refusal: str  # why it ended before the last step; empty if it reached the last step
    #: (n, d). Coordinates of the replay at the step for which the session has stored coordinates.
    stored: Floats | None
    #: (n, d). Velocities there, as :class:`.Recorded` has them; mesh length unit per second.
    velocity: Floats | None = None

    @property
    def name(self) -> str:
        """A name that lists the changes."""
        return ", ".join(f"{key} = {value}" for key, value in self.changes.items()) or "replayed"


@dataclass(frozen=True)
class Agreement:
    """Whether a replay reached the recorded states."""

    steps: int  # number of steps requested
    #: compared, equal: numbers of steps with a known digest, and of those with an equal digest
    compared: int
    equal: int
    first_difference: int  # the first step that differs; 0: none
    #: recorded_min, replayed_min: lowest size-skew at the first step that differs; NaN if not known
    recorded_min: float
    replayed_min: float
    stored_step: int  # the step whose coordinates were compared; 0: none
    distance: float | None  # largest distance between nodes of the two states at the stored step, mesh length unit
    #: Largest difference of a node's velocities there, mesh length unit per second; None without time levels.
    velocity_distance: float | None

    @property
    def exact(self) -> bool:
        """Whether everything that was compared is equal, including the stored coordinates and velocities."""
        apart = {self.distance, self.velocity_distance}
        return self.equal == self.compared > 0 and apart <= {None, 0.0}

    def __str__(self) -> str:
        if not self.compared:
            return "no digest is recorded"
        few = f" compared of {self.steps}" if self.compared < self.steps else ""
        text = f"equal in all {self.compared}{few} steps"
        if self.exact:
            return text
        if self.first_difference:
            text = f"equal in {self.equal} of {self.compared} steps, first different in step {self.first_difference}"
        if math.isfinite(self.recorded_min + self.replayed_min):
            text += f" (minimum {self.recorded_min:.6g} recorded, {self.replayed_min:.6g} replayed)"
        if self.distance is not None:
            text += f"; nodes up to {self.distance:.3g} apart at step {self.stored_step}"
        if self.velocity_distance is not None:
            text += f", velocities up to {self.velocity_distance:.3g}"
        return text


@dataclass(frozen=True, eq=False)
class Comparison:
    """A recorded session and its replay."""

    recorded: Recorded
    last: int  # the last requested step
    run: Replayed
    elsewhere: bool = False  # whether a running server made the replay; its version and machine may differ

    @cached_property
    def recorded_steps(self) -> Columns:
        """The recorded steps that are compared, if their events exist."""
        columns = self.recorded.columns
        return {name: column[columns["step"] <= self.last] for name, column in columns.items()}

    @property
    def replayed_steps(self) -> Columns:
        """The replay's steps that are recorded; all steps if none is recorded."""
        columns, known = self.run.columns, self.recorded_steps["step"]
        kept = np.isin(columns["step"], known) if len(known) else np.ones(len(columns["step"]), dtype=bool)
        return {name: column[kept] for name, column in columns.items()}

    @property
    def makers(self) -> list[str]:
        """The versions and processors that computed the compared steps, each once; an empty text means unknown."""
        return list(dict.fromkeys(made for first, made in self.recorded.makers if first <= self.last))

    @property
    def unpromised(self) -> str:
        """The reason why a replay without changes may differ in bits; empty if equal bits are promised."""
        if self.elsewhere:
            return "equal bits are not guaranteed: the replay ran on another server"
        if not self.makers or "" in self.makers:
            return "equal bits are not guaranteed: the session does not record the version that computed it"
        if self.makers != [maker()]:
            return f"equal bits are not guaranteed: the session was computed by {'; '.join(self.makers)}"
        return ""

    @property
    def notes(self) -> list[str]:
        """Notes that a reader needs to understand the figures."""
        notes, known = [*self.recorded.notes, self.unpromised], self.recorded_steps["step"]
        if len(known) < self.last:
            span = f"steps {known[0]:.0f} to {known[-1]:.0f}" if len(known) else "no step"
            notes.append(f"events exist for {len(known)} of {self.last} steps ({span}): only these are counted")
        return [note for note in notes if note]

    @cached_property
    def agreement(self) -> Agreement:
        """Whether the replay reached the recorded states; a missing step counts as different."""
        known = {step: digest for step in range(1, self.last + 1) if (digest := self.recorded.digest(step))}
        differing = [step for step, digest in known.items() if self.run.digests.get(step) != digest]
        first = differing[0] if differing else 0
        stored = self.recorded.stored
        distance = None if stored is None else _farthest(stored[1], self.run.stored)
        return Agreement(
            steps=self.last,
            compared=len(known),
            equal=len(known) - len(differing),
            first_difference=first,
            recorded_min=_minimum(self.recorded.columns, first),
            replayed_min=_minimum(self.run.columns, first),
            stored_step=stored[0] if stored is not None and distance is not None else 0,
            distance=distance,
            velocity_distance=_farthest(self.recorded.velocity, self.run.velocity),
        )

    def broken_promise(self) -> str:
        """The error text if a replay without changes did not give the same bits; empty if there is no error."""
        if self.run.changes or self.unpromised or not self.agreement.compared or self.agreement.exact:
            return ""
        return f"the replay without changes differs: {self.run.refusal or self.agreement}"

    def as_dict(self) -> dict[str, Any]:
        """Plain values, as for JSON."""
        agreement, spec = self.agreement, self.recorded.spec
        values: dict[str, Any] = {
            "session": spec.session,
            "label": spec.label,
            "settings": spec.settings.model_dump(),
            "changes": self.run.changes,
            "refusal": self.run.refusal,
            "last_step": self.last,
            "recorded_by": "; ".join(self.makers),
            "replayed_by": "" if self.elsewhere else maker(),
            "notes": self.notes,
            "recorded": _summary(self.recorded_steps),
            "replayed": _summary(self.replayed_steps),
            "digests": asdict(agreement) | {"exact": agreement.exact, "says": str(agreement)},
            "recorded_steps": _rows(self.recorded_steps, self.recorded.digest),
            "replayed_steps": _rows(self.run.columns, self.run.digests.__getitem__),
        }
        plain: dict[str, Any] = finite(values)
        return plain


def _farthest(recorded: Floats | None, replayed: Floats | None) -> float | None:
    """The largest difference of a node's rows (n, d); None if one side has no rows."""
    if recorded is None or replayed is None:
        return None
    return float(np.sqrt(((recorded - replayed) ** 2).sum(axis=1)).max())


def _rows(columns: Columns, digest: Callable[[int], bytes]) -> list[dict[str, Any]]:
    """A dictionary for each step."""
    rows = [dict(zip(columns, row, strict=True)) for row in zip(*(c.tolist() for c in columns.values()), strict=True)]
    return [row | {"step": int(row["step"]), "digest": digest(int(row["step"])).hex()} for row in rows]


def _minimum(columns: Columns, step: int) -> float:
    """The minimum after a step; NaN if not known."""
    found = columns["actual_min"][columns["step"] == step]
    return float(found[0]) if len(found) else math.nan


def _summary(columns: Columns) -> dict[str, Any]:
    """A run in one column; qualities are size-skew of the committed coordinates, NaN if not known."""
    minima, means = columns["actual_min"], columns["actual_mean"]
    worst = int(np.nanargmin(minima)) if np.isfinite(minima).any() else -1
    return {
        "steps": len(minima),
        "min_quality": float(minima[worst]) if worst >= 0 else math.nan,
        "worst_step": int(columns["step"][worst]) if worst >= 0 else 0,
        "mean_quality": float(np.nanmean(means)) if np.isfinite(means).any() else math.nan,
        "corrections": int(np.count_nonzero((columns["enrichment_points"] > 0) | (columns["freed_nodes"] > 0))),
        "enrichment_points": int(np.nansum(columns["enrichment_points"])),
        "moves": int(columns["iterations"].sum()),
        "refusals": int(columns["refusals"].sum()),
        "seconds": {phase: float(columns[f"seconds_{phase}"].sum()) for phase in PHASES},
        "seconds_total": float(columns["seconds_total"].sum()),
    }


def table_of(comparison: Comparison) -> Table:
    """The printed table: the recorded session, then the replay."""
    run, columns = comparison.run, [_summary(comparison.recorded_steps), _summary(comparison.replayed_steps)]
    columns[1]["refusals"] += bool(run.refusal)
    table = Table("", "recorded", run.name, box=None, pad_edge=False)
    table.add_row("steps", *(str(c["steps"]) for c in columns))
    table.add_row("lowest size-skew", *(f"{_text(c['min_quality'])} (step {c['worst_step']})" for c in columns))
    table.add_row("mean size-skew", *(_text(c["mean_quality"]) for c in columns))
    names = {"corrections": "steps corrected", "enrichment_points": "enrichment points"}
    for name in ("corrections", "enrichment_points", "moves", "refusals"):
        table.add_row(names.get(name, name), *(str(c[name]) for c in columns))
    for phase in PHASES:
        table.add_row(f"seconds to {phase}", *(f"{c['seconds'][phase]:.3f}" for c in columns))
    table.add_row("seconds in all", *(f"{c['seconds_total']:.3f}" for c in columns))
    table.add_row("state digests", "", str(comparison.agreement))
    if run.refusal:
        table.add_row("ended", "", run.refusal)
    return table


def write_comparison(folder: Path, comparison: Comparison) -> None:
    """Write comparison.json: both columns, and the figures of each step."""
    text = json.dumps(comparison.as_dict(), indent=2, allow_nan=False, ensure_ascii=False)
    (folder / "comparison.json").write_text(text + "\n", encoding="utf-8")


def _text(value: float) -> str:
    return f"{value:.4f}" if math.isfinite(value) else "not known"
