"""The distortion ℓ of corner simplices, its p-mean over a mesh, and the gradient with respect to the nodes.

A corner simplex with the edges ``A`` (columns) has the Jacobian ``J = A P`` from its ideal, ``τ = det J`` and
``q = |J|²_F``. Its distortion ::

    ℓ   = log q − log d − (2/d) log τ + (a/m) log cosh(m log τ)                  τ > 0
    ℓ_ε = log q − log d − (2/d + a) log χ + a log((1 + τ²)/2)                    untangling, any τ
          χ = (τ + √(τ² + ε²))/2

With the size's weight a = ½, ℓ is log(1/size-skew) of a simplex but for the rounding of |log τ| (m → ∞ removes it);
other weights stand for other metrics. In 1D there is no shape: the first three terms cancel and the size alone
counts. ℓ_ε is finite for inverted cells. The mesh's distortion is the p-mean, a smooth maximum ::

    E = max ℓ + (1/p) log mean exp(p (ℓ − max ℓ)),      w = softmax(p ℓ)

The first term is the mean-ratio shape measure (Knupp 2001), χ the regularised determinant of Escobar et al. (2003),
Garanzha et al. (2021). Everything is computed in fixed blocks of corners, so results do not depend on the threads.

References
----------
P. M. Knupp, Algebraic mesh quality metrics, SIAM J. Sci. Comput. 23 (2001) 193-218.
J. M. Escobar et al., Simultaneous untangling and smoothing of tetrahedral meshes, CMAME 192 (2003) 2775-2787.
V. Garanzha et al., Foldover-free maps in 50 lines of code, ACM Trans. Graph. 40 (2021).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from mesh_motion_server.numerics.cells import CellTable, CellType
from mesh_motion_server.numerics.metrics import AtRest, sizes_of, skews_of

__all__ = [
    "CornerSimplices",
    "PNorm",
    "corner_simplices",
    "determinants",
    "distortion_gradient",
    "mean_distortion",
    "mean_of_measures",
]

BLOCK = 512
"""Corners per block of the compiled loops: the unit of work of a thread and of every partial sum."""

_NO_WEIGHT = 1e-12  # of the mean weight: less has no gradient
_FLAT_SKEW = 0.3  # simplices of a lower skew at rest are meant to be as they are
_DEGENERATE = 1e-6  # reference corners flatter than this (det / product of edge lengths) take the cell type's ideal


@dataclass(frozen=True)
class PNorm:
    """Which smooth maximum of which distortion.

    Attributes
    ----------
    p : float
        Exponent: 1 is the mean, large values approach the maximum.
    m : float
        Sharpness of the size term's |log τ|.
    epsilon : float
        Regularisation of the determinant; 0 is the barrier (every τ must be positive).
    size_weight : float
        a: what the size counts beside the shape.
    of : {"corners", "cells"}
        What is measured: every corner simplex against the reference mesh, or whole cells as the metric does
        (:mod:`.cell_distortion`), which is the same for simplices and needs ε = 0.
    """

    p: float
    m: float
    epsilon: float = 0.0
    size_weight: float = 0.5
    of: str = "corners"


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
        What is added to the distortions: the logarithm of the skew at rest, where it is measured relative to that.
    """

    nodes: NDArray[np.int32]
    ideal: NDArray[np.float64]
    offset: NDArray[np.float64] | None = None

    def __len__(self) -> int:
        return len(self.nodes)

    @property
    def dimension(self) -> int:
        """1, 2 or 3."""
        return int(self.nodes.shape[1]) - 1


