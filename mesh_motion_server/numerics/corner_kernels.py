"""Compiled kernels of the quality metrics: corner Jacobians in, relative size and skew out (thesis §2.3).

A chunk of :data:`CHUNK` cells is handled in two stages. The first gathers the corner Jacobians of the chunk into a
small buffer ``jacobians[corner, row, column, cell]`` (from node positions, from positions and a gradient per cell, or
from predicted edge vectors); the second turns the buffer into τ and skew, with the cells of the chunk side by side so
that the compiler uses the vector units. Nothing of the size of the mesh is stored besides the results, and no sum
crosses a cell, so the results do not depend on the number of threads.

One formula covers all cell types. With α_k = det A_k, λ_k = A_kᵀ A_k, d the dimension and n the number of corners::

    skew = n / Σ_k f_k
    mean ratio (triangle, tetra, pyramid):  f_k = tr(G λ_k) / d · (det W / |α_k|)^(2/d),   G = W⁻¹ W⁻ᵀ
    angles (quad, hexahedron, wedge):       f_k = (w Π_i √λ_k,ii / |α_k|)^(2/d),           w = det W / Π_i |W_i|

W is the ideal corner of :data:`~mesh_motion_server.numerics.cells.CELL_TYPES`, W_i its columns. The mean ratio is
thesis (2.14) for triangles and tetrahedra, the angle form is (2.14) for quads and (3.30) for hexahedra. Both are 1 for
the ideal cell only and at most 1 for any other: the mean ratio by the inequality of the means, the angle form because
the sines of a triangle's corners are largest together at 60 degrees (wedge) and every sine is at most 1 (quad, hex).
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from mesh_motion_server.numerics.simplex_kernels import cube_root, tetra_quality, triangle_quality

__all__ = [
    "ANGLES",
    "BLOCK",
    "CHUNK",
    "LENGTH",
    "MEAN_RATIO",
    "METRIC_CODES",
    "RELATIVE",
    "chosen_quality",
    "column_quality",
    "evaluate",
    "gather",
    "metric_value",
    "metric_values",
    "node_extremes",
    "node_quality",
    "node_sizes",
    "relative_skew",
    "transformed_quality",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

# how a cell type's skew is computed
LENGTH, MEAN_RATIO, ANGLES = 0, 1, 2

#: Number of each quality metric in the compiled kernels.
METRIC_CODES = {
    "size": 0,
    "skew": 1,
    "size-skew": 2,
    "size-skew-root": 3,
    "size-skew-product": 4,
    "relative-size-skew": 5,
}
RELATIVE = METRIC_CODES["relative-size-skew"]

#: Cells side by side: the corner Jacobians of 128 tetrahedra are 9 KiB, those of 128 hexahedra 72 KiB
CHUNK = 128
# cells per work item of a parallel loop; fixed, so that no result depends on the number of threads
BLOCK = 64 * CHUNK


@njit(cache=True, error_model="numpy")
def _gather_nodes(points, nodes, corners, first, count, jacobians):  # type: ignore[no-untyped-def]
    """Corner Jacobians of the cells first … first + count - 1 from node positions."""
    d = points.shape[1]
    for c in range(corners.shape[0]):
        for s in range(count):
            origin = nodes[first + s, corners[c, 0]]
            for j in range(d):
                node = nodes[first + s, corners[c, j + 1]]
                for i in range(d):
                    jacobians[c, i, j, s] = points[np.uint64(node), i] - points[np.uint64(origin), i]


@njit(cache=True, error_model="numpy", inline="always")
def _gather_tetra(points, nodes, first, count, jacobians):  # type: ignore[no-untyped-def]
    """As _gather_nodes for tetrahedra, unrolled: this loop is much of the time of a large mesh.

    Unsigned indices spare the test for negative ones.
    """
    for s in range(count):
        cell = np.uint64(first + s)
        a, b, c, e = (
            np.uint64(nodes[cell, 0]),
            np.uint64(nodes[cell, 1]),
            np.uint64(nodes[cell, 2]),
            np.uint64(nodes[cell, 3]),
        )
        for i in range(3):
            x = points[a, i]
            jacobians[0, i, 0, s] = points[b, i] - x
            jacobians[0, i, 1, s] = points[c, i] - x
            jacobians[0, i, 2, s] = points[e, i] - x


@njit(cache=True, error_model="numpy", inline="always")
def _gather_triangle(points, nodes, first, count, jacobians):  # type: ignore[no-untyped-def]
    """As _gather_nodes for triangles, unrolled."""
    for s in range(count):
        cell = np.uint64(first + s)
        a, b, c = np.uint64(nodes[cell, 0]), np.uint64(nodes[cell, 1]), np.uint64(nodes[cell, 2])
        for i in range(2):
            x = points[a, i]
            jacobians[0, i, 0, s] = points[b, i] - x
            jacobians[0, i, 1, s] = points[c, i] - x


@njit(cache=True, error_model="numpy", inline="always")
def gather(points, nodes, corners, first, count, jacobians):  # type: ignore[no-untyped-def]
    """As _gather_nodes, by the fastest loop for the cell type."""
    if nodes.shape[1] == 4 and points.shape[1] == 3:
        _gather_tetra(points, nodes, first, count, jacobians)
    elif nodes.shape[1] == 3 and points.shape[1] == 2:
        _gather_triangle(points, nodes, first, count, jacobians)
    else:
        _gather_nodes(points, nodes, corners, first, count, jacobians)


@njit(cache=True, error_model="numpy")
def _determinants(jacobians, corner, count, out):  # type: ignore[no-untyped-def]
    """det A of one corner of each cell in the buffer."""
    d = jacobians.shape[1]
    a = jacobians[corner]
    if d == 1:
        for s in range(count):
            out[s] = a[0, 0, s]
    elif d == 2:
        for s in range(count):
            out[s] = a[0, 0, s] * a[1, 1, s] - a[0, 1, s] * a[1, 0, s]
    else:
        for s in range(count):
            out[s] = (
                a[0, 0, s] * (a[1, 1, s] * a[2, 2, s] - a[2, 1, s] * a[1, 2, s])
                + a[1, 0, s] * (a[2, 1, s] * a[0, 2, s] - a[0, 1, s] * a[2, 2, s])
                + a[2, 0, s] * (a[0, 1, s] * a[1, 2, s] - a[1, 1, s] * a[0, 2, s])
            )


@njit(cache=True, error_model="numpy")
def _mean_ratio(jacobians, corner, count, gram, ideal_det, det, out):  # type: ignore[no-untyped-def]
    """f_k of the mean ratio; gram is G."""
    a = jacobians[corner]
    if jacobians.shape[1] == 2:
        factor = 0.5 * ideal_det
        for s in range(count):
            l00 = a[0, 0, s] * a[0, 0, s] + a[1, 0, s] * a[1, 0, s]
            l11 = a[0, 1, s] * a[0, 1, s] + a[1, 1, s] * a[1, 1, s]
            l01 = a[0, 0, s] * a[0, 1, s] + a[1, 0, s] * a[1, 1, s]
            q = gram[0, 0] * l00 + gram[1, 1] * l11 + 2.0 * gram[0, 1] * l01
            out[s] = factor * q / abs(det[s]) if det[s] != 0.0 else np.inf
    else:
        for s in range(count):
            l00 = a[0, 0, s] * a[0, 0, s] + a[1, 0, s] * a[1, 0, s] + a[2, 0, s] * a[2, 0, s]
            l11 = a[0, 1, s] * a[0, 1, s] + a[1, 1, s] * a[1, 1, s] + a[2, 1, s] * a[2, 1, s]
            l22 = a[0, 2, s] * a[0, 2, s] + a[1, 2, s] * a[1, 2, s] + a[2, 2, s] * a[2, 2, s]
            l01 = a[0, 0, s] * a[0, 1, s] + a[1, 0, s] * a[1, 1, s] + a[2, 0, s] * a[2, 1, s]
            l02 = a[0, 0, s] * a[0, 2, s] + a[1, 0, s] * a[1, 2, s] + a[2, 0, s] * a[2, 2, s]
            l12 = a[0, 1, s] * a[0, 2, s] + a[1, 1, s] * a[1, 2, s] + a[2, 1, s] * a[2, 2, s]
            q = gram[0, 0] * l00 + gram[1, 1] * l11 + gram[2, 2] * l22
            q += 2.0 * (gram[0, 1] * l01 + gram[0, 2] * l02 + gram[1, 2] * l12)
            root = cube_root(abs(det[s]) / ideal_det)
            out[s] = q / (3.0 * root * root) if det[s] != 0.0 else np.inf


@njit(cache=True, error_model="numpy")
def _angles(jacobians, corner, count, ideal_sine, det, out):  # type: ignore[no-untyped-def]
    """f_k of the angle form; ideal_sine is w."""
    a = jacobians[corner]
    if jacobians.shape[1] == 2:
        for s in range(count):
            l00 = a[0, 0, s] * a[0, 0, s] + a[1, 0, s] * a[1, 0, s]
            l11 = a[0, 1, s] * a[0, 1, s] + a[1, 1, s] * a[1, 1, s]
            out[s] = ideal_sine * np.sqrt(l00 * l11) / abs(det[s]) if det[s] != 0.0 else np.inf
    else:
        for s in range(count):
            l00 = a[0, 0, s] * a[0, 0, s] + a[1, 0, s] * a[1, 0, s] + a[2, 0, s] * a[2, 0, s]
            l11 = a[0, 1, s] * a[0, 1, s] + a[1, 1, s] * a[1, 1, s] + a[2, 1, s] * a[2, 1, s]
            l22 = a[0, 2, s] * a[0, 2, s] + a[1, 2, s] * a[1, 2, s] + a[2, 2, s] * a[2, 2, s]
            root = cube_root(ideal_sine * np.sqrt(l00) * np.sqrt(l11) * np.sqrt(l22) / abs(det[s]))
            out[s] = root * root if det[s] != 0.0 else np.inf


@njit(cache=True, error_model="numpy")
def _corner_terms(jacobians, corner, count, shape, ideal, det, out):  # type: ignore[no-untyped-def]
    """f_k by the type's formula; ideal holds G (rows 0 … d-1), then det W and w in the last row."""
    d = jacobians.shape[1]
    if shape == MEAN_RATIO:
        _mean_ratio(jacobians, corner, count, ideal, ideal[d, 0], det, out)
    elif shape == ANGLES:
        _angles(jacobians, corner, count, ideal[d, 1], det, out)
    else:
        for s in range(count):
            out[s] = 1.0 if det[s] != 0.0 else np.inf


