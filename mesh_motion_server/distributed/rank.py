"""The mesh of one rank of a client, when the server has the boundary only: moves the nodes, judges the cells.

It needs the numerics of the server's package, scipy among it, but no server.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.distributed.field import Field
from mesh_motion_server.distributed.judging import first_questions, read_questions, told
from mesh_motion_server.distributed.order_statistics import WHOLE, Way, content_within, within_division
from mesh_motion_server.distributed.summaries import part_of, values_of
from mesh_motion_server.numerics.interpolation.evaluation import LocalEvaluator
from mesh_motion_server.numerics.interpolation.factor_source import Kept, prepared_for
from mesh_motion_server.numerics.mesh.boundary_facets import boundary_nodes
from mesh_motion_server.numerics.mesh.cells import CellTable
from mesh_motion_server.numerics.motion.motion_field import Stage
from mesh_motion_server.numerics.quality.mesh_check import checked_cells
from mesh_motion_server.numerics.quality.metrics import cell_quality, cells_at_rest

__all__ = ["Rank"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
K = TypeVar("K", bound=Kept)


class _Last:
    """A factor source that keeps the last object."""

    def __init__(self) -> None:
        self._kept: tuple[bytes, Kept] | None = None

    def get_or_make(self, key: bytes, make: Callable[[], K], kind: str = "factorization") -> tuple[K, bool]:
        """The object of this ``key``, and whether it was reused."""
        del kind
        if self._kept is not None and self._kept[0] == key:
            return cast(K, self._kept[1]), True
        self._kept = None  # first: two of them need not fit into memory
        made = make()
        self._kept = key, made
        return made, False

    def held(self) -> dict[str, int]:
        """Nobody asks."""
        return {}


class Rank:
    """The nodes and cells of one partition.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
        Reference coordinates.
    cells : mapping of str to (m, k) int array
        By type; nodes in rows of ``points``.
    patch_nodes : (p,) int64 array
        Nodes on patches.

    Attributes
    ----------
    nodes : (b,) int64 array
        Nodes that the server must know, ascending: those on patches, on the boundary of this partition (also towards
        others, where another partition may have a patch), and those that span its box.

    Raises
    ------
    InvalidInput
        If a cell is unusable.
    """

    def __init__(self, points: Floats, cells: Mapping[str, NDArray[np.integer]], patch_nodes: Ints) -> None:
        read = checked_cells(points, CellTable.from_arrays(cells))
        self._points, self._cells = points, read.cells
        self._at_rest = cells_at_rest(points, read.cells, read.sizes)
        spanning = np.concatenate([points.argmin(axis=0), points.argmax(axis=0)])
        self.nodes: Ints = np.unique(np.concatenate([patch_nodes, boundary_nodes(read.cells), spanning]))
        self._evaluator, self._operators = LocalEvaluator(), _Last()

    def displacement(self, field: Field, known: Floats) -> Floats:
        """(n, d) displacement from the reference mesh: by a field, and ``known`` (b, d) of :attr:`nodes`."""
        interpolant, points = field.interpolant(), self._points
        prepared = prepared_for(self._evaluator, interpolant, points, self._operators, unasked=self.nodes)
        found = Stage(None, interpolant).positions(points, self._evaluator, prepared)
        np.subtract(found, points, out=found)
        found[self.nodes] = known
        return found

    def judge(self, displacement: Floats, metric: str) -> Callable[[list[dict[str, Any]]], dict[str, Any]]:
        """Judge the cells with the nodes displaced by (n, d); returns what gives JUDGE's fields for questions."""
        points = self._points + displacement
        quality = cell_quality(points, self._cells, self._at_rest)
        numbers = np.arange(len(self._cells))
        everywhere = values_of(quality, metric)
        part = part_of(quality, everywhere, numbers, lambda cells: self._cells.centres(points, cells), metric=metric)
        answers = {(name, WHOLE): found for name, found in part.contents.items()}
        values = {(name, WHOLE): found for name, found in everywhere.items()}

        def within(name: str, way: Way) -> Floats:
            """The values in a bin, each found once."""
            if (name, way) not in values:
                values[name, way] = within_division(within(name, way[:-1]), way[-1])
            return values[name, way]

        def fields(further: list[dict[str, Any]]) -> dict[str, Any]:
            questions = (*first_questions(metric), *read_questions(further))
            for name, way in questions:
                if (name, way) not in answers:
                    answers[name, way] = content_within(within(name, way), way)
            return told(part, self._place, questions, [answers[one] for one in questions])

        return fields

    def _place(self, cell: int) -> tuple[str, int]:
        """Type of a cell, and its number among those of its type."""
        block, row = self._cells.locate(cell)
        return block.type.name, row
