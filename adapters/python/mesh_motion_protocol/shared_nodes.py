"""One displacement for a node that several patches or partitions give one for.

Their values may differ by rounding, for example because they come from two mappings. The larger of each component is
taken, so that the result depends neither on the order of the patches nor on how the mesh is divided.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["AGREEMENT", "Torn", "united"]

#: Largest difference of a component between the values for one node, as a share of the longest side of the bounding
#: box of the mesh: what single precision rounds. A larger one would tear the mesh.
AGREEMENT = 1e-7


class Torn(ValueError):
    """A node is given two displacements.

    Attributes
    ----------
    place : int
        The number of the node, as in ``places``.
    parts : tuple of two int
        Which parts give it.
    values : tuple of two (d,) arrays
        What they give.
    """

    def __init__(self, place: int, parts: tuple[int, int], values: tuple[NDArray[Any], NDArray[Any]]) -> None:
        super().__init__(f"node {place} is given two displacements")
        self.place, self.parts, self.values = place, parts, values


def united(
    rows: Sequence[NDArray[np.float64]], places: Sequence[NDArray[np.integer]], count: int, extent: float
) -> NDArray[np.float64]:
    """One displacement for each node.

    Parameters
    ----------
    rows : one (r, d) array per part
        Finite displacements, mesh length unit.
    places : one (r,) array per part
        The node of each row: 0 … count - 1.
    count : int
        Number of nodes; each is in some part.
    extent : float
        Longest side of the bounding box of the mesh, mesh length unit.

    Returns
    -------
    (count, d) array

    Raises
    ------
    Torn
        For the first node whose values differ by more than :data:`AGREEMENT` of the extent.
    """
    values, nodes = np.concatenate(rows), np.concatenate(places)
    highest = np.full((count, values.shape[1]), -np.inf)
    np.maximum.at(highest, nodes, values)
    apart = np.max(highest[nodes] - values, axis=1, initial=0.0)
    if (apart > AGREEMENT * extent).any():
        _refuse(values, nodes, apart, [len(part) for part in rows])
    highest[np.bincount(nodes, minlength=count) > 1] += 0.0  # 0 and -0 differ in their bits
    return highest


def _refuse(
    values: NDArray[np.float64], nodes: NDArray[np.integer], apart: NDArray[np.float64], sizes: list[int]
) -> None:
    """Raise for the row that is furthest ``apart`` (r,) from the other values of its node."""
    row = int(np.argmax(apart))
    same = np.flatnonzero(nodes == nodes[row])
    other = int(same[np.argmax(np.abs(values[same] - values[row]).max(axis=1))])
    first, second = sorted((row, other))
    ends = np.cumsum(sizes)
    parts = (int(np.searchsorted(ends, first, side="right")), int(np.searchsorted(ends, second, side="right")))
    raise Torn(int(nodes[row]), parts, (values[first], values[second]))