@njit(cache=True, error_model="numpy")
def _finish(reference, first, count, corners, work, size, skew, inverted):  # type: ignore[no-untyped-def]
    """From Σα, Σf and the number of positive corners to size, skew and inverted; NaN becomes -inf, the worst."""
    for s in range(count):
        tau = work[0, s] / reference[first + s]
        ratio = abs(tau)
        ratio = min(ratio, 1.0 / ratio)
        shape = corners / work[1, s]
        positive = work[2, s]
        shape = shape if positive in (0.0, corners) else 0.0
        # a product with NaN or an infinite sum is not finite: one test for positions that are no numbers
        valid = np.isfinite(work[0, s]) and not np.isnan(work[1, s]) and not np.isnan(tau)
        size[s] = (ratio if tau > 0.0 else -ratio) if valid else -np.inf
        skew[s] = shape if valid else -np.inf
        inverted[s] = positive < corners or not valid


@njit(cache=True, error_model="numpy")
def evaluate(  # type: ignore[no-untyped-def]
    jacobians, first, count, shape, ideal, reference, work, size, skew, inverted
):
    """Size, skew and inverted of the chunk in the buffer; work is (5, CHUNK)."""
    corners = jacobians.shape[0]
    if corners == 1 and shape == MEAN_RATIO:
        if jacobians.shape[1] == 3:
            tetra_quality(jacobians, first, count, ideal, reference, size, skew, inverted)
        else:
            triangle_quality(jacobians, first, count, ideal, reference, size, skew, inverted)
        return
    for i in range(3):
        for s in range(count):
            work[i, s] = 0.0
    for c in range(corners):
        _determinants(jacobians, c, count, work[3])
        _corner_terms(jacobians, c, count, shape, ideal, work[3], work[4])
        for s in range(count):
            work[0, s] += work[3, s]
            work[1, s] += work[4, s]
            work[2, s] += 1.0 if work[3, s] > 0.0 else 0.0
    _finish(reference, first, count, float(corners), work, size, skew, inverted)


