"""The distortion of whole cells: the quality metric itself for quads, hexahedra, wedges and pyramids.

:mod:`.distortion` treats each corner of a cell as a cell, measured against its own reference shape. That untangles
well, but it is not the metric: a quad's skew requires right angles, nothing else. Here the p-mean is taken over ::

    L = log mean_k f_k + (a/m) log cosh(m log τ)          τ = Σ α_k / Σ α_k⁰,  α_k > 0 at every corner k

with the corner terms f_k of :mod:`.metrics`. For a = ½ and m → ∞, L is log(1/size-skew) of any cell exactly.

Relative to the cells at rest, which is for simplices only, the distortion is L minus its value at rest. Simplices that
are flat at rest have their own Jacobian at rest as W (a target matrix), so that only a rigid motion has L = 0. A skew
better than at rest gains nothing, as in the metric: otherwise a cell that was poor at rest could compensate a lost size
by a better shape.

The derivatives use the corners' Jacobians, see kernels/src/correction/cells.h.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import mesh_motion_kernels as kernels
import numpy as np
from numpy.typing import NDArray

from mesh_motion_numerics.arrays import Floats, Integers, Shorts
from mesh_motion_numerics.correction.distortion import CornerSimplices, PNorm
from mesh_motion_numerics.mesh.cells import CellTable, CellType
from mesh_motion_numerics.quality.metrics import AtRest, sizes_of, skews_of, uses_angles


@dataclass(frozen=True, eq=False)
class CellGroup:
    """Cells of one type in the form for the kernels.

    Attributes
    ----------
    nodes : (m, k) int32 array
    reference_sizes : (m,) array, length^d
    ideal : (1, d, d) or (m, d, d) array
        W⁻¹ of all cells or of each, scaled to determinant 1; not used by the angle form.
    offset : (0,) or (m,) array
        Added to L if it is relative to the cells at rest: the logarithm of their skew, 0 where W is the cell's own.
    """

    type: CellType
    nodes: Shorts
    reference_sizes: Floats
    ideal: Floats
    offset: Floats

    def __len__(self) -> int:
        return len(self.nodes)

    @cached_property
    def corners(self) -> Integers:
        """(c, d + 1) local nodes of every corner."""
        return self.type.corner_array

    @cached_property
    def sine(self) -> float:
        """w of the angle form; 0 means that the shape is the mean ratio."""
        w = self.type.ideal_array
        angles = uses_angles(self.type)
        return float(np.linalg.det(w) / np.linalg.norm(w, axis=0).prod()) if angles else 0.0


def cell_groups(cells: CellTable, at_rest: AtRest, simplices: CornerSimplices) -> tuple[CellGroup, ...]:
    """Return the blocks of a table as groups; relative to the cells at rest if these are known and simplices.

    Parameters
    ----------
    at_rest : (m,) array or CellsAtRest
    simplices : CornerSimplices
        The corners of these cells.
    """
    groups, corner = [], 0
    for block, rows in cells.numbered:
        here = slice(corner, corner + len(block))
        corner += len(block) * len(block.type.corners)
        sizes, skews = sizes_of(at_rest)[rows], skews_of(at_rest)
        w = block.type.ideal_array
        ideal = (np.linalg.inv(w) * abs(np.linalg.det(w)) ** (1 / len(w)))[None]
        offset = np.empty(0)
        if skews is not None and simplices.offset is not None and block.type.is_simplex:
            ideal, offset = simplices.ideal[here], simplices.offset[here]
            ideal = ideal * np.abs(np.linalg.det(ideal))[:, None, None] ** (-1 / len(w))
        groups.append(CellGroup(block.type, block.nodes.astype(np.int32), sizes, ideal, offset))
    return tuple(groups)


def mean_cell_distortion(points: Floats, groups: tuple[CellGroup, ...], norm: PNorm) -> tuple[float, Floats]:
    """E and the weights w (m,) of the cells at the points (n, d); E is ``inf`` where a corner is not positive."""
    measure = np.empty(sum(len(group) for group in groups))
    for group, rows in _rows(groups):
        kernels.cell_distortions(*_arrays(points, group, norm), measure[rows])
    return kernels.p_mean(measure, norm.p), measure


def cell_gradient(points: Floats, groups: tuple[CellGroup, ...], weights: Floats, norm: PNorm) -> list[Floats]:
    """Return the gradient of E by cell: for each group (m, k, d), the cell's share of dE/dx at each of its nodes."""
    shares = []
    for group, rows in _rows(groups):
        shares.append(np.empty((*group.nodes.shape, points.shape[1])))
        kernels.cell_gradients(*_arrays(points, group, norm), weights[rows], shares[-1])
    return shares


def cell_blocks(
    points: Floats,
    groups: tuple[CellGroup, ...],
    weights: Floats,
    norm: PNorm,
    blocks: list[NDArray[np.float32]],
    *,
    least_weight: float,
    floor: float,
) -> None:
    """Update the blocks (m, k², d²) of each group's cells heavier than ``least_weight`` in place."""
    for (group, rows), out in zip(_rows(groups), blocks, strict=True):
        least = floor / len(weights), least_weight
        kernels.cell_blocks(*_arrays(points, group, norm), weights[rows], *least, out)


def _rows(groups: tuple[CellGroup, ...]) -> list[tuple[CellGroup, slice]]:
    """Yield each group with the slice of its cell numbers."""
    ends = np.cumsum([0, *(len(group) for group in groups)]).tolist()
    return [(group, slice(a, b)) for group, a, b in zip(groups, ends, ends[1:], strict=False)]


def _arrays(points: Floats, group: CellGroup, norm: PNorm) -> tuple[NDArray[Any] | float, ...]:
    """The arguments of a group and of the norm that every kernel takes."""
    return (
        np.ascontiguousarray(points),
        group.nodes,
        group.corners,
        group.ideal,
        group.sine,
        group.reference_sizes,
        norm.m,
        norm.size_weight,
        group.offset,
        norm.p,
    )
