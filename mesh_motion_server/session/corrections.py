"""The correction of a mesh whose cells stay with the client: it corrects the region that the client's ranks send.

The correction is a pure function of field, boundary and cells: for committed coordinates it is made again instead of
stored.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, cast

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.correction.correction import Correction
from mesh_motion_numerics.correction.correction_problem import goal
from mesh_motion_numerics.correction.part_of_mesh import RegionTooSmall
from mesh_motion_numerics.correction.smooth_motion import RINGS, onset_of
from mesh_motion_numerics.correction.trial_nodes import MARGIN
from mesh_motion_numerics.distributed.field import Field
from mesh_motion_numerics.distributed.region import ALL, Extent, Region
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.factor_source import FactorSource
from mesh_motion_numerics.mesh.points import marks_at
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.crossing import refuse_region
from mesh_motion_numerics.motion.smooth_step import NOT_SMOOTH
from mesh_motion_numerics.quality.metrics import WORST_CORNER
from mesh_motion_numerics.quality.quality_summary import Judgement
from mesh_motion_protocol.errors import InvalidInput, QualityRefused

from mesh_motion_server.session.model import Model
from mesh_motion_server.session.partitions.exact_displacements import differences_of
from mesh_motion_server.session.partitions.meshes import MergedMesh
from mesh_motion_server.session.partitions.regions import MergedRegion, merge_regions

if TYPE_CHECKING:  # imported only here: other sessions do not need it, and it is large
    from mesh_motion_numerics.motion.body_paths import Way
    from mesh_motion_numerics.motion.boundary_motion import BoundaryMotion

#: Number of rings around the bad cells that the ranks send first: most corrections free fewer.
_FIRST_RINGS = 2
#: With more rings than this, the ranks send all cells.
_MOST_RINGS = 64
#: Tolerance for positions that a rank judges after one more rounding.
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class CorrectedRegion:
    """A region, the number of nodes of the whole mesh, and the positions (n, d) of the nodes; none if no cell resists.

    ``smooth``: whether the smooth correction led there.
    """

    region: MergedRegion | None = None
    n_nodes: int = 0
    points: Floats = field(default_factory=lambda: np.empty((0, 0)))
    smooth: bool = True


@dataclass(frozen=True, eq=False)
class CorrectOutcome:
    """The result of a Correct."""

    #: The larger region that is needed, also around the ``nodes``; there is no correction yet. None: the region was
    #: corrected.
    extent: Extent | None
    nodes: Integers  # (c,). Global ids of the freed nodes
    displacement: Floats  # (c, d), mesh length unit. Displacement of these nodes, since the reference mesh
    correction: Correction | None = None  # result of the correction, without coordinates
    region: CorrectedRegion | None = None  # the region in which the correction was found


def is_good(method: Method, quality: Judgement) -> bool:
    """Whether a mesh of this quality needs no correction; only the ranks know if a cell resists a smooth motion."""
    if method.correction in ("none", "smooth"):
        return method.correction == "none"
    return not quality.inverted and quality.metric.min >= goal(method)


def first_extent(method: Method, dimension: int) -> Extent:
    """The region that the ranks send first."""
    if method.correction == "smooth":
        return _resisting(None)
    below = ALL if dimension == 1 else min(ALL, MARGIN * goal(method) + _ROUNDING)
    return Extent(method.quality_metric, below, _FIRST_RINGS)


def _resisting(n_nodes: int | None) -> Extent:
    """The region of a smooth motion in a mesh of this many nodes; None: the number is unknown, and may be large."""
    onset = onset_of(sys.maxsize if n_nodes is None else n_nodes)
    return Extent(WORST_CORNER, onset + _ROUNDING, RINGS)


def correct(
    mesh: MergedMesh, model: Model, points: Floats, field: Field, regions: Sequence[Region], factors: FactorSource
) -> CorrectOutcome:
    """Correct the region that the ranks send.

    Raises InvalidInput if the regions do not fit the mesh or each other. Raises QualityRefused if no valid mesh was
    found.

    Parameters
    ----------
    mesh : MergedMesh
        The boundary.
    model : Model
        A BoundaryMotion.
    points : (n, d) array, mesh length unit
        Coordinates of the nodes of ``mesh`` before the correction.
    field : Field
        The displacement that led to these coordinates.
    regions : sequence of Region
        One region from each partition, with the same extent.
    factors : FactorSource
        Factorizations of the boundary, for a smooth motion that must be led along a way.
    """
    boundary, extents = cast("BoundaryMotion", model), [one.extent for one in regions]
    if len(set(extents)) > 1:
        raise InvalidInput(
            f"CORRECT: expected one region from all partitions, got {extents[0]} and {extents[1]}",
            hint="send the cells of the region that the last answer requested",
        )
    placed = marks_at(len(points), boundary.motion.known)

    def known(rows: Integers) -> Floats:
        there = mesh.points[rows]
        free = evaluation.displacement(field.interpolant(), there) + there
        return np.where(placed[rows, None], points[rows], free)

    nothing, none = np.empty(0, dtype=np.int64), np.empty((0, points.shape[1]))
    n_nodes = len(mesh.points) + sum(one.interior for one in regions)
    smooth = extents[0].metric == WORST_CORNER
    if smooth and extents[0].below < _resisting(n_nodes).below:
        return CorrectOutcome(_resisting(n_nodes), nothing, none)
    if smooth and not any(one.cells for one in regions):
        return CorrectOutcome(None, nothing, none, Correction(none, none), CorrectedRegion())
    region = merge_regions(mesh, regions, known, boundary.orbits)
    part = region.points, region.positions, region.cells, region.held, region.elsewhere
    try:
        if smooth:
            ways = _ways(mesh, boundary, points[mesh.moving], region, factors)
            found = boundary.smoothed(*part, n_nodes, region.rows, ways)
        else:
            found = boundary.optimised.corrected(*part)
            if model.method.correction == "smooth":
                found = replace(found, warnings=(NOT_SMOOTH,))
    except RegionTooSmall as missing:
        wanted = region.ids[missing.nodes]
        if np.isin(wanted, region.between).all():  # other ranks, or ranks of images, send their cells
            images = np.isin(boundary.orbits, boundary.orbits[region.rows[missing.nodes]])
            return CorrectOutcome(extents[0], np.union1d(mesh.global_ids[images], region.settled), none)
        return CorrectOutcome(_larger(extents[0]), region.between, none)
    except QualityRefused as refusal:
        moving = np.flatnonzero(np.isin(region.ids, mesh.global_ids[mesh.moving]))
        refuse_region(region.cells, moving, np.flatnonzero(region.held), region.points, region.positions, refusal)
        if not smooth:
            raise
        return CorrectOutcome(first_extent(boundary.optimised.method, points.shape[1]), nothing, none)
    moved = np.flatnonzero((found.points != region.positions).any(axis=1))
    displacement = differences_of(found.points, region.points, moved)
    done = replace(found, points=displacement[:0], quality=None)
    kept = CorrectedRegion(region, n_nodes, found.points, smooth)
    return CorrectOutcome(None, region.ids[moved], displacement, done, kept)


def _ways(
    mesh: MergedMesh, model: BoundaryMotion, targets: Floats, region: MergedRegion, factors: FactorSource
) -> Iterator[Callable[[float], Floats]]:
    """Positions of the region's nodes by interpolation, along ways of the moving nodes to the ``targets`` (k, d)."""
    rows = np.flatnonzero(np.isin(region.rows, model.motion.known))
    of_rows = region.rows[rows]

    def plain(at: Floats) -> Floats:
        moved = model.move(mesh.points, at, factors)
        assert moved.field is not None
        found = evaluation.displacement(moved.field, region.points) + region.points
        found[rows] = moved.points[of_rows]
        return found

    for way in model.ways(targets):
        yield partial(_at, plain, way)


def _at(plain: Callable[[Floats], Floats], way: Way, fraction: float) -> Floats:
    return plain(way.at(fraction))


def _larger(extent: Extent) -> Extent:
    rings = 2 * max(extent.rings, 1)
    return Extent(extent.metric, extent.below if rings <= _MOST_RINGS else ALL, rings)
