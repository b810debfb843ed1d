"""The grouping-circular-based greedy algorithm: the errors of one group of nodes at a time (thesis §2.2.3, Fig 2.8).

The boundary nodes are divided into m groups. Each iteration computes the errors of *one* group only and adds its node
of largest error; the next iteration uses the next group, cyclically. So every node is tested, with ``N_c N_b / m``
values of φ per iteration instead of ``N_c N_b``. The algorithm ends when a whole cycle is within the tolerance and no
node was added in between: then all nodes are within the tolerance.

References
----------
H. Fang et al., "Efficient mesh deformation using radial basis functions with a grouping-circular-based greedy
algorithm", J. Comput. Phys. 433 (2021); thesis [20].
"""

import numpy as np

from mesh_motion_numerics.arrays import Integers
from mesh_motion_numerics.reduction.growing_set import GrowingSet, full_operations, full_weights
from mesh_motion_numerics.reduction.problem import Progress, Reduced, ReductionProblem, lengths

#: Smallest number of nodes in a group …
_MIN_GROUP = 32
#: … and largest number of groups.
_MAX_GROUPS = 32


def default_groups(n_points: int) -> int:
    """m for this number of boundary nodes."""
    return max(1, min(_MAX_GROUPS, n_points // _MIN_GROUP))


def greedy(problem: ReductionProblem) -> Reduced:
    """Add the node of the largest error of all until the tolerance is met (thesis §2.2.2, "full point").

    References
    ----------
    T. C. S. Rendall, C. B. Allen, J. Comput. Phys. 228 (2009) 6231–6249.
    """
    return reduce(problem, groups=1)


def reduce(problem: ReductionProblem, *, groups: int = 0) -> Reduced:
    """Add the node of the largest error of one group after the other until a whole cycle is within the tolerance.

    Parameters
    ----------
    groups : int
        m; 0 for :func:`default_groups`. With 1 it is the greedy algorithm.

    Notes
    -----
    Each entry of the history has the errors of one group, the last one those of all nodes.
    """
    progress = Progress(problem)
    selected = select(problem, groups or default_groups(problem.n_points), progress)
    level = problem.level(selected, full_weights(problem, selected))
    error = problem.displacement - problem.values(level)
    progress.count(solve=full_operations(problem, len(selected)), error=float(problem.n_points) * len(selected))
    progress.record(len(selected), error)
    return Reduced((level,), selected, error, tuple(progress.history))


def select(problem: ReductionProblem, m: int, progress: Progress) -> Integers:
    """(nc,) nodes in the order of choice, from ``m`` groups; ``progress`` records the errors of each."""
    free = np.ones(problem.n_points, dtype=bool)
    growing = GrowingSet(problem)
    worst: int | None = problem.start
    turn = within = 0
    while within < m and growing.count < problem.limit:
        if worst is not None:
            progress.count(solve=growing.append(worst))
            free[worst] = False
        # nodes are assigned to the groups in turn, so that every group is spread over all surfaces
        group = turn + m * np.flatnonzero(free[turn::m])
        turn = (turn + 1) % m
        worst, within = None, within + 1
        if group.size:
            error = growing.errors(group)
            progress.count(error=float(group.size) * growing.count)
            if not progress.record(growing.count, error):
                worst, within = int(group[np.argmax(lengths(error))]), 0
    return growing.selected
