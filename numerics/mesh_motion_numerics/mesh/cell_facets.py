"""The facets of cells: all of them with the cells on both sides, those of one cell, and pairs of equal facets.

A facet is a node in 1D, an edge in 2D, a triangle or quad in 3D. Facet ``f`` of cell ``c`` has the number ``8 c + f``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mesh_motion_kernels as kernels
import numpy as np
from numpy.typing import NDArray

from mesh_motion_numerics.arrays import Integers
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.local_facets import LOCAL_FACETS

#: The shortest integers that hold the numbers: they are stored for meshes of millions of cells.
Short = NDArray[np.integer[Any]]


@dataclass(frozen=True, eq=False)
class CellFacets:
    """The facets of cells, each once."""

    #: (f, 4). Anticlockwise seen from outside their first cell; filled up with -1. First the facets between two cells,
    #: ordered by first and second cell, then the boundary facets, in the order of the cells.
    nodes: Short
    owner: Short  # (f,). The first cell of each facet
    neighbour: Short  # (i,). The second cell of the facets between two cells

    @classmethod
    def of(cls, cells: CellTable) -> CellFacets:
        """Find the facets. At most two cells of each facet are used; a checked mesh has no more."""
        single, pairs, _ = matched_facets(cells, pairs=True)
        chosen = np.concatenate([pairs[:, 0], single])
        short = np.int32 if len(cells) < 2**31 else np.int64
        return cls(facet_nodes(cells, chosen), (chosen // 8).astype(short), (pairs[:, 1] // 8).astype(short))

    @property
    def boundary(self) -> Integers:
        """(b, 4) the facets of one cell only."""
        return self.nodes[len(self.neighbour) :].astype(np.int64)


def matched_facets(cells: CellTable, *, pairs: bool = False) -> tuple[Integers, Integers, int]:
    """Numbers (b,) of the facets of one cell, ascending, and on request the pairs (m, 2) of the facets of two cells.

    The pairs are ordered by their cells; for a facet of more than two cells they name the first ones. The third result
    is the least number of a facet with more than two cells, or with two overlapping cells on the same side, or -1.
    """
    tables = [_table(block.type.name) for block in cells]
    most = max(map(len, tables))
    local = np.stack([np.pad(table, ((0, most - len(table)), (0, 0)), constant_values=-1) for table in tables])
    blocks = np.array([block.nodes.shape for block in cells])
    nodes = [block.nodes.reshape(-1) for block in cells]
    found: tuple[Integers, Integers, int] = kernels.match_facets(
        nodes[0] if len(nodes) == 1 else np.concatenate(nodes), blocks, local, pairs
    )
    return found


def facet_nodes(cells: CellTable, numbers: Integers) -> Short:
    """(m, 4) nodes of the facets with these numbers (m,), anticlockwise from outside, filled up with -1."""
    largest = max(int(block.nodes.max()) for block in cells)
    found = np.full((len(numbers), 4), -1, dtype=np.int32 if largest < 2**31 else np.int64)
    for block, of_block, rows in cells.located(numbers // 8):
        here, places = np.flatnonzero(of_block), numbers[of_block] % 8
        for column, local in enumerate(_table(block.type.name).T):
            found[here, column] = np.where(local[places] < 0, -1, block.nodes[rows, local[places]])
    return found


def _table(name: str) -> Integers:
    """(f, 4) local nodes of the facets of a type of cell, filled up with -1."""
    return np.array([facet + (-1,) * (4 - len(facet)) for facet in LOCAL_FACETS[name]], dtype=np.int64)
