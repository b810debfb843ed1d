"""Cells listed in either orientation: cells in the opposite orientation are mirrored, as solvers do.

A cell has the opposite orientation if the determinant at each of its corners is negative; any other cell is kept, and
:mod:`.mesh_check` judges it. In a folded mesh such cells are really inverted: after mirroring, they and their
neighbours lie on the same side of a facet, which
:func:`~mesh_motion_numerics.mesh.boundary_facets.boundary_facets` detects.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.mesh.cells import CellBlock, CellTable
from mesh_motion_numerics.quality.metrics import CellsAtRest, cells_at_rest, reference_sizes, subset_quality

#: Node orders that turn a cell of each type into its mirror image.
_MIRROR: dict[str, tuple[int, ...]] = {
    "line": (1, 0),
    "triangle": (0, 2, 1),
    "quad": (0, 3, 2, 1),
    "tetra": (0, 2, 1, 3),
    "hexahedron": (4, 5, 6, 7, 0, 1, 2, 3),
    "wedge": (0, 2, 1, 3, 5, 4),
    "pyramid": (0, 3, 2, 1, 4),
}
_LISTED = {1: "from right to left", 2: "clockwise", 3: "in the opposite orientation"}
_PLURALS = {"tetra": "tetrahedra", "hexahedron": "hexahedra"}


class OrientedCells(NamedTuple):
    """Cells in the orientation of :data:`~mesh_motion_numerics.mesh.cells.CELL_TYPES`."""

    cells: CellTable  # The same table object if no cell was mirrored
    sizes: Floats  # (m,). Result of :func:`~mesh_motion_numerics.quality.metrics.reference_sizes`
    mirrored: Integers  # (k,). Numbers of the mirrored cells, ascending

    @property
    def warnings(self) -> list[str]:
        """One line about the mirrored cells, or none."""
        counts = np.histogram(self.mirrored, [*self.cells.offsets])[0]
        found = [
            f"{count} of {len(block)} {_plural(block.type.name)}"
            for count, block in zip(counts, self.cells, strict=True)
            if count
        ]
        if not found:
            return []
        were, they = ("was", "it is read as its") if len(self.mirrored) == 1 else ("were", "they are read as their")
        listed = _LISTED[self.cells.dimension]
        return [f"{' and '.join(found)} {were} listed {listed}; {they} mirror image, as solvers do"]


def oriented(points: NDArray[np.floating], cells: CellTable) -> OrientedCells:
    """Mirror the cells in the opposite orientation.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
        Coordinates of the reference mesh.
    cells : CellTable
        With valid node indices.
    """
    sizes = reference_sizes(points, cells)
    negative = np.flatnonzero(sizes < 0.0)
    if not len(negative):
        return OrientedCells(cells, sizes, negative)
    # the skew of a cell is 0 if its corners have different signs
    mirrored = negative[subset_quality(points, cells, sizes, negative).skew > 0.0]
    if len(mirrored):
        cells = _mirrored(cells, mirrored)
        sizes = reference_sizes(points, cells)
    return OrientedCells(cells, sizes, mirrored)


def oriented_at_rest(points: NDArray[np.floating], cells: CellTable) -> tuple[CellTable, CellsAtRest]:
    """The cells in one orientation, and their sizes and skews at rest; parameters as for :func:`oriented`."""
    read = oriented(points, cells)
    return read.cells, cells_at_rest(points, read.cells, read.sizes)


def _mirrored(cells: CellTable, numbers: Integers) -> CellTable:
    """The cells, in which those with these numbers are replaced by their mirror images."""
    blocks = []
    for block, _, rows in cells.located(numbers):
        nodes = block.nodes.copy()
        nodes[rows] = block.nodes[rows[:, None], _MIRROR[block.type.name]]
        blocks.append(CellBlock(block.type, nodes) if len(rows) else block)
    return CellTable(tuple(blocks))


def _plural(name: str) -> str:
    return _PLURALS.get(name, f"{name}s")
