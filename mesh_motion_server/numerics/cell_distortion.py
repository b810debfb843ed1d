"""The distortion of whole cells: what the quality metric itself says of quads, hexahedra, wedges and pyramids.

:mod:`.distortion` treats the corners of a cell as cells of their own, measured against their own reference shape. That
untangles well, but it is not the metric: a quad's skew asks for right angles, nothing else. Here the p-mean is over ::

    L = log mean_k f_k + (a/m) log cosh(m log τ)          τ = Σ α_k / Σ α_k⁰,  α_k > 0 at every corner k

with the corner terms f_k of :mod:`.corner_kernels`. For a = ½ and m → ∞, L is log(1/size-skew) of any cell exactly.

Relative to the cells at rest it is L less its value at rest; simplices that are flat at rest have their own Jacobian at
rest as W (a target matrix), so that only a rigid motion has L = 0.

Derivatives go through the corners' Jacobians ``J = A P``. For the mean ratio P = W⁻¹. The angle form
``f = (w Π |A_i| / α)^(2/d)`` is the smallest mean ratio ``|A P|²_F / d · (w / det A P)^(2/d)`` over all diagonal P (the
inequality of the means), reached at ``P = diag(1/|A_i|)``; so with this P, held while it is differentiated, value and
gradient are exact, and the curvature is that of a majorant. With ω_k = f_k / Σ f and β_k = α_k / Σ α ::

    ∇L = Σ_k [ω_k 2 J/q + h1_k cof J] Pᵀ,     h1_k = (z' β_k − (2/d) ω_k) / det J,     z' = a tanh(m log τ)
    H  = w { Σ_k [corner k]₊ + [(p − 1) g gᵀ + p z' (g nᵀ + n gᵀ) + (p z'² + z″ − z') n nᵀ]₊ }

g and n are the gradients of the cell's shape term and of log τ; a corner's part, with its own rank-one term ω_k, is
projected as in :mod:`.curvature`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from mesh_motion_server.numerics import corner_kernels
from mesh_motion_server.numerics.cells import CellTable, CellType
from mesh_motion_server.numerics.curvature import add_curvature
from mesh_motion_server.numerics.distortion import CornerSimplices, PNorm, cofactor, mean_of_measures
from mesh_motion_server.numerics.metrics import AtRest, block_slices, shape_code, sizes_of, skews_of

__all__ = ["CellGroup", "cell_blocks", "cell_gradient", "cell_groups", "mean_cell_distortion"]

BLOCK = 64
"""Cells per block of the compiled loops."""


@dataclass(frozen=True, eq=False)
class CellGroup:
    """Cells of one type as the kernels want them.

    Attributes
    ----------
    type : CellType
    nodes : (m, k) int32 array
    reference_sizes : (m,) array, length^d
    ideal : (1, d, d) or (m, d, d) array
        W⁻¹ of all cells or of each, scaled to determinant 1; not used by the angle form.
    offset : (1,) or (m,) array
        What is added to L: 0, or the logarithm of the skew at rest.
    """

    type: CellType
    nodes: NDArray[np.int32]
    reference_sizes: NDArray[np.float64]
    ideal: NDArray[np.float64]
    offset: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.nodes)

    @cached_property
    def corners(self) -> NDArray[np.int64]:
        """(c, d + 1) local nodes of every corner."""
        return self.type.corner_array

    @cached_property
    def sine(self) -> float:
        """w of the angle form; 0 says that the shape is the mean ratio."""
        w = self.type.ideal_array
        angles = shape_code(self.type) == corner_kernels.ANGLES
        return float(np.linalg.det(w) / np.linalg.norm(w, axis=0).prod()) if angles else 0.0


def cell_groups(cells: CellTable, at_rest: AtRest, simplices: CornerSimplices) -> tuple[CellGroup, ...]:
    """The blocks of a table; relative to the cells at rest where their skews are known.

    Parameters
    ----------
    cells : CellTable
    at_rest : (m,) array or CellsAtRest
    simplices : CornerSimplices
        Of these cells.
    """
    groups, corner = [], 0
    for block, rows in block_slices(cells):
        here = slice(corner, corner + len(block))
        corner += len(block) * len(block.type.corners)
        sizes, skews = sizes_of(at_rest)[rows], skews_of(at_rest)
        w = block.type.ideal_array
        ideal = (np.linalg.inv(w) * abs(np.linalg.det(w)) ** (1 / len(w)))[None]
        offset = np.zeros(1)
        if skews is not None and simplices.offset is not None and block.type.is_simplex:
            ideal, offset = simplices.ideal[here], simplices.offset[here]
            ideal = ideal * np.abs(np.linalg.det(ideal))[:, None, None] ** (-1 / len(w))
        elif skews is not None:
            offset = np.log(skews[rows])
        groups.append(CellGroup(block.type, block.nodes.astype(np.int32), sizes, ideal, offset))
    return tuple(groups)


def mean_cell_distortion(
    points: NDArray[np.float64], groups: tuple[CellGroup, ...], norm: PNorm
) -> tuple[float, NDArray[np.float64]]:
    """E and the weights w (m,) of the cells at the points (n, d); E is ``inf`` where a corner is not positive."""
    measure = np.empty(sum(len(group) for group in groups))
    for group, rows in _rows(groups):
        _measure(points, *_arrays(group), norm.m, norm.size_weight, measure[rows])
        measure[rows] += group.offset
    return mean_of_measures(measure, norm.p)


def cell_gradient(
    points: NDArray[np.float64], groups: tuple[CellGroup, ...], weights: NDArray[np.float64], norm: PNorm
) -> list[NDArray[np.float64]]:
    """Gradient of E by cell: for each group (m, k, d), the cell's share of dE/dx of each of its nodes."""
    shares = []
    for group, rows in _rows(groups):
        shares.append(np.empty((*group.nodes.shape, points.shape[1])))
        _gradients(points, *_arrays(group), weights[rows], norm.m, norm.size_weight, shares[-1])
    return shares


