"""Sums over centres at the points of a uniform grid, block by block: near centres directly, far ones interpolated.

In a block of grid points, the function of a far centre is nearly a polynomial, of lower order for farther centres. So
all centres of the same order are summed at the Chebyshev points of this order in the block. The sums are interpolated
to the Chebyshev points of the next order, and from the highest order to the grid's points, along one axis after the
other. Near centres are summed at the grid's points directly.

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

#: Number of Chebyshev points along an axis of a block, for its farthest and nearest far centres.
_LEAST, _ORDER = 4, 8
#: Distance in half widths from a block's middle beyond which a centre is far. At this distance the interpolation error
#: is at most 6e-5 of the largest displacement on the wing in a cube, 2e-6 on average: a thirtieth of the spline's error
#: between the grid's points. Direct sums only would take three times as long.
_FAR = 1.8
#: Functions so smooth that large weights cancel: all their far centres get the highest order.
_SMOOTH = ("wendland-c4", "wendland-c6")
#: Largest extent of grid and centres, in support radii: in a wider one, cells of centres leave more sums out.
_WIDE = 3.0
#: Product of the numbers of grid points and centres below which blocks do not save time.
_WORTHWHILE = 2e6


def on_grid(interpolant: Interpolant, grid: NestedGrid) -> Floats:
    """(n, k) values of an interpolant at the points of nested boxes, by blocks if that saves time."""
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
    """The transpose of :func:`on_grid` as a map of the weights (which are not used): (nc, k) for (n, k) values."""
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

    Blocks are suitable in three dimensions, if φ varies on the scale of its distance from a centre: up to the support
    radius. Beyond this radius a compact function is zero; other functions are not suitable there.

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
    """Whether sums at the points of a grid are formed by blocks."""
    centres = interpolant.control_points
    if len(counts) != 3 or math.prod(counts) * len(centres) < _WORTHWHILE:
        return False
    high = low + spacing * (np.array(counts) - 1.0)
    reach = np.maximum(high, centres.max(axis=0)) - np.minimum(low, centres.min(axis=0))
    return (
        float(np.sqrt(np.sum(reach**2))) <= (_WIDE if interpolant.basis.compact else 1.0) * interpolant.support_radius
    )


def _arguments(interpolant: Interpolant, low: Floats, spacing: float) -> tuple[Any, ...]:
    """Arguments of the compiled sums, without the weights and the values."""
    compact, radius = interpolant.basis.compact, interpolant.support_radius
    distances = _ALL_HIGHEST if interpolant.basis.name in _SMOOTH else _DISTANCES
    centres = np.ascontiguousarray(interpolant.control_points.T)
    reach = radius if compact else np.inf
    return interpolant.basis.code, centres, 1.0 / radius, reach, low, spacing, distances


def _distances() -> Floats:
    """(order + 1,) half widths from a block's middle beyond which each order of interpolation is enough.

    The error for a function with a singularity q half widths away falls like ``(q + √(q² − 1))^−order``, and it grows
    with ``(q / order)²``, as measured for the third power of the distance. Every order has at most the error of the
    highest order at the distance ``_FAR``.
    """

    def error(q: Floats, order: int) -> Floats:
        return np.asarray((q / order) ** 2 * (q + np.sqrt(q**2 - 1.0)) ** -order)

    tried = np.geomspace(_FAR, 100.0, 10_000)
    enough = [tried[np.argmax(error(tried, order) <= error(tried[:1], _ORDER))] for order in range(_LEAST, _ORDER + 1)]
    return np.array([np.inf] * _LEAST + enough)


_DISTANCES = _distances()
_ALL_HIGHEST = np.where(np.arange(_ORDER + 1) < _ORDER, np.inf, _DISTANCES)
