"""The drawn part of a mesh: in 2D the cells, in 3D the boundary and all sides of chosen cells.

All arrays have numbers of nodes and cells, so they stay valid when coordinates and colours change.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.numerics.arrays import Floats, Integers, Marks
from mesh_motion_server.numerics.mesh.boundary_facets import LOCAL_FACETS, boundary_facets
from mesh_motion_server.numerics.mesh.cells import CellTable

__all__ = ["Surface", "cells_surface", "joined_surface", "sides_surface"]


_NO_CELL = -1
#: Odd 64-bit constants of a multiplicative hash.
_MIX = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0xD6E8FEB86659FD93], dtype=np.uint64)


@dataclass(frozen=True, eq=False)
class Surface:
    """Polygons as triangles, and the lines around them.

    Attributes
    ----------
    triangles : (t, 3) int64 array
        Node numbers.
    owners : (t,) int64 array
        The cell of each triangle; -1: unknown.
    edges : (e, 2) int64 array
        Each once, lower node first.
    outline : (b, 2) int64 array
        In 2D the boundary's edges; empty in 3D.
    inner : (t,) bool array
        Whether the triangle is a side of a chosen cell, not of the boundary.
    """

    triangles: Integers
    owners: Integers
    edges: Integers
    outline: Integers
    inner: Marks


def cells_surface(cells: CellTable, chosen: Integers | None = None) -> Surface:
    """The cells of a mesh of dimension 1 or 2, or those with the ``chosen`` ascending numbers (s,) only."""
    polygons = [(nodes, numbers) for nodes, numbers in _chosen_blocks(cells, chosen) if nodes.shape[1] > 2]
    lines = [nodes for nodes, _ in _chosen_blocks(cells, chosen) if nodes.shape[1] == 2]
    outline = np.concatenate([_empty(2), *(nodes for nodes in boundary_facets(cells).values() if nodes.shape[1] == 2)])
    triangles, owners = _triangulated(polygons)
    edges = _unique_edges([*lines, *(_loop(nodes) for nodes, _ in polygons)])
    return Surface(triangles, owners, edges, outline, np.zeros(len(triangles), dtype=np.bool_))


def sides_surface(cells: CellTable, chosen: Integers, most: int, near: Floats | None = None) -> Surface:
    """The boundary of a 3D mesh and all sides of the ``chosen`` cells (s,), ascending.

    Parameters
    ----------
    chosen : (s,) int64 array
    most : int
        Maximum number of boundary facets.
    near : (n,) array, optional
        Rank of the nodes: if there are more facets, those with the smallest values stay.
    """
    boundary = [
        (kept, _owners(cells, kept))
        for nodes in boundary_facets(cells).values()
        if len(kept := _nearest(nodes, most, near))
    ]
    sides = [
        (nodes[:, list(facet)], numbers)
        for name in {block.type.name for block in cells}
        for nodes, numbers in _chosen_blocks(cells, chosen, name)
        for facet in LOCAL_FACETS[name]
    ]
    surfaces = [_polygons_surface(boundary, inner=False), _polygons_surface(sides, inner=True)]
    return joined_surface(surfaces)


def joined_surface(surfaces: list[Surface]) -> Surface:
    """Several surfaces as one."""
    return Surface(
        np.concatenate([each.triangles for each in surfaces]),
        np.concatenate([each.owners for each in surfaces]),
        _unique_edges([each.edges for each in surfaces]),
        np.concatenate([each.outline for each in surfaces]),
        np.concatenate([each.inner for each in surfaces]),
    )


def _polygons_surface(polygons: list[tuple[Integers, Integers]], *, inner: bool) -> Surface:
    triangles, owners = _triangulated(polygons)
    edges = _unique_edges([_loop(nodes) for nodes, _ in polygons])
    return Surface(triangles, owners, edges, _empty(2), np.full(len(triangles), inner))


def _chosen_blocks(cells: CellTable, chosen: Integers | None, name: str = "") -> list[tuple[Integers, Integers]]:
    """Nodes (s, k) and numbers (s,) of the chosen cells of each block, or of the block of one type."""
    found = []
    for block, first in zip(cells, cells.offsets, strict=False):
        if name in ("", block.type.name):
            rows = np.arange(len(block)) if chosen is None else _within(chosen, first, first + len(block)) - first
            found.append((block.nodes[rows], rows + first))
    return found


def _within(numbers: Integers, first: int, last: int) -> Integers:
    return numbers[(numbers >= first) & (numbers < last)]


def _triangulated(polygons: list[tuple[Integers, Integers]]) -> tuple[Integers, Integers]:
    """Triangles (t, 3) and owners (t,) of polygons given as nodes (s, k) and owners (s,): fans from the first node."""
    triangles, owners = [_empty(3)], [np.empty(0, dtype=np.int64)]
    for nodes, numbers in polygons:
        for k in range(1, nodes.shape[1] - 1):
            triangles.append(nodes[:, [0, k, k + 1]])
            owners.append(numbers)
    return np.concatenate(triangles), np.concatenate(owners)


def _loop(nodes: Integers) -> Integers:
    """Edges (s k, 2) around polygons (s, k)."""
    return np.stack([nodes, np.roll(nodes, -1, axis=1)], axis=-1).reshape(-1, 2)


def _unique_edges(edges: list[Integers]) -> Integers:
    """(e, 2) edges, each once, lower node first."""
    both = np.sort(np.concatenate([_empty(2), *edges]), axis=1)
    if not len(both):
        return both
    base = int(both.max()) + 1
    keys = np.unique(both[:, 0] * base + both[:, 1])
    return np.stack([keys // base, keys % base], axis=1)


def _empty(columns: int) -> Integers:
    return np.empty((0, columns), dtype=np.int64)


def _nearest(nodes: Integers, most: int, near: Floats | None) -> Integers:
    """At most so many facets (f, k): those whose first node ranks lowest."""
    if len(nodes) <= most or near is None:
        return nodes[:most]
    return nodes[np.sort(np.argpartition(near[nodes[:, 0]], most)[:most])]


def _owners(cells: CellTable, facets: Integers) -> Integers:
    """The cell (f,) that each boundary facet (f, k) was taken from: the one that has these nodes in this order."""
    keys = _hashed(facets)
    order = np.argsort(keys)
    owners = np.full(len(facets), _NO_CELL, dtype=np.int64)
    on_boundary = np.zeros(1 + max(int(block.nodes.max()) for block in cells), dtype=np.bool_)
    on_boundary[facets] = True
    for block, first in zip(cells, cells.offsets, strict=False):
        rows = np.flatnonzero(on_boundary[block.nodes].sum(axis=1) >= facets.shape[1])
        for local in LOCAL_FACETS[block.type.name]:
            if len(local) == facets.shape[1]:
                sides = block.nodes[rows][:, list(local)]
                places = order[np.minimum(np.searchsorted(keys, _hashed(sides), sorter=order), len(facets) - 1)]
                same = (facets[places] == sides).all(axis=1)
                owners[places[same]] = first + rows[same]
    return owners


def _hashed(facets: Integers) -> NDArray[np.uint64]:
    """(f,) keys of facets (f, k), which depend on the node order; facets with equal keys are then compared."""
    keys = np.zeros(len(facets), dtype=np.uint64)
    for column, factor in zip(facets.T, _MIX, strict=False):
        keys = (keys ^ column.astype(np.uint64)) * factor
        keys ^= keys >> np.uint64(29)
    return keys
