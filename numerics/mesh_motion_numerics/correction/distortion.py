"""The distortion ℓ of corner simplices, its p-mean over a mesh, and the derivatives with respect to the nodes.

A corner simplex with the edges ``A`` (columns) has the Jacobian ``J = A P`` from its ideal, ``τ = det J`` and
``q = |J|²_F``. Its distortion ::

    ℓ   = log q − log d − (2/d) log τ + (a/m) log cosh(m log τ)                  τ > 0
    ℓ_ε = log q − log d − (2/d + a) log χ + a log((1 + τ²)/2)                    untangling, any τ
          χ = (τ + √(τ² + ε²))/2

With the size's weight a = ½, ℓ is log(1/size-skew) of a simplex except for the smoothing of |log τ| (m → ∞ removes it);
other weights stand for other metrics. In 1D there is no shape: the first three terms cancel and only the size
counts. ℓ_ε is finite for inverted cells. ℓ may contain, with a weight b, the angles between the edges a_k as well ::

    b (Σ_k log |a_k| − log τ) + constant,     0 at rest

because a squeezed rectangle has the same shape value as a rhombus, although it is better for a finite-volume solver.
The mesh's distortion is the p-mean, a smooth maximum ::

    E = max ℓ + (1/p) log mean exp(p (ℓ − max ℓ)),      w = softmax(p ℓ)

The first term is the mean-ratio shape measure (Knupp 2001), χ the regularised determinant of Escobar et al. (2003),
Garanzha et al. (2021).

References
----------
P. M. Knupp, Algebraic mesh quality metrics, SIAM J. Sci. Comput. 23 (2001) 193-218.
J. M. Escobar et al., Simultaneous untangling and smoothing of tetrahedral meshes, CMAME 192 (2003) 2775-2787.
V. Garanzha et al., Foldover-free maps in 50 lines of code, ACM Trans. Graph. 40 (2021).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import mesh_motion_kernels as kernels
import numpy as np
from numpy.typing import NDArray

from mesh_motion_numerics.arrays import Floats, Integers, Marks, Shorts
from mesh_motion_numerics.mesh.cells import CellTable, CellType
from mesh_motion_numerics.quality.metrics import AtRest, sizes_of, skews_of

FLOOR = 0.1
"""Weight that every corner keeps in the Hessian, in units of the mean weight: no node is without stiffness."""

_FLAT_SKEW = 0.3  # simplices of a lower skew at rest are flat on purpose
_DEGENERATE = 1e-6  # reference corners flatter than this (det / product of edge lengths) take the cell type's ideal


@dataclass(frozen=True)
class PNorm:
    """Selects the smooth maximum and the distortion.

    Attributes
    ----------
    p : float
        Exponent: 1 is the mean, large values approach the maximum.
    m : float
        Sharpness of the size term's |log τ|.
    epsilon : float
        Regularisation of the determinant; 0 is the barrier (every τ must be positive).
    size_weight : float
        a: weight of the size relative to the shape.
    of : {"corners", "cells"}
        Measure every corner simplex against the reference mesh, or whole cells with the metric
        (:mod:`.cell_distortion`), which is the same for simplices and needs ε = 0.
    """

    p: float
    m: float
    epsilon: float = 0.0
    size_weight: float = 0.5
    of: str = "corners"

    @cached_property
    def law(self) -> tuple[float, float, float]:
        """m, ε and a, as the kernels take them."""
        return self.m, self.epsilon, self.size_weight


@dataclass(frozen=True, eq=False)
class CornerSimplices:
    """Corner simplices with their map to the ideal.

    Attributes
    ----------
    nodes : (c, d + 1) int32 array
        Nodes (k, a, b[, c]) of each corner.
    ideal : (c, d, d) array
        P: the Jacobian from the ideal simplex is ``[x_a − x_k, …] P``, of determinant 1 where the size is unchanged.
    offset : (c,) array or None
        Added to the distortions: the logarithm of the skew at rest, if they are relative to it.
    angles : (c,) array
        Obliqueness Σ log |a_k| − log |det A| at rest of the corners whose angles count, negative of others; empty if no
        angles count.
    """

    nodes: Shorts
    ideal: Floats
    offset: Floats | None = None
    angles: Floats = field(default_factory=lambda: np.empty(0))

    def __len__(self) -> int:
        return len(self.nodes)

    @property
    def dimension(self) -> int:
        """1, 2 or 3."""
        return int(self.nodes.shape[1]) - 1

    def of(self, rows: Integers) -> CornerSimplices:
        """Some of the corners (k,)."""
        offset = None if self.offset is None else self.offset[rows]
        angles = self.angles[rows] if len(self.angles) else self.angles
        return CornerSimplices(self.nodes[rows], self.ideal[rows], offset, angles)


def corner_simplices(
    reference: Floats,
    cells: CellTable,
    reference_sizes: AtRest,
    *,
    at_rest: bool = False,
    angles: bool = False,
) -> CornerSimplices:
    """All corner simplices of some cells.

    Parameters
    ----------
    reference : (n, d) array, mesh length unit
        Nodes of the reference mesh: the ideal shape of quad, hexahedron, wedge and pyramid corners.
    reference_sizes : (m,) array, length^d, or CellsAtRest
        Σ_k det A_k of each cell in the reference mesh: the ideal size.
    at_rest : bool
        Measure triangles and tetrahedra against themselves at rest, too.
    angles : bool
        The angles of quads and hexahedra count, but not those of a corner that is degenerate at rest.

    Notes
    -----
    A triangle or tetrahedron is measured against the equilateral simplex of its reference size, because its skew is
    absolute. If the skews at rest are known, the measure is relative to the skew at rest, and a simplex that is flat at
    rest is measured against itself: a higher skew of a boundary layer's cells would destroy the layer. Other cells are
    always measured against their own corners, because a boundary layer's quads are flat on purpose.
    """
    nodes, ideals, offsets, rest_angles = [], [], [], []
    all_sizes, skews = sizes_of(reference_sizes), skews_of(reference_sizes)
    for block, rows in cells.numbered:
        count = len(block.type.corners)
        nodes.append(block.corner_nodes)
        itself, offset = np.full(len(block), at_rest or not block.type.is_simplex), np.zeros(len(block))
        if skews is not None and block.type.is_simplex:
            itself = skews[rows] < _FLAT_SKEW
            offset = np.where(itself, 0.0, np.log(skews[rows]))
        sizes = np.repeat(all_sizes[rows] / count, count)
        ideal, oblique = _ideal_maps(reference, nodes[-1], sizes, block.type, np.repeat(itself, count))
        ideals.append(ideal)
        offsets.append(np.repeat(offset, count))
        rest_angles.append(oblique if block.type.is_box else np.full(len(oblique), -1.0))
    return CornerSimplices(
        np.concatenate(nodes),
        np.concatenate(ideals),
        None if skews is None else np.concatenate(offsets),
        np.concatenate(rest_angles) if angles else np.empty(0),
    )


def _ideal_maps(
    reference: Floats, corners: Shorts, dets: Floats, cell_type: CellType, itself: Marks
) -> tuple[Floats, Floats]:
    """(c, d, d) maps P of the corners (c, d + 1) of one cell type, and their obliqueness (c,) at rest.

    P comes from the type's ideal with determinants ``dets`` (c,), or from the reference corner where ``itself`` (c,).
    The obliqueness is negative where the reference corner is degenerate, and of all if ``itself`` is of none.
    """
    w, d = cell_type.ideal_array, cell_type.dimension
    ideal, oblique = np.empty((len(corners), d, d)), np.full(len(corners), -1.0)
    if itself.any():
        least = 0.0 if cell_type.is_simplex else _DEGENERATE
        kernels.corner_maps(np.ascontiguousarray(reference), corners, least, ideal, oblique)
    other = np.flatnonzero(~itself | (oblique < 0.0))
    scale = (abs(np.linalg.det(w)) / np.abs(dets[other])) ** (1 / d)
    ideal[other] = scale[:, None, None] * np.linalg.inv(w)
    return ideal, oblique


def mean_distortion(points: Floats, simplices: CornerSimplices, norm: PNorm) -> tuple[float, Floats]:
    """E and the weights w (c,) of the corners at the points (n, d).

    E is ``inf`` if the barrier is violated (ε = 0 and some τ ≤ 0) or a value is not finite.
    """
    measure = corner_distortions(points, simplices, norm)
    return kernels.p_mean(measure, norm.p), measure


def corner_distortions(points: Floats, simplices: CornerSimplices, norm: PNorm) -> Floats:
    """ℓ (c,) of every corner at the points (n, d); ``inf`` where the barrier is violated."""
    measure, offset = np.empty(len(simplices.nodes)), np.empty(0) if simplices.offset is None else simplices.offset
    arrays = np.ascontiguousarray(points), simplices.nodes, simplices.ideal, simplices.angles
    kernels.distortions(*arrays, offset, *norm.law, measure)
    return measure


def distortion_gradient(points: Floats, simplices: CornerSimplices, weights: Floats, norm: PNorm) -> Floats:
    """Gradient of E by corner: (c, d + 1, d), the corner's share of dE/dx of each of its nodes."""
    gradient = np.empty((*simplices.nodes.shape, simplices.dimension))
    arrays = np.ascontiguousarray(points), simplices.nodes, simplices.ideal, simplices.angles
    kernels.distortion_gradients(*arrays, weights, *norm.law, gradient)
    return gradient


def corner_blocks(
    points: Floats,
    simplices: CornerSimplices,
    weights: Floats,
    norm: PNorm,
    blocks: NDArray[np.float32],
    *,
    least_weight: float = 0.0,
    floor: float = FLOOR,
) -> None:
    """Update the blocks (c, d², d²) of the corners heavier than ``least_weight`` in place.

    They are positive semi-definite: the negative part of the Hessian, of ℓ and the p-mean's rank-one term, with respect
    to J is dropped (kernels/src/correction/corner.h). Row ``j d + k`` and column ``a d + b`` couple the coordinate a of
    the edge j, which ends at node j + 1, with b of the edge k; the entries of node 0 are minus the sums. Single
    precision is enough for a model of the curvature and halves the memory.
    """
    arrays = np.ascontiguousarray(points), simplices.nodes, simplices.ideal
    kernels.corner_blocks(*arrays, weights, floor / len(weights), least_weight, norm.p, *norm.law, blocks)


def determinants(points: Floats, simplices: CornerSimplices) -> Floats:
    """τ (c,) of every corner at the points (n, d)."""
    out = np.empty(len(simplices))
    kernels.determinants(np.ascontiguousarray(points), simplices.nodes, simplices.ideal, out)
    return out
