"""Mesh quality: relative size, skew and size-skew of every cell (thesis §2.3).

The size metric compares a cell with itself in the reference mesh, ``τ = Σ_k α_k / Σ_k α_k⁰`` with the corner
determinants α_k (on a line the ratio of lengths (3.6)), ``size = sign(τ) · min(|τ|, 1/|τ|)``: thesis (2.13), which as
printed sums the ratios and so gives n for an undeformed cell. Skew is absolute: 1 for the ideal cell, 0 for a
degenerate one. It is made of the entries of λ = AᵀA (3.22), thesis (2.14), (3.30); the formulas of all cell types stand
in :mod:`~mesh_motion_server.numerics.corner_kernels`. Size and skew are combined to

======================  =================================  =========================================
metric                  formula                            source
======================  =================================  =========================================
``size``                size                               thesis (2.13); its 2D tables use this one
``skew``                skew                               thesis (2.14)
``size-skew``           sign(size) · √|size| · skew        thesis, text below (2.15)
``size-skew-root``      sign(size) · √(|size| · skew)      thesis (2.15)
``size-skew-product``   size · skew                        thesis (3.21), (3.24), (3.28), (3.30)
``relative-size-skew``  size-skew with the skew relative   target matrices: Knupp (2012)
                        to that of the cell at rest
======================  =================================  =========================================

The last one compares both with the cell itself in the reference mesh, ``min(1, skew / skew at rest)``: 1 at rest and
wherever the cell has only been carried along, whatever it looks like. A triangle of a boundary layer that is a thousand
times as long as high has a skew of 1e-3 for ever; its relative skew falls when its height does.

Skew is never negative. A cell whose corners are all inverted keeps the skew of its mirror image, so that size-skew
tells a badly inverted cell from a slightly inverted one; a cell of which some corners are inverted has skew 0. A cell
with a position that is not finite has -inf in every metric: worse than any number, and never equal to a good value.

Node indices are not checked here: :func:`~mesh_motion_server.numerics.mesh_check.check_mesh` does that once.

References
----------
P. M. Knupp, Algebraic mesh quality metrics for unstructured initial meshes, Finite Elements in Analysis and Design
39 (2003) 217–241. P. M. Knupp, Introducing the target-matrix paradigm for mesh optimization via node-movement,
Engineering with Computers 28 (2012) 419–429.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics import corner_kernels as kernels
from mesh_motion_server.numerics.cells import CELL_TYPES, CellBlock, CellTable, CellType
from mesh_motion_server.numerics.quality_summary import QualitySummary, summarize
from mesh_motion_server.numerics.read_only import read_only
from mesh_motion_server.numerics.thread_share import threads_for

__all__ = [
    "QUALITY_METRICS",
    "AtRest",
    "CellQuality",
    "CellsAtRest",
    "Extremes",
    "QualitySummary",
    "cell_quality",
    "cells_at_rest",
    "minimum_quality",
    "quality_extremes",
    "reference_sizes",
    "rest_for",
    "sizes_of",
    "skews_of",
    "subset_quality",
    "summarize",
]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

#: Name → formula of every quality metric.
QUALITY_METRICS: dict[str, str] = {
    "size": "sign(τ) min(|τ|, 1/|τ|)",
    "skew": "skew",
    "size-skew": "sign(size) √|size| skew",
    "size-skew-root": "sign(size) √(|size| skew)",
    "size-skew-product": "size skew",
    "relative-size-skew": "sign(size) √|size| min(1, skew / skew at rest)",
}

_NO_SKEWS = np.empty(0)
_SHAPES = {
    "line": kernels.LENGTH,
    "triangle": kernels.MEAN_RATIO,
    "quad": kernels.ANGLES,
    "tetra": kernels.MEAN_RATIO,
    "hexahedron": kernels.ANGLES,
    "wedge": kernels.ANGLES,
    "pyramid": kernels.MEAN_RATIO,
}


@dataclass(frozen=True, eq=False)
class CellQuality:
    """Quality of m cells.

    Attributes
    ----------
    size : (m,) array
        Signed relative size in [-1, 1]; -inf for a cell with positions that are not finite.
    skew : (m,) array
        In [0, 1]; -inf as above.
    inverted : (m,) bool array
        Any corner determinant ≤ 0 (or not a number).
    rest : (m,) array, optional
        Skew at rest, where it is known: what "relative-size-skew" needs.
    """

    size: Floats
    skew: Floats
    inverted: Bools
    rest: Floats | None = None

    def __len__(self) -> int:
        return len(self.size)

    def subset(self, numbers: Ints | slice) -> CellQuality:
        """Of the cells with the given numbers only, in that order."""
        rest = None if self.rest is None else self.rest[numbers]
        return CellQuality(self.size[numbers], self.skew[numbers], self.inverted[numbers], rest)

    @property
    def relative_skew(self) -> Floats:
        """Skew relative to that at rest (m,), at most 1; InvalidInput where the skews at rest are not known."""
        return np.minimum(self.skew / _known(self.rest), 1.0)

    def relative_extremes(self) -> tuple[float, float]:
        """The smallest relative skew, 0 of an inverted cell, and the smallest size."""
        relative = np.where(self.inverted, 0.0, self.relative_skew)
        return float(relative.min()), float(self.size.min())

    def metric(self, name: str) -> Floats:
        """Values (m,) of one of :data:`QUALITY_METRICS`.

        Raises
        ------
        InvalidInput
            On an unknown name, or one that needs the cells' skews at rest where they are not known.
        """
        code, skew = metric_code(name), self.skew
        if name in ("size", "skew"):
            return self.size if name == "size" else self.skew
        if code == kernels.RELATIVE:
            skew = self.relative_skew
        with threads_for(work_items(len(self))):
            values: Floats = kernels.metric_values(read_only(self.size), read_only(skew), code)
        return values


@dataclass(frozen=True, eq=False)
class CellsAtRest:
    """What the cells of the reference mesh are measured by.

    Attributes
    ----------
    sizes : (m,) array
        Of :func:`reference_sizes`.
    skews : (m,) array
    """

    sizes: Floats
    skews: Floats

    def __len__(self) -> int:
        return len(self.sizes)

    def __getitem__(self, rows: Any) -> CellsAtRest:
        return CellsAtRest(self.sizes[rows], self.skews[rows])


#: Reference sizes alone, or with the skews at rest.
AtRest = Floats | CellsAtRest


def _known(rest: Floats | None) -> Floats:
    """The skews at rest (m,), or an error."""
    if rest is None:
        raise InvalidInput("the metric 'relative-size-skew' needs the cells' skews at rest: give CellsAtRest")
    return rest


def sizes_of(rest: AtRest) -> Floats:
    """(m,) reference sizes."""
    return rest.sizes if isinstance(rest, CellsAtRest) else rest


def skews_of(rest: AtRest) -> Floats | None:
    """(m,) skews at rest, or None."""
    return rest.skews if isinstance(rest, CellsAtRest) else None


def rest_for(metric: str, rest: AtRest) -> AtRest:
    """Of the cells at rest what a metric needs: the sizes alone, but for "relative-size-skew"."""
    if metric_code(metric) != kernels.RELATIVE:
        return sizes_of(rest)
    _known(skews_of(rest))
    return rest


class Extremes(NamedTuple):
    """What one pass over a mesh says without storing anything.

    Attributes
    ----------
    minimum : float
        The smallest value of the metric.
    cell : int
        The cell it belongs to; of equal ones the first.
    inverted : int
        Number of inverted cells.
    """

    minimum: float
    cell: int
    inverted: int


def metric_code(name: str) -> int:
    """Number of a metric in the compiled kernels; InvalidInput on an unknown name."""
    if name not in QUALITY_METRICS:
        raise InvalidInput(
            f"unknown quality metric {name!r}; known are {', '.join(QUALITY_METRICS)}", details={"metric": str(name)}
        )
    return kernels.METRIC_CODES[name]


@lru_cache
def ideal_corner(type_name: str) -> Floats:
    """(d + 1, d) array for the kernels: G = W⁻¹ W⁻ᵀ, then the row (det W, det W / Π|W_i|, …)."""
    W = CELL_TYPES[type_name].ideal_array
    d = len(W)
    out = np.zeros((d + 1, max(d, 2)))
    inverse = np.linalg.inv(W)
    out[:d, :d] = inverse @ inverse.T
    det = float(np.linalg.det(W))
    out[d, :2] = det, det / float(np.prod(np.linalg.norm(W, axis=0)))
    return out


def shape_code(cell_type: CellType) -> int:
    """Which formula of the kernels gives this cell type's skew."""
    return _SHAPES[cell_type.name]


