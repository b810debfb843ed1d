"""A field as arrays: the data with which a client evaluates the motion of a boundary at its own nodes.

Centres and grids belong to the reference mesh and stay the same in a session; the coefficients are the motion. A field
that is rebuilt from its arrays gives bitwise the same values; so does a part of it, inside its box.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.centres import CentreLayout
from mesh_motion_numerics.interpolation.interpolant import Interpolant
from mesh_motion_numerics.interpolation.kernels import basis_named
from mesh_motion_numerics.interpolation.polynomial import LinearBasis, Polynomial
from mesh_motion_numerics.interpolation.two_scale.interpolant import AnyInterpolant, TwoScaleInterpolant
from mesh_motion_numerics.interpolation.two_scale.nested_grid import NestedSpline
from mesh_motion_numerics.mesh.points import padded


@dataclass(frozen=True, eq=False)
class Field:
    """An interpolant of d components: a spline, if there are boxes, and sums over centres."""

    #: Plain values: ``basis``, ``radius``, ``centres`` (their number), the grid of all centres of the sum (``origin``,
    #: ``inverse_side``, ``extent``, ``shape``), and with a polynomial its ``centre`` and ``scale``. Without a spline
    #: the first sum is the coarse field. All others are compact levels, in their order.
    sums: Sequence[Mapping[str, Any]]
    centres: Floats  # (c, d), mesh length unit. The centres of all sums, one sum after the other
    #: (b, 14). The boxes of the spline, finest first: lower corner (3), inverse spacing, cells (3), first row of the
    #: box's coefficients among all; along each axis the first (3) and the last + 1 (3) of the coefficients that are
    #: present.
    boxes: Floats
    #: (r, d). For each sum its weights, then the coefficients of its polynomial; after all sums those of the spline.
    coefficients: Floats

    @classmethod
    def of(cls, interpolant: AnyInterpolant) -> Self:
        """Return the arrays of an interpolant."""
        sums, spline = _parts(interpolant)
        rows, boxes = [_rows(each) for each in sums], np.empty((0, 14))
        if spline is not None:
            first, last = np.zeros_like(spline.cells), _layers(spline.cells)
            boxes = np.column_stack(
                [spline.origin, spline.inverse_spacing, spline.cells, spline.start, first, last]
            )  # fmt: skip
            rows.append(spline.coefficients)
        centres = np.concatenate([each.control_points for each in sums])
        return cls([_described(each) for each in sums], centres, boxes, np.concatenate(rows))

    def differs_in_coefficients_only(self, other: Field) -> bool:
        """Whether another field has the same centres and boxes: both are of one boundary."""
        same = self.sums == other.sums and np.array_equal(self.boxes, other.boxes)
        return same and np.array_equal(self.centres, other.centres)

    def interpolant(self, like: AnyInterpolant | None = None) -> AnyInterpolant:
        """Rebuild the interpolant; faster if ``like`` is one of a field that differs in coefficients only."""
        centres, rows = _Taken(self.centres), _Taken(self.coefficients)
        layouts = [None] * len(self.sums) if like is None else [each.layout for each in _parts(like)[0]]
        sums = [_sum(described, centres, rows, at) for described, at in zip(self.sums, layouts, strict=True)]
        if len(self.boxes):
            spline = _spline(self.boxes, rows.rest(), self.centres.shape[1])
            return TwoScaleInterpolant(spline, tuple(sums))
        return sums[0] if len(sums) == 1 else TwoScaleInterpolant(sums[0], tuple(sums[1:]))

    def counted(self, places: Floats, weights: Floats) -> Floats:
        """The transpose: (r, k) derivatives by the coefficients, for (n, k) weights of the values at (n, d) places."""
        sums, spline = _parts(self.interpolant())
        rows, layouts = [], dict[tuple[str, float], CentreLayout]()
        for each in sums:
            law = each.basis.name, each.support_radius
            if law not in layouts:
                layouts[law] = CentreLayout.build(places, each.basis, each.support_radius)
            turned = Interpolant(places, weights, each.basis, each.support_radius, layouts[law])
            rows.append(evaluation.displacement(turned, each.control_points))
            if each.polynomial is not None:
                rows.append(each.polynomial.basis.matrix(places).T @ weights)
        if spline is not None:
            counts = replace(spline, coefficients=np.zeros((len(spline.coefficients), weights.shape[1])))
            counts.count(places, weights)
            rows.append(counts.coefficients[np.concatenate(list(_places(self.boxes)))])
        return np.concatenate(rows)

    def split(self, rows: Floats) -> tuple[Floats, list[Floats]]:
        """Split rows (r, k) of all coefficients: those of the spline or first sum, and those of each compact level."""
        ends = np.cumsum([each["centres"] + (1 + len(each["centre"]) if "scale" in each else 0) for each in self.sums])
        *levels, spline = np.split(rows, ends)
        return (spline, levels) if len(self.boxes) else (levels[0], levels[1:])

    def part(self, box: Floats) -> FieldPart:
        """Return the part of this field, and of fields with other coefficients, for the points of a box (2, d).

        From a sum: the cells of its grid in the box and next to it, with all their centres. From a spline: the
        coefficients that a point of the box uses.
        """
        sums, spline = _parts(self.interpolant())
        described, kept_centres, rows, boxes = [], [], [], self.boxes.copy()
        first_centre = first_row = 0
        for each, values in zip(sums, self.sums, strict=True):
            kept, count = _visited(each.layout, box), len(each.control_points)
            described.append({**values, "centres": len(kept)})
            kept_centres.append(first_centre + kept)
            polynomial = 0 if each.polynomial is None else len(each.polynomial.coefficients)
            rows += [first_row + kept, first_row + np.arange(count, count + polynomial)]
            first_centre, first_row = first_centre + count, first_row + count + polynomial
        if spline is not None:
            boxes[:, 8:] = [np.concatenate(_range(spline, number, box)) for number in range(len(boxes))]
            rows += [first_row + place for place in _places(boxes)]
        taken = np.concatenate(rows)
        own = Field(described, self.centres[np.concatenate(kept_centres)], boxes, self.coefficients[taken])
        return FieldPart(own, taken)


@dataclass(frozen=True, eq=False)
class FieldPart:
    """The part of fields of one boundary for the points of a box."""

    own: Field  # the part of one of these fields
    rows: Integers | slice  # (r,), or slice. The rows of the part among the coefficients of a whole field

    @classmethod
    def whole(cls, field: Field) -> Self:
        """Return the part that is the whole field."""
        return cls(field, slice(None))

    def of(self, coefficients: Floats) -> Field:
        """The part of a field with these coefficients (r, d)."""
        return replace(self.own, coefficients=coefficients[self.rows])


def _parts(interpolant: AnyInterpolant) -> tuple[list[Interpolant], NestedSpline | None]:
    """Yield the sums of the field, and its spline."""
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
    """Describe a sum without its arrays."""
    layout = each.layout
    found = {
        "basis": each.basis.name,
        "radius": float(each.support_radius),
        "centres": len(each.control_points),
        "origin": layout.origin.tolist(),
        "inverse_side": float(layout.inverse_side),
        "extent": float(layout.extent),
        "shape": layout.shape.tolist(),
    }
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
        """Take all remaining rows."""
        return self.next(len(self._rows))


def _sum(described: Mapping[str, Any], centres: _Taken, rows: _Taken, layout: CentreLayout | None) -> Interpolant:
    basis, radius, count = basis_named(described["basis"]), float(described["radius"]), int(described["centres"])
    points, weights, polynomial = centres.next(count), rows.next(count), None
    if "scale" in described:
        linear = LinearBasis(np.array(described["centre"]), float(described["scale"]))
        polynomial = Polynomial(linear, rows.next(points.shape[1] + 1))
    if layout is None:
        origin, shape = np.array(described["origin"]), np.array(described["shape"], dtype=np.int64)
        side, extent = float(described["inverse_side"]), float(described["extent"])
        layout = CentreLayout.on_grid(points, origin, side, extent, shape)
    return Interpolant(points, weights, basis, radius, layout, polynomial)


def _visited(layout: CentreLayout, box: Floats) -> Integers:
    """The centres, ascending, that a sum visits for points of the box (2, d): their cells are at most one cell from it.

    The cells of a row along x are contiguous; the cost depends on the rows in the box, not on all centres.
    """
    place = np.floor((padded(box) - layout.origin) * layout.inverse_side) + np.array([[-1.0], [1.0]])
    (x0, y0, z0), (x1, y1, z1) = np.clip(place, [[0], [-1]], [layout.shape, layout.shape - 1]).astype(np.int64)
    row = ((np.arange(z0, z1 + 1)[:, None] * layout.shape[1] + np.arange(y0, y1 + 1)) * layout.shape[0]).ravel()
    if x1 < x0 or not len(row):
        return np.empty(0, dtype=np.int64)
    first, last = layout.starts[row + x0], layout.starts[row + x1 + 1]
    counts = last - first
    visited = np.repeat(first - np.cumsum(counts) + counts, counts) + np.arange(int(counts.sum()))
    return np.sort(layout.order[visited])


def _layers(cells: Integers) -> Integers:
    """(b, 3) number of coefficients along each axis of boxes with ``cells`` (b, 3)."""
    return np.where(cells > 0, cells + 3, 1)


def _range(spline: NestedSpline, number: int, box: Floats) -> tuple[Integers, Integers]:
    """First (3,) and last + 1 (3,) coefficient of a spline's box along each axis for points of a box (2, d).

    The last box is that of the domain: it has every point that no other box has, and points outside it are moved to its
    rim. One more layer on each side allows for rounding.
    """
    cells = spline.cells[number]
    place = (padded(box) - spline.origin[number]) * spline.inverse_spacing[number]
    if number < len(spline.origin) - 1 and (np.any(place[1] < -1.0) or np.any(place[0] > cells + 1.0)):
        return np.zeros(3, dtype=np.int64), np.zeros(3, dtype=np.int64)
    first, last = np.clip(np.floor(place), 0, np.maximum(cells - 1, 0)).astype(np.int64)
    return np.maximum(first - 1, 0), np.minimum(last + 5, _layers(cells))


def _places(boxes: Floats) -> Iterator[Integers]:
    """The rows of the present coefficients of each box, among the rows of a whole spline."""
    for _, _, _, _, *numbers in boxes.astype(np.int64).tolist():
        cells, start, first, last = numbers[:3], numbers[3], numbers[4:7], numbers[7:]
        x, y, z = _layers(np.array(cells)).tolist()
        whole = start + np.arange(x * y * z).reshape(x, y, z)
        yield whole[tuple(slice(a, b) for a, b in zip(first, last, strict=True))].ravel()


def _spline(boxes: Floats, rows: Floats, dimension: int) -> NestedSpline:
    """Build the spline from its boxes and the present coefficients; all others are zero."""
    origin, inverse, cells_given, start, _ = np.split(boxes, [3, 4, 7, 8], axis=1)
    cells: Integers = np.ascontiguousarray(cells_given, dtype=np.int64)
    coefficients = np.zeros((int(np.prod(_layers(cells), axis=1).sum()), rows.shape[1]))
    coefficients[np.concatenate(list(_places(boxes)))] = rows
    return NestedSpline(
        np.ascontiguousarray(origin), inverse[:, 0].copy(), cells, start[:, 0].astype(np.int64), coefficients, dimension
    )
