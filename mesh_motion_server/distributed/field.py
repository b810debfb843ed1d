"""A field as arrays: what a client needs to evaluate the motion of a boundary at nodes of its own.

Centres and grid belong to the reference mesh and stay the same in a session; the coefficients are the motion. A field
that is made again from its arrays gives bitwise the same values.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.numerics.interpolation.centres import CentreLayout
from mesh_motion_server.numerics.interpolation.interpolant import Interpolant
from mesh_motion_server.numerics.interpolation.kernels import DEFAULT_BASIS, basis_named
from mesh_motion_server.numerics.interpolation.polynomial import LinearBasis, Polynomial
from mesh_motion_server.numerics.interpolation.two_scale.interpolant import AnyInterpolant, TwoScaleInterpolant
from mesh_motion_server.numerics.interpolation.two_scale.nested_grid import NestedSpline

__all__ = ["Field"]

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Field:
    """An interpolant of d components: a spline, if there are boxes, and sums over centres.

    Attributes
    ----------
    sums : sequence of dict
        Plain values: ``basis``, ``radius``, ``centres`` (their number), and with a polynomial its ``centre`` and
        ``scale``. Without a spline the first sum is the coarse field. All others are compact levels, in their order.
    centres : (c, d) array, mesh length unit
        Of all sums, one after the other.
    boxes : (b, 8) array
        Of the spline, finest first: lower corner (3), inverse spacing, cells (3), first row of its coefficients.
    coefficients : (r, d) array
        Of each sum its weights, and behind them its polynomial's; then those of the spline.
    """

    sums: Sequence[Mapping[str, Any]]
    centres: Floats
    boxes: Floats
    coefficients: Floats

    @classmethod
    def of(cls, interpolant: AnyInterpolant) -> Self:
        """The arrays of an interpolant."""
        sums, spline = _parts(interpolant)
        rows, boxes = [_rows(each) for each in sums], np.empty((0, 8))
        if spline is not None:
            boxes = np.column_stack([spline.origin, spline.inverse_spacing, spline.cells, spline.start])
            rows.append(spline.coefficients)
        centres = np.concatenate([each.control_points for each in sums])
        return cls([_described(each) for each in sums], centres, boxes, np.concatenate(rows))

    def differs_in_coefficients_only(self, other: Field) -> bool:
        """Whether another field has the same centres and boxes: both are of one boundary."""
        same = self.sums == other.sums and np.array_equal(self.boxes, other.boxes)
        return same and np.array_equal(self.centres, other.centres)

    def interpolant(self, like: AnyInterpolant | None = None) -> AnyInterpolant:
        """The interpolant again; faster if it is ``like`` one of a field that differs in coefficients only."""
        centres, rows = _Taken(self.centres), _Taken(self.coefficients)
        layouts = [None] * len(self.sums) if like is None else [each.layout for each in _parts(like)[0]]
        sums = [_sum(described, centres, rows, at) for described, at in zip(self.sums, layouts, strict=True)]
        if len(self.boxes):
            origin, inverse, cells, start = np.split(self.boxes, [3, 4, 7], axis=1)
            whole = (np.ascontiguousarray(cells, dtype=np.int64), start[:, 0].astype(np.int64))
            spline = NestedSpline(
                np.ascontiguousarray(origin), inverse[:, 0].copy(), *whole, rows.rest(), self.centres.shape[1]
            )
            return TwoScaleInterpolant(spline, tuple(sums), basis_named(DEFAULT_BASIS), 0)
        return sums[0] if len(sums) == 1 else TwoScaleInterpolant(sums[0], tuple(sums[1:]), sums[0].basis, 0)


def _parts(interpolant: AnyInterpolant) -> tuple[list[Interpolant], NestedSpline | None]:
    """Its sums, and its spline."""
    if isinstance(interpolant, Interpolant):
        return [interpolant], None
    coarse = interpolant.coarse
    if isinstance(coarse, NestedSpline):
        return list(interpolant.levels), coarse
    return [coarse, *interpolant.levels], None


def _rows(each: Interpolant) -> Floats:
    """The coefficients (r, d) of a sum."""
    return each.weights if each.polynomial is None else np.concatenate([each.weights, each.polynomial.coefficients])


def _described(each: Interpolant) -> dict[str, Any]:
    """A sum without its arrays."""
    found = {"basis": each.basis.name, "radius": float(each.support_radius), "centres": len(each.control_points)}
    if each.polynomial is None:
        return found
    linear = each.polynomial.basis
    return found | {"centre": linear.centre.tolist(), "scale": float(linear.scale)}


class _Taken:
    """Takes rows off an array (r, d), one part after the other."""

    def __init__(self, rows: Floats) -> None:
        self._rows = rows

    def next(self, count: int) -> Floats:
        """The next rows."""
        taken, self._rows = self._rows[:count], self._rows[count:]
        return np.ascontiguousarray(taken)

    def rest(self) -> Floats:
        """All that are left."""
        return self.next(len(self._rows))


def _sum(described: Mapping[str, Any], centres: _Taken, rows: _Taken, layout: CentreLayout | None) -> Interpolant:
    basis, radius, count = basis_named(described["basis"]), float(described["radius"]), int(described["centres"])
    points, weights, polynomial = centres.next(count), rows.next(count), None
    if "scale" in described:
        linear = LinearBasis(np.array(described["centre"]), float(described["scale"]))
        polynomial = Polynomial(linear, rows.next(points.shape[1] + 1))
    layout = CentreLayout.build(points, basis, radius) if layout is None else layout
    return Interpolant(points, weights, basis, radius, layout, polynomial)
