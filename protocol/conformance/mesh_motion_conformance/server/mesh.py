"""The mesh of the cases: a small square whose left side moves, whole or in two partitions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["HALVES", "OUTER", "SQUARE", "WITHOUT_VOLUME", "Part", "Side", "boundary"]


@dataclass(frozen=True)
class Side:
    """A patch: its role and its nodes."""

    role: str
    nodes: tuple[int, ...]


@dataclass(frozen=True)
class Part:
    """One partition of a mesh: points (n, d), triangles (m, 3), or (m, 0) if the client keeps them (section 23).

    ``global_ids`` are empty with one partition.
    """

    points: NDArray[np.float64]
    triangles: NDArray[np.int64]
    sides: dict[str, Side]
    global_ids: tuple[int, ...] = ()
    moving: NDArray[np.int64] = field(init=False)

    def __post_init__(self) -> None:
        nodes = {node for side in self.sides.values() if side.role == "moving" for node in side.nodes}
        object.__setattr__(self, "moving", np.array(sorted(nodes), dtype="<i8"))

    def uploads(self) -> Iterator[tuple[dict[str, Any], NDArray[Any]]]:
        """Fields and rows of each UPLOAD."""
        yield {"item": "nodes"}, self.points
        if self.global_ids:
            yield {"item": "global_ids"}, np.array(self.global_ids, dtype="<i8")[:, None]
        yield {"item": "cells", "name": "triangle"}, self.triangles
        for name, side in self.sides.items():
            rows = np.array(side.nodes, dtype="<i8")[:, None]
            yield {"item": "patch", "name": name, "role": side.role}, rows


def _square() -> Part:
    """4 × 4 nodes at multiples of 0.1, which floats cannot represent: sums and differences are rounded."""
    x = np.arange(4) * 0.1
    points = np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2)
    i = (np.arange(3)[:, None] * 4 + np.arange(3)).ravel()
    triangles = np.concatenate([np.stack([i, i + 1, i + 5], axis=1), np.stack([i, i + 5, i + 4], axis=1)])
    sides = {"left": Side("moving", (0, 4, 8, 12)), "right": Side("fixed", (3, 7, 11, 15))}
    return Part(points, triangles.astype("<i8"), sides)


def _half(ids: list[int]) -> Part:
    """The cells of the square whose nodes are all in ``ids`` (global ids)."""
    local = {number: index for index, number in enumerate(ids)}
    cells = [[local[n] for n in cell] for cell in SQUARE.triangles.tolist() if all(n in local for n in cell)]
    sides = {
        name: Side(side.role, tuple(local[n] for n in side.nodes if n in local)) for name, side in SQUARE.sides.items()
    }
    return Part(SQUARE.points[ids], np.array(cells, dtype="<i8"), sides, tuple(ids))


SQUARE = _square()
#: Below and above the nodes 8 … 11, which both have; the upper one uploads its nodes in falling order.
HALVES = (_half(list(range(12))), _half(list(range(15, 7, -1))))
#: Nodes of the square's boundary.
OUTER = (0, 1, 2, 3, 4, 7, 8, 11, 12, 13, 14, 15)
#: Settings that leave the volume alone (section 23).
WITHOUT_VOLUME: dict[str, Any] = {
    "displacement": "absolute", "correction": "none", "sub_steps": "never",
    "reduction": "none", "quality_metric": "size-skew",
}  # fmt: skip


def boundary(rest: Side = Side("fixed", (1, 2, 3, 5, 7, 9, 10, 11))) -> Part:
    """The boundary of the square, and the number of its cells; ``rest``: all nodes that are not on the moving side."""
    kept = np.empty((len(SQUARE.triangles), 0), dtype="<i8")
    return Part(SQUARE.points[list(OUTER)], kept, {"left": Side("moving", (0, 4, 6, 8)), "rest": rest}, OUTER)
