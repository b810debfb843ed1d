"""Compare a recorded session with its replays: one column each, and whether the states are bitwise equal."""

import csv
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from mesh_motion_server.cases.recorded import Recorded, StepFigures
from mesh_motion_server.numerics.arrays import Floats
from mesh_motion_server.session.replay import maker
from mesh_motion_server.watch.observation.series import PHASES

__all__ = ["Agreement", "Comparison", "Replayed", "Summary", "summary_of", "table_of", "write_comparison"]


#: Columns of comparison.csv beside ``run`` and ``step``.
_COLUMNS = ("min_quality", "mean_quality", "standard_min", "predicted_min", "moves", "refusals", "corrected")
_MORE_COLUMNS = ("enrichment_points", "freed_nodes", *(f"seconds_{phase}" for phase in PHASES), "seconds_total")


@dataclass(frozen=True, eq=False)
class Replayed:
    """One replay.

    Attributes
    ----------
    changes : dict
        The settings that differ from the recorded session.
    figures : list of StepFigures
        Figures of the computed steps, from step 1 on.
    refusal : str
        Why it ended before the last step; empty if it reached the last step.
    stored : (n, d) array or None
        Coordinates of the replay at the step for which the session has stored coordinates.
    """

    name: str
    changes: dict[str, Any]
    figures: list[StepFigures]
    refusal: str
    stored: Floats | None


@dataclass(frozen=True)
class Agreement:
    """Whether a replay reached the recorded states.

    Attributes
    ----------
    steps : int
        Number of steps requested.
    compared, equal : int
        Numbers of steps with a known digest, and of those with an equal digest.
    first_difference : int
        The first step that differs; 0: none.
    recorded_min, replayed_min : float or None
        Lowest size-skew at the first step that differs.
    stored_step : int
        The step whose coordinates were compared; 0: none.
    distance : float or None
        Largest distance between nodes of the two states at the stored step, mesh length unit.
    """

    steps: int
    compared: int
    equal: int
    first_difference: int
    recorded_min: float | None
    replayed_min: float | None
    stored_step: int
    distance: float | None

    @property
    def exact(self) -> bool:
        """Whether everything that was compared is equal, including the stored coordinates."""
        return self.equal == self.compared > 0 and self.distance in (None, 0.0)

    def __str__(self) -> str:
        if not self.compared:
            return "no digest is recorded"
        few = f" compared of {self.steps}" if self.compared < self.steps else ""
        text = f"equal in all {self.compared}{few} steps"
        if self.exact:
            return text
        if self.first_difference:
            text = f"equal in {self.equal} of {self.compared} steps, first different in step {self.first_difference}"
        if self.recorded_min is not None and self.replayed_min is not None:
            text += f" (minimum {self.recorded_min:.6g} recorded, {self.replayed_min:.6g} replayed)"
        if self.distance is not None:
            text += f"; nodes up to {self.distance:.3g} apart at step {self.stored_step}"
        return text


@dataclass(frozen=True)
class Summary:
    """A run in one column; qualities are size-skew of the committed coordinates, None where they are not known."""

    name: str
    steps: int
    min_quality: float | None
    worst_step: int
    mean_quality: float | None
    corrections: int
    enrichment_points: int
    refusals: int
    moves: int
    seconds: dict[str, float]
    seconds_total: float


@dataclass(frozen=True, eq=False)
class Comparison:
    """A recorded session and its replays.

    Attributes
    ----------
    last : int
        The last requested step.
    elsewhere : bool
        Whether a running server made the replays; its version and machine may differ.
    """

    recorded: Recorded
    last: int
    runs: Sequence[Replayed]
    elsewhere: bool = False

    @cached_property
    def recorded_figures(self) -> list[StepFigures]:
        """The recorded figures of the compared steps, where available."""
        figures = self.recorded.figures
        return [figures[step] for step in range(1, self.last + 1) if step in figures]

    @property
    def makers(self) -> list[str]:
        """The versions and processors that computed the compared steps, each once; an empty text means unknown."""
        return list(dict.fromkeys(made for first, made in self.recorded.makers if first <= self.last))

    @property
    def unpromised(self) -> str:
        """Why a replay without changes may differ in bits; empty if equal bits are promised."""
        if self.elsewhere:
            return "equal bits are not promised: another server made the replay"
        if not self.makers or "" in self.makers:
            return "equal bits are not promised: what computed the session is not recorded"
        if self.makers != [maker()]:
            return f"equal bits are not promised: the session was computed by {'; '.join(self.makers)}"
        return ""

    @property
    def notes(self) -> list[str]:
        """Notes that a reader needs to understand the figures."""
        notes, known = [*self.recorded.notes, self.unpromised], [found.step for found in self.recorded_figures]
        if len(known) < self.last:
            span = f"steps {known[0]} to {known[-1]}" if known else "no step"
            notes.append(f"events are there of {len(known)} of {self.last} steps ({span}): only those are summed up")
        return [note for note in notes if note]

    def compared_figures(self, run: Replayed) -> list[StepFigures]:
        """The replay's steps that have recorded figures; all steps if no figures are recorded."""
        known = {found.step for found in self.recorded_figures}
        return [found for found in run.figures if found.step in known or not known]

    def agreement(self, run: Replayed) -> Agreement:
        """Whether a replay reached the recorded states; a missing step counts as different."""
        known = {step: digest for step in range(1, self.last + 1) if (digest := self.recorded.digest(step))}
        made = {found.step: found for found in run.figures}
        differing = [step for step, digest in known.items() if step not in made or made[step].digest != digest]
        first = differing[0] if differing else 0
        before, after = self.recorded.figures.get(first), made.get(first)
        stored = self.recorded.stored
        distance = None
        if stored is not None and run.stored is not None:
            distance = float(np.sqrt(((stored[1] - run.stored) ** 2).sum(axis=1)).max())
        return Agreement(
            steps=self.last,
            compared=len(known),
            equal=len(known) - len(differing),
            first_difference=first,
            recorded_min=_known(before.min_quality) if before else None,
            replayed_min=_known(after.min_quality) if after else None,
            stored_step=stored[0] if stored is not None and distance is not None else 0,
            distance=distance,
        )

    def broken_promise(self) -> str:
        """The error text if a replay without changes did not give the same bits; empty if there is no error."""
        for run in self.runs:
            agreement = self.agreement(run)
            if not run.changes and not self.unpromised and agreement.compared and not agreement.exact:
                return f"the replay with nothing changed differs: {run.refusal or agreement}"
        return ""

    def as_dict(self) -> dict[str, Any]:
        """Plain values, as for JSON."""
        runs = []
        for run in self.runs:
            agreement = self.agreement(run)
            values = asdict(summary_of(run.name, self.compared_figures(run))) | {
                "changes": run.changes,
                "refusal": run.refusal,
            }
            runs.append(values | {"digests": asdict(agreement) | {"exact": agreement.exact, "says": str(agreement)}})
        return {
            "session": self.recorded.spec.session,
            "label": self.recorded.spec.label,
            "settings": self.recorded.spec.settings.model_dump(),
            "last_step": self.last,
            "recorded_by": "; ".join(self.makers),
            "replayed_by": "" if self.elsewhere else maker(),
            "notes": self.notes,
            "recorded": asdict(summary_of("recorded", self.recorded_figures)),
            "replayed": runs,
        }


