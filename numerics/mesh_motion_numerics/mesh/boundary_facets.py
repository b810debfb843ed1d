"""The boundary of a mesh: facets that belong to exactly one cell."""

from weakref import WeakKeyDictionary

import numpy as np
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_numerics.arrays import Integers
from mesh_motion_numerics.mesh.cell_facets import facet_nodes, matched_facets
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.local_facets import FACET_NAMES, LOCAL_FACETS

_KEPT: WeakKeyDictionary[CellTable, dict[str, Integers]] = WeakKeyDictionary()


def boundary_facets(cells: CellTable) -> dict[str, Integers]:
    """Facets that belong to exactly one cell.

    Raises InvalidInput if a facet belongs to more than two cells, or to two overlapping cells on the same side of it;
    the message names the facet and the cells.

    Parameters
    ----------
    cells : CellTable
        Node indices must not be negative and no cell may contain a node twice.

    Returns
    -------
    dict of (f, k) int64 arrays
        The facets by type: ``vertex`` (1D), ``line`` (2D), ``triangle`` and ``quad`` (3D); types without a facet are
        left out. Node order as in :data:`LOCAL_FACETS`, hence with outward normals; rows in the order of the cells.

    Notes
    -----
    The facets are computed once for a cell table and kept as long as it exists, because every part of a session needs
    them. Do not modify them.
    """
    if cells not in _KEPT:
        _KEPT[cells] = _found(cells)
    return dict(_KEPT[cells])


def _found(cells: CellTable) -> dict[str, Integers]:
    """The facets of the boundary, by type."""
    single, _, crowded = matched_facets(cells)
    if crowded >= 0:
        raise _crowded_facet(cells, crowded)
    nodes = facet_nodes(cells, single).astype(np.int64)
    sizes = np.count_nonzero(nodes >= 0, axis=1)
    by_type = {name: np.ascontiguousarray(nodes[sizes == size, :size]) for size, name in FACET_NAMES.items()}
    return {name: found for name, found in by_type.items() if len(found)}


def boundary_nodes(cells: CellTable) -> Integers:
    """(b,) node indices of the boundary, ascending, each once; raises as :func:`boundary_facets`."""
    none = np.empty(0, dtype=np.int64)
    return np.unique(np.concatenate([none, *(nodes.ravel() for nodes in boundary_facets(cells).values())]))


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
    for block, span in cells.numbered:
        rows = np.flatnonzero((block.nodes == nodes[0]).any(axis=1))
        for facet in LOCAL_FACETS[block.type.name]:
            if len(facet) == len(nodes):
                same = (np.sort(block.nodes[rows][:, facet], axis=1) == nodes).all(axis=1)
                found += (span.start + rows[same]).tolist()
    return sorted(found)
