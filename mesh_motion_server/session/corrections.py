"""The correction of a mesh whose cells stay with the client: of the region that its ranks tell of.

A pure function of field, boundary and cells: that of committed coordinates is made again rather than stored.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mesh_motion_server.distributed.field import Field
from mesh_motion_server.distributed.region import ALL, Extent, Region
from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.arrays import Floats, Integers
from mesh_motion_server.numerics.correction.correction import Correction
from mesh_motion_server.numerics.correction.correction_problem import goal
from mesh_motion_server.numerics.correction.part_of_mesh import RegionTooSmall
from mesh_motion_server.numerics.correction.trial_nodes import MARGIN
from mesh_motion_server.numerics.interpolation import evaluation
from mesh_motion_server.numerics.method import Method
from mesh_motion_server.numerics.motion.exact_displacements import differences_of
from mesh_motion_server.numerics.quality.quality_summary import Judgement
from mesh_motion_server.session.partitions.meshes import MergedMesh
from mesh_motion_server.session.partitions.regions import merge_regions

__all__ = ["CorrectOutcome", "correct", "first_extent", "is_good"]

#: Rings about the bad cells that are told at first: most corrections free fewer.
_FIRST_RINGS = 2
#: With more rings, all cells are told.
_MOST_RINGS = 64
#: A rank judges positions that are rounded once more.
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class CorrectOutcome:
    """What a Correct found.

    Attributes
    ----------
    extent : Extent or None
        The larger region that it takes; about the ``nodes`` too, and there is no correction yet.
    nodes : (c,) int64 array
        Global ids of the freed nodes.
    displacement : (c, d) array, mesh length unit
        Of these, since the reference mesh.
    correction : Correction or None
        What was done, without coordinates.
    """

    extent: Extent | None
    nodes: Integers
    displacement: Floats
    correction: Correction | None = None


def is_good(method: Method, quality: Judgement) -> bool:
    """Whether a mesh of this quality is left alone."""
    return method.correction == "none" or (not quality.inverted and quality.metric.min >= goal(method))


def first_extent(method: Method, dimension: int) -> Extent:
    """The region that is told first."""
    below = ALL if dimension == 1 else min(ALL, MARGIN * goal(method) + _ROUNDING)
    return Extent(method.quality_metric, below, _FIRST_RINGS)


def correct(mesh: MergedMesh, method: Method, points: Floats, field: Field, told: Sequence[Region]) -> CorrectOutcome:
    """Correct the region that all ranks tell of.

    Parameters
    ----------
    mesh : MergedMesh
        The boundary.
    method : Method
    points : (n, d) array, mesh length unit
        Of the nodes of ``mesh`` before the correction.
    field : Field
        The displacement that led there.
    told : sequence of Region
        One of each partition, of the same extent.

    Raises
    ------
    InvalidInput
        If the regions do not fit the mesh or each other.
    NumericalError
        If no valid mesh was found.
    """
    extents = [one.extent for one in told]
    if len(set(extents)) > 1:
        raise InvalidInput(
            f"CORRECT: expected one region from all partitions, got {extents[0]} and {extents[1]}",
            hint="tell the cells of the region that the last answer asked for",
        )
    on_patches = np.zeros(len(points), dtype=bool)
    on_patches[mesh.on_patches] = True

    def known(rows: Integers) -> Floats:
        there = mesh.points[rows]
        free = evaluation.displacement(field.interpolant(), there) + there
        return np.where(on_patches[rows, None], points[rows], free)

    # imported here: no other session needs it, and it loads much
    from mesh_motion_server.numerics.motion.boundary_motion import correct_region  # noqa: PLC0415

    region = merge_regions(mesh, told, known)
    try:
        found = correct_region(method, region.points, region.positions, region.cells, region.held, region.elsewhere)
    except RegionTooSmall as missing:
        none, wanted = np.empty((0, points.shape[1])), region.ids[missing.nodes]
        if np.isin(wanted, region.between).all():  # as many rings do, where other ranks tell of theirs
            return CorrectOutcome(extents[0], np.union1d(wanted, region.settled), none)
        return CorrectOutcome(_larger(extents[0]), region.between, none)
    moved = np.flatnonzero((found.points != region.positions).any(axis=1))
    displacement = differences_of(found.points, region.points, moved)
    done = replace(found, points=displacement[:0], quality=None)
    return CorrectOutcome(None, region.ids[moved], displacement, done)


def _larger(extent: Extent) -> Extent:
    rings = 2 * max(extent.rings, 1)
    return Extent(extent.metric, extent.below if rings <= _MOST_RINGS else ALL, rings)
