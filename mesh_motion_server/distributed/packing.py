"""Packs the part of an interpolant that reaches a box, which is what a partition needs.

The value at a point of the box is bitwise that of the whole interpolant. Of its grid of centres, the cells that a sum
in the box visits are sent, whole and in their order; of a spline, the coefficients that a point of the box uses. Basis
functions are sent by name.
"""

from __future__ import annotations

import pickle
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.numerics.interpolation.centres import CentreLayout
from mesh_motion_server.numerics.interpolation.interpolant import Interpolant
from mesh_motion_server.numerics.interpolation.kernels import basis_named
from mesh_motion_server.numerics.interpolation.polynomial import Polynomial
from mesh_motion_server.numerics.interpolation.two_scale.interpolant import AnyInterpolant, TwoScaleInterpolant
from mesh_motion_server.numerics.interpolation.two_scale.nested_grid import NestedSpline

__all__ = ["pack", "unpack"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def pack(interpolants: tuple[AnyInterpolant, ...], box: Floats) -> bytes:
    """Pack what is needed of interpolants to evaluate them in a box (2, d), mesh length unit."""
    return pickle.dumps(tuple(_packed(interpolant, box) for interpolant in interpolants), protocol=5)


def unpack(packed: bytes) -> tuple[AnyInterpolant, ...]:
    """The inverse of :func:`pack`; never use it for bytes from an untrusted sender."""
    return tuple(part.unpacked() for part in pickle.loads(packed))


def _packed(interpolant: AnyInterpolant, box: Floats) -> _Sum | _TwoScales:
    if isinstance(interpolant, TwoScaleInterpolant):
        levels = tuple(_Sum.of(level, box) for level in interpolant.levels)
        coarse = interpolant.coarse
        packed = _Sum.of(coarse, box) if isinstance(coarse, Interpolant) else _Spline.of(coarse, box)
        return _TwoScales(packed, levels, interpolant.basis.name)
    return _Sum.of(interpolant, box)


@dataclass(frozen=True, eq=False)
class _Sum:
    """An :class:`Interpolant` with its centres in the layout's order; ``cell`` says in which cell each one lies."""

    basis: str
    radius: float
    centres: Floats
    weights: Floats
    cell: NDArray[np.int32]
    grid: tuple[Floats, float, float, Ints, float]
    polynomial: Polynomial | None

    @classmethod
    def of(cls, interpolant: Interpolant, box: Floats) -> _Sum:
        layout = interpolant.layout
        kept = _visited(layout, box)
        return cls(
            interpolant.basis.name,
            interpolant.support_radius,
            layout.coordinates[: interpolant.dimension, kept],
            interpolant.weights[layout.order[kept]],
            (np.searchsorted(layout.starts, kept, side="right") - 1).astype(np.int32),
            (layout.origin, layout.inverse_side, layout.extent, layout.shape, layout.fraction),
            interpolant.polynomial,
        )

    def unpacked(self) -> Interpolant:
        origin, inverse_side, extent, shape, fraction = self.grid
        d, count = self.centres.shape
        coordinates = np.zeros((3, count))
        coordinates[:d] = self.centres
        cells = int(np.prod(shape))
        starts = np.zeros(cells + 1, dtype=np.int64)
        np.cumsum(np.bincount(self.cell, minlength=cells), out=starts[1:])
        layout = CentreLayout(np.arange(count), coordinates, origin, inverse_side, extent, shape, starts, fraction)
        points = np.ascontiguousarray(self.centres.T)
        basis = basis_named(self.basis)
        return Interpolant(points, self.weights, basis, self.radius, layout, self.polynomial)


def _visited(layout: CentreLayout, box: Floats) -> Ints:
    """Sorted centres, ascending, that the sum at a point of the box visits: their cells are at most one from the box.

    The cells of a row along x are contiguous; the cost depends on the rows in the box, not on all centres.
    """
    low, high = np.zeros(3), np.zeros(3)
    low[: box.shape[1]], high[: box.shape[1]] = box
    around = np.array([[-1.0], [1.0]])
    place = np.floor((np.stack([low, high]) - layout.origin) * layout.inverse_side) + around
    (x0, y0, z0), (x1, y1, z1) = np.clip(place, [[0], [-1]], [layout.shape, layout.shape - 1]).astype(np.int64)
    row = ((np.arange(z0, z1 + 1)[:, None] * layout.shape[1] + np.arange(y0, y1 + 1)) * layout.shape[0]).ravel()
    if x1 < x0 or not len(row):
        return np.empty(0, dtype=np.int64)
    first, last = layout.starts[row + x0], layout.starts[row + x1 + 1]
    counts = last - first
    return np.repeat(first - np.cumsum(counts) + counts, counts) + np.arange(int(counts.sum()))


@dataclass(frozen=True, eq=False)
class _Spline:
    """A :class:`NestedSpline` without its coefficients, with the ranges to send of each box, and their coefficients."""

    frame: NestedSpline
    ranges: Ints
    blocks: tuple[Floats, ...]

    @classmethod
    def of(cls, spline: NestedSpline, box: Floats) -> _Spline:
        low, high = np.zeros(3), np.zeros(3)
        low[: spline.dimension], high[: spline.dimension] = box
        ranges = np.stack([_range(spline, number, low, high) for number in range(len(spline.origin))])
        blocks = tuple(_block(spline, number, ranges[number]) for number in range(len(spline.origin)))
        return cls(replace(spline, coefficients=spline.coefficients[:0]), ranges, blocks)

    def unpacked(self) -> NestedSpline:
        frame = self.frame
        layers = _layers(frame.cells)
        coefficients = np.zeros((int(np.prod(layers, axis=1).sum()), self.blocks[0].shape[-1]))
        for number, block in enumerate(self.blocks):
            if block.size:
                _view(coefficients, frame.start[number], layers[number])[_slices(self.ranges[number])] = block
        return replace(frame, coefficients=coefficients)


def _layers(cells: Ints) -> Ints:
    """(b, 3) coefficients along each axis of boxes with ``cells`` (b, 3)."""
    return np.where(cells > 0, cells + 3, 1)


def _range(spline: NestedSpline, number: int, low: Floats, high: Floats) -> Ints:
    """(2, 3) first and last + 1 coefficient of a box along each axis that points from ``low`` to ``high`` use.

    The last box, the domain's, has every point that no other box has; points outside it count at its rim. One more
    layer on each side allows for rounding.
    """
    cells = spline.cells[number]
    place = (np.stack([low, high]) - spline.origin[number]) * spline.inverse_spacing[number]
    if number < len(spline.origin) - 1 and (np.any(place[1] < -1.0) or np.any(place[0] > cells + 1.0)):
        return np.zeros((2, 3), dtype=np.int64)
    first, last = np.clip(np.floor(place), 0, np.maximum(cells - 1, 0)).astype(np.int64)
    return np.stack([np.maximum(first - 1, 0), np.minimum(last + 5, _layers(cells))])


def _block(spline: NestedSpline, number: int, within: Ints) -> Floats:
    """Coefficients of a box in a range."""
    layers = _layers(spline.cells[number])
    return np.ascontiguousarray(_view(spline.coefficients, spline.start[number], layers)[_slices(within)])


def _view(coefficients: Floats, start: int, layers: Ints) -> Floats:
    """(x, y, z, k) view of a box' coefficients."""
    own = coefficients[int(start) : int(start) + int(np.prod(layers))]
    return own.reshape(*(int(n) for n in layers), coefficients.shape[1])


def _slices(within: Ints) -> tuple[slice, ...]:
    return tuple(slice(int(a), int(b)) for a, b in within.T)


@dataclass(frozen=True, eq=False)
class _TwoScales:
    """A :class:`TwoScaleInterpolant`."""

    coarse: _Spline | _Sum
    levels: tuple[_Sum, ...]
    basis: str

    def unpacked(self) -> TwoScaleInterpolant:
        levels: Any = tuple(level.unpacked() for level in self.levels)
        return TwoScaleInterpolant(self.coarse.unpacked(), levels, basis_named(self.basis), 0)
