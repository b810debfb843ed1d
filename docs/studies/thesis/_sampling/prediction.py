"""Sampled prediction: groups of cells represent their cells; only cells that may be bad are evaluated in full.

1. Neighbouring cells form groups of a given size, each in a ball about its centre.
2. ∇S, ∇²S and ∇³S at the centre give a quality for every cell of the group, and the remainder gives its lower bound.
3. Cells whose least quality is below the threshold are evaluated in full: exactly, from the displacements of their
   nodes. If the minimum is requested, cells that may be worse than the worst one found are evaluated in full too.

With the *certain* bound no cell below the threshold is missed, for any group size: the size influences the cost only.
The *estimated* bound is cheaper, but not certain.

Against the exact prediction, one displacement for every *node*, it is not faster on the measured meshes (study "Sampled
prediction" in docs/thesis.md): a mesh has fewer nodes than cells, an accepted step needs the displacements of the nodes
anyway, and a certain bound must assume that no weights cancel. It is included only to answer the thesis' question.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from mesh_motion_numerics.interpolation.interpolant import Interpolant
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.paths import RigidMotion
from mesh_motion_numerics.quality.metrics import (
    AtRest,
    CellQuality,
    as_positions,
    cell_quality,
    sizes_of,
    skews_of,
    subset_quality,
)
from mesh_motion_protocol.errors import InvalidInput
from numpy.typing import NDArray

from docs.studies.thesis._sampling.cell_bounds import bounded_quality
from docs.studies.thesis._sampling.expansion import EXPANDABLE, expand, third_order_norms
from docs.studies.thesis._sampling.groups import Groups, group_cells
from docs.studies.thesis._sampling.remainder import remainders

__all__ = ["BOUNDS", "DEFAULT_GROUP_SIZE", "ExpandableField", "SampledQuality", "predict_sampled"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

#: About the cheapest with either bound in the study "Sampled prediction" (docs/thesis.md).
DEFAULT_GROUP_SIZE = 256
#: A group whose ∇S is known to less than this decides nothing: its cells are evaluated in full at once.
_HOPELESS = 0.5
#: Control points nearer than so many radii are bounded even where the rest is estimated.
_NEAR = 2.0
_SETTLED = ("threshold", "minimum")


@dataclass(frozen=True, eq=False)
class ExpandableField:
    """A displacement that is one interpolant, possibly after a rigid motion."""

    interpolant: Interpolant
    rigid: RigidMotion | None = None

    @property
    def can_be_expanded(self) -> bool:
        """True if the derivatives of the basis are known (the three smooth functions of Wendland)."""
        return self.interpolant.basis.name in EXPANDABLE

    def expand(self, points: Floats) -> Floats:
        """(g, d, c) Taylor coefficients about points (g, d)."""
        coefficients = expand(self.interpolant, points)
        if self.rigid is not None:
            d = points.shape[1]
            coefficients[:, :, :d] += self.rigid.rotation - np.eye(d)
        return coefficients


@dataclass(frozen=True, eq=False)
class SampledQuality:
    """The results of a sampled prediction.

    Attributes
    ----------
    quality : CellQuality
        Exact where ``in_full``, by the group's polynomial elsewhere.
    in_full : (m,) bool array
        Cells that were evaluated in full.
    least : (m,) array
        No less than this is the metric of any other cell, certainly or as estimated; of those in full their value.
    groups, expanded : int
        Groups, and how many of them were expanded.
    nodes : int
        Nodes whose displacement was needed.
    """

    quality: CellQuality
    in_full: Bools
    least: Floats
    groups: int
    expanded: int
    nodes: int


def _certain(field: ExpandableField, groups: Groups) -> tuple[Floats, Floats]:
    """Remainders (g,) and coefficients (g, d, c); infinite and zero for groups without a useful bound."""
    remainder = remainders(field.interpolant, groups, near=math.inf)
    return _expand_hopeful(field, groups, remainder)


def _estimated(field: ExpandableField, groups: Groups) -> tuple[Floats, Floats]:
    """Like _certain, from the near control points only, with the size of the last term for the others."""
    near = remainders(field.interpolant, groups, near=_NEAR)
    remainder, coefficients = _expand_hopeful(field, groups, near)
    last = 0.5 * groups.radii**2 * third_order_norms(coefficients, groups.centres.shape[1])
    return remainder + last, coefficients


def _expand_hopeful(field: ExpandableField, groups: Groups, remainder: Floats) -> tuple[Floats, Floats]:
    """The remainders (infinite for groups without a useful bound), and the coefficients of the others."""
    hopeful = remainder < _HOPELESS
    found = field.expand(groups.centres[hopeful])
    coefficients = np.zeros((len(groups), *found.shape[1:]))
    coefficients[hopeful] = found
    return np.where(hopeful, remainder, np.inf), coefficients


#: The terms that bound the change within a group: (field, groups) → remainders (g,), coefficients (g, d, c).
BOUNDS: dict[str, Callable[[ExpandableField, Groups], tuple[Floats, Floats]]] = {
    "certain": _certain,
    "estimated": _estimated,
}


def predict_sampled(
    points: NDArray[np.floating],
    cells: CellTable,
    reference_sizes: AtRest,
    field: ExpandableField | None,
    displacement: Callable[[Ints], Floats],
    *,
    metric: str = "size-skew",
    threshold: float = 0.2,
    groups: Groups | int = DEFAULT_GROUP_SIZE,
    bound: str = "certain",
    settle: str = "threshold",
) -> SampledQuality:
    """Quality of every cell after a displacement: exact below the threshold, bounded from below elsewhere.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
        Current positions.
    reference_sizes : (m,) array or CellsAtRest
        From :func:`~mesh_motion_numerics.quality.metrics.reference_sizes` or :func:`.cells_at_rest`.
    field : ExpandableField or None
        The displacement; None if it is no single interpolant, or one that cannot be expanded: all is evaluated in full.
    displacement : callable
        The same displacement at the nodes with given numbers (k,): (k, d), mesh length unit.
    metric : str
        What the threshold is about.
    threshold : float
        Every cell that is not known to be at or above it is evaluated in full.
    groups : Groups or int
        From :func:`~docs.studies.thesis._sampling.groups.group_cells`, to use them for several predictions from the
        same positions; or the number of cells of a group.
    bound : {"certain", "estimated"}
    settle : {"threshold", "minimum"}
        Which cells are below the threshold; or also which is the worst of a mesh without such cells, for which more
        cells are evaluated in full.

    Raises
    ------
    InvalidInput
        On an unknown bound, metric or thing to settle, or a group size below 1.
    """
    if bound not in BOUNDS:
        raise InvalidInput(f"unknown bound {bound!r}; known are {', '.join(BOUNDS)}")
    if settle not in _SETTLED:
        raise InvalidInput(f"unknown thing to settle {settle!r}; known are {', '.join(_SETTLED)}")
    if isinstance(groups, int) and groups < 1:
        raise InvalidInput(f"expected a group size of 1 or more, got {groups}")
    positions = as_positions(points, cells.dimension)
    if field is None or not field.can_be_expanded:
        return _all_in_full(positions, cells, reference_sizes, displacement, metric)
    if isinstance(groups, int):
        groups = group_cells(positions, [block.nodes for block in cells], groups)
    remainder, coefficients = BOUNDS[bound](field, groups)
    quality, least = _by_groups(positions, cells, reference_sizes, groups, coefficients, remainder, metric)
    full = _FullEvaluation(positions, cells, reference_sizes, displacement, metric, quality, least)
    full.evaluate(~(least >= max(threshold, np.finfo(float).tiny)))
    if settle == "minimum":
        if not full.done.any():
            full.evaluate(least == least.min())
        full.evaluate(~full.done & (least < least[full.done].min()))
    return SampledQuality(
        quality, full.done, least, len(groups), int(np.isfinite(remainder).sum()), int(full.moved.sum())
    )


def _all_in_full(
    points: Floats, cells: CellTable, reference_sizes: AtRest, displacement: Callable[[Ints], Floats], metric: str
) -> SampledQuality:
    """The exact prediction in the form of a sampled one."""
    quality = cell_quality(points + displacement(np.arange(len(points))), cells, reference_sizes)
    return SampledQuality(quality, np.ones(len(cells), dtype=bool), quality.metric(metric), 0, 0, len(points))


def _by_groups(
    points: Floats,
    cells: CellTable,
    reference_sizes: AtRest,
    groups: Groups,
    coefficients: Floats,
    remainder: Floats,
    metric: str,
) -> tuple[CellQuality, Floats]:
    """Quality of all cells by the polynomials, and the least value of the metric."""
    size, skew, least = np.empty(len(cells)), np.empty(len(cells)), np.empty(len(cells))
    group, sizes, rest = groups.group_of, sizes_of(reference_sizes), skews_of(reference_sizes)
    for block, rows in cells.numbered:
        modelled, low = bounded_quality(
            points,
            block.nodes,
            sizes[rows],
            group[rows],
            groups,
            coefficients,
            remainder,
        )
        size[rows], skew[rows] = modelled
        own = None if rest is None else np.minimum(low[1] / rest[rows], 1.0)
        least[rows] = CellQuality(low[0], low[1], np.zeros(len(block), dtype=bool), own).metric(metric)
    relative = None if rest is None else np.minimum(skew / rest, 1.0)
    return CellQuality(size, skew, np.zeros(len(cells), dtype=bool), relative), least


@dataclass(eq=False)
class _FullEvaluation:
    """Replaces chosen cells in ``quality`` and ``least`` by exact values; a node is displaced at most once."""

    points: Floats
    cells: CellTable
    reference_sizes: AtRest
    displacement: Callable[[Ints], Floats]
    metric: str
    quality: CellQuality
    least: Floats

    def __post_init__(self) -> None:
        self.done = np.zeros(len(self.cells), dtype=bool)
        self.moved = np.zeros(len(self.points), dtype=bool)
        self.positions = self.points.copy()

    def evaluate(self, chosen: Bools) -> None:
        """The cells (m,) chosen, exactly."""
        numbers = np.flatnonzero(chosen)
        needed = np.zeros(len(self.points), dtype=bool)
        for block, span in self.cells.numbered:
            needed[block.nodes[chosen[span]]] = True
        nodes = np.flatnonzero(needed & ~self.moved)
        self.positions[nodes] += self.displacement(nodes)
        self.moved[nodes], self.done[numbers] = True, True
        found = subset_quality(self.positions, self.cells, self.reference_sizes, numbers)
        self.quality.size[numbers], self.quality.skew[numbers] = found.size, found.skew
        self.quality.inverted[numbers] = found.inverted
        if found.relative is not None and self.quality.relative is not None:
            self.quality.relative[numbers] = found.relative
        self.least[numbers] = found.metric(self.metric)
