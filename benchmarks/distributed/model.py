"""What a step costs on many workers: a sum of terms whose constants a run has measured.

``T = a + b n_b + (l + P τ) rounds + (β n_b + γ P) / B + c (N / P) (1 + h)``, the halo's share ``h = k (N / P)^(−1/3)``

for N nodes, n_b of them on the boundary, in P partitions on as many workers of one thread.
"""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.distributed.figures import Results, Row

__all__ = ["ASSUMED_BANDWIDTH", "CostModel", "Terms"]

ASSUMED_BANDWIDTH = 1.25e9
"""Bytes a second of the cluster's network, 10 Gbit/s; on one machine only the loopback can be measured."""


@dataclass(frozen=True)
class Terms:
    """Seconds of a step.

    Attributes
    ----------
    solve : float
        The interpolation of all boundary nodes, in one process.
    messages : float
        Round trips, and tasks through the scheduler.
    wire : float
        Coefficients, out of one process.
    volume : float
        Moving and judging, on all workers at the same time.
    """

    solve: float
    messages: float
    wire: float
    volume: float

    @property
    def total(self) -> float:
        """Of a step."""
        return self.solve + self.messages + self.wire + self.volume


@dataclass(frozen=True)
class CostModel:
    """The measured constants.

    Attributes
    ----------
    solve_fixed, solve_per_node : float, seconds
        a, b.
    round_trip, per_task : float, seconds
        l, τ.
    rounds : int
    bytes_per_node, bytes_per_partition : float
        β, γ.
    volume_per_node : float, seconds
        c: displacement of a node and quality of its cells.
    halo : float
        k.
    """

    solve_fixed: float
    solve_per_node: float
    round_trip: float
    per_task: float
    rounds: int
    bytes_per_node: float
    bytes_per_partition: float
    volume_per_node: float
    halo: float

    @classmethod
    def of(cls, results: Results) -> CostModel:
        """The constants of a run, from its smallest and its largest mesh on one and on most workers."""
        rows = [row for row in results.rows if row.way == "partitions" and "×" not in row.case]
        small, large = min(rows, key=_size), max(rows, key=_size)
        one = next(row for row in rows if row.case == large.case and row.workers == 1)
        per_node = max(large.solve - small.solve, 0.0) / max(large.boundary - small.boundary, 1)
        share = sum(large.sent.values()) - sum(one.sent.values())
        per_partition = max(share, 0.0) / max(large.workers - 1, 1)
        return cls(
            solve_fixed=max(small.solve - per_node * small.boundary, 0.0),
            solve_per_node=per_node or small.solve / small.boundary,
            round_trip=results.round_trip,
            per_task=results.per_task,
            rounds=large.rounds,
            bytes_per_node=max(sum(one.sent.values()) - per_partition, 0.0) / one.boundary,
            bytes_per_partition=per_partition,
            volume_per_node=large.all_workers / (large.nodes * (1.0 + large.halo)),
            halo=large.halo * (large.nodes / large.workers) ** (1 / 3),
        )

    def terms(self, nodes: float, boundary: float, workers: float) -> Terms:
        """What a step costs."""
        each = nodes / workers
        return Terms(
            solve=self.solve_fixed + self.solve_per_node * boundary,
            messages=self.rounds * (self.round_trip + workers * self.per_task),
            wire=(self.bytes_per_node * boundary + self.bytes_per_partition * workers) / ASSUMED_BANDWIDTH,
            volume=self.volume_per_node * each * (1.0 + self.halo * each ** (-1 / 3)),
        )


def _size(row: Row) -> tuple[int, int]:
    return row.nodes, row.workers
