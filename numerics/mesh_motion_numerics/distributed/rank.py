"""The mesh of one rank of a client when the server has only the boundary: moves the nodes, judges the cells.

This needs the numerics package and scipy, but no server.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from mesh_motion_protocol.errors import InvalidInput
from numpy.typing import NDArray

from mesh_motion_numerics.arrays import Floats, Integers, Shorts
from mesh_motion_numerics.correction.free_region import cells_of_nodes, nodes_of_cells
from mesh_motion_numerics.correction.trial_nodes import signed
from mesh_motion_numerics.distributed.counted_cells import CountedCells
from mesh_motion_numerics.distributed.field import Field
from mesh_motion_numerics.distributed.judging import read_questions, report_fields
from mesh_motion_numerics.distributed.order_statistics import BinContent, Way
from mesh_motion_numerics.distributed.region import Extent, Region, region_fields
from mesh_motion_numerics.distributed.summaries import first_questions
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.evaluation import NearOperator
from mesh_motion_numerics.interpolation.two_scale.interpolant import AnyInterpolant, TwoScaleInterpolant
from mesh_motion_numerics.mesh.boundary_facets import boundary_facets, boundary_nodes
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.closest_point import are_within
from mesh_motion_numerics.mesh.points import marks_at, rows_among
from mesh_motion_numerics.quality.mesh_check import checked_cells, nodes_in_no_cell
from mesh_motion_numerics.quality.metrics import WORST_CORNER, cell_quality, cells_at_rest, corner_quality


class Rank:
    """The nodes and cells of one partition.

    Raises InvalidInput if a cell is unusable, or a node is in none.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
        Reference coordinates.
    cells : mapping of str to (m, k) int array
        Cells by type; nodes are rows of ``points``.
    patch_nodes : (p,) int64 array
        Nodes on patches.

    Attributes
    ----------
    nodes : (b,) int64 array
        Nodes that the server must know, ascending: nodes on patches, on the boundary of this partition (also towards
        other partitions, because these may have a patch there), and the nodes that span its bounding box. After them
        the nodes of the cells near moving walls.
    """

    def __init__(self, points: Floats, cells: Mapping[str, NDArray[np.integer]], patch_nodes: Integers) -> None:
        self._given = CellTable.from_arrays(cells)
        _check_in_cells(self._given, len(points))
        read = checked_cells(points, self._given)
        self._points, self._cells = points, read.cells
        self._at_rest = cells_at_rest(points, read.cells, read.sizes)
        spanning = np.concatenate([points.argmin(axis=0), points.argmax(axis=0)])
        self.nodes: Integers = np.unique(np.concatenate([patch_nodes, boundary_nodes(read.cells), spanning]))
        self._boundary, self._sent = len(self.nodes), np.zeros(len(read.cells), dtype=bool)
        self._last: tuple[Field, AnyInterpolant, list[NearOperator] | None] | None = None
        self._judged: CountedCells | None = None
        self._moved = np.empty_like(points)  # reused: allocating new memory takes half the time of judging

    @property
    def facets(self) -> dict[str, Shorts]:
        """(f, k) facets of the boundary of this partition, by type, pointing outwards, in rows of :attr:`nodes`."""
        found = boundary_facets(self._cells).items()
        nodes = self.nodes[: self._boundary]
        return {name: np.searchsorted(nodes, rows).astype(np.int32) for name, rows in found}

    def near(self, wall: Floats, reach: float) -> tuple[Integers, dict[str, Integers]]:
        """Return the cells at the nodes within a reach of facets (f, d, d), without cells returned before.

        Returns
        -------
        (k,) int64 array, dict
            Further nodes that the server must know, now at the end of :attr:`nodes`; the cells by type, in rows of
            :attr:`nodes`.
        """
        chosen = cells_of_nodes(self._cells, are_within(wall, self._points, reach)) & ~self._sent
        self._sent |= chosen
        new = np.setdiff1d(np.flatnonzero(nodes_of_cells(self._cells, chosen, len(self._points))), self.nodes)
        self.extend(new)
        row = rows_among(len(self._points), self.nodes)
        blocks = ((block, chosen[span]) for block, span in self._cells.numbered)
        return new, {block.type.name: row[block.nodes[own]] for block, own in blocks if own.any()}

    def extend(self, nodes: Integers) -> None:
        """Add nodes (k,) to the nodes that the server knows."""
        self.nodes = np.concatenate([self.nodes, nodes])

    def displacement(self, field: Field, known: Floats) -> Floats:
        """(n, d) displacement from the reference mesh: from a field, and ``known`` (b, d) at :attr:`nodes`."""
        found = self._positions(field)
        found -= self._points
        found[self.nodes] = known
        return found

    def velocity(self, field: Field, known: Floats) -> Floats:
        """(n, d) velocity: from a field of velocities, and ``known`` (b, d) at :attr:`nodes`."""
        interpolant, prepared = self._prepared(field)
        found = evaluation.displacement(interpolant, self._points, prepared)
        found[self.nodes] = known
        return found

    def counted(self, field: Field, weights: Floats, others: Integers) -> Floats:
        """(r, d) derivatives by a field's coefficients, for weights (n, d) without :attr:`nodes` and ``others``."""
        own = ~marks_at(len(self._points), self.nodes, others)
        return field.counted(self._points[own], np.ascontiguousarray(weights[own]))

    def region(self, field: Field, known: Floats, extent: Extent, around: Integers) -> Region:
        """The cells that are bad after the displacement by a field and ``known`` (b, d), and the cells around them.

        Ids are indices of this rank's nodes; ``around`` (k,) has further nodes whose cells are included.
        """
        positions = self._positions(field)
        positions[self.nodes] = self._points[self.nodes] + known
        quality = cell_quality(positions, self._cells, self._at_rest)
        interior = len(self._points) - len(self.nodes)
        if extent.metric == WORST_CORNER:
            values = corner_quality(positions, self._cells, self._at_rest.points)
        else:
            values = signed(quality, extent.metric)
        return region_fields(self._points, positions, self._given, quality, values, extent, around, interior=interior)

    def _positions(self, field: Field) -> Floats:
        """(n, d) positions of the nodes after a field's displacement, except those of :attr:`nodes`."""
        interpolant, prepared = self._prepared(field)
        found = evaluation.displacement(interpolant, self._points, prepared)
        found += self._points
        return found

    def _prepared(self, field: Field) -> tuple[AnyInterpolant, list[NearOperator] | None]:
        """The interpolant of a field, with the data that stays constant while only coefficients change."""
        last = self._last
        if last is not None and field.differs_in_coefficients_only(last[0]):
            return field.interpolant(last[1]), last[2]
        self._last = last = None  # first delete the old data: both may not fit into memory
        interpolant, prepared = field.interpolant(), None
        if isinstance(interpolant, TwoScaleInterpolant):
            levels = interpolant.levels
            prepared = [NearOperator.build(level, self._points, skipped=self.nodes) for level in levels]
        self._last = field, interpolant, prepared
        return interpolant, prepared

    def judge(self, displacement: Floats, metric: str) -> Callable[[list[dict[str, Any]]], dict[str, Any]]:
        """Judge the cells with the nodes displaced by (n, d); return a function from questions to JUDGE's fields."""
        if self._judged is None or self._judged.metric != metric:
            self._judged = CountedCells(self._cells, self._at_rest, metric)
        judged = self._judged
        part = judged.judge(np.add(self._points, displacement, out=self._moved))
        answers: dict[tuple[str, Way], BinContent] = {}

        def fields(further: list[dict[str, Any]]) -> dict[str, Any]:
            questions = (*first_questions(metric), *read_questions(further))
            unanswered = tuple(one for one in questions if one not in answers)
            answers.update(zip(unanswered, judged.contents(unanswered), strict=True))
            return report_fields(part, self._place, questions, [answers[one] for one in questions])

        return fields

    def _place(self, cell: int) -> tuple[str, int]:
        """The type of a cell, and its number among the cells of its type."""
        block, row = self._cells.locate(cell)
        return block.type.name, row


def _check_in_cells(cells: CellTable, count: int) -> None:
    """Check that each of ``count`` nodes is in a cell: others may be outside the box for which the field is sent."""
    alone = nodes_in_no_cell(count, cells)
    if len(alone):
        raise InvalidInput(
            f"evaluation = 'client': node {alone[0]} is in no cell of this partition ({len(alone)} such nodes)",
            code="INVALID_ARGUMENT.MESH",
            hint="leave it out, or open the session with evaluation = 'server'",
            details={"node": int(alone[0])},
        )
