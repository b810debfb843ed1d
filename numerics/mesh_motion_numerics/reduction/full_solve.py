"""Weights of a selected set by a fresh Cholesky factorization: φ_cc γ = d_c, thesis (2.4) without a polynomial."""

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.interpolation.factorizations.dense import PanelCholesky
from mesh_motion_numerics.reduction.problem import ReductionProblem

__all__ = ["full_operations", "full_weights"]


def full_weights(problem: ReductionProblem, selected: Integers) -> Floats:
    """(nc, k) weights that reproduce the displacement of the selected nodes.

    Raises QualityRefused if the matrix is singular to working precision.
    """
    factor = PanelCholesky(
        len(selected), lambda first, last: problem.columns(selected[first:last], rows=selected[first:])
    )
    return factor.solve(problem.displacement[selected])


def full_operations(problem: ReductionProblem, count: int) -> float:
    """Multiply-adds of a solution: a Cholesky factor of order ``count``, two substitutions for k right-hand sides."""
    components = int(problem.displacement.shape[1])
    return float(count) ** 3 / 6.0 + components * float(count) ** 2
