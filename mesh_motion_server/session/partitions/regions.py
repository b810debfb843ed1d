"""One region of a mesh whose cells stay with the client, made from the parts that its ranks send.

Nodes and cells are put in the order of the whole mesh: a correction of the region then gives the same result as with
the whole mesh, bit for bit.
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


@dataclass(frozen=True, eq=False)
class MergedRegion:
    """The nodes and cells of all ranks' regions, in canonical order."""

    #: ids, rows: (n,). Global ids, and indices in the boundary's mesh; -1 for a node that was not uploaded
    ids: Integers
    rows: Integers
    #: points, positions: (n, d), mesh length unit. Coordinates in the reference mesh, and after the interpolation
    points: Floats
    positions: Floats
    cells: CellTable
    held: Marks  # (n,) bool. Nodes on patches
    elsewhere: Elsewhere
    #: between, settled: (k,), (s,). ``between``: global ids of the nodes in the region that several ranks have, and of
    #: all periodic nodes with an image in the region. ``settled``: the global ids among them whose cells are all sent
    between: Integers
    settled: Integers


def merge_regions(
    mesh: MergedMesh, regions: Sequence[Region], known: Callable[[Integers], Floats], orbits: Integers
) -> MergedRegion:
    """Join the regions of all partitions.

    Raises InvalidInput if a partition sends impossible cells or nodes.

    Parameters
    ----------
    mesh : MergedMesh
        The boundary.
    regions : sequence of Region
        One region from each partition; ids are global.
    known : callable
        Indices (k,) of nodes in ``mesh`` → positions (k, d) to which the interpolation takes them.
    orbits : (n,) int64 array
        The node of ``mesh`` that represents each node and its periodic images.
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
    in_mesh = np.full(len(whole.points), -1, dtype=np.int64)
    in_mesh[row_of(mesh.global_ids[own])] = own
    positions, rim = np.empty_like(whole.points), np.zeros(len(whole.points), dtype=bool)
    for one in regions:
        rows = row_of(one.ids)
        positions[rows] = one.positions
        rim[rows[~one.whole]] = True
    positions[row_of(mesh.global_ids[own])] = known(own)
    for node_map, there in zip(mesh.node_maps, sent, strict=True):  # a rank without data about a node has cells at it
        absent = np.intersect1d(node_map[~there], here)
        rim[row_of(mesh.global_ids[absent])] = True
    alike = np.isin(orbits, orbits[here])
    torn = np.isin(orbits[own], orbits[np.setdiff1d(np.flatnonzero(alike), own)])
    torn |= ~np.isin(own, here)
    rim[row_of(mesh.global_ids[own[torn]])] = True
    held = np.isin(whole.global_ids, mesh.global_ids[np.union1d(mesh.on_patches, np.setdiff1d(spanning, here))])
    free = len(mesh.points) - len(mesh.on_patches) + sum(one.interior for one in regions)
    skews, sizes = zip(*(one.extremes for one in regions), strict=True)
    elsewhere = Elsewhere(rim, free - int(np.count_nonzero(~held)), (min(skews), min(sizes)))
    holders = np.bincount(np.concatenate(mesh.node_maps), minlength=len(mesh.points))
    several = np.union1d(here[holders[here] > 1], np.flatnonzero(alike & (np.bincount(orbits)[orbits] > 1)))
    between, there = mesh.global_ids[several], mesh.global_ids[np.intersect1d(several, here)]
    settled = there[~rim[row_of(there)]]
    return MergedRegion(
        whole.global_ids, in_mesh, whole.points, positions, whole.cells, held, elsewhere, between, settled
    )


class Rows:
    """Row numbers of nodes, by global id."""

    def __init__(self, ids: Integers) -> None:
        self._order = np.argsort(ids)
        self._sorted = ids[self._order]

    def __call__(self, ids: Integers) -> Integers:
        return np.asarray(self._order[np.searchsorted(self._sorted, ids)])
