"""The greedy algorithm with a full solution for every point (thesis §2.2.2, "full point").

    solve φ_cc γ = d_c; ε = d_b − φ_bc γ; add the node of the largest |ε|; repeat until it is small enough.

A factorization from scratch for every point: ``Σ j³/6 = N_c⁴/24`` multiply-adds with a Cholesky factor, the fourth
power of thesis Table 2.3, and ``N_c² N_b / 2`` values of φ for the errors.

References
----------
T. C. S. Rendall, C. B. Allen, "Efficient mesh motion using radial basis functions with data reduction algorithms",
J. Comput. Phys. 228 (2009) 6231–6249.
"""

from functools import partial

import numpy as np
from mesh_motion_numerics.reduction.problem import Reduced, ReductionProblem

from docs.studies.thesis._point_reduction.greedily import full_solution, greedily

__all__ = ["reduce"]


def reduce(problem: ReductionProblem) -> Reduced:
    """Add the node of the largest error, solve again, until the tolerance is met."""
    return greedily(problem, partial(full_solution, problem), lambda size, _: np.argmax(size, keepdims=True))
