"""From a motion's coordinates to what a Move answers with, and the trial's coordinates that follow from it.

Both are as large as the mesh: they are made in one pass over blocks that stay in the processor's cache.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Answer", "answer", "same_bits"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Rows of a block.
_ROWS = 1 << 14


class Answer(NamedTuple):
    """What becomes of a motion.

    Attributes
    ----------
    displacement : (n, d) array, mesh length unit
        Since the frame's coordinates, of the moving nodes as it was told.
    points : (n, d) array, mesh length unit
        The frame's coordinates plus the displacement, rounded as whoever adds them up rounds; read-only.
    exact : bool
        Whether ``points`` are the motion's coordinates to the last bit. Adding the difference may round elsewhere,
        mostly in a frame that the motion did not start from.
    """

    displacement: Floats
    points: Floats
    exact: bool


def answer(moved: Floats, base: Floats, moving: Ints, told: Floats) -> Answer:
    """The displacement that leads from ``base`` to ``moved``, and where it leads.

    Parameters
    ----------
    moved, base : (n, d) arrays, mesh length unit
        Coordinates after the motion, and those of the frame.
    moving : (k,) int64 array
        Moving nodes, ascending.
    told : (k, d) array, mesh length unit
        Their displacements.
    """
    displacement, points, exact = np.empty_like(base), np.empty_like(base), True
    for start in range(0, len(base), _ROWS):
        rows = slice(start, start + _ROWS)
        np.subtract(moved[rows], base[rows], out=displacement[rows])
        first, last = np.searchsorted(moving, (start, start + _ROWS))
        displacement[moving[first:last]] = told[first:last]
        np.add(base[rows], displacement[rows], out=points[rows])
        exact = exact and same_bits(points[rows], moved[rows])
    points.flags.writeable = False
    return Answer(displacement, points, exact)


def same_bits(a: Floats, b: Floats) -> bool:
    """Whether two (n, d) arrays have the same shape and bits: 0.0 is not -0.0, and a NaN is itself."""
    return np.array_equal(np.ascontiguousarray(a).view(np.int64), np.ascontiguousarray(b).view(np.int64))
