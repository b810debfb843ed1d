"""Chapter 4's test case (Figs 4.1, 4.2): 21 nodes on [0, 1], ends that stay, two inner boundary nodes that move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from mesh_motion_numerics.correction.enrichment.imposed_gradient import (
    EnrichedInterpolant,
    ImposedGradient,
    solve_imposed_gradient,
)
from mesh_motion_numerics.correction.enrichment.placement import local_minima
from mesh_motion_numerics.mesh.cells import CellTable
from numpy.typing import NDArray

Floats = NDArray[np.float64]

NODES = np.linspace(0.0, 1.0, 21)
CENTRES = 0.5 * (NODES[1:] + NODES[:-1])
CELLS = CellTable.from_arrays({"line": np.column_stack([np.arange(20), np.arange(1, 21)])})
NOWHERE = np.empty(0)
FINE = np.linspace(0.0, 1.0, 401)


@dataclass(frozen=True)
class Line:
    """The two moving nodes, their displacements, and the radii.

    Attributes
    ----------
    places, moves : pairs of float, length of the domain
    support_radius, enrichment_radius : float
        R and R_l.
    """

    places: tuple[float, float] = (0.2, 0.8)
    moves: tuple[float, float] = (0.15, -0.15)
    support_radius: float = 0.4
    enrichment_radius: float = 1.0

    @property
    def boundary(self) -> Floats:
        """(4,) places of the boundary nodes."""
        return np.array([0.0, *self.places, 1.0])

    @property
    def displacement(self) -> Floats:
        """(4,) their displacements."""
        return np.array([0.0, *self.moves, 0.0])

    def solve(
        self, points: Floats = NOWHERE, slopes: Sequence[float] | None = None, *, function: str = "H1"
    ) -> EnrichedInterpolant:
        """Thesis (4.9) with enrichment points (nc,); slopes by (4.1) unless given."""
        settings = ImposedGradient(self.support_radius, self.enrichment_radius, function=function)
        imposed = None if slopes is None else np.asarray(slopes, dtype=np.float64)
        return solve_imposed_gradient(self.boundary, self.displacement, points, settings, slopes_at_points=imposed)

    def worst_places(self, threshold: float = 0.9) -> Floats:
        """Cell centres that are minima of the predicted size below a threshold, thesis (4.11)."""
        return np.sort(CENTRES[local_minima(CELLS, predicted(self.solve()), threshold)])


def predicted(interpolant: EnrichedInterpolant) -> Floats:
    """(20,) size at the cell centres, 1 + S′."""
    return 1.0 + interpolant.gradient(CENTRES)


def sizes(interpolant: EnrichedInterpolant) -> Floats:
    """(20,) length of every cell after the motion over its length before."""
    return np.diff(NODES + interpolant.displacement(NODES)) / np.diff(NODES)


def smallest(interpolant: EnrichedInterpolant) -> float:
    """Actual minimum size: min(τ, 1/τ), signed."""
    ratio = sizes(interpolant)
    return float(np.where(ratio > 1.0, 1.0 / np.maximum(ratio, 1.0), ratio).min())


def best_slope(line: Line, points: Floats, slopes: Floats) -> tuple[float, float]:
    """The common slope of all points with the best minimum size, and this minimum."""
    reached = [smallest(line.solve(points, [slope] * len(points))) for slope in slopes]
    best = int(np.argmax(reached))
    return float(slopes[best]), reached[best]


def draw_displacement(ax: Any, line: Line, curves: dict[str, EnrichedInterpolant]) -> None:
    """Displacement of the field, the nodes marked, with the ideal straight lines."""
    ax.plot(line.boundary, line.displacement, "k--", lw=1, label="ideal")
    for label, interpolant in curves.items():
        drawn = ax.plot(FINE, interpolant.displacement(FINE), lw=1.2, label=label)
        ax.plot(NODES, interpolant.displacement(NODES), ".", ms=4, color=drawn[0].get_color())
    ax.set(xlabel="x", ylabel="displacement")
    ax.legend(fontsize=7)


def draw_parts(ax: Any, line: Line, interpolant: EnrichedInterpolant) -> None:
    """Displacement by the RBFs and by the enrichment functions, and their sum."""
    bare = EnrichedInterpolant(
        interpolant.boundary,
        interpolant.enrichment_points,
        interpolant.weights,
        np.zeros_like(interpolant.coefficients),
        interpolant.settings,
    )
    total, own = interpolant.displacement(FINE), bare.displacement(FINE)
    ax.plot(FINE, own, label="RBFs")
    ax.plot(FINE, total - own, label="enrichment")
    ax.plot(FINE, total, "k", label="sum")
    ax.plot(line.boundary, line.displacement, "ks", ms=4)
    ax.plot(interpolant.enrichment_points, np.zeros(len(interpolant.enrichment_points)), "r^", ms=5)
    ax.set_xlabel("x")
    ax.legend(fontsize=7)
