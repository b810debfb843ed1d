"""Which facets of cells are the same: each is compared with those that have the same smallest node, a few dozen.

A facet is known by its node numbers, and two cells that share one see it from different sides. The side is 1 where,
going round the facet from its smallest node as seen from outside the cell, the smaller neighbour comes first. The
facets of a simplex follow from its sorted nodes: the one without the j-th of them is seen from side 1 - j mod 2, and
from the other where sorting took an odd number of exchanges.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from mesh_motion_server.numerics.facet_buckets import smallest

__all__ = ["NODES_PER_ITEM", "unmatched_facets"]

NODES_PER_ITEM = 2048
"""Smallest nodes per work item of the parallel loop."""

_PAIRWISE = 48  # longest bucket that is not sorted before: a node of a good mesh has about 25 facets
_LONGEST_RUN = 64  # quads with three nodes in common: in a valid mesh at most two
_MOST = 4  # facets of a cell with the same smallest node: those around the tip of a pyramid
_NONE = np.iinfo(np.int64).max
_BEYOND = np.int64(1) << 62  # larger than any node: the third and fourth of a cell that has none


@njit(cache=True)
def _simplex_facets(nodes, cell, count, node, omitted, n, keys, fourth, tags, size, tag):  # type: ignore[no-untyped-def]
    """Append the facets of a simplex whose smallest node is ``node``; the new size.

    ``omitted`` (4,) is the number of the facet without each local node. That one goes along with the nodes in two bits
    of theirs, so that sorting takes no branch.
    """
    a, b, c, d = 4 * np.int64(nodes[cell]), 4 * np.int64(nodes[cell + 1]) + 1, _BEYOND, _BEYOND
    if count > 2:
        c = 4 * np.int64(nodes[cell + 2]) + 2
    if count > 3:
        d = 4 * np.int64(nodes[cell + 3]) + 3
    odd = (b < a) ^ (d < c)
    a, b, c, d = min(a, b), max(a, b), min(c, d), max(c, d)
    odd ^= (c < a) ^ (d < b)
    a, b, c, d = min(a, c), min(b, d), max(a, c), max(b, d)
    odd ^= c < b
    b, c = min(b, c), max(b, c)
    second, third, last = b >> 2, c >> 2, d >> 2
    if fourth.size:
        fourth[size : size + 3] = -1
    if node == a >> 2:
        keys[size] = 0 if count == 2 else third if count == 3 else third * n + last
        tags[size] = tag + 2 * omitted[b & 3] + odd
        if count > 2:
            keys[size + 1] = second if count == 3 else second * n + last
            tags[size + 1] = tag + 2 * omitted[c & 3] + 1 - odd
        if count > 3:
            keys[size + 2] = second * n + third
            tags[size + 2] = tag + 2 * omitted[d & 3] + odd
        return size + count - 1
    keys[size] = 0 if count == 2 else third if count == 3 else third * n + last
    tags[size] = tag + 2 * omitted[a & 3] + 1 - odd
    return size + 1


@njit(cache=True)
def _facets(nodes, cell, node, local, sizes, n, keys, fourth, tags, size, tag):  # type: ignore[no-untyped-def]
    """Append the facets of any cell whose smallest node is ``node``; the new size."""
    for f in range(sizes.size):
        if sizes[f]:
            place, least = smallest(nodes, cell, local[f], sizes[f])
            if least == node:
                keys[size], last, side = _described(nodes, cell, local[f], sizes[f], place, n)
                if fourth.size:
                    fourth[size] = last
                tags[size] = tag + 2 * f + side
                size += 1
    return size


@njit(cache=True)
def _described(nodes, cell, facet, size, place, n):  # type: ignore[no-untyped-def]
    """Key, fourth node and side of a facet of two or more nodes whose local node ``place`` is the smallest.

    The key is made of the two smaller ones of the others.
    """
    if size == 2:
        return np.int64(nodes[cell + facet[1 - place]]), np.int64(-1), np.int64(place == 0)
    after = np.int64(nodes[cell + facet[place + 1 if place + 1 < size else 0]])
    before = np.int64(nodes[cell + facet[place - 1 if place > 0 else size - 1]])
    low, middle, side, last = min(after, before), max(after, before), np.int64(after < before), np.int64(-1)
    if size == 4:
        last = np.int64(nodes[cell + facet[place + 2 if place < 2 else place - 2]])
        if last < middle:
            middle, last = last, middle
        if middle < low:
            low, middle = middle, low
    return low * n + middle, last, side


@njit(cache=True, parallel=True)
def unmatched_facets(nodes, blocks, local, sizes, starts, order, unmatched):  # type: ignore[no-untyped-def]
    """Mark the facets without a partner; returns the cell and place of the first facet of too many cells of each item.

    Parameters
    ----------
    nodes : (k,) array
        Of all cells, one after the other.
    blocks : (b + 1, 4) array
        Where the nodes of each cell type begin, its first cell, nodes per cell, whether it is a simplex; the ends in
        the last row.
    local : (b, f, 4) array
        Local nodes of the facets; of a simplex in the last row instead the number of the facet without each node.
    sizes : (b, f) array
        How many nodes they have; 0 for no facet.
    starts : (n + 1,) array
        Where in ``order`` the cells of each smallest node begin.
    order : (e,) array
        Cells that have a facet with a smallest node.
    unmatched : (e,) uint8 array
        Gets a bit for each facet of the cell with this smallest node that no other cell has.
    """
    n, quads = starts.size - 1, sizes.max() == 4
    items = (n + NODES_PER_ITEM - 1) // NODES_PER_ITEM
    least = np.full(items, _NONE)
    for item in prange(items):
        begin, end = item * NODES_PER_ITEM, min(n, (item + 1) * NODES_PER_ITEM)
        longest = 1
        for node in range(begin, end):
            longest = max(longest, _MOST * (starts[node + 1] - starts[node]))
        keys, fourth = np.empty(longest, dtype=np.int64), np.empty(longest if quads else 0, dtype=np.int64)
        tags, equal = np.empty(longest, dtype=np.int64), np.empty(longest, dtype=np.int64)
        for node in range(begin, end):
            size = 0
            for entry in range(starts[node], starts[node + 1]):
                block, cell = _where(blocks, np.int64(order[entry]))
                tag, table = 16 * entry, local[block]
                if blocks[block, 3]:
                    count = blocks[block, 2]
                    size = _simplex_facets(nodes, cell, count, node, table[-1], n, keys, fourth, tags, size, tag)
                else:
                    size = _facets(nodes, cell, node, table, sizes[block], n, keys, fourth, tags, size, tag)
            crowded = _match_all(keys[:size], fourth[:size], tags[:size], equal, unmatched)
            if crowded < _NONE:
                least[item] = min(least[item], 8 * np.int64(order[crowded >> 4]) + ((crowded >> 1) & 7))
    return least


@njit(cache=True)
def _where(blocks, number):  # type: ignore[no-untyped-def]
    """The block of a cell, and where its nodes begin."""
    block = 0
    while number >= blocks[block + 1, 1]:
        block += 1
    return block, blocks[block, 0] + (number - blocks[block, 1]) * blocks[block, 2]


@njit(cache=True)
def _match_all(keys, fourth, tags, equal, unmatched):  # type: ignore[no-untyped-def]
    """:func:`_match` for all facets with one smallest node: of many only those with an equal key are compared."""
    size = keys.size
    if size <= _PAIRWISE:
        return _match(keys, fourth, tags, equal, 0, size, unmatched)
    ascending = np.argsort(keys)
    keys[:], tags[:] = keys[ascending], tags[ascending]
    if fourth.size:
        fourth[:] = fourth[ascending]
    first, crowded = 0, _NONE
    while first < size:
        last = first + 1
        while last < size and keys[last] == keys[first]:
            last += 1
        if last - first > _LONGEST_RUN:
            crowded = min(crowded, tags[first:last].min())
        else:
            crowded = min(crowded, _match(keys, fourth, tags, equal, first, last, unmatched))
        first = last
    return crowded


@njit(cache=True)
def _match(keys, fourth, tags, equal, first, last, unmatched):  # type: ignore[no-untyped-def]
    """Mark the unmatched ones of some facets; the least tag of one that too many cells have.

    A tag is 16 times the entry of ``unmatched`` plus twice the facet of the cell plus the side. One of each different
    facet is kept at the front, ``equal`` how many cells it has so far, where 3 stands for too many: three cells cannot
    all be on different sides.
    """
    different, crowded = first, _NONE
    for i in range(first, last):
        key, tag, group = keys[i], tags[i], first
        while group < different and (keys[group] != key or (fourth.size and fourth[group] != fourth[i])):
            group += 1
        if group == different:
            keys[group], tags[group], equal[group] = key, tag, 1
            if fourth.size:
                fourth[group] = fourth[i]
            different += 1
        else:
            equal[group] = 2 if equal[group] == 1 and (tags[group] ^ tag) & 1 else 3
            tags[group] = min(tags[group], tag)
    for group in range(first, different):
        tag = tags[group]
        if equal[group] == 1:
            unmatched[tag >> 4] |= np.uint8(1) << ((tag >> 1) & 7)
        elif equal[group] == 3:
            crowded = min(crowded, tag)
    return crowded
