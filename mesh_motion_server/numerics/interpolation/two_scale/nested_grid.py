"""A field known on the points of nested boxes, and a cubic spline through them.

On each box the field becomes a uniform cubic B-spline by the local quasi-interpolation ``c = (8 f − f₋ − f₊) / 6``
along each axis, of fourth order. A box' outer layers take the coefficients of its parent, subdivided, and over the next
layers pass into its own: both splines are the same at its rim, so the field is twice continuously differentiable.

References
----------
C. de Boor, *A Practical Guide to Splines*, Springer 2001, ch. XII (quasi-interpolants), ch. IX (subdivision).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import mesh_motion_kernels as kernels
import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.numerics.interpolation.two_scale.boxes import Box

__all__ = ["NestedGrid", "NestedSpline"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Layers of coefficients that are the parent's: those of which a cubic spline's value, slope and curvature at the rim
#: consist; and layers over which a box passes into its own.
_RIM, _BLEND = 3, 3


@dataclass(frozen=True, eq=False)
class NestedSpline:
    """A spline on nested boxes.

    Attributes
    ----------
    origin : (b, 3) array, mesh length unit
        Lower corner of each box, finest first.
    inverse_spacing : (b,) array
    cells : (b, 3) int64 array
    start : (b,) int64 array
        First row of each box' coefficients.
    coefficients : (c, k) array
        Box by box, x slowest.
    dimension : int
    """

    origin: Floats
    inverse_spacing: Floats
    cells: Indices
    start: Indices
    coefficients: Floats
    dimension: int

    def values(self, points: Floats, out: Floats) -> None:
        """Fill ``out`` (n, k) at (n, d) points; a point outside all boxes takes the value of the nearest rim."""
        kernels.spline_values(np.ascontiguousarray(points), *self._boxes, self.coefficients, out)

    def gradients(self, points: Floats, out: Floats) -> None:
        """Fill ``out`` (n, k, d) at (n, d) points."""
        kernels.spline_gradients(np.ascontiguousarray(points), *self._boxes, self.coefficients, out)

    @property
    def _boxes(self) -> tuple[Floats, Floats, Indices, Indices]:
        """What the compiled loops know of the boxes."""
        return self.origin, self.inverse_spacing, self.cells, self.start


@dataclass(frozen=True, eq=False)
class NestedGrid:
    """The points of nested boxes.

    Attributes
    ----------
    boxes : list of Box
        Coarsest first.
    low : (3,) array, mesh length unit
        Lower corner of the domain.
    dimension : int
    """

    boxes: list[Box]
    low: Floats
    dimension: int

    def points(self) -> Floats:
        """(g, d) points at which the field is needed, box by box."""
        return np.concatenate([self.points_of(box) for box in self.boxes])

    def points_of(self, box: Box) -> Floats:
        """(g, d) points of one box, x slowest."""
        axes = [
            corner + box.spacing * np.arange(count)
            for corner, count in zip(self.corner(box), self.counts(box), strict=False)
        ]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, self.dimension)

    def corner(self, box: Box) -> Floats:
        """(3,) first point of a box, two before its own."""
        return np.asarray(self.low + box.spacing * (box.first - 2.0))

    def counts(self, box: Box) -> tuple[int, ...]:
        """Points along each axis of a box, two more than its own on every side."""
        return tuple(int(n) + 5 for n in box.cells[: self.dimension])

    def spline(self, values: Floats) -> NestedSpline:
        """The spline of values (g, k) at :meth:`points`."""
        coefficients: list[Floats] = []
        first = 0
        for box in self.boxes:
            own = values[first : first + box.grid_points].reshape(*self.counts(box), -1)
            first += box.grid_points
            for axis in range(self.dimension):
                own = _quasi_interpolated(own, axis)
            if box.parent >= 0:
                own = self._blended(own, box, coefficients[box.parent])
            coefficients.append(own)
        return self._packed(coefficients)

    def _blended(self, own: Floats, box: Box, parents: Floats) -> Floats:
        """Coefficients that pass from the parent's at the rim to the box' own."""
        parent = self.boxes[box.parent]
        inherited = parents
        for axis in range(self.dimension):
            first = int(box.first[axis]) // 2 - int(parent.first[axis])
            inherited = _subdivided(inherited, axis, first, int(box.cells[axis]))
        share = np.ones(1)
        for axis in range(self.dimension):
            share = np.multiply.outer(share, _share(box, int(self.boxes[0].cells[axis]), axis))
        share = share.reshape(own.shape[:-1])[..., None]
        return np.ascontiguousarray(inherited + share * (own - inherited))

    def _packed(self, coefficients: list[Floats]) -> NestedSpline:
        """All boxes in one array, the finest first: a point takes the first that holds it."""
        order = range(len(self.boxes) - 1, -1, -1)
        rows = [coefficients[i].reshape(-1, coefficients[i].shape[-1]) for i in order]
        boxes = [self.boxes[i] for i in order]
        return NestedSpline(
            np.stack([self.low + box.spacing * box.first for box in boxes]),
            np.array([1.0 / box.spacing for box in boxes]),
            np.stack([box.cells for box in boxes]),
            np.cumsum([0, *(len(part) for part in rows[:-1])]),
            np.concatenate(rows) if len(rows) > 1 else np.ascontiguousarray(rows[0]),
            self.dimension,
        )


def _quasi_interpolated(values: Floats, axis: int) -> Floats:
    """(8 f − f₋ − f₊) / 6 along an axis, which loses its first and last entry."""
    before, after = values.shape[:axis], values.shape[axis + 1 :]
    out = np.empty((*before, values.shape[axis] - 2, *after))
    rows, stride = math.prod(before), math.prod(after)
    kernels.quasi_interpolate(np.ascontiguousarray(values).reshape(rows, -1), stride, out.reshape(rows, -1))
    return out


def _subdivided(coefficients: Floats, axis: int, first: int, cells: int) -> Floats:
    """Coefficients −1 … cells + 1 of the halved spacing along an axis, from the parent's cell ``first`` on."""
    c = np.moveaxis(coefficients, axis, 0)[first : first + cells // 2 + 3]  # parent's −1 … cells / 2 + 1
    out = np.empty((cells + 3, *c.shape[1:]))
    out[1::2] = (c[:-2] + 6.0 * c[1:-1] + c[2:]) / 8.0
    out[0::2] = 0.5 * (c[:-1] + c[1:])
    return np.moveaxis(out, 0, axis)


def _share(box: Box, domain_cells: int, axis: int) -> Floats:
    """(cells + 3,) share of its own coefficients along an axis; 1 towards a side that is the domain's."""
    n = int(box.cells[axis]) + 3
    rise = _smooth_step((np.arange(n) - (_RIM - 1.0)) / (_BLEND + 1.0))
    share = np.ones(n)
    if box.first[axis] > 0:
        share = np.minimum(share, rise)
    if box.first[axis] + box.cells[axis] < domain_cells << box.level:
        share = np.minimum(share, rise[::-1])
    return share


def _smooth_step(t: NDArray[np.floating]) -> Floats:
    """0 up to t = 0, 1 from t = 1 on, twice continuously differentiable between."""
    t = np.clip(t, 0.0, 1.0)
    return np.asarray(t**3 * (10.0 - 15.0 * t + 6.0 * t**2))
