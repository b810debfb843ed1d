"""A Newton system in fewer unknowns: each free node's step is a matrix times the step of one representative.

``u_i = M_i v_t(i)`` covers a node that slides (M_i projects onto its tangents, t(i) = i) and nodes that move alike
(t(i) the first of them, M_i the rotation between the two). Then ``H_v = Σ M_iᵀ H_ij M_j`` and ``g_v = Σ M_iᵀ g_i``. A
direction that a representative must not take gets a stiffness of its own, with nothing that pulls there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mesh_motion_server.numerics.free_region import NodeAdjacency

__all__ = ["LinkedUnknowns"]

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class LinkedUnknowns:
    """The links of a region's free nodes.

    Attributes
    ----------
    targets : (f,) int64 array
        Number of each free node's representative among the r representatives.
    roots : (r,) int64 array
        The representatives among the free nodes, ascending.
    adjacency : NodeAdjacency
        The representatives' Hessian pattern; it has no corners of its own.
    rows, columns, slots : (b,) int64 arrays
        Free nodes of each block of their Hessian, and where it goes among the representatives' blocks.
    """

    targets: Integers
    roots: Integers
    adjacency: NodeAdjacency
    rows: Integers
    columns: Integers
    slots: Integers

    @classmethod
    def build(cls, adjacency: NodeAdjacency, representatives: Integers) -> LinkedUnknowns:
        """Link the free nodes: ``representatives`` (f,), the free node that each one follows, itself if none."""
        roots = np.flatnonzero(representatives == np.arange(len(representatives)))
        number = np.full(len(representatives), -1, dtype=np.int64)
        number[roots] = np.arange(len(roots))
        targets = number[representatives]
        order = np.argsort(targets, kind="stable")
        starts, columns, slots = _pattern(adjacency.row_starts, adjacency.columns, targets, order, len(roots))
        none = np.empty((0, 1), dtype=np.int32)
        reduced = NodeAdjacency(np.zeros(len(roots) + 1, dtype=np.int64), none[:, 0], none, starts, columns)
        rows = np.repeat(np.arange(len(targets)), np.diff(adjacency.row_starts))
        return cls(targets, roots, reduced, rows, adjacency.columns.astype(np.int64), slots)

    def reduce(self, matrices: Floats, blocks: Floats, right: Floats) -> tuple[Floats, Floats]:
        """Blocks (b', d, d) and right side (r, d) of the representatives.

        Parameters
        ----------
        matrices : (f, d, d) array
            M; an orthogonal projector for a representative.
        blocks : (b, d, d) array
            H, in the pattern that the links were built from.
        right : (f, d) array
        """
        hessian = np.zeros((len(self.adjacency.columns), *blocks.shape[1:]))
        sums = np.zeros((len(self.roots), right.shape[1]))
        _add_blocks(self.rows, self.columns, self.slots, matrices, blocks, hessian)
        np.add.at(sums, self.targets, np.einsum("fji,fj->fi", matrices, right))
        diagonal = self.adjacency.row_starts[:-1]
        stiffness = np.trace(hessian[diagonal], axis1=1, axis2=2)
        stiffness[stiffness <= 0.0] = 1.0
        hessian[diagonal] += stiffness[:, None, None] * (np.eye(right.shape[1]) - matrices[self.roots])
        return hessian, sums

    def expand(self, matrices: Floats, step: Floats) -> Floats:
        """Steps (f, d) of the free nodes, of those (r, d) of their representatives."""
        return np.asarray(np.einsum("fij,fj->fi", matrices, step[self.targets]))


@njit(cache=True, error_model="numpy")
def _pattern(row_starts, columns, targets, order, n_roots):  # type: ignore[no-untyped-def]
    """Block rows of the representatives, diagonal first: row starts (r + 1), columns, and slots (b) of the blocks."""
    starts = np.zeros(n_roots + 1, np.int64)
    found = np.empty(len(columns) + n_roots, np.int32)
    slots = np.empty(len(columns), np.int64)
    where = np.full(n_roots, -1, np.int64)
    filled, at = 0, 0
    for root in range(n_roots):
        first = filled
        found[filled] = root
        where[root] = filled
        filled += 1
        while at < len(order) and targets[order[at]] == root:
            node = order[at]
            for e in range(row_starts[node], row_starts[node + 1]):
                column = targets[columns[e]]
                if where[column] < first:
                    where[column] = filled
                    found[filled] = column
                    filled += 1
                slots[e] = where[column]
            at += 1
        starts[root + 1] = filled
    return starts, found[:filled].copy(), slots


@njit(cache=True, error_model="numpy")
def _add_blocks(rows, columns, slots, matrices, blocks, out):  # type: ignore[no-untyped-def]
    """out (b', d, d) += Mᵀ H M of each block, in order."""
    d = matrices.shape[1]
    half = np.empty((d, d))
    for e in range(len(slots)):
        left, right = matrices[rows[e]], matrices[columns[e]]
        for i in range(d):
            for j in range(d):
                half[i, j] = 0.0
                for k in range(d):
                    half[i, j] += blocks[e, i, k] * right[k, j]
        for i in range(d):
            for j in range(d):
                t = 0.0
                for k in range(d):
                    t += left[k, i] * half[k, j]
                out[slots[e], i, j] += t
