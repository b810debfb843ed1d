"""The minimum work of a step, and how near its phases come to the machine's limits.

Bytes that must move, f64 coordinates and i32 node numbers:

=========  ======================================================================================
displace   the n nodes are read and written once: 16 d n
predict    the n nodes, the m (d + 1) node numbers and the m reference sizes are read once: 8 d n + 4 (d + 1) m + 8 m
step       the same, with the nodes read once: 16 d n + 4 (d + 1) m + 8 m
=========  ======================================================================================

Operations that must be done, for the design in two scales on simplices:

=========  ======================================================================================
displace   at every node a cubic spline of d components: 4ᵈ coefficients contracted axis by axis, and its weights
predict    of every cell d edges, the determinant, the squared length of all edges, and the comparison of size³ · skew³
=========  ======================================================================================

Other work of a phase (the coarse system, the compact sums near the wall, a later pass over the same nodes) counts as
time but not as work, so it lowers the share.
"""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.scale.figures import Figures, Rates, Seconds, of_threads

__all__ = ["Share", "Work", "shares", "work"]

#: Operations of one cell, by dimension: edges, determinant, squared lengths of all edges with their sum, comparison.
_CELL_FLOPS = {2: 4 + 3 + 12 + 6, 3: 9 + 14 + 33 + 8}


@dataclass(frozen=True)
class Work:
    """Bytes that must move and operations that must be done."""

    bytes: float
    flops: float

    def seconds(self, rates: Rates) -> float:
        """Seconds at the machine's limits: the longer time of moving bytes and of operations."""
        return max(self.bytes / rates.triad, self.flops / rates.arithmetic)


@dataclass(frozen=True)
class Share:
    """The share of the machine's limits that a phase reaches.

    Attributes
    ----------
    phase : {"displace", "predict", "step"}
    bandwidth, arithmetic : float
        Shares of the measured rates.
    times : float
        The phase's time over the time of its work at the limits.
    """

    phase: str
    bandwidth: float
    arithmetic: float
    times: float


def work(figures: Figures, dimension: int) -> dict[str, Work]:
    """Work of each phase on a mesh of simplices."""
    n, m, d = figures.nodes, figures.cells, dimension
    spline = d * sum(2.0 * 4**axis for axis in range(1, d + 1)) + 12.0 * d
    cells = m * (4.0 * (d + 1) + 8.0)
    displace = Work(16.0 * d * n, spline * n)
    predict = Work(8.0 * d * n + cells, _CELL_FLOPS[d] * float(m))
    return {
        "displace": displace,
        "predict": predict,
        "step": Work(16.0 * d * n + cells, displace.flops + predict.flops),
    }


def shares(figures: Figures, dimension: int, rates: Rates, threads: int) -> list[Share]:
    """Shares of the phases that pass over the mesh and of the whole step."""
    times: dict[str, Seconds] = {phase: getattr(figures, phase) for phase in ("displace", "predict", "step")}
    found = []
    for phase, least in work(figures, dimension).items():
        taken = of_threads(times[phase], threads)
        found.append(
            Share(
                phase,
                least.bytes / taken / rates.triad,
                least.flops / taken / rates.arithmetic,
                taken / least.seconds(rates),
            )
        )
    return found
