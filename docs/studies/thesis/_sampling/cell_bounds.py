"""Quality of cells by their group's Taylor polynomial, and its lower bound with the remainder."""

from __future__ import annotations

import mesh_motion_kernels as kernels
import numpy as np
from numpy.typing import NDArray

from docs.studies.thesis._sampling.groups import Groups

__all__ = ["bounded_quality"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def bounded_quality(
    points: Floats,
    nodes: NDArray[np.integer],
    reference: Floats,
    group: Ints,
    groups: Groups,
    coefficients: Floats,
    remainder: Floats,
) -> tuple[Floats, Floats]:
    """Size and skew of cells of one type by the polynomials of their groups, and their lower bounds.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
    nodes : (m, n_nodes) array
    reference : (m,) array
        Summed corner determinants of the reference mesh.
    group : (m,) array
        Group of each cell.
    coefficients : (g, d, c) array
        Taylor coefficients about the groups' centres.
    remainder : (g,) array

    Returns
    -------
    modelled, least : (2, m) arrays
        Rows size and skew; ``least`` is -inf if there is no bound.
    """
    modelled, least = np.empty((2, len(nodes))), np.empty((2, len(nodes)))
    kernels.bounded_quality(
        points,
        np.ascontiguousarray(nodes),
        np.ascontiguousarray(reference),
        group,
        np.ascontiguousarray(groups.centres),
        np.ascontiguousarray(coefficients),
        np.ascontiguousarray(remainder),
        modelled,
        least,
    )
    return modelled, least
