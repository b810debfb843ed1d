"""The thesis' Algorithm 1: the change of the displacement gradient that improves a bad cell.

The scaling factors of a cell are the eigenvalues of ``B = I + J``. A factor ≤ 0 becomes +0.1; if there is none, the
smaller factor gains 0.1. The directions V are kept: ``B_new = V Λ_new V⁻¹``, ``dJ = B_new - B`` (thesis (5.13),
(5.14)).

The printed algorithm sets ``λ ← −0.1`` in a loop that would not end; its text and comment say +0.1. Two cases that it
does not define are handled here. A complex pair is a rotation: the pair gains 0.1 together, 0.05 along each of its two
directions, which is the real part of V Λ_new V⁻¹. (Nearly) equal eigenvalues with parallel directions, a pure shear,
would need an unbounded change; they are treated as a complex pair, because they are the limit of such pairs.
"""

import numpy as np

from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.decomposition import deformation, eigen

INCREMENT = 0.1
"""The thesis' constant: the new value of a factor ≤ 0, and also the gain of the smaller factor."""

# From this condition number of V on, directions are taken as parallel: the change is 10 times that of a symmetric B.
_PARALLEL = 100.0


def eigen_correction(gradient: Floats) -> Floats:
    """Change dJ of a displacement gradient J that improves the cell, thesis Algorithm 1.

    Parameters
    ----------
    gradient : (d, d) array
        J, ``[i, j] = ∂S_i/∂x_j`` at the cell.

    Returns
    -------
    (d, d) array
        ``J_new - J``.
    """
    B = deformation(gradient)
    values, vectors = (part[0] for part in eigen(B[None]))
    reversed_directions = (values.imag == 0.0) & (values.real <= 0.0)
    if np.linalg.cond(vectors) > _PARALLEL:
        least = float(values.real[reversed_directions].min(initial=0.0))
        return (INCREMENT - least if reversed_directions.any() else INCREMENT / len(B)) * np.eye(len(B))
    change = np.where(reversed_directions, INCREMENT - values.real, 0.0)
    if not reversed_directions.any():
        change[0] = INCREMENT  # eigen() sorts: the first is the smallest, or belongs to the smallest pair
    return np.asarray((vectors * change @ np.linalg.inv(vectors)).real)
