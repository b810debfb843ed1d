"""Cells put side by side that have a facet with the same smallest node: a counting sort of cell numbers.

The smallest node of a simplex is that of all its facets but one, which has the second one.
"""

from __future__ import annotations

import numpy as np
from numba import njit

__all__ = ["count_cells", "place_cells", "smallest"]


@njit(cache=True)
def smallest(nodes, cell, facet, size):  # type: ignore[no-untyped-def]
    """Which local node of a facet is the smallest, and its number; ``cell`` is where its cell's nodes begin."""
    place, least = 0, nodes[cell + facet[0]]
    for i in range(1, size):
        node = nodes[cell + facet[i]]
        if node < least:
            place, least = i, node
    return place, least


@njit(cache=True)
def _two_smallest(nodes, cell, count):  # type: ignore[no-untyped-def]
    """The two smallest nodes of a cell of ``count`` nodes."""
    first, second = nodes[cell], nodes[cell + 1]
    if second < first:
        first, second = second, first
    for i in range(2, count):
        node = nodes[cell + i]
        if node < first:
            first, second = node, first
        elif node < second:
            second = node
    return first, second


@njit(cache=True)
def _smallest_of_facets(nodes, cell, local, sizes, out):  # type: ignore[no-untyped-def]
    """How many different smallest nodes the facets of a cell have; they go to ``out``."""
    count = 0
    for f in range(sizes.size):
        node, i = smallest(nodes, cell, local[f], sizes[f])[1], 0
        while i < count and out[i] != node:
            i += 1
        if i == count:
            out[count] = node
            count += 1
    return count


@njit(cache=True)
def count_cells(nodes, kind, local, sizes, counts):  # type: ignore[no-untyped-def]
    """Add the cells of one type to the ``counts`` (n,) of the smallest nodes of their facets.

    ``nodes`` are those of one cell after the other; ``kind`` the nodes per cell and whether it is a simplex; ``local``
    (f, 4) the facets' local nodes, of which ``sizes`` (f,) count.
    """
    per_cell, simplex = kind
    found = np.empty(sizes.size, dtype=np.int64)
    for cell in range(0, nodes.size, per_cell):
        if simplex:
            first, second = _two_smallest(nodes, cell, per_cell)
            counts[first] += 1
            counts[second] += 1
        else:
            for i in range(_smallest_of_facets(nodes, cell, local, sizes, found)):
                counts[found[i]] += 1


@njit(cache=True)
def place_cells(nodes, kind, local, sizes, first_cell, place, order):  # type: ignore[no-untyped-def]
    """Put the numbers of these cells, from ``first_cell`` on, where the next cell of each such node goes to."""
    per_cell, simplex = kind
    found, number = np.empty(sizes.size, dtype=np.int64), first_cell
    for cell in range(0, nodes.size, per_cell):
        if simplex:
            first, second = _two_smallest(nodes, cell, per_cell)
            order[place[first]] = number
            place[first] += 1
            order[place[second]] = number
            place[second] += 1
        else:
            for i in range(_smallest_of_facets(nodes, cell, local, sizes, found)):
                order[place[found[i]]] = number
                place[found[i]] += 1
        number += 1