def cell_blocks(
    points: NDArray[np.float64],
    groups: tuple[CellGroup, ...],
    weights: NDArray[np.float64],
    norm: PNorm,
    blocks: list[NDArray[np.float32]],
    *,
    least_weight: float,
    floor: float,
) -> None:
    """Update the blocks (m, k d, k d) of each group's cells heavier than ``least_weight`` in place."""
    law = norm.p, norm.m, norm.size_weight
    for (group, rows), out in zip(_rows(groups), blocks, strict=True):
        _blocks(points, *_arrays(group), weights[rows], floor / len(weights), least_weight, law, out)


def _rows(groups: tuple[CellGroup, ...]) -> list[tuple[CellGroup, slice]]:
    """Each group with the slice of cell numbers that belongs to it."""
    ends = np.cumsum([0, *(len(group) for group in groups)]).tolist()
    return [(group, slice(a, b)) for group, a, b in zip(groups, ends, ends[1:], strict=False)]


def _arrays(
    group: CellGroup,
) -> tuple[NDArray[np.int32], NDArray[np.int64], NDArray[np.float64], float, NDArray[np.float64]]:
    """What every kernel gets of a group."""
    return group.nodes, group.corners, group.ideal, group.sine, group.reference_sizes


@njit(cache=True, error_model="numpy", forceinline=True)
def _corner(points, cell, corner, ideal, sine, jac, to_ideal):  # type: ignore[no-untyped-def]
    """jac (d, d) = J, to_ideal (d, d) = P of one corner; returns (α, det J, q, log f)."""
    d = points.shape[1]
    alpha_over_tau = 1.0
    for j in range(d):
        for i in range(d):
            to_ideal[i, j] = ideal[i, j]
    if sine > 0.0:
        for j in range(d):
            length = 0.0
            for i in range(d):
                edge = points[cell[corner[j + 1]], i] - points[cell[corner[0]], i]
                length += edge * edge
            length = math.sqrt(length)
            alpha_over_tau *= length
            for i in range(d):
                to_ideal[i, j] = 1.0 / length if i == j else 0.0
    q = 0.0
    for i in range(d):
        first = points[cell[corner[0]], i]
        for k in range(d):
            t = 0.0
            for j in range(d):
                t += (points[cell[corner[j + 1]], i] - first) * to_ideal[j, k]
            jac[i, k] = t
            q += t * t
    if d == 2:
        tau = jac[0, 0] * jac[1, 1] - jac[0, 1] * jac[1, 0]
    else:
        tau = (
            jac[0, 0] * (jac[1, 1] * jac[2, 2] - jac[1, 2] * jac[2, 1])
            - jac[0, 1] * (jac[1, 0] * jac[2, 2] - jac[1, 2] * jac[2, 0])
            + jac[0, 2] * (jac[1, 0] * jac[2, 1] - jac[1, 1] * jac[2, 0])
        )
    if not tau > 0.0:
        return tau, tau, q, np.inf
    unit = sine if sine > 0.0 else 1.0
    return tau * alpha_over_tau, tau, q, math.log(q / d) - (2.0 / d) * math.log(tau / unit)


