"""Sums over centres at the points of a uniform grid, block by block: near centres directly, far ones interpolated.

Seen from a block of grid points, the function of a centre far away is a polynomial but for a little, of a lower order
the further it is: its sum with all others of the kind is formed at so many Chebyshev points of the block and
interpolated to those of the next order, and from the highest to the grid's points, along one axis after the other. What
is near is summed at the grid's points themselves.

References
----------
W. Fong, E. Darve, "The black-box fast multipole method", J. Comput. Phys. 228 (2009) 8712–8725.
"""

import math
from typing import Any

import mesh_motion_kernels as kernels
import numpy as np

from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.centres import CentreLayout
from mesh_motion_numerics.interpolation.interpolant import Interpolant
from mesh_motion_numerics.interpolation.two_scale.nested_grid import NestedGrid

__all__ = ["grid_sums", "on_grid", "on_grid_transposed"]


#: Chebyshev points along an axis of a block for its furthest and nearest far centres.
_LEAST, _ORDER = 4, 8
#: Half widths from a block's middle beyond which a centre is far. Then the interpolation leaves at most 6e-5 of the
#: largest displacement on the wing in a cube, 2e-6 in the mean: a thirtieth of what the spline between the grid's
#: points leaves there. All sums directly take three times as long.
_FAR = 1.8
#: Functions so smooth that large weights cancel: all their far centres get the highest order.
_SMOOTH = ("wendland-c4", "wendland-c6")
#: Support radii that grid and centres may be wide: in a wider one cells of centres leave more sums out.
_WIDE = 3.0
#: Products of grid points and centres below which blocks do not pay.
_WORTHWHILE = 2e6


def on_grid(interpolant: Interpolant, grid: NestedGrid) -> Floats:
    """(n, k) values of an interpolant at the points of nested boxes, by blocks where that pays."""
    values = np.empty((sum(box.grid_points for box in grid.boxes), interpolant.components))
    first = 0
    for box in grid.boxes:
        part = values[first : first + box.grid_points]
        first += box.grid_points
        if not grid_sums(interpolant, grid.corner(box), box.spacing, grid.counts(box), part):
            part[:] = evaluation.displacement(interpolant, grid.points_of(box))
        elif interpolant.polynomial is not None:
            part += interpolant.polynomial(grid.points_of(box))
    return values


def on_grid_transposed(interpolant: Interpolant, grid: NestedGrid, values: Floats) -> Floats:
    """(nc, k) the transpose of :func:`on_grid` as a map of the weights, which do not count, of (n, k) values."""
    out, first = np.zeros((len(interpolant.control_points), values.shape[1])), 0
    for box in grid.boxes:
        part = np.ascontiguousarray(values[first : first + box.grid_points])
        first += box.grid_points
        where = grid.corner(box), box.spacing, grid.counts(box)
        if _blocks_suit(interpolant, *where):
            code, centres, *further = _arguments(interpolant, *where[:2])
            back = np.empty(out.shape[::-1])
            kernels.sum_from_grid(code, centres, part.reshape(*where[2][:2], -1), *further, back)
            out += back.T
        else:
            basis, radius, points = interpolant.basis, interpolant.support_radius, grid.points_of(box)
            turned = Interpolant(points, part, basis, radius, CentreLayout.build(points, basis, radius))
            out += evaluation.displacement(turned, interpolant.control_points)
    return out


def grid_sums(interpolant: Interpolant, low: Floats, spacing: float, counts: tuple[int, ...], out: Floats) -> bool:
    """Fill ``out`` (n, k) with ``Σ_j w_j φ(|x − x_j| / R)`` at the points of a grid.

    Blocks suit in three dimensions, and where φ varies on the scale of its distance from a centre: up to the support
    radius. Beyond it a compact function is zero, and any other one does not suit.

    Parameters
    ----------
    interpolant : Interpolant
        Its polynomial is left out.
    low : (3,) array, mesh length unit
        First point of the grid.
    spacing : float, mesh length unit
    counts : tuple of int
        Points along each axis.
    out : (n, k) array
        x slowest.

    Returns
    -------
    bool
        False if blocks are not worth it or not suitable: ``out`` stays unchanged.
    """
    if not _blocks_suit(interpolant, low, spacing, counts):
        return False
    code, centres, *further = _arguments(interpolant, low, spacing)
    weights = np.ascontiguousarray(interpolant.weights.T)
    kernels.sum_on_grid(code, centres, weights, *further, out.reshape(*counts[:2], -1))
    return True


def _blocks_suit(interpolant: Interpolant, low: Floats, spacing: float, counts: tuple[int, ...]) -> bool:
    """Whether sums at the points of a grid go by blocks."""
    centres = interpolant.control_points
    if len(counts) != 3 or math.prod(counts) * len(centres) < _WORTHWHILE:
        return False
    high = low + spacing * (np.array(counts) - 1.0)
    reach = np.maximum(high, centres.max(axis=0)) - np.minimum(low, centres.min(axis=0))
    return (
        float(np.sqrt(np.sum(reach**2))) <= (_WIDE if interpolant.basis.compact else 1.0) * interpolant.support_radius
    )


def _arguments(interpolant: Interpolant, low: Floats, spacing: float) -> tuple[Any, ...]:
    """What the compiled sums take, without the weights and the values."""
    compact, radius = interpolant.basis.compact, interpolant.support_radius
    distances = _ALL_HIGHEST if interpolant.basis.name in _SMOOTH else _DISTANCES
    centres = np.ascontiguousarray(interpolant.control_points.T)
    reach = radius if compact else np.inf
    return interpolant.basis.code, centres, 1.0 / radius, reach, low, spacing, distances


def _distances() -> Floats:
    """(order + 1,) half widths from a block's middle beyond which an order of interpolation is enough.

    The error for a function with a singularity q half widths away falls like ``(q + √(q² − 1))^−order``, and it grows
    with ``(q / order)²``, as measured for the third power of the distance. It is that of the highest order from
    ``_FAR`` on for all.
    """

    def error(q: Floats, order: int) -> Floats:
        return np.asarray((q / order) ** 2 * (q + np.sqrt(q**2 - 1.0)) ** -order)

    tried = np.geomspace(_FAR, 100.0, 10_000)
    enough = [tried[np.argmax(error(tried, order) <= error(tried[:1], _ORDER))] for order in range(_LEAST, _ORDER + 1)]
    return np.array([np.inf] * _LEAST + enough)


_DISTANCES = _distances()
_ALL_HIGHEST = np.where(np.arange(_ORDER + 1) < _ORDER, np.inf, _DISTANCES)
