"""The greedy algorithm with a Cholesky factor that grows by one row at a time (Fang et al.; thesis §2.2.3).

    φ_cc = L Lᵀ;  a new point adds the row  l = L⁻¹ φ_c,  λ = √(φ(0) − l·l)

Here the row is computed for all boundary nodes at once, not for the selected ones only. Column j of
``V = φ_bc L⁻ᵀ`` is then the new basis function at all nodes; it vanishes at the points chosen before, and the
error needs no weights until the end::

    v = (φ_b,new − V l) / λ,    l = V[new],    y = ε[new] / λ,    ε ← ε − v y,    at the end  Lᵀ γ = y

``N_c³/6`` multiply-adds go into rows of L, the others, ``N_c² (N_b − N_c/3) / 2``, into the errors; there is no
triangular system inside the loop. V takes ``8 N_b N_c`` bytes.

With one product ``V l`` for each point, memory bandwidth limits the speed. So the next points are predicted: the same
algorithm runs ahead on the nodes of large error only, then the columns of all its points are computed in one matrix
product. A predicted point is accepted only if it is the node of the largest error of all, so the selection is exactly
that of the full greedy algorithm, at the speed of a matrix product.

References
----------
H. Fang, C. Gong, C. Yu et al., the thesis' [18]; described in thesis §2.2.3. S. Müller, R. Schaback, "A Newton basis
for kernel spaces", J. Approx. Theory 161 (2009) 645–655: the columns of V.
"""

import numpy as np
from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.interpolation.factorizations.dense import LOST, singular
from mesh_motion_numerics.interpolation.kernels import values
from mesh_motion_numerics.reduction.problem import Progress, Reduced, ReductionProblem, lengths
from mesh_motion_protocol.errors import InvalidInput
from scipy.linalg import solve_triangular

from docs.studies.thesis._point_reduction.growing_columns import GrowingColumns

__all__ = ["reduce"]


#: Most points foreseen at once, and the share of the nodes they are foreseen on. 1000 points of 18 000 on a wing take
#: 2.6 s of one core (1.6 times the least number of operations); 2.5 s with 8, 2.7 s with 32 on a tenth, 11 s with 1.
_AHEAD, _SHARE = 16, 0.05
#: Bytes of V that are still stored.
_MEMORY = 2 << 30


def reduce(problem: ReductionProblem) -> Reduced:
    """Add the node of the largest error, grow the factor by its row, until the tolerance is met."""
    progress = Progress(problem)
    growing = _GrowingCholesky(problem, progress)
    while not growing.extend(growing.foresee()):
        pass
    selected = np.array(growing.selected)
    level = problem.level(selected, growing.weights())
    return Reduced((level,), selected, problem.displacement - problem.values(level), tuple(progress.history))


class _GrowingCholesky:
    """V (nb, nc) and the (nb, k) errors."""

    def __init__(self, problem: ReductionProblem, progress: Progress) -> None:
        self.problem, self.progress = problem, progress
        self.selected: list[int] = []
        self.error = problem.displacement.copy()
        self._columns = GrowingColumns(problem.n_points)
        self._at_zero = float(values(problem.row, np.zeros(1))[0])
        self._coefficients: list[Floats] = []

    def weights(self) -> Floats:
        """(nc, k) γ of Lᵀ γ = y."""
        n = len(self.selected)
        self.progress.count(solve=0.5 * n * n * self.error.shape[1])
        lower = self._columns.rows(np.array(self.selected))
        return np.asarray(solve_triangular(lower, np.array(self._coefficients), trans=1, lower=True))

    def foresee(self) -> list[int]:
        """The predicted next points, under the assumption that none has a small error now: at least the next one."""
        if not self.selected:
            return [self.problem.start]
        size = self._open_errors()
        count = min(max(1, int(_SHARE * len(size))), len(size) - 1)
        nodes = np.sort(np.argpartition(-size, count)[:count])
        rows, error, size = self._columns.rows(nodes), self.error[nodes], size[nodes]
        ahead = np.empty((_AHEAD, len(nodes)))
        places = [int(np.argmax(size))]
        for m, place in enumerate(places):
            column = self.problem.columns(nodes[[place]], rows=nodes)[:, 0]
            column -= rows @ rows[place] + ahead[:m, place] @ ahead[:m]
            if m + 1 == _AHEAD or not column[place] > 0.0:
                break
            ahead[m] = column / np.sqrt(column[place])
            error -= np.outer(ahead[m], error[place] / ahead[m, place])
            size = lengths(error)
            size[places] = -1.0
            places.append(int(np.argmax(size)))
        self.progress.count(error=float(len(nodes)) * len(places) * (len(self.selected) + 0.5 * len(places)))
        return [int(node) for node in nodes[places]]

    def extend(self, foreseen: list[int]) -> bool:
        """Add these nodes while each is the node of the largest error; return True if the tolerance is met.

        Raises
        ------
        QualityRefused
            If the pivot of a node is only a rounding error.
        """
        self._refuse_too_many(len(foreseen))
        n, nodes = self._columns.count, np.array(foreseen)
        block = np.asfortranarray(self.problem.columns(nodes))
        self._columns.subtract_products(self._columns.rows(nodes), block)
        self.progress.count(error=len(nodes) * ((n + 1.0) * self.problem.n_points - 0.5 * n * n))
        for place, node in enumerate(foreseen):
            block[:, place] -= block[:, :place] @ block[node, :place]
            self._append(node, block[:, place])
            if self.progress.record(len(self.selected), self.error):
                return True
            if place + 1 < len(foreseen) and foreseen[place + 1] != int(np.argmax(self._open_errors())):
                break
        return False

    def _append(self, node: int, column: Floats) -> None:
        """Turn the remainder (nb,) of a node's φ into its column of V in place; subtract its share from the errors."""
        if not column[node] > LOST * self._at_zero:
            raise singular()
        column /= np.sqrt(column[node])
        column[self.selected] = 0.0  # rounding is left there
        coefficient = self.error[node] / column[node]
        self.error -= np.outer(column, coefficient)
        self.error[node] = 0.0
        self._coefficients.append(coefficient)
        self._columns.append(column)
        self.selected.append(node)
        self.progress.count(solve=0.5 * float(self._columns.count) ** 2)

    def _open_errors(self) -> Floats:
        """(nb,) error lengths, −1 at selected nodes."""
        size = lengths(self.error)
        size[self.selected] = -1.0
        return size

    def _refuse_too_many(self, more: int) -> None:
        """Raise if V would need more memory than allowed."""
        nb = self.problem.n_points
        if 8 * nb * (self._columns.count + more) > _MEMORY:
            raise InvalidInput(
                f"the reduction 'recurrence-cholesky' stores {nb} values a control point: more than "
                f"{_MEMORY >> 30} GiB from {_MEMORY // (8 * nb)} points on",
                hint="take reduction = 'error-peaks'",
            )
