"""Sums over centres at the points of a uniform grid, block by block: near centres directly, far ones interpolated.

Seen from a block of grid points, the function of a centre far away is a polynomial but for a little, of a lower order
the further it is: its sum with all others of the kind is formed at so many Chebyshev points of the block and
interpolated to those of the next order, and from the highest to the grid's points, along one axis after the other. What
is near is summed at the grid's points themselves.

References
----------
W. Fong, E. Darve, "The black-box fast multipole method", J. Comput. Phys. 228 (2009) 8712–8725.
"""

from __future__ import annotations

import math
from itertools import pairwise, product

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from mesh_motion_server.numerics.evaluation import Evaluator
from mesh_motion_server.numerics.interpolant import Interpolant
from mesh_motion_server.numerics.kernel_maps import map_phi
from mesh_motion_server.numerics.threads import threads_for
from mesh_motion_server.numerics.two_scale.nested_grid import NestedGrid

__all__ = ["grid_sums", "on_grid"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Chebyshev points along an axis of a block for its furthest and nearest far centres, and grid points at most.
_LEAST, _ORDER, _SIDE = 4, 8, 13
#: Half widths from a block's middle beyond which a centre is far. Then the interpolation leaves at most 6e-5 of the
#: largest displacement on the wing in a cube, 2e-6 in the mean: a thirtieth of what the spline between the grid's
#: points leaves there. All sums directly take three times as long.
_FAR = 1.8
#: Functions so smooth that large weights cancel: all their far centres get the highest order.
_SMOOTH = ("wendland-c4", "wendland-c6")
#: Products of grid points and centres below which blocks do not pay.
_WORTHWHILE = 2e6


def on_grid(interpolant: Interpolant, grid: NestedGrid, evaluator: Evaluator) -> Floats:
    """(n, k) values of an interpolant at the points of nested boxes, by blocks where that pays."""
    parts = []
    for box in grid.boxes:
        low, counts = grid.corner(box), grid.counts(box)
        values = grid_sums(interpolant, low, box.spacing, counts)
        if values is None:
            values = evaluator.displacement(interpolant, grid.points_of(box))
        elif interpolant.polynomial is not None:
            values += interpolant.polynomial(grid.points_of(box))
        parts.append(values)
    return np.concatenate(parts) if len(parts) > 1 else parts[0]


def grid_sums(interpolant: Interpolant, low: Floats, spacing: float, counts: tuple[int, ...]) -> Floats | None:
    """``Σ_j w_j φ(|x − x_j| / R)`` at the points of a grid; None where blocks do not pay or do not suit.

    They suit in three dimensions, and where φ varies on the scale of its distance from a centre: for a support radius
    as large as the distances.

    Parameters
    ----------
    interpolant : Interpolant
        Its polynomial is left out.
    low : (3,) array, mesh length unit
        First point of the grid.
    spacing : float, mesh length unit
    counts : tuple of int
        Points along each axis.

    Returns
    -------
    (n, k) array or None
        x slowest.
    """
    centres = interpolant.control_points
    if len(counts) != 3 or math.prod(counts) * len(centres) < _WORTHWHILE:
        return None
    high = low + spacing * (np.array(counts) - 1.0)
    reach = np.maximum(high, centres.max(axis=0)) - np.minimum(low, centres.min(axis=0))
    if float(np.sqrt(np.sum(reach**2))) > interpolant.support_radius:
        return None
    out = np.empty((*counts, interpolant.weights.shape[1]))
    blocks = np.array(list(product(*(_ranges(count) for count in counts))), dtype=np.int64)
    with threads_for(0.5 * math.prod(counts) * len(centres)):
        _sum_blocks(
            interpolant.basis.code,
            np.ascontiguousarray(centres.T),
            np.ascontiguousarray(interpolant.weights.T),
            1.0 / interpolant.support_radius,
            low,
            spacing,
            blocks,
            _ALL_HIGHEST if interpolant.basis.name in _SMOOTH else _DISTANCES,
            _NODES,
            _INTERPOLATIONS,
            out,
        )
    return out.reshape(-1, out.shape[-1])


def _ranges(count: int) -> list[tuple[int, int]]:
    """[first, last) of about equal parts of an axis, none longer than a block's side."""
    parts = -(-count // _SIDE)
    return list(pairwise(count * i // parts for i in range(parts + 1)))


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


def _chebyshev() -> Floats:
    """(order + 1, order) points of the first kind in [−1, 1], of every order."""
    out = np.zeros((_ORDER + 1, _ORDER))
    for order in range(_LEAST, _ORDER + 1):
        out[order, :order] = np.cos(np.pi * (np.arange(order) + 0.5) / order)
    return out


def _interpolations(nodes: Floats) -> Floats:
    """(order + 1, side + 1, order, side) values of the Lagrange polynomials of every order.

    At 2 … side equidistant points of [−1, 1], and in place 0 at the Chebyshev points of the next order.
    """
    out = np.zeros((_ORDER + 1, _SIDE + 1, _ORDER, _SIDE))
    for order in range(_LEAST, _ORDER + 1):
        own = nodes[order, :order]
        others = [(size, np.linspace(-1.0, 1.0, size)) for size in range(2, _SIDE + 1)]
        if order < _ORDER:
            others.append((0, nodes[order + 1, : order + 1]))
        for size, places in others:
            for a in range(order):
                rest = np.delete(own, a)
                values = np.prod((places[:, None] - rest) / (own[a] - rest), axis=1)
                out[order, size, a, : len(places)] = values
    return out


_DISTANCES, _NODES, _INTERPOLATIONS = _distances(), _chebyshev(), _interpolations(_chebyshev())
_ALL_HIGHEST = np.where(np.arange(_ORDER + 1) < _ORDER, np.inf, _DISTANCES)


@njit(cache=True, error_model="numpy", parallel=True)
def _sum_blocks(
    code: int,
    centres: Floats,
    weights: Floats,
    inverse_radius: float,
    low: Floats,
    spacing: float,
    blocks: Indices,
    distances: Floats,
    nodes: Floats,
    interpolations: Floats,
    out: Floats,
) -> None:
    """Fill ``out`` (nx, ny, nz, k); ``blocks`` (b, 3, 2) are [first, last) along each axis."""
    for b in prange(len(blocks)):
        _sum_block(
            code, centres, weights, inverse_radius, low, spacing, blocks[b], distances, nodes, interpolations, out
        )


@njit(cache=True, error_model="numpy")
def _sum_block(code, centres, weights, inverse_radius, low, spacing, block, distances, nodes, interpolations, out):  # type: ignore[no-untyped-def]
    """One block of :func:`_sum_blocks`."""
    sizes = block[:, 1] - block[:, 0]
    middle = low + 0.5 * spacing * (block[:, 0] + block[:, 1] - 1)
    half = 0.5 * spacing * (sizes - 1)
    orders = _orders(centres, middle, half.max(), distances)
    places = _tensor(
        low[0] + spacing * np.arange(block[0, 0], block[0, 1]),
        low[1] + spacing * np.arange(block[1, 0], block[1, 1]),
        low[2] + spacing * np.arange(block[2, 0], block[2, 1]),
    )
    totals = np.zeros((len(weights), places.shape[1]))
    _accumulate(code, places, centres, weights, np.flatnonzero(orders == 0), inverse_radius, totals)
    few = np.zeros((len(weights), _LEAST**3))
    for order in range(_LEAST, _ORDER + 1):
        own, n = nodes[order, :order], order + 1
        proxies = _tensor(middle[0] + half[0] * own, middle[1] + half[1] * own, middle[2] + half[2] * own)
        _accumulate(code, proxies, centres, weights, np.flatnonzero(orders == order), inverse_radius, few)
        if order < _ORDER:
            raised, up = np.zeros((len(weights), n**3)), interpolations[order, 0]
            for c in range(len(weights)):
                _interpolate(few[c], order, up, up, up, n, n, n, raised[c])
            few = raised
    last = interpolations[_ORDER]
    mx, my, mz = last[sizes[0]], last[sizes[1]], last[sizes[2]]
    for c in range(len(weights)):
        _interpolate(few[c], _ORDER, mx, my, mz, sizes[0], sizes[1], sizes[2], totals[c])
    at = 0
    for ix in range(block[0, 0], block[0, 1]):
        for iy in range(block[1, 0], block[1, 1]):
            for iz in range(block[2, 0], block[2, 1]):
                for c in range(len(weights)):
                    out[ix, iy, iz, c] = totals[c, at]
                at += 1


@njit(cache=True, error_model="numpy")
def _orders(centres, middle, half, distances):  # type: ignore[no-untyped-def]
    """(n,) the order of interpolation that each centre asks for; 0 for those that are near."""
    orders = np.zeros(centres.shape[1], dtype=np.int64)
    for j in range(centres.shape[1]):
        square = 0.0
        for axis in range(3):
            square += max(abs(centres[axis, j] - middle[axis]) - half, 0.0) ** 2
        away = half + math.sqrt(square)  # opposite a face the distance from the middle, opposite a corner more
        for order in range(_ORDER, _LEAST - 1, -1):
            if away > distances[order] * half:
                orders[j] = order
    return orders


@njit(cache=True, error_model="numpy")
def _tensor(x, y, z):  # type: ignore[no-untyped-def]
    """(3, n) coordinates of the points of a grid."""
    out, at = np.empty((3, len(x) * len(y) * len(z))), 0
    for i in range(len(x)):
        for j in range(len(y)):
            for m in range(len(z)):
                out[0, at], out[1, at], out[2, at] = x[i], y[j], z[m]
                at += 1
    return out


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def _accumulate(code, places, centres, weights, members, inverse_radius, totals):  # type: ignore[no-untyped-def]
    """Add the functions of some centres at places (3, n) to ``totals`` (k, n), one centre after the other."""
    values = np.empty(places.shape[1])
    xs, ys, zs = places[0], places[1], places[2]
    for j in members:
        x, y, z = centres[0, j], centres[1, j], centres[2, j]
        for i in range(values.size):
            dx, dy, dz = xs[i] - x, ys[i] - y, zs[i] - z
            values[i] = math.sqrt(dx * dx + dy * dy + dz * dz) * inverse_radius
        map_phi(code, values)
        for c in range(len(weights)):
            weight, row = weights[c, j], totals[c]
            for i in range(values.size):
                row[i] += weight * values[i]


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def _interpolate(few, order, mx, my, mz, nx, ny, nz, total):  # type: ignore[no-untyped-def]
    """Add the interpolation of values (order³,) to ``total`` at nx × ny × nz points, by each axis' (order, points)."""
    slabs, lines = np.zeros((nx, order * order)), np.zeros((nx * ny, order))
    for i in range(nx):
        for a in range(order):
            for r in range(order * order):
                slabs[i, r] += mx[a, i] * few[a * order * order + r]
    for i in range(nx):
        for j in range(ny):
            for a in range(order):
                for r in range(order):
                    lines[i * ny + j, r] += my[a, j] * slabs[i, a * order + r]
    for line in range(nx * ny):
        for a in range(order):
            for m in range(nz):
                total[line * nz + m] += mz[a, m] * lines[line, a]
