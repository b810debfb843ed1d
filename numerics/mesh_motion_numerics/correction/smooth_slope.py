"""The derivative of the smooth motion by the plain motion: dy for a given dy_plain, and the transpose.

At the minimum y of E(y, y_plain) (:mod:`.smooth_motion`) the gradient by the free nodes vanishes, whatever the plain
motion is. So (implicit function theorem) ::

    H dy_free = K dp_free − H_held dp_held − PENALTY m (y − p) d(1/σ) − G do,      dσ by the chain of averages

with the Hessian H of the free nodes, its coupling H_held to the neighbouring nodes, and the penalty's matrix K(σ).
Free nodes that slide along one direction of a curved wall are held across it: there dy = dp. The
activation σ depends on the plain mesh, so no correction is frozen. In a mesh that is wound by turning bodies, the
distortion o at which cells begin to resist also depends on the boundary; G is the derivative of the gradient by o.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from mesh_motion_protocol.errors import QualityRefused

from mesh_motion_numerics.arrays import Floats, Integers, Shorts
from mesh_motion_numerics.correction.distortion import corner_distortions, distortion_gradient
from mesh_motion_numerics.correction.free_region import gathered
from mesh_motion_numerics.correction.smooth_motion import FAR, RAMP, RINGS, SmoothMotion
from mesh_motion_numerics.correction.smooth_region import PENALTY, SmoothRegion

#: Largest Newton step, as a share of the mesh's extent, at which a mesh is accepted as the minimum.
_AT_MINIMUM = 1e-6
#: Two positions of a node are the same if they differ by less, as a share of the extent.
SAME = 1e-9


@dataclass(frozen=True, eq=False)
class SmoothSlope:
    """The derivative at one mesh."""

    motion: SmoothMotion
    #: plain, points: (n, d), mesh length unit. The plain motion and the corrected one.
    plain: Floats
    points: Floats
    region: SmoothRegion | None  # The free nodes; None if no cell resists, so that both meshes are the same

    @classmethod
    def build(cls, motion: SmoothMotion, plain: Floats, points: Floats) -> SmoothSlope:
        """Build the derivative at the ``points`` that the correction of the ``plain`` motion has found.

        Raises QualityRefused if they are not the minimum, or nodes that are not free have left the plain motion: the
        mesh was corrected in another way.
        """
        region, extent = motion.region(plain), np.ptp(motion.reference, axis=0).max()
        made, left = cls(motion, plain, points, region), np.abs(plain - points).max(axis=1) > SAME * extent
        if region is not None:
            left[region.free.free] = False
        # nodes without a cell follow others: the opposite side of a mesh of one layer
        if left.any() and any(left[block.nodes].any() for block in motion.cells):
            raise not_at_minimum()
        if region is not None:
            free = region.free.free
            if not np.isfinite(made._distortions).all():
                raise not_at_minimum()
            step = made._solved(-made._model[0])
            if np.abs(step).max() > _AT_MINIMUM * extent:
                raise not_at_minimum()
            points = points.copy()  # one more Newton step: the derivative is only as exact as the minimum
            points[free] += step
            made = replace(made, points=points)
        return made

    def apply(self, plain_change: Floats, later: float = 0.0) -> Floats:
        """(n, d) dy for dy_plain (n, d), and for a change of the distortion at which cells begin to resist."""
        if self.region is None:
            return plain_change
        free, nodes, out = self.region.free.free, self.region.free.nodes, plain_change.copy()
        held, across = plain_change[nodes], self._across(plain_change[free])
        held[: len(free)] = across
        right = self.region.pull(plain_change[free] - across)[1] - self._coupled(held)[: len(free)]
        right -= self._pull_by_activation * self._activated(plain_change, later)[free, None]
        if later != 0.0:
            right -= later * self._gradient_by_onset
        out[free] = across + self._solved(right)
        return out

    def transpose(self, weights: Floats) -> tuple[Floats, float]:
        """The transpose: derivatives by dy_plain (n, d) and by the onset's change, for weights (n, d) of dy."""
        if self.region is None:
            return weights, 0.0
        free, nodes, out = self.region.free.free, self.region.free.nodes, weights.copy()
        solved = self._solved(weights[free])
        local = np.zeros((len(nodes), weights.shape[1]))
        local[: len(free)] = solved
        pulled, coupled = self.region.pull(solved)[1], self._coupled(local)
        out[free] = pulled + self._across(weights[free] - pulled - coupled[: len(free)])
        out[nodes[len(free) :]] -= coupled[len(free) :]
        activated = np.zeros(len(weights))
        activated[free] = -np.sum(self._pull_by_activation * solved, axis=1)
        by_plain, later = self._activated_transposed(activated)
        return out + by_plain, later - float(np.sum(self._gradient_by_onset * solved))

    # --- the minimum -------------------------------------------------------------------------------------------------

    @property
    def _required(self) -> SmoothRegion:
        assert self.region is not None
        return self.region

    @cached_property
    def _local(self) -> Floats:
        return self.points[self._required.free.nodes]

    @cached_property
    def _distortions(self) -> Floats:
        return corner_distortions(self._local, self._required.free.simplices, self.motion.law.norm)

    @cached_property
    def _model(self) -> tuple[Floats, Floats]:
        region = self._required
        rest = self.plain[region.free.nodes]
        return self.motion.model(self._local, rest, region, self._distortions, exact=True)

    def _solved(self, right: Floats) -> Floats:
        """H⁻¹ times (f, d) in the directions in which nodes can move."""
        return self._solver(np.ascontiguousarray(right))

    def _across(self, changes: Floats) -> Floats:
        """The part of ``changes`` (f, d) in directions in which nodes cannot move."""
        constraint = self._required.constraint
        return np.zeros_like(changes) if constraint is None else constraint.across(self._local, changes)

    @cached_property
    def _solver(self) -> Callable[[Floats], Floats]:
        """The Hessian's factor, used for every vector."""
        try:
            return self._required.solver(self._local, self._model[1])
        except ArithmeticError as error:
            raise not_at_minimum() from error

    @cached_property
    def _active(self) -> Integers:
        return np.flatnonzero(self._distortions > self.motion.law.onset)

    @cached_property
    def _blocks(self) -> Floats:
        """(c, j, k, a, b) second derivatives of the active corners' resistance by their edges j, k."""
        region, law, active, d = self._required, self.motion.law, self._active, self.plain.shape[1]
        _, slope, bend = law.resistance(self._distortions[active])
        simplices, weights = region.free.simplices.of(active), region.weights[active]
        blocks = self.motion.corner_hessians(self._local, simplices, weights * slope, weights * bend, exact=True)
        return blocks.reshape(-1, d, d, d, d)

    def _coupled(self, local: Floats) -> Floats:
        """(l, d) the resistance's Hessian times (l, d) of all local nodes."""
        nodes, out = self._required.free.simplices.nodes[self._active], np.zeros_like(local)
        edges = local[nodes[:, 1:]] - local[nodes[:, :1]]
        forces = np.einsum("cjkab,ckb->cja", self._blocks, edges)
        np.add.at(out, nodes[:, 1:], forces)
        np.subtract.at(out, nodes[:, 0], forces.sum(axis=1))
        return out

    @cached_property
    def _gradient_by_onset(self) -> Floats:
        """(f, d) derivative of the gradient by the distortion at which cells begin to resist."""
        region, law, active = self._required, self.motion.law, self._active
        d = self.plain.shape[1]
        shares = np.zeros((len(self._distortions), d + 1, d))
        weights = region.weights[active] * law.resistance(self._distortions[active])[2]
        shares[active] = distortion_gradient(self._local, region.free.simplices.of(active), weights, law.norm)
        return -np.asarray(gathered(region.free.adjacency, shares))

    # --- the activation ----------------------------------------------------------------------------------------------

    @cached_property
    def _pull_by_activation(self) -> Floats:
        """(f, d) derivative of K (y − p) by each free node's own σ."""
        region = self._required
        free = region.free.free
        by_sigma = -PENALTY * region.mass / self._sigma[-1][self.motion.alike[free]] ** 2
        return np.asarray(by_sigma[:, None] * (self.points[free] - self.plain[free]))

    @cached_property
    def _ramp(self) -> tuple[Shorts, Floats, Floats]:
        """The nodes (c, d + 1) of corners whose activation varies, dx/df of log(1 − s(x)), gradients of f by node."""
        motion = self.motion
        simplices = motion.distorted_corners(self.plain)
        assert simplices is not None  # as for a region
        distortion = np.minimum(corner_distortions(self.plain, simplices, motion.law.norm), FAR)
        x = (distortion - motion.law.onset) / RAMP
        rows = np.flatnonzero((x > 0.0) & (x < 1.0))
        x = x[rows]
        slope = 30.0 * x**2 * (1.0 - x) ** 2 / RAMP / (1.0 - x**3 * (10.0 + x * (6.0 * x - 15.0)))
        varying = simplices.of(rows)
        gradients = distortion_gradient(self.plain, varying, np.ones(len(rows)), motion.law.norm)
        return varying.nodes, slope, gradients

    @cached_property
    def _sigma(self) -> list[Floats]:
        """σ (n,) after each ring."""
        return self.motion.activations(self.plain)

    def _rings(self) -> Iterator[tuple[Floats, Floats]]:
        """1 − σ and 1 − A σ before each ring."""
        for sigma in self._sigma[:RINGS]:
            yield 1.0 - sigma, 1.0 - self.motion.averages @ sigma

    def _activated(self, change: Floats, later: float) -> Floats:
        """(n,) dσ for dp (n, d) and for a change of the distortion at which cells begin to resist."""
        (nodes, slope, gradients), alike = self._ramp, self.motion.alike
        of_corner = slope * (np.einsum("cai,cai->c", gradients, change[nodes]) - later)
        sigma = np.zeros(len(change))
        np.add.at(sigma, alike[nodes], of_corner[:, None])
        sigma *= 1.0 - self._sigma[0]
        for calm, calm_about in self._rings():
            sigma = sigma * calm_about + calm * (self.motion.averages @ sigma)
        return np.asarray(sigma[alike])

    def _activated_transposed(self, weights: Floats) -> tuple[Floats, float]:
        """The transpose: derivatives by dp (n, d) and by the onset's change, for weights (n,) of dσ."""
        (nodes, slope, gradients), alike = self._ramp, self.motion.alike
        sigma: Floats = np.bincount(alike, weights=weights, minlength=len(weights)).astype(np.float64)
        for calm, calm_about in reversed([*self._rings()]):
            sigma = sigma * calm_about + self.motion.averages.T @ (calm * sigma)
        sigma = sigma * (1.0 - self._sigma[0])
        of_corner = slope * sigma[alike[nodes]].sum(axis=1)
        out = np.zeros_like(self.plain)
        np.add.at(out, nodes, of_corner[:, None, None] * gradients)
        return out, -float(of_corner.sum())


def not_at_minimum() -> QualityRefused:
    """Return the error for a mesh that is not the result of a motion with a derivative."""
    return QualityRefused(
        "the mesh was not corrected by the smooth correction: its motion has no derivative here",
        code="FAILED_PRECONDITION",
        hint="request it at a step whose MOVED has no such warning",
    )
