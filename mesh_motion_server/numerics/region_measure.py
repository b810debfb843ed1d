"""What a descent lowers in a region: the p-mean over corner simplices, or over whole cells.

===========  ====================================================================================================
corners      :mod:`.distortion` and :mod:`.curvature`: each corner against the reference mesh; untangles
cells        :mod:`.cell_distortion`: the metric itself; the same as ``corners`` where all cells are simplices
===========  ====================================================================================================
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.numerics.cell_distortion import cell_blocks, cell_gradient, mean_cell_distortion
from mesh_motion_server.numerics.curvature import corner_blocks
from mesh_motion_server.numerics.distortion import PNorm, distortion_gradient, mean_distortion
from mesh_motion_server.numerics.free_region import FreeRegion

__all__ = ["MEASURES", "RegionMeasure", "region_measure"]

Floats = NDArray[np.float64]


class RegionMeasure(Protocol):
    """A p-mean over a region and its derivatives with respect to the free nodes."""

    def mean(self, points: Floats) -> tuple[float, Floats]:
        """E at the points (l, d), and the weight of every corner or cell."""
        ...

    def gradient(self, points: Floats, weights: Floats) -> Floats:
        """dE/dx (f, d)."""
        ...

    def hessian(self, points: Floats, weights: Floats, *, refresh: float, floor: float) -> Floats:
        """Positive semi-definite (b, d, d) in the region's pattern.

        What weighs less than ``refresh`` mean weights keeps the curvature of the last call; ``floor`` mean weights
        are added to every weight.
        """
        ...


class _Corners:
    """:class:`RegionMeasure` over the corner simplices."""

    def __init__(self, region: FreeRegion, norm: PNorm) -> None:
        d = region.simplices.dimension
        self._region, self._norm, self._d = region, norm, d
        self._blocks = np.zeros((len(region.simplices), d * d, d * d), dtype=np.float32)

    def mean(self, points: Floats) -> tuple[float, Floats]:
        return mean_distortion(points, self._region.simplices, self._norm)

    def gradient(self, points: Floats, weights: Floats) -> Floats:
        shares = distortion_gradient(points, self._region.simplices, weights, self._norm)
        return self._region.adjacency.gather(shares)

    def hessian(self, points: Floats, weights: Floats, *, refresh: float, floor: float) -> Floats:
        least = refresh / len(weights)
        simplices = self._region.simplices
        corner_blocks(points, simplices, weights, self._norm, self._blocks, least_weight=least, floor=floor)
        return self._region.adjacency.assemble(self._blocks, self._d)


class _Cells:
    """:class:`RegionMeasure` over whole cells."""

    def __init__(self, region: FreeRegion, norm: PNorm) -> None:
        d = region.simplices.dimension
        self._region, self._norm, self._d = region, norm, d
        widths = [(len(group), d * group.nodes.shape[1]) for group in region.groups]
        self._blocks = [np.zeros((cells, width, width), dtype=np.float32) for cells, width in widths]

    def mean(self, points: Floats) -> tuple[float, Floats]:
        return mean_cell_distortion(points, self._region.groups, self._norm)

    def gradient(self, points: Floats, weights: Floats) -> Floats:
        shares = cell_gradient(points, self._region.groups, weights, self._norm)
        gathered = [a.gather(share) for a, share in zip(self._region.cell_adjacency, shares, strict=True)]
        return sum(gathered[1:], start=gathered[0])

    def hessian(self, points: Floats, weights: Floats, *, refresh: float, floor: float) -> Floats:
        least = refresh / len(weights)
        region = self._region
        cell_blocks(points, region.groups, weights, self._norm, self._blocks, least_weight=least, floor=floor)
        hessian = np.zeros((len(region.adjacency.columns), self._d, self._d))
        for adjacency, blocks in zip(region.cell_adjacency, self._blocks, strict=True):
            adjacency.add(blocks, hessian)
        return hessian


MEASURES: dict[str, type[_Corners] | type[_Cells]] = {"corners": _Corners, "cells": _Cells}
"""By name, see :class:`~mesh_motion_server.numerics.distortion.PNorm`."""


def region_measure(region: FreeRegion, norm: PNorm) -> RegionMeasure:
    """The measure that a norm names."""
    simplices_only = all(block.type.is_simplex for block in region.cells)
    return MEASURES["corners" if simplices_only else norm.of](region, norm)