@njit(cache=True, error_model="numpy", inline="always")
def metric_value(size: float, skew: float, code: int) -> float:
    """One quality metric of one cell, of RELATIVE with its relative skew; -inf stays -inf."""
    if code == 0 or size == -np.inf:
        return size
    if code == 1:
        return skew
    value: float
    if code in (2, 5):
        value = np.sqrt(abs(size)) * skew
    elif code == 3:
        value = np.sqrt(abs(size) * skew)
    else:
        value = abs(size) * skew
    return value if size > 0.0 else -value


@njit(cache=True, error_model="numpy", inline="always")
def relative_skew(skew: float, rest: float) -> float:
    """A cell's skew relative to that at rest: at most 1, what is better than at rest is as good."""
    return min(skew / rest, 1.0)


@njit(cache=True, error_model="numpy", parallel=True)
def metric_values(size: Floats, skew: Floats, code: int) -> Floats:
    """Values (m,) of the metric with the given number."""
    m = size.size
    out = np.empty(m)
    for b in prange((m + BLOCK - 1) // BLOCK):
        for e in range(b * BLOCK, min(m, (b + 1) * BLOCK)):
            out[e] = metric_value(size[e], skew[e], code)
    return out


@njit(cache=True, error_model="numpy", parallel=True)
def node_sizes(points: Floats, nodes: Ints, corners: Ints, out: Floats) -> None:
    """Σ_k det A_k of each cell."""
    m, d = nodes.shape[0], points.shape[1]
    for b in prange((m + BLOCK - 1) // BLOCK):
        jacobians = np.empty((corners.shape[0], d, d, CHUNK))
        det = np.empty(CHUNK)
        for first in range(b * BLOCK, min(m, (b + 1) * BLOCK), CHUNK):
            count = min(CHUNK, m - first)
            gather(points, nodes, corners, first, count, jacobians)
            for c in range(corners.shape[0]):
                _determinants(jacobians, c, count, det)
                for s in range(count):
                    out[first + s] = det[s] if c == 0 else out[first + s] + det[s]


@njit(cache=True, error_model="numpy", parallel=True)
def node_quality(  # type: ignore[no-untyped-def]
    points, nodes, corners, shape, ideal, reference, size, skew, inverted
):
    """Size, skew and inverted of each cell from node positions."""
    m, d = nodes.shape[0], points.shape[1]
    for b in prange((m + BLOCK - 1) // BLOCK):
        jacobians = np.empty((corners.shape[0], d, d, CHUNK))
        work = np.empty((5, CHUNK))
        for first in range(b * BLOCK, min(m, (b + 1) * BLOCK), CHUNK):
            count = min(CHUNK, m - first)
            last = first + count
            gather(points, nodes, corners, first, count, jacobians)
            evaluate(
                jacobians, first, count, shape, ideal, reference, work,
                size[first:last], skew[first:last], inverted[first:last],
            )  # fmt: skip


@njit(cache=True, error_model="numpy", parallel=True)
def chosen_quality(  # type: ignore[no-untyped-def]
    points, nodes, corners, shape, ideal, reference, chosen, size, skew, inverted
):
    """As node_quality of the cells with the numbers ``chosen`` only, in that order."""
    m, d = chosen.size, points.shape[1]
    for b in prange((m + BLOCK - 1) // BLOCK):
        jacobians = np.empty((corners.shape[0], d, d, CHUNK))
        work, own, told = np.empty((5, CHUNK)), np.empty((CHUNK, nodes.shape[1]), np.int64), np.empty(CHUNK)
        for first in range(b * BLOCK, min(m, (b + 1) * BLOCK), CHUNK):
            count = min(CHUNK, m - first)
            last = first + count
            for s in range(count):
                told[s] = reference[chosen[first + s]]
                for j in range(nodes.shape[1]):
                    own[s, j] = nodes[chosen[first + s], j]
            gather(points, own, corners, 0, count, jacobians)
            evaluate(
                jacobians, 0, count, shape, ideal, told, work,
                size[first:last], skew[first:last], inverted[first:last],
            )  # fmt: skip


@njit(cache=True, error_model="numpy", parallel=True)
def transformed_quality(  # type: ignore[no-untyped-def]
    points, nodes, corners, shape, ideal, reference, gradients, size, skew, inverted
):
    """As node_quality with every corner Jacobian A replaced by (I + J) A, J = gradients (m, d, d) of the cell."""
    m, d = nodes.shape[0], points.shape[1]
    for b in prange((m + BLOCK - 1) // BLOCK):
        jacobians = np.empty((corners.shape[0], d, d, CHUNK))
        before = np.empty((corners.shape[0], d, d, CHUNK))
        work = np.empty((5, CHUNK))
        for first in range(b * BLOCK, min(m, (b + 1) * BLOCK), CHUNK):
            count = min(CHUNK, m - first)
            last = first + count
            gather(points, nodes, corners, first, count, before)
            for c in range(corners.shape[0]):
                for i in range(d):
                    for j in range(d):
                        for s in range(count):
                            jacobians[c, i, j, s] = before[c, i, j, s]
                        for k in range(d):
                            for s in range(count):
                                jacobians[c, i, j, s] += gradients[first + s, i, k] * before[c, k, j, s]
            evaluate(
                jacobians, first, count, shape, ideal, reference, work,
                size[first:last], skew[first:last], inverted[first:last],
            )  # fmt: skip


@njit(cache=True, error_model="numpy", parallel=True)
def column_quality(edges, columns, shape, ideal, reference, size, skew, inverted):  # type: ignore[no-untyped-def]
    """As node_quality from edge vectors (e, d); columns (m, n_corners, d) is ±(edge number + 1)."""
    m, n_corners, d = columns.shape
    for b in prange((m + BLOCK - 1) // BLOCK):
        jacobians = np.empty((n_corners, d, d, CHUNK))
        work = np.empty((5, CHUNK))
        for first in range(b * BLOCK, min(m, (b + 1) * BLOCK), CHUNK):
            count = min(CHUNK, m - first)
            last = first + count
            for c in range(n_corners):
                for j in range(d):
                    for s in range(count):
                        column = columns[first + s, c, j]
                        for i in range(d):
                            value = edges[abs(column) - 1, i]
                            jacobians[c, i, j, s] = value if column > 0 else -value
            evaluate(
                jacobians, first, count, shape, ideal, reference, work,
                size[first:last], skew[first:last], inverted[first:last],
            )  # fmt: skip


@njit(cache=True, error_model="numpy", parallel=True)
def node_extremes(  # type: ignore[no-untyped-def]
    points, nodes, corners, shape, ideal, reference, rest, code
):
    """Per work item: the smallest metric value, its cell, and the number of inverted cells. Nothing is stored."""
    m, d = nodes.shape[0], points.shape[1]
    blocks = (m + BLOCK - 1) // BLOCK
    least, where, inversions = np.empty(blocks), np.empty(blocks, np.int64), np.empty(blocks, np.int64)
    for b in prange(blocks):
        jacobians = np.empty((corners.shape[0], d, d, CHUNK))
        work = np.empty((5, CHUNK))
        size, skew, inverted = np.empty(CHUNK), np.empty(CHUNK), np.empty(CHUNK, np.bool_)
        lowest, cell, count_inverted = np.inf, b * BLOCK, 0
        for first in range(b * BLOCK, min(m, (b + 1) * BLOCK), CHUNK):
            count = min(CHUNK, m - first)
            gather(points, nodes, corners, first, count, jacobians)
            evaluate(jacobians, first, count, shape, ideal, reference, work, size, skew, inverted)
            for s in range(count):
                if code == RELATIVE:
                    skew[s] = relative_skew(skew[s], rest[first + s])
                value = metric_value(size[s], skew[s], code)
                count_inverted += inverted[s]
                if value < lowest:
                    lowest, cell = value, first + s
        least[b], where[b], inversions[b] = lowest, cell, count_inverted
    return least, where, inversions
