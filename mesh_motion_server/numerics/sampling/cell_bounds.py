"""Quality of cells by their group's Taylor polynomial, and the least it can be given the remainder.

If ∇S is known up to ε (operator norm) in a ball that holds the cell, an edge e of it is known up to ε |e|. So a corner
Jacobian with columns J_i is off by columns of length δ_i = ε |e_i| at most, and ::

    |det − det J| ≤ Π (|J_i| + δ_i) − Π |J_i|                          (Hadamard, term by term)
    |J W⁻¹|_F off by at most √(Σ δ_i²) |W⁻¹|                           (mean ratio)
    Π of the column lengths at most Π (|J_i| + δ_i)                     (angles)

With the least determinants the largest f_k of :mod:`~mesh_motion_server.numerics.corner_kernels` follow, hence the
least skew n / Σ f_k; with the least and the largest Σ α_k the least size. A cell with a corner that might be inverted
has no bound (-inf).
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from mesh_motion_server.numerics.cells import CellType
from mesh_motion_server.numerics.corner_kernels import ANGLES, MEAN_RATIO
from mesh_motion_server.numerics.metrics import ideal_corner, shape_code, work_items
from mesh_motion_server.numerics.read_only import read_only
from mesh_motion_server.numerics.sampling.groups import Groups
from mesh_motion_server.numerics.thread_share import threads_for

__all__ = ["bounded_quality"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

# cells per work item of the parallel loop
_BLOCK = 4096
# what rounding may add to a bound that is exact in real numbers
_ROUNDING = 1.0 - 1e-9


def bounded_quality(
    points: Floats,
    cell_type: CellType,
    nodes: Ints,
    reference: Floats,
    group: Ints,
    groups: Groups,
    coefficients: Floats,
    remainder: Floats,
) -> tuple[Floats, Floats]:
    """Size and skew of cells of one type by the polynomials of their groups, and their least values.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
    cell_type : CellType
    nodes : (m, n_nodes) array
    reference : (m,) array
        Summed corner determinants of the reference mesh.
    group : (m,) array
        Group of each cell.
    groups : Groups
    coefficients : (g, d, c) array
        Taylor coefficients about the groups' centres.
    remainder : (g,) array

    Returns
    -------
    modelled, least : (2, m) arrays
        Rows size and skew; ``least`` is -inf where nothing is certain.
    """
    ideal = ideal_corner(cell_type.name)
    d = cell_type.dimension
    modelled, least = np.empty((2, len(nodes))), np.empty((2, len(nodes)))
    with threads_for(work_items(len(nodes))):
        _bound(
            points,
            read_only(nodes),
            cell_type.corner_array,
            shape_code(cell_type),
            ideal,
            float(np.sqrt(np.linalg.eigvalsh(ideal[:d, :d])[-1])),
            read_only(reference),
            read_only(group),
            read_only(groups.centres),
            read_only(coefficients),
            read_only(remainder),
            modelled,
            least,
        )
    return modelled, least


@njit(cache=True, error_model="numpy")
def _polynomial(y, coefficients, out):  # type: ignore[no-untyped-def]
    """Displacement (d,) at y from the group's centre, less that of the centre itself."""
    d = y.size
    for i in range(d):
        c = coefficients[i]
        total = 0.0
        place = 0
        for a in range(d):
            total += c[place] * y[a]
            place += 1
        for a in range(d):
            for b in range(a, d):
                total += c[place] * y[a] * y[b]
                place += 1
        for a in range(d):
            for b in range(a, d):
                for e in range(b, d):
                    total += c[place] * y[a] * y[b] * y[e]
                    place += 1
        out[i] = total


@njit(cache=True, error_model="numpy")
def _determinant(j):  # type: ignore[no-untyped-def]
    d = j.shape[0]
    if d == 1:
        return j[0, 0]
    if d == 2:
        return j[0, 0] * j[1, 1] - j[0, 1] * j[1, 0]
    return (
        j[0, 0] * (j[1, 1] * j[2, 2] - j[2, 1] * j[1, 2])
        + j[1, 0] * (j[2, 1] * j[0, 2] - j[0, 1] * j[2, 2])
        + j[2, 0] * (j[0, 1] * j[1, 2] - j[1, 1] * j[0, 2])
    )


