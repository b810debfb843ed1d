"""A matrix of many rows that grows by columns, in blocks: nothing is copied when it grows."""

from collections.abc import Iterator

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from scipy.linalg.blas import dgemm

__all__ = ["GrowingColumns"]


#: Columns a block: wide enough for full speed of a product, narrow enough that few matrices of few columns waste none.
_BLOCK = 128


class GrowingColumns:
    """(rows, count) matrix, columns stored one after the other."""

    def __init__(self, rows: int) -> None:
        self._rows = rows
        self._blocks: list[Floats] = []
        self.count = 0

    def append(self, column: Floats) -> None:
        """Add a (rows,) column."""
        place = self.count % _BLOCK
        if place == 0:
            self._blocks.append(np.empty((self._rows, _BLOCK), order="F"))
        self._blocks[-1][:, place] = column
        self.count += 1

    def rows(self, numbers: Integers) -> Floats:
        """(m, count) copy of rows."""
        out = np.empty((len(numbers), self.count))
        for first, block in self._filled():
            out[:, first : first + block.shape[1]] = block[numbers]
        return out

    def subtract_products(self, rows: Floats, out: Floats) -> None:
        """``out −= M rowsᵀ`` in place, for (m, count) rows and a column-major (rows, m) array."""
        for first, block in self._filled():
            # fails to write in place only if out is not column-major
            dgemm(-1.0, block, rows[:, first : first + block.shape[1]], 1.0, out, trans_b=1, overwrite_c=1)

    def _filled(self) -> Iterator[tuple[int, Floats]]:
        """First column number and the filled part of each block."""
        for number, block in enumerate(self._blocks):
            first = number * _BLOCK
            yield first, block[:, : self.count - first]
