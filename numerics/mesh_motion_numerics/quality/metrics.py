"""Mesh quality: relative size, skew and size-skew of every cell (thesis §2.3).

The size metric compares a cell with itself in the reference mesh, ``τ = Σ_k α_k / Σ_k α_k⁰`` with the corner
determinants α_k (on a line the ratio of lengths (3.6)), ``size = sign(τ) · min(|τ|, 1/|τ|)``: thesis (2.13), which, as
printed, sums the ratios and so gives n for an undeformed cell. Skew is absolute: 1 for the ideal cell, 0 for a
degenerate one. It is computed from the entries of λ = AᵀA (3.22), thesis (2.14), (3.30); the formulas of all cell types
are in ``kernels/src/quality/cell_types.h``. Size and skew are combined to

======================  =================================  =========================================
metric                  formula                            source
======================  =================================  =========================================
``size``                size                               thesis (2.13); its 2D tables use this one
``skew``                skew                               thesis (2.14)
``size-skew``           sign(size) · √|size| · skew        thesis, text below (2.15)
``size-skew-root``      sign(size) · √(|size| · skew)      thesis (2.15)
``size-skew-product``   size · skew                        thesis (3.21), (3.24), (3.28), (3.30)
``relative-size-skew``  size-skew with the shape relative  target matrices: Knupp (2012)
                        to the cell at rest
======================  =================================  =========================================

The last one compares size and shape with the cell itself in the reference mesh: it is 1 at rest and after any rigid
motion of the cell, for every shape. For triangles and tetrahedra the relative shape is ``min(1, skew / skew at rest)``:
a triangle of a boundary layer that is a thousand times as long as high always has a skew of 1e-3; its relative shape
falls when its height falls. For other cells it is the smallest ``d det(T)^(2/d) / |T|²_F`` of ``T = A_k A_k⁰⁻¹`` over
the corners: the skew of (2.14) depends only on their angles and is 1 for every rectangle, but T also depends on the
aspect ratio. The worst corner is used and not a mean, because the worst corner affects a flow solver: a mean over a
quad's corners may be three times as good.

Skew is never negative. A cell whose corners are all inverted has the skew of its mirror image, so size-skew
distinguishes a badly inverted cell from a slightly inverted one; a cell with only some corners inverted has skew 0. A
cell with a position that is not finite has -inf in every metric: worse than any number, never equal to a good value.

Node indices are not checked here: :func:`~mesh_motion_numerics.quality.mesh_check.checked_mesh` does that once.

References
----------
P. M. Knupp, Algebraic mesh quality metrics for unstructured initial meshes, Finite Elements in Analysis and Design
39 (2003) 217–241. P. M. Knupp, Introducing the target-matrix paradigm for mesh optimization via node-movement,
Engineering with Computers 28 (2012) 419–429.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import mesh_motion_kernels as kernels
import numpy as np
from mesh_motion_protocol.errors import InvalidInput
from numpy.typing import NDArray

from mesh_motion_numerics.arrays import Floats, Integers, Marks, Shorts
from mesh_motion_numerics.mesh.cells import CellTable, CellType

#: Name → formula of every quality metric.
QUALITY_METRICS: dict[str, str] = {
    "size": "sign(τ) min(|τ|, 1/|τ|)",
    "skew": "skew",
    "size-skew": "sign(size) √|size| skew",
    "size-skew-root": "sign(size) √(|size| skew)",
    "size-skew-product": "size skew",
    "relative-size-skew": "sign(size) √|size| shape relative to the cell at rest",
}

#: Name of :func:`corner_quality`, by which regions are chosen.
WORST_CORNER = "corner-shape-size"
#: Number of each quality metric in the compiled loops.
METRIC_CODES = {name: code for code, name in enumerate(QUALITY_METRICS)}
_RELATIVE = "relative-size-skew"
_NOTHING = np.empty(0), np.empty((0, 0))


@dataclass(frozen=True, eq=False)
class CellQuality:
    """Quality of m cells."""

    size: Floats  # (m,). Signed relative size in [-1, 1]; -inf for a cell with positions that are not finite
    skew: Floats  # (m,). In [0, 1]; -inf as above
    inverted: Marks  # (m,) bool. Any corner determinant ≤ 0 (or not a number)
    #: (m,). Shape relative to the cell at rest, in [0, 1], if the cells at rest are known;
    #: "relative-size-skew" needs it.
    relative: Floats | None = None

    def __len__(self) -> int:
        return len(self.size)

    def subset(self, numbers: Integers | slice) -> CellQuality:
        """The quality of only the cells with the given numbers, in that order."""
        relative = None if self.relative is None else self.relative[numbers]
        return CellQuality(self.size[numbers], self.skew[numbers], self.inverted[numbers], relative)

    def worst(self, numbers: Integers, metric: str) -> Floats:
        """The metric, size, skew and size-skew (s, 4) of the worst cells."""
        chosen = self.subset(numbers)
        return np.column_stack([chosen.metric(name) for name in (metric, "size", "skew", "size-skew")])

    @property
    def relative_shape(self) -> Floats:
        """Shape relative to the cell at rest (m,), at most 1; InvalidInput if the cells at rest are not known."""
        if self.relative is None:
            raise _unknown_rest()
        return self.relative

    def relative_extremes(self) -> tuple[float, float]:
        """The smallest relative shape (0 for an inverted cell) and the smallest size."""
        relative = np.where(self.inverted, 0.0, self.relative_shape)
        return float(relative.min()), float(self.size.min())

    def metric(self, name: str) -> Floats:
        """Values (m,) of one of :data:`QUALITY_METRICS`.

        Raises InvalidInput on an unknown name, or one that needs the cells at rest if they are not known.
        """
        code, skew = metric_code(name), self.skew
        if name in ("size", "skew"):
            return self.size if name == "size" else self.skew
        if name == _RELATIVE:
            skew = self.relative_shape
        values = np.empty(len(self))
        kernels.metric_values(np.ascontiguousarray(self.size), np.ascontiguousarray(skew), code, values)
        return values


@dataclass(frozen=True, eq=False)
class CellsAtRest:
    """The cells in the reference mesh; moved cells are measured against them."""

    sizes: Floats  # (m,). Result of :func:`reference_sizes`
    skews: Floats  # (m,)
    points: Floats  # (n, d), mesh length unit. Coordinates of the reference mesh's nodes

    def __len__(self) -> int:
        return len(self.sizes)

    def __getitem__(self, rows: Any) -> CellsAtRest:
        return CellsAtRest(self.sizes[rows], self.skews[rows], self.points)

    def of_nodes(self, nodes: Integers) -> CellsAtRest:
        """The same cells in a mesh that has only these nodes (k,)."""
        return replace(self, points=self.points[nodes])


#: Reference sizes alone, or the cells at rest.
AtRest = Floats | CellsAtRest


def _unknown_rest() -> InvalidInput:
    return InvalidInput("the metric 'relative-size-skew' needs the cells at rest: give CellsAtRest")


def sizes_of(rest: AtRest) -> Floats:
    """(m,) reference sizes."""
    return rest.sizes if isinstance(rest, CellsAtRest) else rest


def skews_of(rest: AtRest) -> Floats | None:
    """(m,) skews at rest, or None."""
    return rest.skews if isinstance(rest, CellsAtRest) else None


def metric_code(name: str) -> int:
    """Number of a metric in the compiled loops; InvalidInput on an unknown name."""
    if name not in QUALITY_METRICS:
        raise InvalidInput(
            f"unknown quality metric {name!r}; known are {', '.join(QUALITY_METRICS)}", details={"metric": str(name)}
        )
    return METRIC_CODES[name]


def uses_angles(cell_type: CellType) -> bool:
    """Whether the skew of a cell type follows from the angles between its edges, not from the mean ratio."""
    return cell_type.name in ("quad", "hexahedron", "wedge")


def empty_quality(count: int) -> CellQuality:
    """Uninitialised result arrays for the compiled loops."""
    return CellQuality(np.empty(count), np.empty(count), np.empty(count, dtype=np.bool_))


def judged(
    points: NDArray[np.floating], cells: CellTable, rest: AtRest, metric: str
) -> tuple[Floats, tuple[Shorts, ...], Floats, tuple[Floats, Floats], int]:
    """Arguments of loops over all cells: the points (n, d), the nodes of each block, the reference sizes, the skews and
    points at rest (empty unless the metric needs them), and the metric's number. Raises InvalidInput on points of
    another dimension, an unknown metric, or one that needs the cells at rest if they are not known.
    """
    code, at_rest = metric_code(metric), _NOTHING
    if metric == _RELATIVE:
        if not isinstance(rest, CellsAtRest):
            raise _unknown_rest()
        at_rest = np.ascontiguousarray(rest.skews), np.ascontiguousarray(rest.points)
    sizes = np.ascontiguousarray(sizes_of(rest))
    return as_positions(points, cells.dimension), cells.nodes, sizes, at_rest, code


def as_positions(points: NDArray[np.floating], dimension: int) -> Floats:
    """Points in the form for the compiled loops; InvalidInput if they are not (n, d) with the cells' dimension."""
    positions = np.ascontiguousarray(points, dtype=np.float64)
    if positions.ndim != 2 or positions.shape[1] != dimension:
        raise InvalidInput(
            f"points: expected an array of shape (n, {dimension}) for {dimension}D cells, got {positions.shape}",
            code="INVALID_ARGUMENT.SHAPE",
            details={"shape": list(positions.shape), "dimension": dimension},
        )
    return positions


