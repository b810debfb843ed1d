"""The input and result of every point reduction (thesis §2.2.1–2.2.3).

A reduction interpolates the displacement of all boundary nodes from few of them. All algorithms have one calling
convention, ``reduce(problem) -> Reduced``, so that they can be exchanged by name and compared.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.assembly import dense_block
from mesh_motion_numerics.interpolation.centres import CentreLayout
from mesh_motion_numerics.interpolation.control_points import checked_control_points
from mesh_motion_numerics.interpolation.interpolant import Interpolant
from mesh_motion_numerics.interpolation.kernels import DEFAULT_BASIS, Basis, basis_named
from mesh_motion_numerics.interpolation.two_scale.interpolant import AnyInterpolant
from mesh_motion_numerics.mesh.points import padded

#: A level is an interpolant: weights on a subset of the boundary nodes, with its own support radius.
Level = Interpolant


@dataclass(frozen=True, eq=False)
class ReductionProblem:
    """Displacements of boundary nodes, to be reproduced from few of them.

    Raises InvalidInput if two points coincide.
    """

    points: Floats  # (nb, d), mesh length unit. Boundary nodes with a prescribed displacement, distinct
    displacement: Floats  # (nb, k), mesh length unit. C-contiguous
    basis: str = DEFAULT_BASIS  # a positive definite basis of :data:`~mesh_motion_numerics.interpolation.kernels.BASES`
    support_radius: float = 1.0  # mesh length unit. R of the (first) level
    #: Allowed largest error of a node, as a share of the largest displacement; 0 asks for all nodes.
    tolerance: float = 1e-3
    max_points: int = 0  # largest number of selected nodes; 0: no limit

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", checked_control_points(self.points))

    @property
    def n_points(self) -> int:
        """nb."""
        return len(self.points)

    @property
    def limit(self) -> int:
        """Largest number of nodes that may be selected."""
        return min(self.max_points or self.n_points, self.n_points)

    @cached_property
    def row(self) -> Basis:
        """The basis function."""
        return basis_named(self.basis)

    @cached_property
    def largest(self) -> float:
        """Length of the largest displacement, mesh length unit."""
        return float(np.sqrt(np.max(_squared_lengths(self.displacement))))

    @property
    def allowed_error(self) -> float:
        """Largest error of a node that satisfies the tolerance, mesh length unit."""
        return self.tolerance * self.largest

    @property
    def start(self) -> int:
        """The first node of every algorithm: the first one with the largest displacement (never a random one)."""
        return int(np.argmax(_squared_lengths(self.displacement)))

    def columns(self, selected: Integers, *, rows: Integers | None = None) -> Floats:
        """(nb or len(rows), nc) values of φ between boundary nodes and the selected ones."""
        at = self._padded if rows is None else self._padded[rows]
        return dense_block(self.row, self.support_radius, at, self._padded[selected])

    def level(self, selected: Integers, weights: Floats, *, support_radius: float | None = None) -> Level:
        """The interpolant with these (nc, k) weights at the selected nodes."""
        radius = support_radius or self.support_radius
        centres = self.points[selected]
        return Interpolant(centres, weights, self.row, radius, CentreLayout.build(centres, self.row, radius))

    def values(self, level: Level) -> Floats:
        """(nb, k) values of a level at all boundary nodes; thesis (2.11)."""
        return evaluation.displacement(level, self.points)

    @cached_property
    def _padded(self) -> Floats:
        """(nb, 3) the points, missing coordinates zero."""
        return padded(self.points)


@dataclass(frozen=True)
class Iterate:
    """The state of an algorithm each time it has computed errors at the boundary nodes."""

    points: int  # nodes selected
    #: mesh length unit. Largest error at the nodes that the algorithm tested (all nodes unless it says otherwise)
    max_error: float
    #: solve_operations, error_operations: Multiply-adds so far for weights (the N_c⁴ or N_c³ of thesis Table 2.3), and
    #: evaluations of φ or stored entries used so far for errors (the N_c² N_b). These are counts and not times, so that
    #: they are repeatable
    solve_operations: float
    error_operations: float


@dataclass(frozen=True, eq=False)
class Reduced:
    """A reduced interpolation."""

    levels: tuple[AnyInterpolant, ...]  # their sum is the field
    selected: Integers  # (nc,). Boundary nodes in the order of choice, each once
    #: (nb, k), mesh length unit. Remaining error at all boundary nodes: prescribed minus interpolated, thesis (2.12).
    error: Floats
    history: tuple[Iterate, ...]

    @property
    def max_error(self) -> float:
        """Largest error of a node, mesh length unit."""
        return float(np.sqrt(np.max(_squared_lengths(self.error))))


class Progress:
    """Counts operations and records an :class:`Iterate` each time the errors are known: common to all algorithms."""

    def __init__(self, problem: ReductionProblem) -> None:
        self._problem = problem
        self._solve, self._error = 0.0, 0.0
        self.history: list[Iterate] = []

    def count(self, *, solve: float = 0.0, error: float = 0.0) -> None:
        """Add multiply-adds spent on weights, and φ evaluated or read for errors."""
        self._solve += solve
        self._error += error

    def record(self, points: int, error: Floats) -> bool:
        """Record the (n, k) remaining errors with this number of points; return whether to stop.

        The end is reached if the tolerance is met, or if no further point may be selected. A tolerance of 0 is met only
        by a zero error, so that rounding does not decide about the end.
        """
        size = lengths(error)
        largest = float(size.max())
        self.history.append(Iterate(points, largest, self._solve, self._error))
        return largest <= self._problem.allowed_error or points >= self._problem.limit


def lengths(vectors: Floats) -> Floats:
    """(n,) Euclidean lengths of (n, k) vectors."""
    return np.asarray(np.sqrt(_squared_lengths(vectors)))


def _squared_lengths(vectors: Floats) -> Floats:
    """(n,) squared lengths of (n, k) vectors."""
    return np.asarray(np.einsum("ij,ij->i", vectors, vectors))
