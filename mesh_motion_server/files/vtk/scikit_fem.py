"""Boundaries of scikit-fem: an array ``skfem:b:<name>`` on cells has a bit for each side of a cell that is in one.

https://github.com/kinnala/scikit-fem, skfem/mesh/mesh.py and skfem/refdom.py
"""

from collections.abc import Mapping, Sequence

import numpy as np
from mesh_motion_numerics.arrays import Integers
from numpy.typing import NDArray

_PREFIX = "skfem:b:"
#: The corners of the sides in scikit-fem's order, for cells in VTK's order; wedges have another order in each format.
_SIDES: dict[str, Sequence[Sequence[int]]] = {
    "triangle": ((0, 1), (1, 2), (0, 2)),
    "quad": ((0, 1), (1, 2), (2, 3), (0, 3)),
    "tetra": ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)),
    "hexahedron": ((0, 4, 7, 3), (0, 3, 2, 1), (0, 1, 5, 4), (3, 7, 6, 2), (4, 5, 6, 7), (1, 2, 6, 5)),
}


def marked_sides(
    arrays: Mapping[str, NDArray[np.generic]], cells: Sequence[tuple[str, Integers, Integers]]
) -> dict[str, Integers]:
    """{name: (p,) nodes, with repeats} of the boundaries in arrays on cells.

    Parameters
    ----------
    cells : [(our type, rows (m,) of the arrays, corners (m, k))]
    """
    found: dict[str, Integers] = {}
    if any(name not in _SIDES for name, _, _ in cells):
        return found
    for key, values in arrays.items():
        if key.startswith(_PREFIX) and values.dtype.kind in "iu":
            parts = [np.empty(0, np.int64)]
            for name, rows, nodes in cells:
                bits = values[rows].astype(np.int64)
                for side, corners in enumerate(_SIDES[name]):
                    parts.append(nodes[(bits >> side) & 1 == 1][:, list(corners)].ravel())
            found[key.removeprefix(_PREFIX)] = np.concatenate(parts)
    return found
