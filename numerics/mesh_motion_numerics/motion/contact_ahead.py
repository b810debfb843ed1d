"""The number of further steps like the last one until no mesh with this boundary is valid: it meets itself.

A node meets a facet when the simplex of both has no volume while the node is inside the facet, and so do two edges in
space. This volume is a polynomial along the step, so its roots are exact, like those of a cell (:mod:`.headroom`). Not
found: a flat part of the boundary that folds onto itself. A cell all of whose nodes have prescribed positions may
invert earlier: no correction moves it.
"""

from __future__ import annotations

from dataclasses import dataclass

import mesh_motion_kernels as kernels
import numpy as np
from numpy.typing import NDArray

from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.mesh.boundary_crossing import BoundaryFacets
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.morton import morton_codes
from mesh_motion_numerics.mesh.smooth_pieces import area_vectors, as_simplices, of_one_width, widened

_BLOCK = 16  # facets


@dataclass(frozen=True, eq=False)
class ContactAhead:
    """The facets of a boundary all of whose nodes have prescribed positions."""

    #: (f, d). Segments or triangles; followed by a node on their inner side, where the cells are, they are a simplex of
    #: positive volume.
    facets: NDArray[np.int32]
    starts: Integers  # (b,). The first facets of blocks of neighbours that face the same side of the axes
    moving: Marks  # (f,). Whether a node of the facet moves
    stiff: CellTable | None  # The cells without a free node, if there are any

    @classmethod
    def build(cls, boundary: BoundaryFacets, points: Floats, stiff: CellTable | None = None) -> ContactAhead:
        """Build it for reference coordinates (n, d)."""
        outwards = as_simplices(of_one_width(boundary.nodes))
        areas = area_vectors(points, widened(outwards, max(2, 4 * (points.shape[1] - 2))))
        facets = np.concatenate([outwards[:, :1], outwards[:, :0:-1]], axis=1).astype(np.int32)  # inwards
        axes, moving = np.abs(areas).argmax(axis=1), np.asarray(boundary.moving[facets].any(axis=1))
        back = np.take_along_axis(areas, axes[:, None], axis=1)[:, 0] < 0.0
        kinds = 6 * moving + 2 * axes + back
        order = np.lexsort((morton_codes(points[facets].mean(axis=1)), kinds))
        _, firsts, counts = np.unique(kinds[order], return_index=True, return_counts=True)
        starts = np.concatenate([np.arange(a, a + n, _BLOCK) for a, n in zip(firsts, counts, strict=True)])
        return cls(facets[order], starts, moving[order], stiff)

    def steps(self, points: Floats, before: Floats, most: float) -> float:
        """Steps like that from ``before`` to ``points`` (n, d) until no mesh is valid; ``inf`` above ``most``."""
        stiff = float(np.inf)
        if self.stiff is not None:
            every = np.arange(len(self.stiff))
            stiff = float(kernels.first_inversions(points, before, self.stiff.nodes, every, most, 1)[0][0])
        boundary = self.facets, self.starts, self.moving
        return min(stiff, float(kernels.first_contact(points, before, *boundary, min(most, stiff))))
