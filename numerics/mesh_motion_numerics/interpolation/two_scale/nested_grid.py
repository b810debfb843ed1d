"""A field known on the points of nested boxes, and a cubic spline through them.

On each box the field becomes a uniform cubic B-spline by the local quasi-interpolation ``c = (8 f − f₋ − f₊) / 6``
along each axis, of fourth order. The outer layers of a box have the subdivided coefficients of its parent; over the
next layers these are blended into the box's own coefficients. So both splines are equal at the rim of the box, and the
field is twice continuously differentiable.

References
----------
C. de Boor, *A Practical Guide to Splines*, Springer 2001, ch. XII (quasi-interpolants), ch. IX (subdivision).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import mesh_motion_kernels as kernels
import numpy as np
from numpy.typing import NDArray

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.interpolation.two_scale.boxes import Box

#: Number of layers with the parent's coefficients: those that give a cubic spline's value, slope and curvature at the
#: rim; and number of layers over which they are blended into the box's own.
_RIM, _BLEND = 3, 3


@dataclass(frozen=True, eq=False)
class NestedSpline:
    """A spline on nested boxes."""

    origin: Floats  # (b, 3), mesh length unit. Lower corner of each box, finest first
    inverse_spacing: Floats  # (b,)
    cells: Integers  # (b, 3)
    start: Integers  # (b,). First row of each box's coefficients
    coefficients: Floats  # (c, k). Box by box, x slowest
    dimension: int

    def values(self, points: Floats) -> Floats:
        """(n, k) values at (n, d) points; a point outside all boxes takes the value of the nearest rim."""
        out = np.empty((len(points), self.coefficients.shape[1]))
        kernels.spline_values(np.ascontiguousarray(points), *self._boxes, self.coefficients, out)
        return out

    def gradients(self, points: Floats) -> Floats:
        """(n, k, d) gradients at (n, d) points."""
        out = np.empty((len(points), self.coefficients.shape[1], self.dimension))
        kernels.spline_gradients(np.ascontiguousarray(points), *self._boxes, self.coefficients, out)
        return out

    def count(self, points: Floats, weights: Floats) -> None:
        """Add to the coefficients their derivatives for (n, k) weights of the values at (n, d) points."""
        points, weights = np.ascontiguousarray(points), np.ascontiguousarray(weights)
        kernels.add_spline_coefficients(points, *self._boxes, weights, self.coefficients)

    @property
    def _boxes(self) -> tuple[Floats, Floats, Integers, Integers]:
        """The arguments of the compiled loops for the boxes."""
        return self.origin, self.inverse_spacing, self.cells, self.start


@dataclass(frozen=True, eq=False)
class NestedGrid:
    """The points of nested boxes."""

    boxes: list[Box]  # Coarsest first
    low: Floats  # (3,), mesh length unit. Lower corner of the domain
    dimension: int

    def points(self) -> Floats:
        """(g, d) points at which the field is evaluated, box by box."""
        return np.concatenate([self.points_of(box) for box in self.boxes])

    def points_of(self, box: Box) -> Floats:
        """(g, d) points of one box, x slowest."""
        axes = [
            corner + box.spacing * np.arange(count)
            for corner, count in zip(self.corner(box), self.counts(box), strict=False)
        ]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, self.dimension)

    def corner(self, box: Box) -> Floats:
        """(3,) first point of a box's evaluation points, two before the box's own corner."""
        return np.asarray(self.low + box.spacing * (box.first - 2.0))

    def counts(self, box: Box) -> tuple[int, ...]:
        """Number of points along each axis of a box, two more than its own on every side."""
        return tuple(int(n) + 5 for n in box.cells[: self.dimension])

    def spline(self, values: Floats) -> NestedSpline:
        """Return the spline of values (g, k) at :meth:`points`."""
        packed, starts = self._packed(np.empty, values.shape[1])
        coefficients: list[Floats] = []
        first = 0
        for box, row, size in zip(self.boxes, starts, self._sizes, strict=True):
            own = values[first : first + box.grid_points].reshape(*self.counts(box), -1)
            first += box.grid_points
            for axis in range(self.dimension):
                out = packed.coefficients[row : row + size] if axis == self.dimension - 1 else None
                own = _quasi_interpolated(own, axis, out)
            if box.parent >= 0:
                self._blend(own, box, coefficients[box.parent])
            coefficients.append(own)
        return packed

    def spline_transposed(self, *weighted: tuple[Floats, Floats], of_coefficients: Floats | None = None) -> Floats:
        """(g, k) derivatives by the values at :meth:`points`, for (n, k) weights of the spline at (n, d) points.

        Each argument has points with their weights. ``of_coefficients`` (r, k): weights of the spline's
        coefficients, in addition.
        """
        components = weighted[0][1].shape[1]
        packed, starts = self._packed(np.zeros, components)
        for points, weights in weighted:
            packed.count(points, weights)
        if of_coefficients is not None:
            packed.coefficients[:] += of_coefficients
        own = [
            packed.coefficients[row : row + size].reshape(*(box.cells[: self.dimension] + 3), -1)
            for box, row, size in zip(self.boxes, starts, self._sizes, strict=True)
        ]
        values = []
        for box, found in zip(self.boxes[::-1], own[::-1], strict=True):  # each box before its parent
            # transposed: the same differences along an axis, with zeros beyond both ends
            counted = np.zeros((*(n + 4 for n in found.shape[:-1]), components))
            inner = counted[(slice(2, -2),) * self.dimension]
            inner[:] = self._blend_transposed(found, box, own[box.parent]) if box.parent >= 0 else found
            for axis in range(self.dimension):
                counted = _quasi_interpolated(counted, axis)
            values.append(counted.reshape(-1, components))
        return np.concatenate(values[::-1])

    @property
    def _sizes(self) -> list[int]:
        """Number of coefficients of each box."""
        return [math.prod(int(n) + 3 for n in box.cells[: self.dimension]) for box in self.boxes]

    def _packed(self, make: Callable[[tuple[int, int]], Floats], components: int) -> tuple[NestedSpline, Integers]:
        """Make a spline whose coefficients NumPy allocates; return also the first coefficient (b,) of each box."""
        order = self.boxes[::-1]  # finest first: a point uses the first box that contains it
        start = np.cumsum([0, *self._sizes[::-1]])
        spline = NestedSpline(
            np.stack([self.low + box.spacing * box.first for box in order]),
            np.array([1.0 / box.spacing for box in order]),
            np.stack([box.cells for box in order]),
            start[:-1],
            make((int(start[-1]), components)),
            self.dimension,
        )
        return spline, start[-2::-1]

    def _blend(self, own: Floats, box: Box, parents: Floats) -> None:
        """Blend a box's own coefficients with the parent's at the rim."""
        missing, (first, shares) = 3 - self.dimension, self._blending(box)
        kernels.blend_with_parent(
            _as_cube(parents), np.append(np.zeros(missing, int), first), *[np.ones(1)] * missing, *shares, _as_cube(own)
        )

    def _blend_transposed(self, own: Floats, box: Box, parents: Floats) -> Floats:
        """The transpose: return the own coefficients' share, and add the parent's share to its coefficients."""
        first, shares = self._blending(box)
        share = np.ones(1)
        for axis_share in shares:
            share = share[..., None] * axis_share
        share = share[0][..., None]
        inherited = (1.0 - share) * own
        for axis, start in enumerate(first):
            matrix = _subdivision(inherited.shape[axis], int(start), parents.shape[axis])
            inherited = np.moveaxis(np.tensordot(matrix, inherited, axes=(0, axis)), 0, axis)
        parents += inherited
        return np.asarray(share * own)

    def _blending(self, box: Box) -> tuple[Integers, list[Floats]]:
        """The parent's first layer (d,) at a box, and the share of the box's own coefficients along each axis."""
        first = (box.first // 2 - self.boxes[box.parent].first)[: self.dimension]
        return first, [_share(box, int(self.boxes[0].cells[axis]), axis) for axis in range(self.dimension)]


def _as_cube(coefficients: Floats) -> Floats:
    """Coefficients (…, n, k) as (n0, n1, n k), with one layer along each missing axis."""
    leading = coefficients.shape[:-2]
    return coefficients.reshape(*(1,) * (2 - len(leading)), *leading, -1)


def _quasi_interpolated(values: Floats, axis: int, out: Floats | None = None) -> Floats:
    """(8 f − f₋ − f₊) / 6 along an axis, which loses its first and last entry; written into ``out``, if given."""
    before, after = values.shape[:axis], values.shape[axis + 1 :]
    shape = (*before, values.shape[axis] - 2, *after)
    out = np.empty(shape) if out is None else out.reshape(shape)
    rows, stride = math.prod(before), math.prod(after)
    kernels.quasi_interpolate(np.ascontiguousarray(values).reshape(rows, -1), stride, out.reshape(rows, -1))
    return out


def _subdivision(n: int, first: int, parents: int) -> Floats:
    """(n, parents) matrix: the layers of a box along an axis from those of its parent, of twice the spacing."""
    out = np.zeros((n, parents))
    for i in range(n):
        weights = (0.125, 0.75, 0.125) if i % 2 else (0.5, 0.5)
        out[i, first + i // 2 : first + i // 2 + len(weights)] = weights
    return out


def _share(box: Box, domain_cells: int, axis: int) -> Floats:
    """(cells + 3,) share of a box's own coefficients along an axis; 1 towards a side of the domain."""
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
