"""The loop of the greedy reductions with a new solution for each choice."""

from collections.abc import Callable

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.reduction.growing_set import full_operations, full_weights
from mesh_motion_numerics.reduction.problem import Progress, Reduced, ReductionProblem, lengths

__all__ = ["full_solution", "greedily"]


def greedily(
    problem: ReductionProblem,
    solve: Callable[[Integers], tuple[Floats, float]],
    choose: Callable[[Floats, int], Integers],
) -> Reduced:
    """Select nodes and interpolate from them until the tolerance is met.

    Parameters
    ----------
    solve : callable
        Selected nodes (nc,) → their weights (nc, k), and the number of multiply-adds.
    choose : callable
        Length (nb,) of the error at each node, −1 at selected ones, and how many nodes may be added → nodes to add.
    """
    progress = Progress(problem)
    selected = np.array([problem.start], dtype=np.int64)
    while True:
        weights, operations = solve(selected)
        level = problem.level(selected, weights)
        error = problem.displacement - problem.values(level)
        progress.count(solve=operations, error=float(problem.n_points) * len(selected))
        if progress.record(len(selected), error):
            return Reduced((level,), selected, error, tuple(progress.history))
        size = lengths(error)
        size[selected] = -1.0  # the error there is only rounding
        selected = np.append(selected, choose(size, problem.limit - len(selected)))


def full_solution(problem: ReductionProblem, selected: Integers) -> tuple[Floats, float]:
    """(nc, k) weights, and the number of multiply-adds."""
    return full_weights(problem, selected), full_operations(problem, len(selected))
