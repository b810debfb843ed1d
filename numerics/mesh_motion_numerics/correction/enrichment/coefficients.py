"""Optimised enrichment: all coefficients of all enrichment points at once, chosen for the best worst cell.

The functions ψ of an :class:`~.space.EnrichmentSpace` vanish on the boundary nodes, so the boundary condition holds for
*any* coefficients, and the trial positions of all nodes are linear in them: ``y = y_standard + Σ ψ_m C_m``. The
coefficients that minimise the p-mean of the distortion (:mod:`.correction.distortion`) are found by
the same projected Gauss–Newton as free nodes, with its steps restricted to the space of the ψ: a dense system of at
most 2 K d² unknowns.

On a large mesh only a working set of cells is used: the worst cells and a sample of the others. The result is judged on
all cells, and cells that are worse than the working set join it.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve, lstsq
from scipy.sparse import csr_matrix

from mesh_motion_numerics.arrays import Floats, Marks
from mesh_motion_numerics.correction.enrichment.placement import Placement, spread_placement
from mesh_motion_numerics.correction.enrichment.space import EnrichmentSpace
from mesh_motion_numerics.correction.free_region import NodeAdjacency, free_region, nodes_of_cells
from mesh_motion_numerics.correction.trial_nodes import Polished, TrialMesh, polish
from mesh_motion_numerics.mesh.cells import CellTable

WHOLE_CELLS = 100_000
"""Meshes up to this size are optimised as a whole: with 90 000 cells in half the time of the working sets."""

WORKING_CELLS = 20_000
"""Number of cells of the first working set of a larger mesh."""

RADIUS_CYCLE = (1.0, 2.0)
"""Radii of consecutive points, relative to R_l: wider than for one point at a time, because all points act together."""

_ROUNDS = 4
_DEPENDENT = 3e-6  # singular values below this share of the largest; ten times as much costs up to 6 % of the quality
_RIDGES = (1e-6, 1e-4, 1e-2)  # added to a unit diagonal


def optimised_placement(start: Floats, cells: CellTable, quality: Floats, *, count: int, radius: float) -> Placement:
    """Enrichment points for :func:`optimised_enrichment`, at bad cells (quality (m,)) far from each other.

    The badness is squared: in 3D this gives up to a tenth more of the best possible quality, in 2D the same.
    """
    squared = 1.0 - (1.0 - np.clip(quality, -1.0, 1.0)) ** 2
    placement = spread_placement(start, cells, squared, count=count, radius=radius)
    radii = radius * np.resize(np.array(RADIUS_CYCLE), len(placement.points))
    return placement._replace(radii=radii)


class _SpaceSteps:
    """Newton steps within the span of functions (f, s) at the free nodes.

    The functions are nearly dependent. An orthonormal basis of their span without its negligible directions is so well
    conditioned that the Hessian can be reduced in single precision, in two thirds (20 points) to a third (60) of the
    time.
    """

    def __init__(self, functions: Floats) -> None:
        scaled = functions / np.maximum(np.linalg.norm(functions, axis=0), 1e-300)
        left, values, _ = np.linalg.svd(scaled, full_matrices=False)
        self._basis = np.ascontiguousarray(left[:, values > _DEPENDENT * values[0]])
        self._single = self._basis.astype(np.float32)

    def __call__(self, adjacency: NodeAdjacency, hessian: Floats, right: Floats) -> Floats:
        """Step (f, d): the Hessian (b, d, d) and the right side (f, d) projected to the basis (f, r), and solved."""
        d, r = right.shape[1], self._basis.shape[1]
        coefficients = _solve_scaled(self._reduced(adjacency, hessian), (self._basis.T @ right).T.ravel())
        return np.asarray(self._basis @ coefficients.reshape(d, r).T)

    def _reduced(self, adjacency: NodeAdjacency, hessian: Floats) -> NDArray[np.float32]:
        """(d r, d r) Hessian in the basis, component by component; it is symmetric."""
        basis, (n, r), d = self._single, self._single.shape, hessian.shape[1]
        single = hessian.astype(np.float32)
        reduced = np.empty((d, r, d, r), dtype=np.float32)
        for i in range(d):
            for j in range(i, d):
                part = csr_matrix((single[:, i, j], adjacency.columns, adjacency.row_starts), shape=(n, n))
                reduced[i, :, j] = basis.T @ (part @ basis)
                if j > i:
                    reduced[j, :, i] = reduced[i, :, j].T
        return reduced.reshape(d * r, d * r)


def _solve_scaled(matrix: NDArray[np.float32], right: Floats) -> Floats:
    """Solve with unit diagonal and the smallest ridge that makes the matrix, which is overwritten, definite."""
    scale = 1.0 / np.sqrt(np.maximum(matrix.diagonal(), np.finfo(matrix.dtype).tiny))
    matrix *= scale[:, None]
    matrix *= scale
    for ridge in _RIDGES:
        np.fill_diagonal(matrix, 1.0 + ridge)
        try:
            factor = cho_factor(matrix, lower=True, check_finite=False)
        except LinAlgError:
            continue
        return np.asarray(scale * cho_solve(factor, (scale * right).astype(matrix.dtype)), dtype=np.float64)
    return np.asarray(scale * scale * right, dtype=np.float64)


def optimised_enrichment(
    mesh: TrialMesh, start: Floats, standard: Floats, space: EnrichmentSpace, *, target: float
) -> Polished:
    """Choose the coefficients of an enrichment space for the best worst cell.

    Parameters
    ----------
    start, standard : (n, d) arrays, mesh length unit
        Positions before the motion, and those of the standard motion.
    space : EnrichmentSpace
        Over the positions ``start``.
    target : float
        Stop as soon as every cell is at least this good.
    """
    quality = mesh.quality(standard)
    chosen = _working_set(quality)
    points, minimum, iterations = standard, float(quality.min()), 0
    found = points
    for _ in range(_ROUNDS):
        found, polished = _optimise(mesh, start, standard, found, space, chosen, target)
        iterations += polished.iterations
        quality = mesh.quality(found)
        if quality.min() > minimum:
            points, minimum = found, float(quality.min())
        if minimum >= target or quality.min() >= polished.minimum:
            break
        chosen |= quality < max(polished.minimum, np.partition(quality, WORKING_CELLS // 10)[WORKING_CELLS // 10])
    return Polished(points, minimum, iterations=iterations)


def _working_set(quality: Floats) -> Marks:
    """Mark (m) the cells to use: all, or one half the worst cells and one half a sample of the rest."""
    chosen = np.ones(len(quality), dtype=bool)
    if len(quality) > WHOLE_CELLS:
        chosen[:] = False
        chosen[np.argsort(quality, kind="stable")[: WORKING_CELLS // 2]] = True
        chosen[:: -(-2 * len(quality) // WORKING_CELLS)] = True
    return chosen


def _optimise(
    mesh: TrialMesh,
    start: Floats,
    standard: Floats,
    points: Floats,
    space: EnrichmentSpace,
    chosen: Marks,
    target: float,
) -> tuple[Floats, Polished]:
    """Optimise over the chosen (m) cells from ``points`` (n, d); the positions of all nodes follow."""
    marked = nodes_of_cells(mesh.cells, chosen, len(points)) & ~mesh.held
    region = free_region(mesh.reference, mesh.cells, mesh.reference_sizes, marked, chosen=chosen)
    psi = space.values(start[region.free])
    polished = polish(points, mesh, region, target=target, solve=_SpaceSteps(psi))
    if region.n_free == np.count_nonzero(~mesh.held):
        return polished.points, polished
    coefficients = lstsq(psi, polished.points[region.free] - standard[region.free], lapack_driver="gelsy")[0]
    rest = np.flatnonzero(~mesh.held)
    moved = standard.copy()
    moved[rest] += space.displacement(start[rest], coefficients)
    return moved, polished