@njit(cache=True, error_model="numpy")
def _shape_term(shape, ideal, inverse_norm, j, longer, slack, det):  # type: ignore[no-untyped-def]
    """f_k of a corner with determinant det: √(Σ δ²) and |J_i| + δ_i for its bound, 0 and |J_i| for its value."""
    d = j.shape[0]
    if shape == MEAN_RATIO:
        square = 0.0
        for a in range(d):
            for b in range(d):
                for i in range(d):
                    square += ideal[a, b] * j[i, a] * j[i, b]
        norm = np.sqrt(max(square, 0.0)) + slack * inverse_norm
        ratio = ideal[d, 0] / det
        return norm * norm / d * (ratio if d == 2 else np.cbrt(ratio * ratio))
    if shape == ANGLES:
        ratio = ideal[d, 1] / det
        for i in range(d):
            ratio *= longer[i]
        return ratio if d == 2 else np.cbrt(ratio * ratio)
    return 1.0


@njit(cache=True, error_model="numpy")
def _displace(points, nodes, middle, coefficients, y, moved):  # type: ignore[no-untyped-def]
    """moved (n_nodes, d) = displacements of a cell's nodes by its group's polynomial; y (d,) is workspace."""
    for k in range(nodes.size):
        for i in range(y.size):
            y[i] = points[nodes[k], i] - middle[i]
        _polynomial(y, coefficients, moved[k])


@njit(cache=True, error_model="numpy")
def _columns(points, nodes, corner, moved, epsilon, j, lengths, longer):  # type: ignore[no-untyped-def]
    """Fill a corner's Jacobian j (d, d), |J_i| and |J_i| + δ_i (d,); their products, and Σ δ²."""
    d = j.shape[0]
    origin = corner[0]
    product, product_longer, slack = 1.0, 1.0, 0.0
    for a in range(d):
        end = corner[a + 1]
        before, after = 0.0, 0.0
        for i in range(d):
            edge = points[nodes[end], i] - points[nodes[origin], i]
            j[i, a] = edge + moved[end, i] - moved[origin, i]
            before += edge * edge
            after += j[i, a] * j[i, a]
        delta = epsilon * np.sqrt(before)
        lengths[a] = np.sqrt(after)
        longer[a] = lengths[a] + delta
        product *= lengths[a]
        product_longer *= longer[a]
        slack += delta * delta
    return product, product_longer, slack


@njit(cache=True, error_model="numpy")
def _corner_sums(points, nodes, corners, shape, ideal, inverse_norm, moved, epsilon, j, lengths, longer):  # type: ignore[no-untyped-def]
    """Σ det with its least and largest value, Σ f_k with its largest, and whether no corner might be inverted."""
    total, total_low, total_high, terms, terms_high, certain = 0.0, 0.0, 0.0, 0.0, 0.0, True
    for c in range(len(corners)):
        product, product_longer, slack = _columns(points, nodes, corners[c], moved, epsilon, j, lengths, longer)
        det = _determinant(j)
        off = product_longer - product
        total += det
        total_low += det - off
        total_high += det + off
        terms += _shape_term(shape, ideal, inverse_norm, j, lengths, 0.0, abs(det))
        if det - off > 0.0:
            terms_high += _shape_term(shape, ideal, inverse_norm, j, longer, np.sqrt(slack), det - off)
        else:
            certain = False
    return total, total_low, total_high, terms, terms_high, certain


@njit(cache=True, error_model="numpy", parallel=True)
def _bound(  # type: ignore[no-untyped-def]
    points,
    nodes,
    corners,
    shape,
    ideal,
    inverse_norm,
    reference,
    group,
    middles,
    coefficients,
    remainder,
    modelled,
    least,
):
    """Fill modelled and least (2, m); cells of a group without a remainder (inf) get NaN and -inf."""
    m, n_nodes = nodes.shape
    d = points.shape[1]
    n_corners = corners.shape[0]
    for block in prange((m + _BLOCK - 1) // _BLOCK):
        y, moved = np.empty(d), np.empty((n_nodes, d))
        j, lengths, longer = np.empty((d, d)), np.empty(d), np.empty(d)
        for e in range(block * _BLOCK, min(m, (block + 1) * _BLOCK)):
            g = group[e]
            epsilon = remainder[g]
            modelled[0, e], modelled[1, e], least[0, e], least[1, e] = np.nan, np.nan, -np.inf, -np.inf
            if not epsilon < np.inf:
                continue
            _displace(points, nodes[e], middles[g], coefficients[g], y, moved)
            total, total_low, total_high, terms, terms_high, certain = _corner_sums(
                points, nodes[e], corners, shape, ideal, inverse_norm, moved, epsilon, j, lengths, longer
            )
            tau = total / reference[e]
            size = min(abs(tau), 1.0 / abs(tau))
            modelled[0, e] = size if tau > 0.0 else -size
            modelled[1, e] = n_corners / terms
            if certain:
                least[0, e] = _ROUNDING * min(total_low / reference[e], reference[e] / total_high)
                least[1, e] = _ROUNDING * n_corners / terms_high
