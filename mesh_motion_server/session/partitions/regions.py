"""One region of a mesh whose cells stay with the client, from what its ranks send of it.

Nodes and cells come into the order that they have in the whole mesh: a correction that sees the region then does what
it does with the whole mesh, bit for bit.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.correction.part_of_mesh import Elsewhere
from mesh_motion_numerics.distributed.region import Region
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.session.partitions.merging import merge
from mesh_motion_server.session.partitions.meshes import MergedMesh, PartitionMesh

__all__ = ["MergedRegion", "Rows", "merge_regions"]


@dataclass(frozen=True, eq=False)
class MergedRegion:
    """The nodes and cells of all ranks' regions, in canonical order.

    Attributes
    ----------
    ids : (n,) int64 array
        Global ids.
    points, positions : (n, d) arrays, mesh length unit
        In the reference mesh, and where the interpolation takes them.
    cells : CellTable
    held : (n,) bool array
        Nodes on patches.
    elsewhere : Elsewhere
    between, settled : (k,), (s,) int64 arrays
        Global ids of the nodes here that several ranks have; and of those of them whose cells are all sent.
    """

    ids: Integers
    points: Floats
    positions: Floats
    cells: CellTable
    held: Marks
    elsewhere: Elsewhere
    between: Integers
    settled: Integers


def merge_regions(mesh: MergedMesh, regions: Sequence[Region], known: Callable[[Integers], Floats]) -> MergedRegion:
    """Unite the regions of all partitions.

    Parameters
    ----------
    mesh : MergedMesh
        The boundary.
    regions : sequence of Region
        One of each partition; ids are global.
    known : callable
        Indices (k,) of nodes in ``mesh`` → positions (k, d) to which the interpolation takes them.

    Raises
    ------
    InvalidInput
        If a partition sends cells or nodes that cannot be.
    """
    for number, one in enumerate(regions):
        if one.points.shape[1] != mesh.points.shape[1]:
            raise InvalidInput(
                f"CORRECT of partition {number}: expected points of shape (r, {mesh.points.shape[1]}), "
                f"got {one.points.shape}",
                code="INVALID_ARGUMENT.SHAPE",
                details={"partition": number},
            )
    sent = [np.isin(mesh.global_ids[node_map], one.ids) for node_map, one in zip(mesh.node_maps, regions, strict=True)]
    here = np.unique(np.concatenate([m[there] for m, there in zip(mesh.node_maps, sent, strict=True)]))
    spanning = np.concatenate([mesh.points.argmin(axis=0), mesh.points.argmax(axis=0)])  # for the order along the curve
    own = np.union1d(here, spanning)
    parts = [PartitionMesh(mesh.points[own], mesh.global_ids[own], {}, {})]
    parts += [PartitionMesh(one.points, one.ids, one.cells, {}) for one in regions if len(one.ids)]
    whole = merge(parts)
    row_of = Rows(whole.global_ids)
    positions, rim = np.empty_like(whole.points), np.zeros(len(whole.points), dtype=bool)
    for one in regions:
        rows = row_of(one.ids)
        positions[rows] = one.positions
        rim[rows[~one.whole]] = True
    positions[row_of(mesh.global_ids[own])] = known(own)
    for node_map, there in zip(mesh.node_maps, sent, strict=True):  # a rank that sent nothing of a node has cells at it
        absent = np.intersect1d(node_map[~there], here)
        rim[row_of(mesh.global_ids[absent])] = True
    held = np.isin(whole.global_ids, mesh.global_ids[np.union1d(mesh.on_patches, np.setdiff1d(spanning, here))])
    free = len(mesh.points) - len(mesh.on_patches) + sum(one.interior for one in regions)
    skews, sizes = zip(*(one.extremes for one in regions), strict=True)
    elsewhere = Elsewhere(rim, free - int(np.count_nonzero(~held)), (min(skews), min(sizes)))
    holders = np.bincount(np.concatenate(mesh.node_maps), minlength=len(mesh.points))
    between = mesh.global_ids[here[holders[here] > 1]]
    settled = between[~rim[row_of(between)]]
    return MergedRegion(whole.global_ids, whole.points, positions, whole.cells, held, elsewhere, between, settled)


class Rows:
    """Rows of nodes, by global id."""

    def __init__(self, ids: Integers) -> None:
        self._order = np.argsort(ids)
        self._sorted = ids[self._order]

    def __call__(self, ids: Integers) -> Integers:
        return np.asarray(self._order[np.searchsorted(self._sorted, ids)])
