"""One displacement for a node to which several patches or partitions give displacements.

Their values may differ by rounding, for example because they come from two mappings. The larger value of each component
is taken, so that the result depends neither on the order of the patches nor on the partitioning of the mesh.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["AGREEMENT", "Torn", "united"]

#: Largest allowed difference of a component between the values for one node, as a share of the longest side of the
#: mesh's bounding box: the rounding of single precision. A larger difference would tear the mesh.
AGREEMENT = 1e-7


class Torn(ValueError):
    """A node has two different displacements.

    Attributes
    ----------
    place : int
        The number of the node, as in ``places``.
    parts : tuple of two int
        Numbers of the parts that give them.
    values : tuple of two (d,) arrays
        The two displacements.
    """

    def __init__(self, place: int, parts: tuple[int, int], values: tuple[NDArray[Any], NDArray[Any]]) -> None:
        super().__init__(f"node {place} is given two displacements")
        self.place, self.parts, self.values = place, parts, values


def united(
    rows: Sequence[NDArray[np.float64]], places: Sequence[NDArray[np.integer]], count: int, extent: float
) -> NDArray[np.float64]:
    """Return one displacement for each node.

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
    highest[np.bincount(nodes, minlength=count) > 1] += 0.0  # 0 and -0 are equal but have different bits
    return highest


def _refuse(
    values: NDArray[np.float64], nodes: NDArray[np.integer], apart: NDArray[np.float64], sizes: list[int]
) -> None:
    """Raise the error for the row that is furthest ``apart`` (r,) from the other values of its node."""
    row = int(np.argmax(apart))
    same = np.flatnonzero(nodes == nodes[row])
    other = int(same[np.argmax(np.abs(values[same] - values[row]).max(axis=1))])
    first, second = sorted((row, other))
    ends = np.cumsum(sizes)
    parts = (int(np.searchsorted(ends, first, side="right")), int(np.searchsorted(ends, second, side="right")))
    raise Torn(int(nodes[row]), parts, (values[first], values[second]))
