"""All measurements of one run, stored as JSON."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path

from benchmarks.correction.cost import Cost
from benchmarks.derivatives import DerivativeCost
from benchmarks.peers.comparison import Outcome
from benchmarks.scale.results import Results
from benchmarks.scale.truth import Truth

__all__ = ["Evidence"]


@dataclass
class Evidence:
    """The results so far.

    Attributes
    ----------
    results : Results
        Results of :mod:`benchmarks.scale`.
    truths : dict
        The large motion with all boundary nodes as centres, by case of :mod:`benchmarks.scale`.
    costs : dict
        Results of :mod:`benchmarks.correction`, by case.
    derivatives : dict
        Results of :mod:`benchmarks.derivatives`, by mesh.
    outcomes : list of Outcome
        Results of :mod:`benchmarks.peers`.
    left_out : list of str
        Jobs for which there was no time, or that failed.
    """

    results: Results
    truths: dict[str, Truth] = field(default_factory=dict)
    costs: dict[str, Cost] = field(default_factory=dict)
    derivatives: dict[str, DerivativeCost] = field(default_factory=dict)
    outcomes: list[Outcome] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)

    def outcome(self, case: str, system: str) -> Outcome | None:
        """The outcome of a system that completed its motion."""
        for outcome in self.outcomes:
            if (outcome.case, outcome.system) == (case, system) and outcome.measurement and outcome.verdict:
                return outcome
        return None

    def step(self, case: str, system: str) -> float | None:
        """Mean time of a peer's step: processor time if one thread is measured, else wall time."""
        outcome = self.outcome(case, system)
        if outcome is None or outcome.measurement is None:
            return None
        return outcome.measurement.step_cpu if self.results.threads == 1 else outcome.measurement.step

    def save(self, path: Path) -> None:
        """Write JSON."""
        content = {
            "scale": asdict(self.results),
            "truth": {name: asdict(found) for name, found in self.truths.items()},
            "correction": {name: asdict(cost) for name, cost in self.costs.items()},
            "derivatives": {name: asdict(cost) for name, cost in self.derivatives.items()},
            "peers": [outcome.as_dict() for outcome in self.outcomes],
            "left_out": self.left_out,
        }
        path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
