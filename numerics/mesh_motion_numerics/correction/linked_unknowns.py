"""A Newton system in fewer unknowns: each free node's step is a matrix times the step of one representative.

``u_i = M_i v_t(i)`` covers a node that slides (M_i projects onto its tangents, t(i) = i) and nodes that move together
(t(i) is the first of them, M_i the rotation between the two). Then ``H_v = Σ M_iᵀ H_ij M_j`` and ``g_v = Σ M_iᵀ g_i``.
A direction that a representative must not take gets its own stiffness and no force.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mesh_motion_kernels as kernels
import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.correction.free_region import NodeAdjacency
from mesh_motion_numerics.mesh.points import rows_among

StepSolver = Callable[[NodeAdjacency, Floats, Floats], Floats]
"""(adjacency, Hessian blocks (b, d, d), −g (f, d)) → step (f, d)."""
System = Callable[[NodeAdjacency, Floats], Callable[[Floats], Floats]]
"""(adjacency, Hessian blocks (b, d, d)) → −g (f, d) → step (f, d)."""


@dataclass(frozen=True, eq=False)
class LinkedUnknowns:
    """The links of a region's free nodes."""

    targets: Integers  # (f,). Number of each free node's representative among the r representatives
    roots: Integers  # (r,). The representatives among the free nodes, ascending
    adjacency: NodeAdjacency  # The representatives' Hessian pattern; it has no corners of its own
    #: rows, columns, slots: (b,). Free nodes of each block of their Hessian, and its position among the
    #: representatives' blocks.
    rows: Integers
    columns: Integers
    slots: Integers

    @classmethod
    def build(cls, adjacency: NodeAdjacency, representatives: Integers) -> LinkedUnknowns:
        """Link the free nodes: each follows the free node in ``representatives`` (f,), possibly itself."""
        roots = np.flatnonzero(representatives == np.arange(len(representatives)))
        targets = rows_among(len(representatives), roots)[representatives]
        order = np.argsort(targets, kind="stable")
        starts, columns, slots = kernels.linked_pattern(
            adjacency.row_starts, adjacency.columns, targets, order, len(roots)
        )
        none = adjacency.slots[:0]
        reduced = NodeAdjacency(np.zeros(len(roots) + 1, dtype=np.int64), none[:, 0], none, starts, columns)
        rows = np.repeat(np.arange(len(targets)), np.diff(adjacency.row_starts))
        return cls(targets, roots, reduced, rows, adjacency.columns.astype(np.int64), slots)

    def reduce(self, matrices: Floats, blocks: Floats) -> Floats:
        """Blocks (b', d, d) of the representatives' Hessian.

        Parameters
        ----------
        matrices : (f, d, d) array
            M; an orthogonal projector for a representative.
        blocks : (b, d, d) array
            H, in the pattern that the links were built from.
        """
        hessian = np.zeros((len(self.adjacency.columns), *blocks.shape[1:]))
        kernels.add_linked_blocks(self.rows, self.columns, self.slots, matrices, blocks, hessian)
        fixed = np.eye(blocks.shape[1]) - matrices[self.roots]  # directions in which no step goes
        tied = np.flatnonzero(fixed.any(axis=(1, 2)))
        diagonal = self.adjacency.row_starts[tied]
        stiffness = np.trace(hessian[diagonal], axis1=1, axis2=2)
        stiffness[stiffness <= 0.0] = 1.0
        hessian[diagonal] += stiffness[:, None, None] * fixed[tied]
        return hessian

    def gather(self, matrices: Floats, right: Floats) -> Floats:
        """(r, d) the representatives' right side from that (f, d) of the free nodes."""
        sums = np.zeros((len(self.roots), right.shape[1]))
        np.add.at(sums, self.targets, np.einsum("fji,fj->fi", matrices, right))
        return sums

    def expand(self, matrices: Floats, step: Floats) -> Floats:
        """Steps (f, d) of the free nodes from those (r, d) of their representatives."""
        return np.asarray(np.einsum("fij,fj->fi", matrices, step[self.targets]))
