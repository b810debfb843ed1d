"""The Morton (Z-order) curve: neighbours in a list are neighbours in space.

References
----------
G. M. Morton, A computer oriented geodetic data base and a new technique in file sequencing, IBM (1966).
"""

import numpy as np
from numpy.typing import NDArray

from mesh_motion_numerics.arrays import Floats

#: Bits per coordinate, by dimension: as many as fit into a code of 63 bits and a double of 53 bits.
_BITS = {1: 52, 2: 31, 3: 21}
#: Shift and mask pairs that spread the bits of one coordinate: one gap for 2D, two gaps for 3D.
_SPREAD = {
    1: (),
    2: (
        (16, 0x0000FFFF0000FFFF),
        (8, 0x00FF00FF00FF00FF),
        (4, 0x0F0F0F0F0F0F0F0F),
        (2, 0x3333333333333333),
        (1, 0x5555555555555555),
    ),
    3: (
        (32, 0x001F00000000FFFF),
        (16, 0x001F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ),
}


def morton_codes(points: Floats) -> NDArray[np.uint64]:
    """Morton code of each point in the bounding box of all points.

    Parameters
    ----------
    points : (n, d) array
        Finite; d = 1, 2 or 3.

    Returns
    -------
    (n,) uint64 array
    """
    dimension = points.shape[1]
    # halves, because the difference of two coordinates may overflow
    low = 0.5 * points.min(axis=0)
    extent = float(np.max(0.5 * points.max(axis=0) - low)) or 1.0
    top = float(2 ** _BITS[dimension] - 1)
    codes = np.zeros(len(points), dtype=np.uint64)
    for axis in range(dimension):
        # the clip guards against x·top rounding up past the last cell
        cells = np.minimum((0.5 * points[:, axis] - low[axis]) / extent * top, top).astype(np.uint64)
        codes |= _spread(cells, dimension) << np.uint64(axis)
    return codes


def _spread(values: NDArray[np.uint64], dimension: int) -> NDArray[np.uint64]:
    """(n,) values with ``dimension - 1`` zero bits between their bits."""
    for shift, mask in _SPREAD[dimension]:
        values = (values | (values << np.uint64(shift))) & np.uint64(mask)
    return values