@njit(cache=True, error_model="numpy", forceinline=True)
def _sums(points, cell, corners, ideal, sine, reference, work, shapes, alphas):  # type: ignore[no-untyped-def]
    """shapes, alphas (c) = f_k, α_k; returns (mean f, τ of the cell), (inf, 0) outside the barrier."""
    total, size = 0.0, 0.0
    for k in range(len(corners)):
        alpha, _, _, log_f = _corner(points, cell, corners[k], ideal, sine, work[0], work[1])
        if not math.isfinite(log_f):
            return np.inf, 0.0
        shapes[k], alphas[k] = math.exp(log_f), alpha
        total += shapes[k]
        size += alpha
    return total / len(corners), size / reference


@njit(cache=True, error_model="numpy", parallel=True)
def _measure(points, nodes, corners, ideal, sine, references, m, a, out):  # type: ignore[no-untyped-def]
    """out (m,) = L."""
    n, d = len(nodes), points.shape[1]
    for block in prange((n + BLOCK - 1) // BLOCK):
        work, long = np.empty((2, d, d)), np.empty((2, len(corners)))
        for c in range(block * BLOCK, min(n, (block + 1) * BLOCK)):
            own = ideal[min(c, len(ideal) - 1)]
            mean, tau = _sums(points, nodes[c], corners, own, sine, references[c], work, long[0], long[1])
            if not tau > 0.0:
                out[c] = np.inf
                continue
            x = abs(m * math.log(tau))
            out[c] = math.log(mean) + a * (x + math.log1p(math.exp(-2.0 * x)) - math.log(2.0)) / m


@njit(cache=True, error_model="numpy", forceinline=True)
def _add_edges(pull, corner, to_ideal, out):  # type: ignore[no-untyped-def]
    """out (k, d) += pull (d, d) Pᵀ at the ends of the edges, minus their sum at the corner."""
    d = len(pull)
    for i in range(d):
        for j in range(d):
            t = 0.0
            for k in range(d):
                t += pull[i, k] * to_ideal[j, k]
            out[corner[j + 1], i] += t
            out[corner[0], i] -= t


@njit(cache=True, error_model="numpy", parallel=True)
def _gradients(  # type: ignore[no-untyped-def]
    points, nodes, corners, ideal, sine, references, weights, m, a, out
):
    """out (m, k, d) = w dL/dx of each cell's nodes."""
    n, d = len(nodes), points.shape[1]
    for block in prange((n + BLOCK - 1) // BLOCK):
        work, long = np.empty((4, d, d)), np.empty((2, len(corners)))
        for c in range(block * BLOCK, min(n, (block + 1) * BLOCK)):
            own = ideal[min(c, len(ideal) - 1)]
            mean, tau = _sums(points, nodes[c], corners, own, sine, references[c], work, long[0], long[1])
            slope = a * math.tanh(m * math.log(tau))
            out[c] = 0.0
            for k in range(len(corners)):
                alpha, det, q, _ = _corner(points, nodes[c], corners[k], own, sine, work[0], work[1])
                cofactor(work[0], d, work[2])
                omega, beta = long[0, k] / (mean * len(corners)), alpha / (tau * references[c])
                h1 = (slope * beta - (2.0 / d) * omega) / det
                for i in range(d):
                    for j in range(d):
                        work[3, i, j] = weights[c] * (2.0 * omega * work[0, i, j] / q + h1 * work[2, i, j])
                _add_edges(work[3], corners[k], work[1], out[c])


@njit(cache=True, error_model="numpy", parallel=True)
def _blocks(  # type: ignore[no-untyped-def]
    points, nodes, corners, ideal, sine, references, weights, floor, least_weight, law, out
):
    """out (m, k d, k d): the blocks of the cells heavier than least_weight."""
    n, d, k = len(nodes), points.shape[1], nodes.shape[1]
    for block in prange((n + BLOCK - 1) // BLOCK):
        small, long, vectors = np.empty((11, d, d)), np.empty((2, len(corners))), np.empty((2, d))
        total, pulls, whole = np.empty((d * d, d * d)), np.empty((2, k, d)), np.empty((k * d, k * d))
        for c in range(block * BLOCK, min(n, (block + 1) * BLOCK)):
            if weights[c] < least_weight:
                continue
            weight = weights[c] + floor
            own = ideal[min(c, len(ideal) - 1)]
            mean, tau = _sums(points, nodes[c], corners, own, sine, references[c], small[9:], long[0], long[1])
            tanh = math.tanh(law[1] * math.log(tau))
            slope = law[2] * tanh
            pulls[:], whole[:] = 0.0, 0.0
            for corner in range(len(corners)):
                omega = long[0, corner] / (mean * len(corners))
                beta = long[1, corner] / (tau * references[c])
                _, det, q, _ = _corner(points, nodes[c], corners[corner], own, sine, small[0], small[10])
                _add_pulls(small, det, q, omega, beta, corners[corner], pulls)
                h1 = (slope * beta - (2.0 / d) * omega) / det
                terms = (omega, h1, (2.0 / d) * omega / (det * det), omega, -(2.0 / d) / det)
                total[:] = 0.0
                # the literal dimensions let the compiler unroll every small loop
                if d == 3:
                    add_curvature(det, q, small[10], terms, weight, 3, small, vectors, total)
                else:
                    add_curvature(det, q, small[10], terms, weight, 2, small, vectors, total)
                _scatter(total, corners[corner], d, whole)
            _add_rank_two(pulls, weight, law[0], slope, law[2] * law[1] * (1.0 - tanh * tanh), whole)
            for a in range(k * d):
                for b in range(k * d):
                    out[c, a, b] = np.float32(whole[a, b])


@njit(cache=True, error_model="numpy", forceinline=True)
def _add_pulls(small, det, q, omega, beta, corner, pulls):  # type: ignore[no-untyped-def]
    """pulls (2, k, d) += the corner's share of g and of n; small holds J, work space and P."""
    jac, cof, pull, to_ideal = small[0], small[1], small[2], small[10]
    d = len(jac)
    cofactor(jac, d, cof)
    for i in range(d):
        for j in range(d):
            pull[i, j] = omega * (2.0 * jac[i, j] / q - (2.0 / d) * cof[i, j] / det)
            cof[i, j] *= beta / det
    _add_edges(pull, corner, to_ideal, pulls[0])
    _add_edges(cof, corner, to_ideal, pulls[1])


@njit(cache=True, error_model="numpy", forceinline=True)
def _scatter(total, corner, d, whole):  # type: ignore[no-untyped-def]
    """whole (k d, k d) += the corner's block, of which total (d², d²) is the lower half, taken to the nodes."""
    for a in range(d * d):
        row, i = corner[a // d + 1] * d, a % d
        for b in range(d * d):
            column, j = corner[b // d + 1] * d, b % d
            value = total[a, b] if b <= a else total[b, a]
            whole[row + i, column + j] += value
            whole[corner[0] * d + i, column + j] -= value
            whole[row + i, corner[0] * d + j] -= value
            whole[corner[0] * d + i, corner[0] * d + j] += value


@njit(cache=True, error_model="numpy", forceinline=True)
def _add_rank_two(pulls, weight, p, slope, bend, whole):  # type: ignore[no-untyped-def]
    """whole += w × the projected matrix in g and n: the eigenpairs of its 2 × 2 coefficients that are positive."""
    a, b, c = p - 1.0, p * slope, p * slope * slope + bend - slope
    middle, radius = 0.5 * (a + c), math.hypot(0.5 * (a - c), b)
    angle = 0.5 * math.atan2(2.0 * b, a - c)
    k, d = pulls.shape[1], pulls.shape[2]
    for number in range(2):
        value = middle + radius if number == 0 else middle - radius
        if not value > 0.0:
            continue
        x = math.cos(angle) if number == 0 else -math.sin(angle)
        y = math.sin(angle) if number == 0 else math.cos(angle)
        for r in range(k * d):
            left = weight * value * (x * pulls[0, r // d, r % d] + y * pulls[1, r // d, r % d])
            for s in range(k * d):
                whole[r, s] += left * (x * pulls[0, s // d, s % d] + y * pulls[1, s // d, s % d])
