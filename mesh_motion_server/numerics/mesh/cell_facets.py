"""All facets of all cells, each once, and the cells on both sides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mesh_motion_server.numerics.mesh.cells import CellTable
from mesh_motion_server.numerics.mesh.facet_matching import Ints, Short, facet_nodes, matched_facets

__all__ = ["CellFacets"]


@dataclass(frozen=True, eq=False)
class CellFacets:
    """The facets of cells, each once.

    Attributes
    ----------
    nodes : (f, 4) array
        Anticlockwise seen from outside their first cell; filled up with -1. First the facets between two cells, ordered
        by first and second cell, then those of the boundary, in the order of the cells.
    owner : (f,) array
        Their first cell.
    neighbour : (i,) array
        The second cell of the facets between two cells.
    """

    nodes: Short
    owner: Short
    neighbour: Short

    @classmethod
    def of(cls, cells: CellTable) -> CellFacets:
        """Find the facets. At most two cells of each facet are used; a checked mesh has no more."""
        single, pairs, _ = matched_facets(cells, pairs=True)
        chosen = np.concatenate([pairs[:, 0], single])
        short = np.int32 if len(cells) < 2**31 else np.int64
        return cls(facet_nodes(cells, chosen), (chosen // 8).astype(short), (pairs[:, 1] // 8).astype(short))

    @property
    def boundary(self) -> Ints:
        """(b, 4) the facets of one cell only."""
        return self.nodes[len(self.neighbour) :].astype(np.int64)
