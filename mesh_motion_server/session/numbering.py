"""The mesh in the numbering its senders know, for messages about it.

Nodes count through the global ids in ascending order: with one partition these are the local indices as uploaded. Cells
count through the types in the order of :data:`~mesh_motion_server.numerics.cells.CELL_TYPES`, within a type through the
partitions as uploaded.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.numerics.cells import CellTable
from mesh_motion_server.numerics.roles import Patch
from mesh_motion_server.session.partitions import MergedMesh

__all__ = ["UploadView", "upload_view"]


@dataclass(frozen=True, eq=False)
class UploadView:
    """The mesh in the senders' numbering.

    Attributes
    ----------
    points : (n, d) array
        Reference coordinates, mesh length unit.
    cells : CellTable
    patches : dict
    cell_order : (m,) int64 array
        Canonical number of each cell.
    mesh : MergedMesh
    """

    points: NDArray[np.float64]
    cells: CellTable
    patches: Mapping[str, Patch]
    cell_order: NDArray[np.int64]
    mesh: MergedMesh

    def name_cell(self, cell: int) -> dict[str, object]:
        """Partition, type and local index of a cell of this numbering."""
        partition, type_name, local = self.mesh.locate_cell(int(self.cell_order[cell]))
        return {"partition": partition, "type": type_name, "cell": local}

    def name_node(self, node: int) -> dict[str, object]:
        """Lowest partition, local index and global id of a node of this numbering."""
        canonical = int(self.mesh.id_order[node])
        partition, local = self.mesh.locate_node(canonical)
        return {"partition": partition, "node": local, "global_id": int(self.mesh.global_ids[canonical])}


def upload_view(mesh: MergedMesh) -> UploadView:
    """A merged mesh in the senders' numbering."""
    rank = np.empty_like(mesh.id_order)
    rank[mesh.id_order] = np.arange(len(rank))
    tables, orders = {}, []
    for block, origin, first in zip(mesh.cells.blocks, mesh.cell_origins, mesh.cells.offsets, strict=False):
        order = np.lexsort((origin.local, origin.partition))
        tables[block.type.name] = rank[block.nodes[order]]
        orders.append(first + order)
    return UploadView(
        points=mesh.points[mesh.id_order],
        cells=CellTable.from_arrays(tables),
        patches={name: Patch(patch.role, np.sort(rank[patch.nodes])) for name, patch in mesh.patches.items()},
        cell_order=np.concatenate(orders),
        mesh=mesh,
    )
