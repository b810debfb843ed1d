"""A correction that is smooth in time: a function of the boundary alone, without a threshold that switches it.

A correction that starts at one threshold and stops at another makes nodes jump from step to step, and a fluid solver
treats every jump as a mesh velocity. Here the correction itself is penalised, not its change (a penalty on the change
would lag behind the boundary and drift)::

    y = argmin  E(y) + (a_k/n) Σ_c |∇(y − y_RBF)|²_F,      a_k = a (1 + (δ/|u|)²)

E is the p-mean of the distortion (:mod:`.distortion`, p = 24, m = 4) with its barrier, y_RBF the standard motion, |u|
the largest displacement of a boundary node, the sum goes over the n corners, and the gradient is that of the map from
each corner's ideal. Without displacement the weight is infinite and y = y_RBF is the reference mesh: when a body
returns, the mesh returns to the reference mesh. Held nodes have y = y_RBF, so only the free nodes' part of the matrix
is needed.

A correction that is always fully active would make the nodes jump once, when the body leaves its place, by the
correction of the mesh at rest; instead it grows as |u|² over a length δ. δ is eight times that jump: then no node moves
much further in a step than the boundary does, whatever the amplitude of the motion.

E is not convex, but within the barrier and with the penalty every start that was tried leads to the same minimum; the
iterations continue until the result does not depend on the start.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from mesh_motion_server.numerics.arrays import Floats, Marks
from mesh_motion_server.numerics.correction.distortion import PNorm, determinants, mean_distortion
from mesh_motion_server.numerics.correction.free_region import FreeRegion
from mesh_motion_server.numerics.correction.newton import Accuracy, QuadraticTerm, newton
from mesh_motion_server.numerics.correction.trial_nodes import SIZE_WEIGHTS, Polished, Stage, TrialMesh, untangle
from mesh_motion_server.numerics.mesh.paths import split_rigid

__all__ = ["PENALTY", "SmoothInTime", "gradient_stiffness", "travel"]


PENALTY = 0.1
"""a: between 0.01 and 0.1 the quality differs by a hundredth."""

_LEVEL = PNorm(24, 4)
_OPENING = (PNorm(2, 1), PNorm(8, 2))  # run first from a start that is not near the minimum
_OPENING_ITERATIONS, _ITERATIONS = 6, 60
_ONSET = 8.0
_PLANE = Accuracy(
    full_step_gain=1e-7,
    least_decrement=1e-7,
    least_gain=1e-10,
    refresh=0.0,
    floor=0.0,  # the penalty is stiffness enough
    direct_unknowns=40_000,
    cg_reduction=0.03,
    cg_iterations=200,
)
_SETTLED = {1: _PLANE, 2: _PLANE, 3: replace(_PLANE, direct_unknowns=1500)}  # in 3D a factorization is expensive
_BARRIER = 1e-3  # a start with a determinant below it is untangled first
_NO_TRAVEL = 1e-9  # of δ: the weight of the penalty is infinite


@dataclass(frozen=True, eq=False)
class SmoothInTime:
    """The correction of one mesh.

    Attributes
    ----------
    region : FreeRegion
        Every node that is not held.
    stiffness : (b, d, d) array, 1 / length²
        Of ``(1/n) Σ |∇v|²``, see :func:`gradient_stiffness`.
    onset : float, mesh length unit
        δ.
    """

    mesh: TrialMesh
    region: FreeRegion
    stiffness: Floats
    onset: float

    @classmethod
    def build(cls, mesh: TrialMesh) -> SmoothInTime:
        """Prepare the correction, and measure δ: eight times the largest correction of the mesh at rest."""
        region = mesh.free(~mesh.held)
        active = cls(mesh, region, gradient_stiffness(region), 0.0)
        jump = active.correct(mesh.reference, math.inf).points - mesh.reference
        return replace(active, onset=_ONSET * float(np.sqrt(np.max(np.sum(jump * jump, axis=1)))))

    def correct(
        self, standard: Floats, travelled: float, start: Floats | None = None, valid: Floats | None = None
    ) -> Polished:
        """The corrected positions.

        Parameters
        ----------
        standard : (n, d) array, mesh length unit
            y_RBF.
        travelled : float, mesh length unit
            |u|, see :func:`travel`.
        start : (n, d) array, mesh length unit, optional
            Where to begin; it only changes the computing time.
        valid : (n, d) array, mesh length unit, optional
            A valid mesh, if one is known: then ``standard`` need not be untangled.

        Returns
        -------
        Polished
            Still tangled, with a negative minimum, if no valid mesh was found.
        """
        if travelled <= _NO_TRAVEL * self.onset:
            return Polished(standard, float(self.mesh.quality(standard).min()))
        weight = PENALTY * (1.0 + (self.onset / travelled) ** 2)
        term = QuadraticTerm(standard[self.region.free], weight * self.stiffness)
        local, history = self._settle(standard, start, valid, term)
        moved = standard.copy()
        moved[self.region.free] = local[: self.region.n_free]
        minimum = float(self.mesh.quality(moved).min())
        history = [stage._replace(minimum=minimum) for stage in history]
        return Polished(moved, minimum, self.region.n_free, sum(stage.iterations for stage in history), tuple(history))

    def _settle(
        self, standard: Floats, start: Floats | None, valid: Floats | None, term: QuadraticTerm
    ) -> tuple[Floats, list[Stage]]:
        """Positions (l, d) of the minimum, and the stages of the minimisation."""
        levels: tuple[PNorm, ...] = (*_OPENING, _LEVEL)
        local = standard[self.region.nodes]
        if start is not None and self._distortion(start[self.region.nodes]) < self._distortion(local):
            local, levels = start[self.region.nodes], (_LEVEL,)
        elif determinants(local, self.region.simplices).min() <= _BARRIER:
            local = untangle(local if valid is None else valid[self.region.nodes], self.region, self.mesh.metric)
        history = []
        for level in levels:
            norm, iterations, accuracy = self._level(level)
            found = newton(local, self.region, norm, iterations=iterations, quadratic=term, accuracy=accuracy)
            local = found.points
            history.append(Stage(norm, self.region.n_free, found.iterations, math.nan))
        return local, history

    def _level(self, norm: PNorm) -> tuple[PNorm, int, Accuracy]:
        """A level's norm with the metric's size weight, and its iterations and accuracy."""
        weighted = replace(norm, size_weight=SIZE_WEIGHTS[self.mesh.metric])
        if norm is not _LEVEL:
            return weighted, _OPENING_ITERATIONS, Accuracy()
        return weighted, _ITERATIONS, _SETTLED[self.region.simplices.dimension]

    def _distortion(self, local: Floats) -> float:
        """E at the region's points (l, d); inf where a corner is inverted."""
        return mean_distortion(local, self.region.simplices, self._level(_LEVEL)[0])[0]


def gradient_stiffness(region: FreeRegion) -> Floats:
    """(b, d, d) matrix K of ``½ vᵀ K v = (1/n) Σ_c |∇v|²_F`` for displacements v of the free nodes, zero elsewhere.

    With V = [v_a − v_k, …] a corner's gradient from its ideal is V P, and ``|V P|² = Σ v_ij (P Pᵀ)_jl v_il``.
    """
    ideal = region.simplices.ideal
    n, d, _ = ideal.shape
    products = np.einsum("cik,cjk->cij", ideal, ideal)
    blocks = np.einsum("cjl,ik->cjlik", products, np.eye(d)).reshape(n, d * d, d * d)
    stiffness: Floats = 2.0 / n * region.adjacency.assemble(np.ascontiguousarray(blocks, dtype=np.float32), d)
    return stiffness


def travel(start: Floats, moved: Floats, held: Marks) -> float:
    """|u|: largest displacement of a held (n) node from ``start`` to ``moved`` (n, d), without their rigid motion."""
    _, remainder = split_rigid(start[held], moved[held] - start[held])
    return float(np.sqrt(np.max(np.sum(remainder * remainder, axis=1))))
