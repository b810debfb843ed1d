"""The boundary of a mesh: facets that belong to exactly one cell.

A facet is a node in 1D, an edge in 2D, a triangle or quad in 3D. Facets are recognised by their node numbers
(:mod:`.facet_matching`) in three passes over the cells, without a table of their nodes, and the result does not depend
on threads.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Self
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.cells import CellTable
from mesh_motion_server.numerics.facet_buckets import count_cells, place_cells
from mesh_motion_server.numerics.facet_matching import NODES_PER_ITEM, unmatched_facets
from mesh_motion_server.numerics.local_facets import LOCAL_FACETS
from mesh_motion_server.numerics.read_only import read_only
from mesh_motion_server.numerics.thread_share import threads_for

__all__ = ["LOCAL_FACETS", "boundary_facets", "boundary_nodes"]

Ints = NDArray[np.int64]

_FACET_NAMES = {1: "vertex", 2: "line", 3: "triangle", 4: "quad"}

_KEPT: WeakKeyDictionary[CellTable, dict[str, Ints]] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class _Facets:
    """All facets of a mesh as the kernels ask for them.

    nodes : (k,) array, of all cells, one after the other
    blocks : (b + 1, 4) array, where each block's nodes begin, its first cell, nodes per cell, whether it is a simplex;
        the ends
    local : (b, f, 4) array, local nodes of the facets; of a simplex last the facet without each local node
    sizes : (b, f) array, how many nodes they have; 0 for no facet
    """

    nodes: Ints
    blocks: Ints
    local: Ints
    sizes: Ints

    @classmethod
    def of(cls, cells: CellTable) -> Self:
        """Describe them."""
        tables = [LOCAL_FACETS[block.type.name] for block in cells]
        local = np.zeros((len(tables), 1 + max(map(len, tables)), 4), dtype=np.int64)
        sizes = np.zeros(local.shape[:2], dtype=np.int64)
        blocks = np.zeros((len(tables) + 1, 4), dtype=np.int64)
        for b, (block, table) in enumerate(zip(cells, tables, strict=True)):
            for f, facet in enumerate(table):
                local[b, f, : len(facet)], sizes[b, f] = facet, len(facet)
                if block.type.is_simplex:
                    (omitted,) = set(range(block.type.n_nodes)) - set(facet)
                    local[b, -1, omitted] = f
            blocks[b, 2:] = block.type.n_nodes, block.type.is_simplex
            blocks[b + 1, :2] = blocks[b, :2] + (block.nodes.size, len(block))
        return cls(read_only(_joined([block.nodes.reshape(-1) for block in cells])), blocks, local, sizes)

    def by_smallest_node(self) -> tuple[Ints, NDArray[Any]]:
        """Starts (n + 1,) of the cells that have a facet with each smallest node, and these cells (e,)."""
        counts = np.zeros(int(self.nodes.max()) + 2, dtype=np.int64)
        for part in self._parts():
            count_cells(*part, counts[1:])
        starts = np.cumsum(counts, out=counts)
        # as short as the numbers allow: this is what a session's memory peaks with
        order = np.empty(int(starts[-1]), dtype=np.int32 if self.blocks[-1, 1] < 2**31 else np.int64)
        place = starts[:-1].copy()
        for part, first in zip(self._parts(), self.blocks[:, 1], strict=False):
            place_cells(*part, first, place, order)
        return starts, order

    def _parts(self) -> Iterator[tuple[Ints, tuple[int, int], Ints, Ints]]:
        """Nodes, kind of cell, local nodes of the facets and how many they are, block after block."""
        for (begin, _, *kind), end, local, sizes in zip(
            self.blocks.tolist(), self.blocks[1:, 0], self.local, self.sizes, strict=False
        ):
            yield self.nodes[begin:end], (kind[0], kind[1]), local, sizes[sizes > 0]


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
    facets = _Facets.of(cells)
    starts, order = facets.by_smallest_node()
    unmatched = np.zeros(len(order), dtype=np.uint8)
    with threads_for(len(starts) // NODES_PER_ITEM):
        least = unmatched_facets(facets.nodes, facets.blocks, facets.local, facets.sizes, starts, order, unmatched)
    if least.min() < 8 * len(cells):
        raise _crowded_facet(cells, int(least.min()))
    entries = np.flatnonzero(unmatched)
    row, facet = np.nonzero(unmatched[entries, None] >> np.arange(8, dtype=np.uint8) & 1)
    return _collect(cells, np.sort(8 * order[entries].astype(np.int64)[row] + facet))


def boundary_nodes(cells: CellTable) -> Ints:
    """(b,) node indices of the boundary, ascending, each once; raises as :func:`boundary_facets`."""
    none = np.empty(0, dtype=np.int64)
    return np.unique(np.concatenate([none, *(nodes.ravel() for nodes in boundary_facets(cells).values())]))


def _joined(pieces: list[Ints]) -> Ints:
    """The pieces one behind the other; an only piece itself."""
    return pieces[0] if len(pieces) == 1 else np.concatenate(pieces)


def _collect(cells: CellTable, facets: Ints) -> dict[str, Ints]:
    """Node arrays of the facets with these numbers, ascending, by facet type, oriented outwards."""
    found: dict[str, list[Ints]] = {}
    for block, first, last in zip(cells, cells.offsets, cells.offsets[1:], strict=False):
        here = facets[(facets >= 8 * first) & (facets < 8 * last)] - 8 * first
        local = LOCAL_FACETS[block.type.name]
        rows, places = here // 8, here % 8
        for size in sorted({len(facet) for facet in local}):
            columns = np.array([facet if len(facet) == size else (0,) * size for facet in local])
            chosen = np.array([len(facet) == size for facet in local])[places]
            nodes = block.nodes[rows[chosen, None], columns[places[chosen]]]
            found.setdefault(_FACET_NAMES[size], []).append(nodes)
    joined = {name: np.concatenate(found[name]) for name in _FACET_NAMES.values() if name in found}
    return {name: nodes for name, nodes in joined.items() if len(nodes)}


def _crowded_facet(cells: CellTable, facet: int) -> InvalidInput:
    """The error for a facet of too many cells."""
    block, row = cells.locate(facet // 8)
    nodes = sorted(block.nodes[row, list(LOCAL_FACETS[block.type.name][facet % 8])].tolist())
    numbers = _cells_with(cells, nodes)
    listed = ", ".join(map(str, numbers[:4])) + (", …" if len(numbers) > 4 else "")
    return InvalidInput(
        f"the facet with the nodes {nodes} belongs to {len(numbers)} cells ({listed}); expected one cell on the "
        "boundary, two inside, on different sides",
        code="INVALID_ARGUMENT.MESH_DEGENERATE",
        hint="remove duplicate or overlapping cells",
        details={"facet": nodes, "cells": numbers[:16]},
    )


def _cells_with(cells: CellTable, nodes: list[int]) -> list[int]:
    """Numbers of the cells that have a facet with these nodes, once for each."""
    found: list[int] = []
    for block, first in zip(cells, cells.offsets, strict=False):
        rows = np.flatnonzero((block.nodes == nodes[0]).any(axis=1))
        for facet in LOCAL_FACETS[block.type.name]:
            if len(facet) == len(nodes):
                same = (np.sort(block.nodes[rows][:, facet], axis=1) == nodes).all(axis=1)
                found += (first + rows[same]).tolist()
    return sorted(found)
