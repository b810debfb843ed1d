"""The function that a descent minimises in a region: the p-mean over corner simplices, or over whole cells.

===========  ====================================================================================================
corners      :mod:`.distortion`: each corner against the reference mesh; untangles
cells        :mod:`.cell_distortion`: the metric itself; the same as ``corners`` if all cells are simplices, except
             for skews relative to those at rest
===========  ====================================================================================================
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.correction.cell_distortion import cell_blocks, cell_gradient, mean_cell_distortion
from mesh_motion_numerics.correction.distortion import PNorm, corner_blocks, distortion_gradient, mean_distortion
from mesh_motion_numerics.correction.free_region import FreeRegion, gathered


class RegionMeasure(Protocol):
    """A p-mean over a region and its derivatives with respect to the free nodes."""

    def mean(self, points: Floats) -> tuple[float, Floats]:
        """E at the points (l, d), and the weight of every corner or cell."""
        ...

    def gradient(self, points: Floats, weights: Floats) -> Floats:
        """dE/dx (f, d)."""
        ...

    def hessian(self, points: Floats, weights: Floats, *, refresh: float, floor: float) -> Floats:
        """Positive semi-definite (b, d, d) in the region's pattern; overwritten by the next call.

        From the second call on, corners or cells of less than ``refresh`` mean weights keep their curvature; ``floor``
        mean weights are added to every weight.
        """
        ...

    def sharpened(self, norm: PNorm) -> RegionMeasure:
        """The same measure with another norm; if both are barriers, light corners or cells keep their curvature."""
        ...


class _Corners:
    """:class:`RegionMeasure` over the corner simplices."""

    def __init__(self, region: FreeRegion, norm: PNorm) -> None:
        d = region.simplices.dimension
        self._region, self._norm, self._filled = region, norm, False
        self._blocks = np.empty((len(region.simplices), d * d, d * d), dtype=np.float32)
        self._hessian = np.empty((len(region.adjacency.columns), d, d))

    def mean(self, points: Floats) -> tuple[float, Floats]:
        return mean_distortion(points, self._region.simplices, self._norm)

    def gradient(self, points: Floats, weights: Floats) -> Floats:
        shares = distortion_gradient(points, self._region.simplices, weights, self._norm)
        return gathered(self._region.adjacency, shares)

    def hessian(self, points: Floats, weights: Floats, *, refresh: float, floor: float) -> Floats:
        least = refresh / len(weights) if self._filled else 0.0
        simplices, adjacency = self._region.simplices, self._region.adjacency
        corner_blocks(points, simplices, weights, self._norm, self._blocks, least_weight=least, floor=floor)
        adjacency.reassemble(self._blocks, weights, least, self._hessian)
        self._filled = True
        return self._hessian

    def sharpened(self, norm: PNorm) -> RegionMeasure:
        if norm.epsilon or self._norm.epsilon:
            return _Corners(self._region, norm)
        self._norm = norm
        return self


class _Cells:
    """:class:`RegionMeasure` over whole cells."""

    def __init__(self, region: FreeRegion, norm: PNorm) -> None:
        d = region.simplices.dimension
        self._region, self._norm, self._filled = region, norm, False
        sizes = [(len(group), group.nodes.shape[1] ** 2, d * d) for group in region.groups]
        self._blocks = [np.empty(size, dtype=np.float32) for size in sizes]
        self._hessian = np.empty((len(region.adjacency.columns), d, d))

    def mean(self, points: Floats) -> tuple[float, Floats]:
        return mean_cell_distortion(points, self._region.groups, self._norm)

    def gradient(self, points: Floats, weights: Floats) -> Floats:
        shares = cell_gradient(points, self._region.groups, weights, self._norm)
        sums = [gathered(a, share) for a, share in zip(self._region.cell_adjacency, shares, strict=True)]
        return sum(sums[1:], start=sums[0])

    def hessian(self, points: Floats, weights: Floats, *, refresh: float, floor: float) -> Floats:
        least = refresh / len(weights) if self._filled else 0.0
        region = self._region
        cell_blocks(points, region.groups, weights, self._norm, self._blocks, least_weight=least, floor=floor)
        self._hessian[:] = 0.0
        for adjacency, blocks in zip(region.cell_adjacency, self._blocks, strict=True):
            adjacency.add(blocks, self._hessian)
        self._filled = True
        return self._hessian

    def sharpened(self, norm: PNorm) -> RegionMeasure:
        if norm.epsilon:
            return _Corners(self._region, norm)
        self._norm = norm
        return self


MEASURES: dict[str, type[_Corners] | type[_Cells]] = {"corners": _Corners, "cells": _Cells}
"""Measures by name, see :class:`~mesh_motion_numerics.correction.distortion.PNorm`."""


def region_measure(region: FreeRegion, norm: PNorm, earlier: RegionMeasure | None = None) -> RegionMeasure:
    """Return the measure that a norm selects; an earlier measure of the same region is reused with its curvature."""
    kind = MEASURES[norm.of if _of_cells(region) else "corners"]
    return earlier.sharpened(norm) if type(earlier) is kind else kind(region, norm)


def _of_cells(region: FreeRegion) -> bool:
    """Whether whole cells may be measured.

    Relative to rest, the quality of a cell that is not a simplex is that of its worst corner, so corners are measured.
    For tetrahedra the corners take less time than the cells.
    """
    simplices = all(block.type.is_simplex for block in region.cells)
    if region.simplices.offset is not None:
        return simplices and region.simplices.dimension == 2
    return not simplices