def empty_quality(count: int) -> CellQuality:
    """Uninitialised result arrays for the kernels."""
    return CellQuality(np.empty(count), np.empty(count), np.empty(count, dtype=np.bool_))


def block_slices(cells: CellTable) -> Iterator[tuple[CellBlock, slice]]:
    """Each block with the slice of cell numbers that belongs to it."""
    for block, first in zip(cells.blocks, cells.offsets, strict=False):
        yield block, slice(first, first + len(block))


def work_items(cells: int) -> int:
    """How many work items the kernels' parallel loops have for so many cells."""
    return -(-cells // kernels.BLOCK)


def judged_blocks(
    kernel: Callable[..., Any], positions: Floats, cells: CellTable, rest: AtRest
) -> Iterator[tuple[slice, Callable[..., Any]]]:
    """Each block's slice of cell numbers, and a kernel that judges cells with its first arguments: those of the block.

    The last of these are the reference sizes and the skews at ``rest``, none of them where the sizes alone are given.

    The threads are those that the block is worth, until the next one is asked for.
    """
    skews = skews_of(rest)
    for block, rows in block_slices(cells):
        with threads_for(work_items(len(block))):
            yield (
                rows,
                partial(
                    kernel,
                    positions,
                    read_only(block.nodes),
                    block.type.corner_array,
                    shape_code(block.type),
                    ideal_corner(block.type.name),
                    read_only(sizes_of(rest)[rows]),
                    read_only(_NO_SKEWS if skews is None else skews[rows]),
                ),
            )


def as_positions(points: NDArray[np.floating], dimension: int) -> Floats:
    """Points as the kernels want them; InvalidInput if they are not (n, d) with the cells' dimension."""
    positions = np.ascontiguousarray(points, dtype=np.float64)
    if positions.ndim != 2 or positions.shape[1] != dimension:
        raise InvalidInput(
            f"points: expected an array of shape (n, {dimension}) for {dimension}D cells, got {positions.shape}",
            code="INVALID_ARGUMENT.SHAPE",
            details={"shape": list(positions.shape), "dimension": dimension},
        )
    return read_only(positions)


def reference_sizes(points: NDArray[np.floating], cells: CellTable) -> Floats:
    """Σ_k det A_k of every cell of the reference mesh: what τ is measured against.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
    cells : CellTable

    Returns
    -------
    (m,) array, mesh length unit to the power d
        Proportional to length, area or volume (:attr:`CellType.size_factor`).
    """
    positions = as_positions(points, cells.dimension)
    out = np.empty(len(cells))
    for block, rows in block_slices(cells):
        with threads_for(work_items(len(block))):
            kernels.node_sizes(positions, read_only(block.nodes), block.type.corner_array, out[rows])
    return out


def cells_at_rest(points: NDArray[np.floating], cells: CellTable, sizes: Floats | None = None) -> CellsAtRest:
    """Sizes and skews of the cells of the reference mesh with nodes at ``points`` (n, d).

    Parameters
    ----------
    points : (n, d) array, mesh length unit
    cells : CellTable
    sizes : (m,) array, optional
        Of :func:`reference_sizes`, if they are known.
    """
    sizes = reference_sizes(points, cells) if sizes is None else sizes
    return CellsAtRest(sizes, cell_quality(points, cells, sizes).skew)


def cell_quality(points: NDArray[np.floating], cells: CellTable, reference_sizes: AtRest) -> CellQuality:
    """Size, skew and validity of every cell.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
    cells : CellTable
    reference_sizes : (m,) array or CellsAtRest
        From :func:`reference_sizes` or :func:`cells_at_rest` of the mesh that cells are measured against; non-zero.
    """
    positions, sizes = as_positions(points, cells.dimension), sizes_of(reference_sizes)
    out = empty_quality(len(cells))
    for block, rows in block_slices(cells):
        _block_quality(positions, block.type, block.nodes, sizes[rows], out, rows)
    return replace(out, rest=skews_of(reference_sizes))


def subset_quality(
    points: NDArray[np.floating], cells: CellTable, reference_sizes: AtRest, numbers: NDArray[np.integer]
) -> CellQuality:
    """As :func:`cell_quality` for the cells with the given numbers (s,) only, in that order; cost follows s."""
    positions = as_positions(points, cells.dimension)
    chosen, sizes, skews = np.asarray(numbers, dtype=np.int64), sizes_of(reference_sizes), skews_of(reference_sizes)
    out = empty_quality(len(chosen))
    for block, rows in block_slices(cells):
        if len(cells.blocks) == 1:
            _chosen_quality(positions, block, chosen, sizes, out)
            break
        here = np.flatnonzero((chosen >= rows.start) & (chosen < rows.stop))
        part = empty_quality(len(here))
        _chosen_quality(positions, block, chosen[here] - rows.start, sizes[rows], part)
        out.size[here], out.skew[here], out.inverted[here] = part.size, part.skew, part.inverted
    return out if skews is None else replace(out, rest=skews[chosen])


def quality_extremes(
    points: NDArray[np.floating], cells: CellTable, reference_sizes: AtRest, metric: str = "size-skew"
) -> Extremes:
    """Smallest value of a metric, its cell and the number of inverted cells, in one pass that stores nothing."""
    positions, code = as_positions(points, cells.dimension), metric_code(metric)
    best, inversions = (np.inf, 0), 0
    for rows, extremes in judged_blocks(kernels.node_extremes, positions, cells, rest_for(metric, reference_sizes)):
        least, where, inverted = extremes(code)
        first = int(np.argmin(least))
        best = min(best, (float(least[first]), rows.start + int(where[first])))
        inversions += int(inverted.sum())
    return Extremes(*best, inversions)


def minimum_quality(
    points: NDArray[np.floating], cells: CellTable, reference_sizes: AtRest, metric: str = "size-skew"
) -> float:
    """Smallest value of a metric over the mesh; stores nothing (see :func:`quality_extremes`)."""
    return quality_extremes(points, cells, reference_sizes, metric).minimum


def _block_quality(
    points: Floats, cell_type: CellType, nodes: Ints, reference: Floats, out: CellQuality, rows: slice
) -> None:
    """Quality of cells of one type, written into out[rows]."""
    with threads_for(work_items(len(nodes))):
        kernels.node_quality(
            points,
            read_only(nodes),
            cell_type.corner_array,
            shape_code(cell_type),
            ideal_corner(cell_type.name),
            read_only(reference),
            out.size[rows],
            out.skew[rows],
            out.inverted[rows],
        )


def _chosen_quality(points: Floats, block: CellBlock, chosen: Ints, reference: Floats, out: CellQuality) -> None:
    """Quality of the cells of a block with the given numbers (s,) in it."""
    with threads_for(work_items(len(chosen))):
        kernels.chosen_quality(
            points,
            read_only(block.nodes),
            block.type.corner_array,
            shape_code(block.type),
            ideal_corner(block.type.name),
            read_only(reference),
            read_only(chosen),
            out.size,
            out.skew,
            out.inverted,
        )