def corner_simplices(reference: NDArray[np.float64], cells: CellTable, reference_sizes: AtRest) -> CornerSimplices:
    """All corner simplices of some cells.

    Parameters
    ----------
    reference : (n, d) array, mesh length unit
        Nodes of the reference mesh: the ideal shape of quad, hexahedron, wedge and pyramid corners.
    cells : CellTable
    reference_sizes : (m,) array, length^d, or CellsAtRest
        Σ_k det A_k of each cell in the reference mesh: the ideal size.

    Notes
    -----
    A triangle or tetrahedron is measured against the equilateral simplex of its reference size, because its skew is
    absolute. Where the skews at rest are known, that is relative to its skew at rest, and one that is flat at rest is
    measured against itself: to raise the skew of a boundary layer's cells would destroy the layer. The others are
    always measured against their own corners, because a boundary layer's flat quads are meant.
    """
    nodes, ideals, offsets = [], [], []
    all_sizes, skews = sizes_of(reference_sizes), skews_of(reference_sizes)
    for block, first in zip(cells, cells.offsets, strict=False):
        corners = block.nodes[:, block.type.corner_array]  # (m, k, d + 1)
        rows, count = slice(first, first + len(block)), corners.shape[1]
        nodes.append(corners.reshape(-1, corners.shape[2]).astype(np.int32))
        itself, offset = np.full(len(block), not block.type.is_simplex), np.zeros(len(block))
        if skews is not None and block.type.is_simplex:
            itself = skews[rows] < _FLAT_SKEW
            offset = np.where(itself, 0.0, np.log(skews[rows]))
        sizes = np.repeat(all_sizes[rows] / count, count)
        ideals.append(_ideal_maps(reference, nodes[-1], sizes, block.type, np.repeat(itself, count)))
        offsets.append(np.repeat(offset, count))
    return CornerSimplices(
        np.concatenate(nodes), np.concatenate(ideals), None if skews is None else np.concatenate(offsets)
    )


