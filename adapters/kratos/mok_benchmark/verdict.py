"""Comparison of the two histories, and the quality of the meshes in one measure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.metrics import cell_quality, reference_sizes
from numpy.typing import NDArray

from mok_benchmark.benchmark import POINTS, PUBLISHED
from mok_benchmark.execution import History

__all__ = ["ALLOWED", "Outcome", "differences", "judged", "table"]

#: Largest difference of the two histories, as a share of the largest displacement.
ALLOWED = 0.02


@dataclass(frozen=True)
class Outcome:
    """One run in numbers.

    Attributes
    ----------
    largest, last : dict
        Reference point → horizontal displacement in m, largest and at the end.
    iterations : float
        Coupling iterations a time step, mean.
    worst_size_skew, worst_skew : float
        Smallest of any cell in any time step; a cell's size is relative to its undeformed one.
    inverted : int
        Most inverted cells in a time step.
    mesh_seconds, first_step_seconds, seconds : float
        Of the mesh solver, of that in the first time step (it opens the server's session there), and of the whole.
    milliseconds_a_move : float
        Of the mesh solver, median of the steps' means.
    cpu_seconds : float
        Of all processes.
    """

    largest: dict[str, float]
    last: dict[str, float]
    iterations: float
    worst_size_skew: float
    worst_skew: float
    inverted: int
    mesh_seconds: float
    first_step_seconds: float
    seconds: float
    milliseconds_a_move: float
    cpu_seconds: float

    def as_dict(self) -> dict[str, object]:
        """As plain values."""
        return asdict(self)


def judged(history: History, points: NDArray[np.float64], triangles: NDArray[np.int64]) -> Outcome:
    """Take a run's numbers.

    Parameters
    ----------
    points : (n, 2) array, m
        The undeformed mesh.
    triangles : (m, 3) int array
    """
    cells = CellTable.from_arrays({"triangle": triangles})
    sizes = reference_sizes(points, cells)
    qualities = [cell_quality(moved, cells, sizes) for moved in history.points]
    horizontal = dict(zip(POINTS, history.displacements[:, :, 0].T, strict=True))
    return Outcome(
        largest={name: float(values.max()) for name, values in horizontal.items()},
        last={name: float(values[-1]) for name, values in horizontal.items()},
        iterations=float(history.iterations.mean()),
        worst_size_skew=float(min(quality.metric("size-skew").min() for quality in qualities)),
        worst_skew=float(min(quality.skew.min() for quality in qualities)),
        inverted=max(int(quality.inverted.sum()) for quality in qualities),
        mesh_seconds=float(history.mesh_seconds.sum()),
        first_step_seconds=float(history.mesh_seconds[0]),
        seconds=float(history.seconds.sum()),
        milliseconds_a_move=1e3 * float(np.median(history.mesh_seconds / history.iterations)),
        cpu_seconds=history.cpu_seconds,
    )


def differences(control: History, ours: History) -> dict[str, float]:
    """Largest distance of the two histories, as a share of the control's largest displacement, by reference point."""
    if len(control.times) != len(ours.times) or not np.allclose(control.times, ours.times):
        return dict.fromkeys(POINTS, float("inf"))
    apart = np.linalg.norm(ours.displacements - control.displacements, axis=2).max(axis=0)
    return dict(zip(POINTS, apart / np.linalg.norm(control.displacements, axis=2).max(axis=0), strict=True))


def table(outcomes: Mapping[str, Outcome], found: Mapping[str, float], whole: bool) -> str:
    """The result for people.

    Parameters
    ----------
    outcomes : mapping
        Mesh solver → its run.
    found : mapping
        :func:`differences`.
    whole : bool
        Whether the runs reach the largest displacement, so that they can be compared with the published ones.
    """
    columns = [_column(outcome) for outcome in outcomes.values()]
    lines = [f"{'':30}" + "".join(f"{name:>24}" for name in outcomes)]
    lines += [f"{label:30}" + "".join(f"{column[label]:>24}" for column in columns) for label in columns[0]]
    if whole:
        lines += [
            f"{source}: largest u_x {', '.join(f'{name} {100 * value:.2f} cm' for name, value in values.items())}"
            for source, values in PUBLISHED.items()
        ]
    shares = ", ".join(f"{name} {share:.3%}" for name, share in found.items())
    met = "met" if max(found.values()) <= ALLOWED else "MISSED"
    lines.append(
        f"largest difference of the histories: {shares} of the largest displacement; allowed {ALLOWED:.0%}: {met}"
    )
    return "\n".join(lines) + "\n"


def _column(outcome: Outcome) -> dict[str, str]:
    """A run's numbers by name."""
    return {
        **{f"{name}: largest u_x [cm]": f"{100 * value:.3f}" for name, value in outcome.largest.items()},
        **{f"{name}: u_x at the end [cm]": f"{100 * value:.3f}" for name, value in outcome.last.items()},
        "coupling iterations a step": f"{outcome.iterations:.2f}",
        "worst size-skew": f"{outcome.worst_size_skew:.3f}",
        "worst skew": f"{outcome.worst_skew:.3f}",
        "inverted cells": str(outcome.inverted),
        "mesh solver [s]": f"{outcome.mesh_seconds:.1f}",
        "of it in the first step [s]": f"{outcome.first_step_seconds:.1f}",
        "a move, median [ms]": f"{outcome.milliseconds_a_move:.1f}",
        "whole [s]": f"{outcome.seconds:.1f}",
        "CPU, all processes [s]": f"{outcome.cpu_seconds:.1f}",
    }
