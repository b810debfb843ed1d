"""Which box of points takes which box of centres through a polynomial, and of how many points.

Walks down the boxes of points with a list of the boxes of centres that are still to be settled. One that cannot reach a
box of points is dropped; one that a polynomial in that box can stand for, within the bound asked for a unit of weight
and at less cost than its points, is settled there; the others are left to the box's children, cut where they are
larger than it. What is left at a leaf is summed directly. So every centre counts once for every point, and the errors
add up to the bound times the sum of the weights at most.
"""

from __future__ import annotations

from dataclasses import dataclass

import mesh_motion_kernels as kernels
import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.numerics.interpolation.far_field.box_tree import BoxTree
from mesh_motion_server.numerics.interpolation.far_field.derivative_bounds import (
    ORDERS,
    DerivativeBounds,
    lebesgue_constant,
)

__all__ = ["Plan", "Runs", "make_plan"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

#: A polynomial is taken where its points are at most this share of the box's.
_SHARE = 0.8
#: Highest order by dimension: its evaluation at a point costs as much as that of so many basis functions.
_MOST = {1: 10, 2: 10, 3: 8}

_LEBESGUE = np.array([0.0, 0.0, *(lebesgue_constant(order) for order in ORDERS)])


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
    far, near, bound = kernels.plan_far_field(
        *(points.low / radius, points.high / radius, points.parent, points.points_of, points.children_of),
        *(centres.low / radius, centres.high / radius, centres.points_of, centres.children_of, weight),
        *(bounds.table, bounds.distances, bounds.reach, bounds.across, _LEBESGUE),
        tolerance,
        dimension,
        _MOST[dimension],
        _SHARE,
    )
    return Plan(_grouped(far), _grouped(near), bound)


def _grouped(entries: Indices) -> Runs:
    """Entries (e, 4) of box, order, first and last centre as groups, with adjacent runs joined."""
    group = entries[:, 0] * (ORDERS[-1] + 1) + entries[:, 1]
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