def _ideal_maps(
    reference: NDArray[np.float64],
    corners: NDArray[np.int32],
    dets: NDArray[np.float64],
    cell_type: CellType,
    itself: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """(c, d, d) maps P of the corners (c, d + 1) of one cell type.

    Those of the type's ideal with determinants ``dets`` (c,), or where ``itself`` (c,) says so of the reference corner.
    """
    w, d = cell_type.ideal_array, cell_type.dimension
    scale = (abs(np.linalg.det(w)) / np.abs(dets)) ** (1 / d)
    ideal: NDArray[np.float64] = scale[:, None, None] * np.linalg.inv(w)
    if not itself.any():
        return ideal
    edges = np.swapaxes(reference[corners[:, 1:]] - reference[corners[:, :1]], 1, 2)
    lengths = np.linalg.norm(edges, axis=1).prod(axis=1)
    least = 0.0 if cell_type.is_simplex else _DEGENERATE
    itself = itself & (np.linalg.det(edges) > least * lengths)
    ideal[itself] = np.linalg.inv(edges[itself])
    return ideal


def mean_distortion(
    points: NDArray[np.float64], simplices: CornerSimplices, norm: PNorm
) -> tuple[float, NDArray[np.float64]]:
    """E and the weights w (c,) of the corners at the points (n, d).

    E is ``inf`` where the barrier is violated (ε = 0 and some τ ≤ 0) or anything is not finite.
    """
    measure = np.empty(len(simplices))
    highest = _measure(points, simplices.nodes, simplices.ideal, norm.m, norm.epsilon, norm.size_weight, measure)
    if simplices.offset is not None and math.isfinite(highest):
        measure += simplices.offset
        highest = float(measure.max())
    return _p_mean(measure, highest, norm.p)


def mean_of_measures(measure: NDArray[np.float64], p: float) -> tuple[float, NDArray[np.float64]]:
    """The p-mean of any measure (c,), and the weights w (c,), which take its place in memory."""
    return _p_mean(measure, float(measure.max()), p)


def _p_mean(measure: NDArray[np.float64], highest: float, p: float) -> tuple[float, NDArray[np.float64]]:
    """(E, w) of a measure (c,) and its largest value; w takes its place in memory."""
    if not math.isfinite(highest):
        return math.inf, measure
    total = _soften(measure, highest, p)
    return highest + math.log(total / len(measure)) / p, measure


def distortion_gradient(
    points: NDArray[np.float64], simplices: CornerSimplices, weights: NDArray[np.float64], norm: PNorm
) -> NDArray[np.float64]:
    """Gradient of E by corner: (c, d + 1, d), the corner's share of dE/dx of each of its nodes."""
    gradient = np.zeros((*simplices.nodes.shape, simplices.dimension))
    _corner_gradients(
        points, simplices.nodes, simplices.ideal, weights, norm.m, norm.epsilon, norm.size_weight, gradient
    )
    return gradient


def determinants(points: NDArray[np.float64], simplices: CornerSimplices) -> NDArray[np.float64]:
    """τ (c,) of every corner at the points (n, d)."""
    out = np.empty(len(simplices))
    _determinants(points, simplices.nodes, simplices.ideal, out)
    return out


@njit(cache=True, error_model="numpy", forceinline=True)
def jacobian(points, corner, ideal, d, out):  # type: ignore[no-untyped-def]
    """out (d, d) = J of one corner; returns (τ, q), q = ∞ in 1D, where there is no shape."""
    if d == 2:
        x0, y0 = points[corner[0], 0], points[corner[0], 1]
        ax, ay = points[corner[1], 0] - x0, points[corner[1], 1] - y0
        bx, by = points[corner[2], 0] - x0, points[corner[2], 1] - y0
        a = ax * ideal[0, 0] + bx * ideal[1, 0]
        b = ax * ideal[0, 1] + bx * ideal[1, 1]
        c = ay * ideal[0, 0] + by * ideal[1, 0]
        e = ay * ideal[0, 1] + by * ideal[1, 1]
        out[0, 0], out[0, 1], out[1, 0], out[1, 1] = a, b, c, e
        return a * e - b * c, a * a + b * b + c * c + e * e
    q = 0.0
    for i in range(d):
        first = points[corner[0], i]
        for k in range(d):
            t = 0.0
            for j in range(d):
                t += (points[corner[j + 1], i] - first) * ideal[j, k]
            out[i, k] = t
            q += t * t
    if d == 1:
        return out[0, 0], np.inf
    tau = (
        out[0, 0] * (out[1, 1] * out[2, 2] - out[1, 2] * out[2, 1])
        - out[0, 1] * (out[1, 0] * out[2, 2] - out[1, 2] * out[2, 0])
        + out[0, 2] * (out[1, 0] * out[2, 1] - out[1, 1] * out[2, 0])
    )
    return tau, q


@njit(cache=True, error_model="numpy", forceinline=True)
def _shape(q, d):  # type: ignore[no-untyped-def]
    """log q − log d and the exponent 2/d of the determinant; both 0 in 1D, where they cancel for every τ > 0."""
    return (math.log(q / d), 2.0 / d) if d > 1 else (0.0, 0.0)


@njit(cache=True, error_model="numpy", forceinline=True)
def distortion(tau, q, d, m, epsilon, a):  # type: ignore[no-untyped-def]
    """ℓ or ℓ_ε of one corner; ``inf`` outside the barrier."""
    shape, b = _shape(q, d)
    if epsilon == 0.0:
        if not tau > 0.0:
            return np.inf
        t = math.log(tau)
        x = abs(m * t)
        log_cosh = x + math.log1p(math.exp(-2.0 * x)) - math.log(2.0)
        return shape - b * t + a * log_cosh / m
    chi = 0.5 * (tau + math.hypot(tau, epsilon)) if tau > 0.0 else 0.5 * epsilon**2 / (math.hypot(tau, epsilon) - tau)
    return shape - (b + a) * math.log(chi) + a * math.log(0.5 * (1.0 + tau * tau))


@njit(cache=True, error_model="numpy", forceinline=True)
def slopes(tau, d, m, epsilon, a):  # type: ignore[no-untyped-def]
    """First and second derivative (h1, h2) of the part of ℓ that depends on τ alone."""
    b = 2.0 / d if d > 1 else 0.0
    if epsilon == 0.0:
        x = math.tanh(m * math.log(tau))
        return (a * x - b) / tau, (a * m * (1.0 - x * x) + b - a * x) / (tau * tau)
    b += a
    s = math.hypot(tau, epsilon)
    square = 1.0 + tau * tau
    return 2.0 * a * tau / square - b / s, b * tau / (s * s * s) + 2.0 * a * (1.0 - tau * tau) / (square * square)


@njit(cache=True, error_model="numpy", forceinline=True)
def cofactor(jac, d, out):  # type: ignore[no-untyped-def]
    """out (d, d) = cof J = dτ/dJ."""
    if d == 1:
        out[0, 0] = 1.0
    elif d == 2:
        out[0, 0], out[0, 1] = jac[1, 1], -jac[1, 0]
        out[1, 0], out[1, 1] = -jac[0, 1], jac[0, 0]
    else:
        for i in range(3):
            i1, i2 = (i + 1) % 3, (i + 2) % 3
            for k in range(3):
                k1, k2 = (k + 1) % 3, (k + 2) % 3
                out[i, k] = jac[i1, k1] * jac[i2, k2] - jac[i1, k2] * jac[i2, k1]


@njit(cache=True, error_model="numpy", parallel=True)
def _measure(points, corners, ideals, m, epsilon, a, out):  # type: ignore[no-untyped-def]
    """out (c,) = ℓ; returns the largest, inf or nan where there is one."""
    n, d = len(corners), points.shape[1]
    n_blocks = (n + BLOCK - 1) // BLOCK
    highest = np.empty(n_blocks)
    for block in prange(n_blocks):
        jac = np.empty((d, d))
        top = -np.inf
        for c in range(block * BLOCK, min(n, (block + 1) * BLOCK)):
            if d == 3:
                tau, q = jacobian(points, corners[c], ideals[c], 3, jac)
            else:
                tau, q = jacobian(points, corners[c], ideals[c], d, jac)
            value = distortion(tau, q, d, m, epsilon, a)
            out[c] = value
            if not value <= top:
                top = value
                if not math.isfinite(value):
                    top = np.inf
        highest[block] = top
    return highest.max()


@njit(cache=True, error_model="numpy", parallel=True)
def _soften(values, highest, p):  # type: ignore[no-untyped-def]
    """Turn ℓ (c,) into the weights w in place; returns Σ exp(p (ℓ − highest))."""
    n = len(values)
    n_blocks = (n + BLOCK - 1) // BLOCK
    partial = np.empty(n_blocks)
    for block in prange(n_blocks):
        s = 0.0
        for c in range(block * BLOCK, min(n, (block + 1) * BLOCK)):
            values[c] = math.exp(p * (values[c] - highest))
            s += values[c]
        partial[block] = s
    total = 0.0
    for block in range(n_blocks):
        total += partial[block]
    for block in prange(n_blocks):
        for c in range(block * BLOCK, min(n, (block + 1) * BLOCK)):
            values[c] /= total
    return total


@njit(cache=True, error_model="numpy", parallel=True)
def _corner_gradients(points, corners, ideals, weights, m, epsilon, a, out):  # type: ignore[no-untyped-def]
    """out (c, d + 1, d) = w dℓ/dx of each corner's nodes."""
    n, d = len(corners), points.shape[1]
    for block in prange((n + BLOCK - 1) // BLOCK):
        jac, cof = np.empty((d, d)), np.empty((d, d))
        for c in range(block * BLOCK, min(n, (block + 1) * BLOCK)):
            if weights[c] < _NO_WEIGHT / n:
                continue
            if d == 3:
                _gradient(points, corners[c], ideals[c], weights[c], m, epsilon, a, 3, jac, cof, out[c])
            elif d == 2:
                _gradient(points, corners[c], ideals[c], weights[c], m, epsilon, a, 2, jac, cof, out[c])
            else:
                _gradient(points, corners[c], ideals[c], weights[c], m, epsilon, a, 1, jac, cof, out[c])


@njit(cache=True, error_model="numpy", forceinline=True)
def _gradient(points, corner, ideal, weight, m, epsilon, a, d, jac, cof, out):  # type: ignore[no-untyped-def]
    """out (d + 1, d) = w (2 J/q + h1 cof J) Pᵀ at the ends of the edges, minus their sum at node 0."""
    tau, q = jacobian(points, corner, ideal, d, jac)
    h1, _ = slopes(tau, d, m, epsilon, a)
    cofactor(jac, d, cof)
    for i in range(d):
        first = 0.0
        for j in range(d):
            t = 0.0
            for k in range(d):
                t += (2.0 * jac[i, k] / q + h1 * cof[i, k]) * ideal[j, k]
            out[j + 1, i] = weight * t
            first -= weight * t
        out[0, i] = first


@njit(cache=True, error_model="numpy", parallel=True)
def _determinants(points, corners, ideals, out):  # type: ignore[no-untyped-def]
    n, d = len(corners), points.shape[1]
    for block in prange((n + BLOCK - 1) // BLOCK):
        jac = np.empty((d, d))
        for c in range(block * BLOCK, min(n, (block + 1) * BLOCK)):
            out[c], _ = jacobian(points, corners[c], ideals[c], d, jac)
