"""All facets of all cells, each once, and which cells are on either side; plain NumPy.

Facets are recognised by their sorted node numbers, two of which make one number of 64 bits: the two numbers of a facet
are sorted, and equal neighbours are the two sides of one facet.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.numerics.cells import CellTable
from mesh_motion_server.numerics.local_facets import LOCAL_FACETS

__all__ = ["CellFacets", "padded"]

Ints = NDArray[np.int64]
#: As short as the numbers allow: meshes of millions of cells are kept so.
Short = NDArray[np.integer[Any]]


@dataclass(frozen=True, eq=False)
class CellFacets:
    """The facets of cells, each once.

    Attributes
    ----------
    nodes : (f, 4) array
        As their first cell sees them from inside, anticlockwise from outside; filled up with -1. First those between
        two cells, ordered by first and second cell, then those of the boundary, in the order of the cells.
    owner : (f,) array
        Their first cell.
    neighbour : (i,) array
        The second cell of those between two.
    """

    nodes: Short
    owner: Short
    neighbour: Short

    @classmethod
    def of(cls, cells: CellTable) -> CellFacets:
        """Find them. Of each facet no more than two cells are seen; a checked mesh has no more."""
        pieces = _pieces(cells)
        first, second = _keys(pieces)
        order = np.lexsort((second, first))
        equal = (first[order[1:]] == first[order[:-1]]) & (second[order[1:]] == second[order[:-1]])
        del first, second
        cell_of = np.concatenate([cells_of for _, cells_of in pieces])
        pairs = np.stack([order[:-1][equal], order[1:][equal]])
        turned = cell_of[pairs[1]] < cell_of[pairs[0]]
        pairs[:, turned] = pairs[::-1, turned]
        alone = np.ones(len(order), dtype=bool)
        alone[:-1][equal] = alone[1:][equal] = False
        outer = order[alone]
        outer = outer[np.lexsort((outer, cell_of[outer]))]
        pairs = pairs[:, np.lexsort((cell_of[pairs[1]], cell_of[pairs[0]]))]
        chosen = np.concatenate([pairs[0], outer])
        return cls(_nodes(pieces, chosen), cell_of[chosen], cell_of[pairs[1]])

    @property
    def boundary(self) -> Ints:
        """(b, 4) the facets of one cell only."""
        return self.nodes[len(self.neighbour) :].astype(np.int64)


def padded(nodes: Ints) -> Ints:
    """(m, 4) facets (m, k) filled up with -1."""
    return np.pad(nodes, ((0, 0), (0, 4 - nodes.shape[1])), constant_values=-1)


_Piece = tuple[tuple[Ints, tuple[int, ...]], Short]


def _pieces(cells: CellTable) -> list[_Piece]:
    """For each local facet of each block: the block's nodes (m, n), the facet's local nodes, and its cells (m,)."""
    short: type[np.integer[Any]] = np.int32 if len(cells) < 2**31 else np.int64
    return [
        ((block.nodes, local), np.arange(first, first + len(block), dtype=short))
        for block, first in zip(cells, cells.offsets, strict=False)
        for local in LOCAL_FACETS[block.type.name]
    ]


def _keys(pieces: list[_Piece]) -> tuple[Ints, Ints]:
    """Two numbers (f,) of each facet that only facets with the same nodes have both of."""
    count = 2 + max(int(nodes.max()) for (nodes, _), _ in pieces)
    keys = np.empty((2, sum(len(nodes) for (nodes, _), _ in pieces)), dtype=np.int64)
    begin = 0
    for (nodes, local), _ in pieces:
        ascending = np.sort(padded(nodes[:, local]), axis=1) + 1
        end = begin + len(nodes)
        keys[0, begin:end] = ascending[:, 0] * count + ascending[:, 1]
        keys[1, begin:end] = ascending[:, 2] * count + ascending[:, 3]
        begin = end
    return keys[0], keys[1]


def _nodes(pieces: list[_Piece], chosen: Ints) -> Short:
    """(c, 4) nodes of the facets with these numbers (c,), filled up with -1."""
    largest = max(int(nodes.max()) for (nodes, _), _ in pieces)
    found = np.full((len(chosen), 4), -1, dtype=np.int32 if largest < 2**31 else np.int64)
    begin = 0
    for (nodes, local), _ in pieces:
        here = np.flatnonzero((chosen >= begin) & (chosen < begin + len(nodes)))
        rows = chosen[here] - begin
        for column, node in enumerate(local):
            found[here, column] = nodes[rows, node]
        begin += len(nodes)
    return found
