"""Points with more coordinates than their cells have dimensions: a plane mesh in a file with three coordinates."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["is_flat"]

#: How much a coordinate without use may vary, as a share of the largest extent. Single precision rounds to 6e-8 of the
#: size, and programs that turn or compute a plane mesh leave no less in it.
_ROUNDING = 1e-6


def is_flat(points: NDArray[Any], dimension: int) -> bool:
    """Whether the coordinates of points (n, 1 to 3) beyond the cells' ``dimension`` differ by rounding only."""
    extents = np.ptp(points, axis=0)
    return not (extents[dimension:] > _ROUNDING * extents.max()).any()
