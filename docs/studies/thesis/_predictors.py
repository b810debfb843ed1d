"""The quality a mesh would have after a displacement, before any node moves (thesis chapter 3).

A corner Jacobian A becomes ``A + [S(x_a) - S(x_k), S(x_b) - S(x_k), …]`` with the displacement S of the nodes at x_k:
thesis (3.1)–(3.4). The predictors use different properties of S:

===========================  ==================================================  ===============  ================
predictor                    new Jacobian                                        triangle, tetra  line, quad,
                                                                                 wedge, pyramid   hexahedron
===========================  ==================================================  ===============  ================
``centre-gradient``          (I + ∇S) A, ∇S at the cell's centre; thesis (3.20)  O(h)             O(h²)
``edge-midpoint-gradient``   each edge e becomes (I + ∇S) e, ∇S at its midpoint  O(h²)            O(h²)
``trial-nodes``              from the displacements of the nodes                 exact            exact
===========================  ==================================================  ===============  ================

The thesis takes (3.20) to be of second order on triangles (Fig. 3.10). Its order is one: the midpoints of a
corner's edges are O(h) away from the centre of a simplex, while the errors of opposite corners of a quad cancel.
``trial-nodes`` is the default: it is exact, and a mesh of tetrahedra has five to six times fewer nodes than cells.

A motion is predicted by ``trial-nodes``; the other predictors serve the thesis' studies.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import mesh_motion_kernels as kernels
import numpy as np
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.mesh.cells import CellTable, CellType
from mesh_motion_numerics.quality.metrics import (
    AtRest,
    CellQuality,
    as_positions,
    cell_quality,
    empty_quality,
    sizes_of,
    skews_of,
)
from mesh_motion_protocol.errors import InvalidInput
from numpy.typing import NDArray

if TYPE_CHECKING:
    from mesh_motion_numerics.interpolation.two_scale.interpolant import AnyInterpolant

__all__ = [
    "PREDICTORS",
    "CallableField",
    "DisplacementField",
    "InterpolantField",
    "centre_positions",
    "predict",
    "transformed_quality",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

# Cells per batch of the gradient predictors: bounds their memory for any size of the mesh.
_BATCH = 32768


class DisplacementField(Protocol):
    """A displacement that can be evaluated anywhere."""

    def displacement(self, points: Floats) -> Floats:
        """S at the points (n, d): (n, d), mesh length unit."""
        ...

    def gradient(self, points: Floats) -> Floats:
        """∇S at the points (n, d): (n, d, d), ``[:, i, j] = ∂S_i/∂x_j``."""
        ...


@dataclass(frozen=True)
class CallableField:
    """A displacement field from two functions of points (n, d)."""

    displacement: Callable[[Floats], Floats]
    gradient: Callable[[Floats], Floats]


@dataclass(frozen=True, eq=False)
class InterpolantField:
    """The displacement field of an interpolant."""

    interpolant: AnyInterpolant

    def displacement(self, points: Floats) -> Floats:
        """S at the points (n, d)."""
        return evaluation.displacement(self.interpolant, points)

    def gradient(self, points: Floats) -> Floats:
        """∇S at the points (n, d)."""
        return evaluation.gradient(self.interpolant, points)


def predict(
    name: str, points: NDArray[np.floating], cells: CellTable, reference_sizes: AtRest, field: DisplacementField
) -> CellQuality:
    """Quality of every cell after the displacement, without moving a node.

    Parameters
    ----------
    name : str
        One of :data:`PREDICTORS`.
    points : (n, d) array, mesh length unit
        Current positions.
    reference_sizes : (m,) array or CellsAtRest
        From :func:`~mesh_motion_numerics.quality.metrics.reference_sizes` or :func:`.cells_at_rest`.
    field : DisplacementField
        Displacement since ``points``.

    Raises
    ------
    InvalidInput
        On an unknown predictor.
    """
    if name not in PREDICTORS:
        raise InvalidInput(f"unknown predictor {name!r}; known are {', '.join(PREDICTORS)}")
    positions, sizes = as_positions(points, cells.dimension), sizes_of(reference_sizes)
    found, at_rest = PREDICTORS[name](positions, cells, sizes, field), skews_of(reference_sizes)
    return replace(found, relative=None if at_rest is None else np.minimum(found.skew / at_rest, 1.0))


def centre_positions(points: Floats, cells: CellTable) -> Floats:
    """(m, d) mean of the nodes of every cell, the point at which the thesis evaluates ∇S."""
    return np.concatenate([points[block.nodes].mean(axis=1) for block in cells])


def transformed_quality(
    points: NDArray[np.floating], cells: CellTable, reference_sizes: Floats, gradients: Floats
) -> CellQuality:
    """Quality with every corner Jacobian A of a cell replaced by (I + ∇S) A.

    Thesis (3.3), (3.4) with one ∇S for all edges: (3.7) on a line, (3.18)–(3.20) in 2D, (3.26) and (3.27) in 3D.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
    reference_sizes : (m,) array
    gradients : (m, d, d) array
        ∇S of each cell.
    """
    positions, out = as_positions(points, cells.dimension), empty_quality(len(cells))
    for _, nodes, rows in _batches(cells):
        _transform(positions, nodes, reference_sizes, gradients[rows], out, rows)
    return out


def _centre_gradient(
    points: Floats, cells: CellTable, reference_sizes: Floats, field: DisplacementField
) -> CellQuality:
    """Thesis (3.20), (3.27): one gradient for each cell."""
    out = empty_quality(len(cells))
    for _, nodes, rows in _batches(cells):
        gradients = field.gradient(points[nodes].mean(axis=1))
        _transform(points, nodes, reference_sizes, gradients, out, rows)
    return out


def _transform(
    points: Floats, nodes: NDArray[np.int32], reference_sizes: Floats, gradients: Floats, out: CellQuality, rows: slice
) -> None:
    """(I + ∇S) A of cells of one type, written into out[rows]."""
    kernels.transformed_quality(
        points,
        nodes,
        np.ascontiguousarray(reference_sizes[rows]),
        np.ascontiguousarray(gradients),
        out.size[rows],
        out.skew[rows],
        out.inverted[rows],
    )


def _edge_midpoint_gradient(
    points: Floats, cells: CellTable, reference_sizes: Floats, field: DisplacementField
) -> CellQuality:
    """One gradient for each edge: the midpoint rule for S(x_a) - S(x_k) = ∫ ∇S e ds, hence of second order."""
    out = empty_quality(len(cells))
    for cell_type, nodes, rows in _batches(cells):
        ends, columns = _corner_edges(nodes, cell_type)
        start, end = points[ends[:, 0]], points[ends[:, 1]]
        edges = end - start
        edges = edges + np.einsum("eij,ej->ei", field.gradient(0.5 * (start + end)), edges)
        kernels.column_quality(
            edges,
            columns,
            np.ascontiguousarray(reference_sizes[rows]),
            out.size[rows],
            out.skew[rows],
            out.inverted[rows],
        )
    return out


def _trial_nodes(points: Floats, cells: CellTable, reference_sizes: Floats, field: DisplacementField) -> CellQuality:
    """Thesis (3.2) for the nodes, exact."""
    return cell_quality(points + field.displacement(points), cells, reference_sizes)


#: Every predictor: (points, cells, reference sizes, field) → CellQuality.
PREDICTORS: dict[str, Callable[[Floats, CellTable, Floats, DisplacementField], CellQuality]] = {
    "trial-nodes": _trial_nodes,
    "edge-midpoint-gradient": _edge_midpoint_gradient,
    "centre-gradient": _centre_gradient,
}


def _batches(cells: CellTable) -> Iterator[tuple[CellType, NDArray[np.int32], slice]]:
    """Batches of cells of one type with their cell numbers."""
    for block, rows in cells.numbered:
        for first in range(0, len(block), _BATCH):
            nodes = block.nodes[first : first + _BATCH]
            yield block.type, nodes, slice(rows.start + first, rows.start + first + len(nodes))


def _corner_edges(nodes: NDArray[np.int32], cell_type: CellType) -> tuple[Ints, Ints]:
    """The edges (e, 2) that leave the cells' corners, each once, and ±(edge + 1) for each (cell, corner, column)."""
    corners = cell_type.corner_array
    start = np.repeat(nodes[:, corners[:, 0], None], cell_type.dimension, axis=2)
    end = nodes[:, corners[:, 1:]]
    low, high = np.minimum(start, end).ravel().astype(np.int64), np.maximum(start, end).ravel()  # keys exceed 2³¹
    n = int(high.max()) + 1
    keys, places = np.unique(low * n + high, return_inverse=True)
    sign = np.where(start < end, 1, -1)
    return np.column_stack([keys // n, keys % n]), sign * (places.reshape(sign.shape) + 1)
