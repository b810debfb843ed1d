"""The boundary of a mesh: facets that belong to exactly one cell.

A facet is a node in 1D, an edge in 2D, a triangle or quad in 3D. Facets are recognised by their node numbers: they
are put into one bucket per smallest node (a counting sort), and each bucket, a few dozen facets, is sorted by the
other nodes. That takes two passes over the facets and no hashing, and the result does not depend on threads.
"""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.cells import CellTable
from mesh_motion_server.numerics.read_only import read_only
from mesh_motion_server.numerics.thread_share import threads_for

__all__ = ["LOCAL_FACETS", "boundary_facets", "boundary_nodes"]

Ints = NDArray[np.int64]

#: Local node numbers of each cell type's facets, seen anticlockwise from outside (an edge has its cell on the left).
LOCAL_FACETS: dict[str, tuple[tuple[int, ...], ...]] = {
    "line": ((0,), (1,)),
    "triangle": ((0, 1), (1, 2), (2, 0)),
    "quad": ((0, 1), (1, 2), (2, 3), (3, 0)),
    "tetra": ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)),
    "hexahedron": ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
    "wedge": ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    "pyramid": ((0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
}
_FACET_NAMES = {1: "vertex", 2: "line", 3: "triangle", 4: "quad"}

_NODES_PER_ITEM = 1024  # buckets per work item of the parallel loop
_CELLS_PER_THREAD = 4096  # fewer are done before a thread is awake
_INSERTION_SORT = 48  # longest bucket sorted by insertion: a node of a good mesh has about 25 facets
_LONGEST_RUN = 64  # quads with three nodes in common: in a valid mesh at most two

_KEPT: WeakKeyDictionary[CellTable, dict[str, Ints]] = WeakKeyDictionary()

# what becomes of a facet
_BOUNDARY, _INSIDE, _CROWDED = 1, 2, 3


@dataclass(frozen=True)
class _FacetTable:
    """All facets of a mesh, block after block, cell after cell.

    nodes : (F, k) int32 array, ascending in each row, filled up with -1 at the end
    side : (F,) bool array, from which side the cell sees the facet: two cells that share it differ
    first : number of the first facet of each block, and F
    """

    nodes: NDArray[np.int32]
    side: NDArray[np.bool_]
    first: tuple[int, ...]


def boundary_facets(cells: CellTable) -> dict[str, Ints]:
    """Facets that belong to exactly one cell.

    Parameters
    ----------
    cells : CellTable
        Node indices must not be negative and no cell may name a node twice.

    Returns
    -------
    dict of (f, k) int64 arrays
        By facet type: ``vertex`` (1D), ``line`` (2D), ``triangle`` and ``quad`` (3D); types without a facet are left
        out. Node order as in :data:`LOCAL_FACETS`, hence pointing outwards; rows in the order of the cells.

    Raises
    ------
    InvalidInput
        If a facet belongs to more than two cells, or to two on the same side of it, which then overlap; the message
        names the facet and the cells.

    Notes
    -----
    Found once for a cell table and kept as long as that lives: every part of a session asks for them. Not to be written
    to.
    """
    found = _KEPT.get(cells)
    if found is None:
        found = _KEPT[cells] = _found(cells)
    return dict(found)


def _found(cells: CellTable) -> dict[str, Ints]:
    """The boundary's facets, by type."""
    table = _facet_table(cells)
    n = int(table.nodes.max()) + 1
    # as short as the numbers allow: this is what a session's memory peaks with
    order = np.empty(len(table.nodes), dtype=np.int32 if len(table.nodes) < 2**31 else np.int64)
    starts = _buckets(table.nodes, n, order)
    multiplicity = np.empty(len(table.nodes), dtype=np.int8)
    with threads_for(n // _NODES_PER_ITEM):
        _count_equal(table.nodes, table.side, starts, order, n, multiplicity)
    crowded = np.flatnonzero(multiplicity > _INSIDE)
    if len(crowded):
        raise _crowded_facet(cells, table, int(crowded[0]))
    return _collect(cells, table, np.flatnonzero(multiplicity == _BOUNDARY))


def boundary_nodes(cells: CellTable) -> Ints:
    """(b,) node indices of the boundary, ascending, each once; raises as :func:`boundary_facets`."""
    none = np.empty(0, dtype=np.int64)
    return np.unique(np.concatenate([none, *(nodes.ravel() for nodes in boundary_facets(cells).values())]))


def _facet_table(cells: CellTable) -> _FacetTable:
    """Sorted nodes of every facet of every cell."""
    local = [LOCAL_FACETS[block.type.name] for block in cells]
    width = max(len(facet) for facets in local for facet in facets)
    first = np.cumsum([0, *(len(block) * len(facets) for block, facets in zip(cells, local, strict=True))])
    nodes, side = np.empty((int(first[-1]), width), dtype=np.int32), np.empty(int(first[-1]), dtype=np.bool_)
    for block, facets, start, stop in zip(cells, local, first, first[1:], strict=False):
        padded = np.array([facet + (-1,) * (width - len(facet)) for facet in facets], dtype=np.int64)
        with threads_for(len(block) // _CELLS_PER_THREAD):
            _sorted_facets(read_only(block.nodes), padded, nodes[start:stop], side[start:stop])
    return _FacetTable(nodes, side, tuple(int(f) for f in first))


@njit(cache=True, parallel=True)
def _sorted_facets(cells, local, out, side):  # type: ignore[no-untyped-def]
    """Nodes of each facet of the cells (m, n_nodes), ascending, -1 for a place that the facet has not."""
    facets, width = local.shape
    for e in prange(cells.shape[0]):
        for f in range(facets):
            row = out[e * facets + f]
            for i in range(width):
                node = cells[e, local[f, i]] if local[f, i] >= 0 else -1
                place = i
                while place > 0 and 0 <= node < row[place - 1]:
                    row[place] = row[place - 1]
                    place -= 1
                row[place] = node
            side[e * facets + f] = _side(cells[e], local[f], row[0])


@njit(cache=True)
def _side(cell, local, smallest):  # type: ignore[no-untyped-def]
    """Whether, going round the facet from its smallest node, the smaller neighbour comes first."""
    size = 0
    while size < local.size and local[size] >= 0:
        size += 1
    if size == 1:
        return local[0] == 0
    place = 0
    while cell[local[place]] != smallest:
        place += 1
    if size == 2:
        return place == 0
    return cell[local[(place + 1) % size]] < cell[local[(place - 1) % size]]


@njit(cache=True)
def _buckets(nodes, n, order):  # type: ignore[no-untyped-def]
    """Counting sort of the facets by their smallest node: (n + 1,) starts; the facets' numbers go to ``order`` (F,)."""
    starts = np.zeros(n + 1, dtype=np.int64)
    for f in range(nodes.shape[0]):
        starts[nodes[f, 0] + 1] += 1
    for i in range(n):
        starts[i + 1] += starts[i]
    place = starts[:-1].copy()
    for f in range(nodes.shape[0]):
        node = nodes[f, 0]
        order[place[node]] = f
        place[node] += 1
    return starts


@njit(cache=True)
def _sorting(keys):  # type: ignore[no-untyped-def]
    """Permutation that sorts the keys of a bucket."""
    if keys.size > _INSERTION_SORT:
        return np.argsort(keys)
    order = np.arange(keys.size)
    for i in range(1, keys.size):
        j = i
        while j > 0 and keys[order[j - 1]] > keys[i]:
            order[j] = order[j - 1]
            j -= 1
        order[j] = i
    return order


@njit(cache=True)
def _count_bucket(nodes, side, facets, n, multiplicity):  # type: ignore[no-untyped-def]
    """Whether each facet of one bucket occurs once, twice from different sides, or otherwise."""
    width = nodes.shape[1]
    keys = np.zeros(facets.size, dtype=np.int64)
    for i in range(facets.size):
        for column in range(1, min(width, 3)):
            keys[i] = keys[i] * n + nodes[facets[i], column]
    order = _sorting(keys)
    first = 0
    while first < facets.size:
        last = first + 1
        while last < facets.size and keys[order[last]] == keys[order[first]]:
            last += 1
        for i in range(first, last):
            multiplicity[facets[order[i]]] = _fate(nodes, side, facets, order[first:last], order[i])
        first = last


@njit(cache=True)
def _fate(nodes, side, facets, run, own):  # type: ignore[no-untyped-def]
    """_BOUNDARY, _INSIDE or _CROWDED, for one facet of a run of facets with the same first three nodes."""
    if run.size > _LONGEST_RUN:
        return _CROWDED
    equal, same_side = 0, 0
    for other in run:
        if nodes.shape[1] < 4 or nodes[facets[other], 3] == nodes[facets[own], 3]:
            equal += 1
            same_side += side[facets[other]] == side[facets[own]]
    return _CROWDED if same_side > 1 else min(equal, _CROWDED)


@njit(cache=True, parallel=True)
def _count_equal(nodes, side, starts, order, n, multiplicity):  # type: ignore[no-untyped-def]
    """How often each facet occurs, bucket by bucket."""
    for item in prange((n + _NODES_PER_ITEM - 1) // _NODES_PER_ITEM):
        for node in range(item * _NODES_PER_ITEM, min(n, (item + 1) * _NODES_PER_ITEM)):
            _count_bucket(nodes, side, order[starts[node] : starts[node + 1]], n, multiplicity)


def _collect(cells: CellTable, table: _FacetTable, facets: Ints) -> dict[str, Ints]:
    """Node arrays of the given facets, by facet type, oriented outwards."""
    found: dict[str, list[Ints]] = {}
    for block, first, last in zip(cells, table.first, table.first[1:], strict=False):
        here = facets[(facets >= first) & (facets < last)] - first
        local = LOCAL_FACETS[block.type.name]
        rows, places = here // len(local), here % len(local)
        for size in sorted({len(facet) for facet in local}):
            columns = np.array([facet if len(facet) == size else (0,) * size for facet in local])
            chosen = np.array([len(facet) == size for facet in local])[places]
            nodes = block.nodes[rows[chosen, None], columns[places[chosen]]]
            found.setdefault(_FACET_NAMES[size], []).append(nodes)
    joined = {name: np.concatenate(found[name]) for name in _FACET_NAMES.values() if name in found}
    return {name: nodes for name, nodes in joined.items() if len(nodes)}


def _crowded_facet(cells: CellTable, table: _FacetTable, facet: int) -> InvalidInput:
    """The error for a facet of too many cells."""
    nodes = [int(node) for node in table.nodes[facet] if node >= 0]
    same = np.flatnonzero((table.nodes == table.nodes[facet]).all(axis=1))
    numbers = [_owner(cells, table, int(f)) for f in same]
    listed = ", ".join(map(str, numbers[:4])) + (", …" if len(same) > 4 else "")
    return InvalidInput(
        f"the facet with the nodes {nodes} belongs to {len(same)} cells ({listed}); expected one cell on the boundary, "
        "two inside, on different sides",
        code="INVALID_ARGUMENT.MESH_DEGENERATE",
        hint="remove duplicate or overlapping cells",
        details={"facet": nodes, "cells": numbers[:16]},
    )


def _owner(cells: CellTable, table: _FacetTable, facet: int) -> int:
    """Number of the cell that a facet of the table belongs to."""
    block = int(np.searchsorted(table.first, facet, side="right")) - 1
    per_cell = len(LOCAL_FACETS[cells.blocks[block].type.name])
    return cells.offsets[block] + (facet - table.first[block]) // per_cell
