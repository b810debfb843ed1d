"""Which box of points takes which box of centres through a polynomial, and of how many points.

Walks down the boxes of points with a list of the boxes of centres that are still to be settled. One that cannot reach a
box of points is dropped; one that a polynomial in that box can stand for, within the bound asked for a unit of weight
and at less cost than its points, is settled there; the others are left to the box's children, cut where they are
larger than it. What is left at a leaf is summed directly. So every centre counts once for every point, and the errors
add up to the bound times the sum of the weights at most.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mesh_motion_server.numerics.far_field.box_tree import BoxTree
from mesh_motion_server.numerics.far_field.derivative_bounds import ORDERS, DerivativeBounds, lebesgue_constant

__all__ = ["Plan", "Runs", "make_plan"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

#: A polynomial is taken where its points are at most this share of the box's.
_SHARE = 0.8
#: Highest order by dimension: its evaluation at a point costs as much as that of so many basis functions.
_MOST = {1: 10, 2: 10, 3: 8}

_LEBESGUE = np.array([0.0, 0.0, *(lebesgue_constant(order) for order in ORDERS)])
_FIRST_ORDER, _LAST_ORDER = ORDERS[0], ORDERS[-1]


@dataclass(frozen=True, eq=False)
class Runs:
    """For each of g groups the sorted centres that it sums over.

    Attributes
    ----------
    box : (g,) int64 array
        Ascending.
    order : (g,) int64 array
        Points an axis of the polynomial; 0 for the points of the box themselves.
    starts : (g + 1,) int64 array
    runs : (r, 2) int64 array
        First centre and one past the last; those of group g are ``runs[starts[g]:starts[g + 1]]``.
    """

    box: Indices
    order: Indices
    starts: Indices
    runs: Indices

    @property
    def centres(self) -> Indices:
        """(g,) number of centres of each group."""
        total = np.append(0, np.cumsum(self.runs[:, 1] - self.runs[:, 0]))
        return np.asarray(np.diff(total[self.starts]))


@dataclass(frozen=True, eq=False)
class Plan:
    """What is summed where.

    Attributes
    ----------
    far : Runs
        A group for each box and order of its polynomials.
    near : Runs
        A group for each leaf.
    bound : (b,) array
        Largest error at a point of each box that the polynomials of the box and those above it may make.
    """

    far: Runs
    near: Runs
    bound: Floats


def make_plan(
    points: BoxTree,
    centres: BoxTree,
    weight: Floats,
    bounds: DerivativeBounds,
    *,
    dimension: int,
    radius: float,
    tolerance: float,
) -> Plan:
    """The plan for sums over centres whose boxes' absolute weights sum up to ``weight`` (b,).

    Parameters
    ----------
    points, centres : BoxTree
    weight : (b,) array
    bounds : DerivativeBounds
    dimension : int
        Of the space, d: a polynomial has order^d points.
    radius : float, mesh length unit
        R.
    tolerance : float
        Error allowed for a unit of weight.
    """
    far, near, bound = _walk(
        (points.low / radius, points.high / radius, points.parent, points.points_of, points.children_of),
        (centres.low / radius, centres.high / radius, centres.points_of, centres.children_of, weight),
        (bounds.table, bounds.first, bounds.per_octave, bounds.reach, bounds.across, _LEBESGUE),
        tolerance,
        dimension,
        _MOST[dimension],
        _SHARE,
    )
    return Plan(_grouped(far), _grouped(near), bound)


def _grouped(entries: Indices) -> Runs:
    """Entries (e, 4) of box, order, first and last centre as groups, with adjacent runs joined."""
    group = entries[:, 0] * (_LAST_ORDER + 1) + entries[:, 1]
    entries = entries[np.argsort(group * (1 + np.max(entries[:, 2], initial=0)) + entries[:, 2])]
    new_group = np.ones(len(entries), dtype=bool)
    new_group[1:] = np.any(entries[1:, :2] != entries[:-1, :2], axis=1)
    new_run = new_group.copy()
    new_run[1:] |= entries[1:, 2] != entries[:-1, 3]
    first = np.flatnonzero(new_run)
    last = np.append(first[1:], len(entries))[: len(first)] - 1
    runs = np.stack([entries[first, 2], entries[last, 3]], axis=1)
    heads = np.flatnonzero(new_group)
    starts = np.append(np.searchsorted(first, heads), len(first))
    return Runs(entries[heads, 0].copy(), entries[heads, 1].copy(), starts, np.ascontiguousarray(runs))


@njit(cache=True, error_model="numpy")
def _room(entries, n):  # type: ignore[no-untyped-def]
    """Entries (e, …) with room for one more than n."""
    if n < len(entries):
        return entries
    larger = np.empty((2 * len(entries),) + entries.shape[1:], dtype=entries.dtype)  # noqa: RUF005 - for numba
    larger[:n] = entries[:n]
    return larger


@njit(cache=True, error_model="numpy")
def _separation(low, high, other_low, other_high):  # type: ignore[no-untyped-def]
    """Least and largest distance between points of two boxes (3,)."""
    near, far = 0.0, 0.0
    for m in range(3):
        gap = max(other_low[m] - high[m], low[m] - other_high[m], 0.0)
        reach = max(other_high[m] - low[m], high[m] - other_low[m])
        near += gap * gap
        far += reach * reach
    return math.sqrt(near), math.sqrt(far)


@njit(cache=True, error_model="numpy")
def _box_factors(low, high, lebesgue, factors):  # type: ignore[no-untyped-def]
    """``factors[p] = Σ_m Λ_p^(m−1) 2 (a_m/2)^p``, the longest side first; ``factors`` (max order + 1,)."""
    halves = np.sort(0.5 * (high - low))[::-1]
    for order in range(_FIRST_ORDER, _LAST_ORDER + 1):
        total, amplified = 0.0, 1.0
        for m in range(3):
            total += amplified * 2.0 * (0.5 * halves[m]) ** order
            amplified *= lebesgue[order]
        factors[order] = total


@njit(cache=True, error_model="numpy")
def _good_order(near, far, most, factors, bounds, tolerance):  # type: ignore[no-untyped-def]
    """The lowest order up to ``most`` that is good enough for two boxes, or 0; and its error for a unit of weight."""
    table, first, per_octave, reach, across, _ = bounds
    if far > reach:
        most = min(most, across)
    column = 0
    if near > 0.0:
        column = min(max(math.floor((math.log2(near) - first) * per_octave) + 1, 0), table.shape[1] - 1)
    for order in range(_FIRST_ORDER, most + 1):
        error = table[order, column] * factors[order]
        if error <= tolerance:
            return order, error
    return 0, 0.0


@njit(cache=True, error_model="numpy")
def _entered(entries, n, box, order, run):  # type: ignore[no-untyped-def]
    """Entries (e, 4) with one more, of a run (2,) of centres; and their number."""
    entries = _room(entries, n)
    entries[n] = box, order, run[0], run[1]
    return entries, n + 1


@njit(cache=True, error_model="numpy")
def _pushed(boxes, n, first, last):  # type: ignore[no-untyped-def]
    """Boxes (e,) with first … last - 1 behind n of them; and their number."""
    for box in range(first, last):
        boxes = _room(boxes, n)
        boxes[n] = box
        n += 1
    return boxes, n


@njit(cache=True, error_model="numpy")
def _worthwhile_order(size, highest, d, share):  # type: ignore[no-untyped-def]
    """The highest order whose polynomial of order^d points is worth its while for a box of ``size`` points."""
    most = highest
    while most >= _FIRST_ORDER and most**d > share * size:
        most -= 1
    return most


@njit(cache=True, error_model="numpy")
def _walk(points, centres, bounds, tolerance, d, highest, share):  # type: ignore[no-untyped-def]
    """Far and near entries (e, 4) of box, order, first and last centre; the bound (b,) of each box of points."""
    low, high, parent, points_of, children_of = points
    other_low, other_high, centres_of, parts_of, weight = centres
    reach, lebesgue = bounds[3], bounds[5]
    far, near = np.empty((1024, 4), dtype=np.int64), np.empty((1024, 4), dtype=np.int64)
    n_far, n_near = 0, 0
    left = np.empty(1024, dtype=np.int64)  # boxes of centres that a box of points leaves to its children
    left_of = np.zeros((len(parent), 2), dtype=np.int64)
    left[0], n_left = 0, 1
    bound, factors = np.zeros(len(parent)), np.zeros(_LAST_ORDER + 1)
    stack = np.empty(1024, dtype=np.int64)
    for box in range(len(parent)):
        leaf = children_of[box, 0] == children_of[box, 1]
        begin, end = (0, 1) if box == 0 else (left_of[parent[box], 0], left_of[parent[box], 1])
        bound[box] = 0.0 if box == 0 else bound[parent[box]]
        _box_factors(low[box], high[box], lebesgue, factors)
        most = _worthwhile_order(points_of[box, 1] - points_of[box, 0], highest, d, share)
        extent = np.max(high[box] - low[box])
        left_of[box, 0] = n_left
        for i in range(begin, end):
            stack[0], depth = left[i], 1
            while depth > 0:
                depth -= 1
                other = stack[depth]
                nearest, furthest = _separation(low[box], high[box], other_low[other], other_high[other])
                if nearest > reach:
                    continue
                order, error = _good_order(nearest, furthest, most, factors, bounds, tolerance)
                cut = parts_of[other, 0] < parts_of[other, 1]
                if order > 0:
                    far, n_far = _entered(far, n_far, box, order, centres_of[other])
                    bound[box] += error * weight[other]
                elif cut and (leaf or np.max(other_high[other] - other_low[other]) > extent):
                    stack, depth = _pushed(stack, depth, parts_of[other, 0], parts_of[other, 1])
                elif leaf:
                    near, n_near = _entered(near, n_near, box, 0, centres_of[other])
                else:
                    left, n_left = _pushed(left, n_left, other, other + 1)
        left_of[box, 1] = n_left
    return far[:n_far].copy(), near[:n_near].copy(), bound
