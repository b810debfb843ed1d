"""The free nodes of a smooth motion: the data of their penalty, and the solution of their Newton systems.

The minimised function is in :mod:`.smooth_motion`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import mesh_motion_kernels as kernels
import numpy as np

from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.correction.boundary_constraint import RegionConstraint
from mesh_motion_numerics.correction.free_region import FreeRegion, NodeAdjacency
from mesh_motion_numerics.interpolation.sparse_rows import Elimination, SparseCholesky

PENALTY = 4.0  # a
LENGTH = 10.0  # l, in cells
#: A larger factorization is slower than conjugate gradients: in 3D as fast with 500 unknowns, 3 times as slow with 1900
#: (tetrahedra), 6 times with 5700 (hexahedra), 13 times with 5500 (tetrahedra).
_DIRECT_UNKNOWNS = {1: 100_000, 2: 100_000, 3: 500}
ROUGH = 0.03  # residual of a Newton system far from the minimum, as a share of the right-hand side
_EXACT = 1e-13
_CG_ITERATIONS = 5000


@dataclass(eq=False)
class SmoothRegion:
    """Free nodes, and the penalty's matrix K, one number for each block of the Hessian's pattern.

    Attributes
    ----------
    constraint : RegionConstraint or None
        The constraint of free nodes that slide or move together.
    elimination : Elimination or None
        Of the Newton systems' factor; None if conjugate gradients are faster.
    weights : (c,) array
        w_c of its corners.
    gradient : (b,) array, 1 / length²
    mass : (f,) array, 1 / length²
        The mass of the free nodes for σ = 1.
    """

    free: FreeRegion
    constraint: RegionConstraint | None
    elimination: Elimination | None
    weights: Floats
    gradient: Floats
    mass: Floats
    penalty: Floats = field(default_factory=partial(np.empty, 0))

    @classmethod
    def build(cls, free: FreeRegion, constraint: RegionConstraint | None, reference: Floats) -> SmoothRegion:
        """Build it for a region of the mesh, with the nodes at ``reference`` (n, d) at rest."""
        weights, adjacency, d = free.cells.corner_shares, free.adjacency, free.simplices.dimension
        gradient, mass = np.zeros(len(adjacency.columns)), np.zeros(free.n_free)
        pattern = adjacency.starts, adjacency.entries, adjacency.slots
        kernels.add_penalty(*pattern, free.simplices.ideal, weights, gradient, mass)
        mass /= LENGTH**2 * (d + 1)  # (d + 1): a corner's mass is shared by its nodes
        unknowns, places = adjacency, reference[free.free]
        if constraint is not None:
            unknowns, places = constraint.links.adjacency, places[constraint.links.roots]
        direct = places.size <= _DIRECT_UNKNOWNS[d]
        elimination = Elimination.of(unknowns.row_starts, unknowns.columns, places) if direct else None
        return cls(free, constraint, elimination, weights, gradient, mass)

    def of_motion(self, plain: Floats, sigma: Floats) -> SmoothRegion:
        """Return the same region for the plain motion (n, d): with the penalty for σ (n,) of all nodes."""
        penalty = self.gradient.copy()
        penalty[self.free.adjacency.row_starts[:-1]] += self.mass / sigma[self.free.free]
        constraint = None if self.constraint is None else self.constraint.through(plain)
        return replace(self, constraint=constraint, penalty=PENALTY * penalty)

    def solver(self, points: Floats, hessian: Floats, accuracy: float = _EXACT) -> Callable[[Floats], Floats]:
        """Return a solver of H (b, d, d) dx = right (f, d) for steps that nodes at local positions (l, d) can take.

        H is factorized once; the returned function can be called for many right sides. Conjugate gradients stop when
        the residual is below ``accuracy`` times the right side.

        Raises
        ------
        ArithmeticError
            If H must be factorized and is not positive definite.
        """
        if self.constraint is None:
            return self._system(self.free.adjacency, hessian, accuracy)
        return self.constraint.solver(points, hessian, partial(self._system, accuracy=accuracy))

    @property
    def is_factorized(self) -> bool:
        """Whether the steps come from a factorization, so that they are exact."""
        return self.elimination is not None

    def _system(self, adjacency: NodeAdjacency, hessian: Floats, accuracy: float) -> Callable[[Floats], Floats]:
        if self.elimination is None:
            return partial(adjacency.iterated, hessian, accuracy=accuracy, most=_CG_ITERATIONS)
        factor = SparseCholesky.build(adjacency.row_starts, adjacency.columns, hessian, self.elimination)
        if factor is None:
            raise ArithmeticError("the matrix is not positive definite")
        return factor.solve

    def admitted(self, points: Floats) -> Floats:
        """The local positions (l, d) put back onto walls, with equal images, so that rounding errors do not add up."""
        return points if self.constraint is None else self.constraint.placed(points)

    @cached_property
    def blocks(self) -> Floats:
        """K (b, d, d)."""
        d = self.free.simplices.dimension
        return np.ascontiguousarray(self.penalty[:, None, None] * np.eye(d))

    def pull(self, offset: Floats) -> tuple[float, Floats]:
        """½ vᵀ K v and K v (f, d) of the free nodes' v (f, d)."""
        product = np.empty_like(offset)
        pattern = self.free.adjacency.row_starts, self.free.adjacency.columns
        return 0.5 * kernels.block_product(*pattern, self.blocks, np.ascontiguousarray(offset), product), product