def reference_sizes(points: NDArray[np.floating], cells: CellTable) -> Floats:
    """Σ_k det A_k of every cell of the reference mesh: the reference of τ.

    Parameters
    ----------
    points : (n, d) array, mesh length unit

    Returns
    -------
    (m,) array, mesh length unit to the power d
        Proportional to length, area or volume (:attr:`CellType.size_factor`).
    """
    positions = as_positions(points, cells.dimension)
    out = np.empty(len(cells))
    for block, rows in cells.numbered:
        kernels.cell_sizes(positions, np.ascontiguousarray(block.nodes), out[rows])
    return out


def cells_at_rest(points: NDArray[np.floating], cells: CellTable, sizes: Floats | None = None) -> CellsAtRest:
    """The cells of the reference mesh with nodes at ``points`` (n, d).

    Parameters
    ----------
    points : (n, d) array, mesh length unit
    sizes : (m,) array, optional
        Result of :func:`reference_sizes`, if it is known.
    """
    sizes = reference_sizes(points, cells) if sizes is None else sizes
    positions = as_positions(points, cells.dimension)
    return CellsAtRest(sizes, cell_quality(positions, cells, sizes).skew, positions)


def cell_quality(points: NDArray[np.floating], cells: CellTable, reference_sizes: AtRest) -> CellQuality:
    """Size, skew, validity and, if the cells at rest are known, relative shape of every cell.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
    reference_sizes : (m,) array or CellsAtRest
        From :func:`reference_sizes` or :func:`cells_at_rest` of the reference mesh; non-zero.
    """
    positions, sizes = as_positions(points, cells.dimension), sizes_of(reference_sizes)
    out = empty_quality(len(cells))
    for block, rows in cells.numbered:
        _block_quality(positions, block.nodes, sizes[rows], out, rows)
    if not isinstance(reference_sizes, CellsAtRest):
        return out
    relative = np.empty(len(cells))
    for block, rows in cells.numbered:
        _relate(positions, block.nodes, reference_sizes[rows], out.skew[rows], relative[rows])
    return replace(out, relative=relative)