def summary_of(name: str, figures: Sequence[StepFigures]) -> Summary:
    """Summarize the figures of a run."""
    known = [found for found in figures if math.isfinite(found.min_quality)]
    worst = min(known, key=lambda found: found.min_quality, default=None)
    means = [found.mean_quality for found in known if math.isfinite(found.mean_quality)]
    return Summary(
        name=name,
        steps=len(figures),
        min_quality=worst.min_quality if worst else None,
        worst_step=worst.step if worst else 0,
        mean_quality=sum(means) / len(means) if means else None,
        corrections=sum(found.corrected for found in figures),
        enrichment_points=sum(found.enrichment_points for found in figures),
        refusals=sum(found.refusals for found in figures),
        moves=sum(found.moves for found in figures),
        seconds={phase: sum(found.seconds[phase] for found in figures) for phase in PHASES},
        seconds_total=sum(found.seconds_total for found in figures),
    )


def table_of(comparison: Comparison) -> Table:
    """The printed table: the recorded session first, then each replay."""
    runs = [("recorded", comparison.recorded_figures)]
    runs += [(run.name, comparison.compared_figures(run)) for run in comparison.runs]
    columns = [summary_of(name, figures) for name, figures in runs]
    refused = ["", *(run.refusal for run in comparison.runs)]
    table = Table("", *(column.name for column in columns), box=None, pad_edge=False)
    rows: list[tuple[str, list[str]]] = [
        ("steps", [str(c.steps) for c in columns]),
        ("lowest size-skew", [f"{_text(c.min_quality)} (step {c.worst_step})" for c in columns]),
        ("mean size-skew", [_text(c.mean_quality) for c in columns]),
        ("steps corrected", [str(c.corrections) for c in columns]),
        ("enrichment points", [str(c.enrichment_points) for c in columns]),
        ("moves", [str(c.moves) for c in columns]),
        (
            "refusals",
            [str(c.refusals + bool(end)) for c, end in zip(columns, refused, strict=True)],
        ),
        *((f"seconds to {phase}", [f"{c.seconds[phase]:.3f}" for c in columns]) for phase in PHASES),
        ("seconds in all", [f"{c.seconds_total:.3f}" for c in columns]),
        ("state digests", ["", *(str(comparison.agreement(run)) for run in comparison.runs)]),
    ]
    if any(refused):
        rows.append(("ended", refused))
    for name, cells in rows:
        table.add_row(name, *cells)
    return table


def write_comparison(folder: Path, comparison: Comparison) -> None:
    """Write comparison.json, and comparison.csv with a line for each run and step."""
    text = json.dumps(comparison.as_dict(), indent=2, allow_nan=False, ensure_ascii=False)
    (folder / "comparison.json").write_text(text + "\n", encoding="utf-8")
    runs = [("recorded", comparison.recorded_figures), *((run.name, run.figures) for run in comparison.runs)]
    with (folder / "comparison.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["run", "step", *_COLUMNS, *_MORE_COLUMNS, "digest"])
        for name, figures in runs:
            for found in figures:
                seconds = {f"seconds_{phase}": value for phase, value in found.seconds.items()}
                values = vars(found) | seconds
                row = [values[column] for column in (*_COLUMNS, *_MORE_COLUMNS)]
                digest = comparison.recorded.digest(found.step) if name == "recorded" else found.digest
                writer.writerow([name, found.step, *row, digest.hex()])


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _text(value: float | None) -> str:
    return "not known" if value is None else f"{value:.4f}"
