"""All results of a run, stored as JSON, and their growth from size to size."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from benchmarks.scale.cases import CASES, MESHES, Case
from benchmarks.scale.figures import Figures, MachineLimits, StartFigures, WireFigures, of_threads

__all__ = ["Results", "exponent", "growth", "smaller"]


@dataclass
class Results:
    """The values that one run measured.

    Attributes
    ----------
    machine : str
        In words.
    threads : int
        Of the kernels.
    library : dict
        Figures by the name of a case.
    wire : dict
        Figures by the name of a case.
    """

    limits: MachineLimits
    machine: str
    threads: int = 1
    library: dict[str, Figures] = field(default_factory=dict)
    wire: dict[str, WireFigures] = field(default_factory=dict)
    start: StartFigures | None = None


def smaller(case: Case) -> str | None:
    """Name of the case with the next smaller mesh of the same kind and motion; None for the smallest."""
    if case.mesh not in MESHES:
        return None
    names = [mesh for mesh, motion in MESHES.items() if motion == MESHES[case.mesh]]
    at = names.index(case.mesh)
    return f"{names[at - 1]}-{case.kind}" if at else None


def growth(results: Results, name: str) -> float | None:
    """Exponent p of the step's time ~ nodesᵖ since the next smaller mesh; None without a smaller mesh."""
    return exponent(results, smaller(CASES[name]) or "", name)


def exponent(results: Results, small: str, large: str) -> float | None:
    """Exponent p of the step's time ~ nodesᵖ from one case to another; None if one of them was not measured."""
    if small not in results.library or large not in results.library:
        return None
    before, now = results.library[small], results.library[large]
    ratio = of_threads(now.step, results.threads) / of_threads(before.step, results.threads)
    return math.log(ratio) / math.log(now.nodes / before.nodes)