def subset_quality(
    points: NDArray[np.floating], cells: CellTable, reference_sizes: AtRest, numbers: NDArray[np.integer]
) -> CellQuality:
    """As :func:`cell_quality` for the cells with the given numbers (s,) only, in that order; the cost is O(s)."""
    positions = as_positions(points, cells.dimension)
    chosen, sizes = np.asarray(numbers, dtype=np.int64), sizes_of(reference_sizes)
    rest = reference_sizes if isinstance(reference_sizes, CellsAtRest) else None
    out = replace(empty_quality(len(chosen)), relative=None if rest is None else np.empty(len(chosen)))
    for block, here, own in cells.located(chosen):
        part = empty_quality(len(own))
        _block_quality(positions, block.nodes[own], sizes[chosen[here]], part, slice(None))
        out.size[here], out.skew[here], out.inverted[here] = part.size, part.skew, part.inverted
        if rest is not None and out.relative is not None:
            relative = np.empty(len(own))
            _relate(positions, block.nodes[own], rest[chosen[here]], part.skew, relative)
            out.relative[here] = relative
    return out


def corner_quality(points: NDArray[np.floating], cells: CellTable, reference: Floats) -> Floats:
    """(m,) quality of each cell's worst corner relative to rest: shape · √size, for quads and hexahedra also angles.

    The nodes are at ``points`` (n, d), and at ``reference`` (n, d) at rest. A cell without a corner below ``exp(−f)``
    has no distortion above f in the smooth correction; its metric has the name :data:`WORST_CORNER` in the choice of
    regions. It is 0 for a corner that is degenerate at rest.
    """
    positions, out = as_positions(points, cells.dimension), np.empty(len(cells))
    for block, rows in cells.numbered:
        kernels.corner_quality(positions, reference, np.ascontiguousarray(block.nodes), out[rows])
    return out


def _relate(points: Floats, nodes: Shorts, rest: CellsAtRest, skew: Floats, out: Floats) -> None:
    """Relative shapes (m,) of cells of one type, from their skews (m,) now."""
    arrays = points, rest.points, np.ascontiguousarray(nodes), skew, np.ascontiguousarray(rest.skews)
    kernels.relative_shapes(*arrays, out)


def _block_quality(points: Floats, nodes: Shorts, reference: Floats, out: CellQuality, rows: slice) -> None:
    """Quality of cells of one type, written into out[rows]."""
    kernels.cell_quality(
        points,
        np.ascontiguousarray(nodes),
        np.ascontiguousarray(reference),
        out.size[rows],
        out.skew[rows],
        out.inverted[rows],
    )
