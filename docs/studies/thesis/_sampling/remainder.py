"""Largest difference of ∇S from a group's Taylor polynomial in the group's ball.

For one radial function and a ball of radius ρ about c, at the distance r of its centre x_j, the remainder of ∇φ after
the terms up to second order is at most ::

    min( ρ³/6 · E_4(r − ρ)/R⁴ ,  ρ² · E_3(r − ρ)/R³ ),     E_k(d) = max over |y| ≥ d of |D^k φ|

(the second one if the ball contains x_j: there D⁴φ is unbounded, and D³φ jumps, but stays bounded). The bound of S is
the sum over all control points with the norms |γ_j| of their weights: it is *certain*, but ignores the cancellation
between weights of opposite sign, which makes an interpolant smooth. It is expensive for that reason, not because of its
order.

The *estimated* remainder keeps the certain sum for the control points nearer than twice the radius, where a Taylor
series does not converge, and takes the last term kept, ½ |D³S| ρ², for all others: in a series that converges fast, the
omitted terms are smaller than the last kept term. This is a rule of thumb, not a bound.

|D^k φ| is the largest value of ``D^k φ[a, …, a]`` for a unit vector a (for a symmetric form the operator norm): with
c the cosine between a and y and ψ_k as in :mod:`.expansion` ::

    D³φ = 3 c ξ ψ_2 + c³ ξ³ ψ_3
    D⁴φ = 3 ψ_2 + 6 c² ξ² ψ_3 + c⁴ ξ⁴ ψ_4
"""

from __future__ import annotations

from functools import lru_cache

import mesh_motion_kernels as kernels
import numpy as np
from mesh_motion_numerics.interpolation.interpolant import Interpolant
from numpy.typing import NDArray

from docs.studies.thesis._sampling.expansion import radial_derivatives
from docs.studies.thesis._sampling.groups import Groups, group_points

__all__ = ["remainders"]

Floats = NDArray[np.float64]

#: Control points taken together, at the distance of the nearest of them: the bound costs so much less.
_CENTRES_TOGETHER = 2
_STEPS, _COSINES = 4096, 257
#: E_k is tabulated: the maximum over the cosine is found on a grid, hence to 1/257² of itself.
_TABLE_SLACK = 1.001


def remainders(interpolant: Interpolant, groups: Groups, *, near: float) -> Floats:
    """Largest |∇S − ∇(Taylor polynomial)| in each group's ball, from control points within ``near`` radii.

    Parameters
    ----------
    interpolant : Interpolant
        With a basis that can be expanded.
    groups : Groups
        g balls.
    near : float
        Infinity for the certain bound of the whole sum.

    Returns
    -------
    (g,) array
        Operator norm, dimensionless.
    """
    weights = np.sqrt(np.sum(interpolant.weights**2, axis=1))
    clusters = group_points(interpolant.control_points, _CENTRES_TOGETHER)
    totals = np.add.reduceat(weights[clusters.order], clusters.starts[:-1])
    out = np.empty(len(groups))
    kernels.sum_remainders(
        groups.centres,
        groups.radii,
        clusters.centres,
        clusters.radii,
        totals,
        envelopes(interpolant.basis.name),
        1.0 / interpolant.support_radius,
        near,
        out,
    )
    return out


@lru_cache
def envelopes(name: str) -> Floats:
    """(2, STEPS + 1) table of E_3 and E_4 over ξ from 0 to 1, not increasing; E_4 is infinite at 0."""
    xi = np.linspace(0.0, 1.0, _STEPS + 1)
    xi[0] = 1e-3 / _STEPS
    polynomials = radial_derivatives(name, 4)
    psi = [np.polynomial.polynomial.polyval(xi, row) / xi ** (2 * (k + 1)) for k, row in enumerate(polynomials)]
    c = np.linspace(0.0, 1.0, _COSINES)[:, None] * xi
    third = np.abs(3.0 * c * psi[1] + c**3 * psi[2]).max(axis=0)
    fourth = np.abs(3.0 * psi[1] + 6.0 * c**2 * psi[2] + c**4 * psi[3]).max(axis=0)
    fourth[0] = np.inf
    table = _TABLE_SLACK * np.stack([third, fourth])
    return np.ascontiguousarray(np.maximum.accumulate(table[:, ::-1], axis=1)[:, ::-1])
