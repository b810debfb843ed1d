"""The mesh in the senders' numbering, for messages about it.

Nodes count through the global ids in ascending order: with one partition these are the local indices as uploaded. Cells
count through the types in the order of :data:`.cells.CELL_TYPES`, within a type through the
partitions as uploaded.
"""

import copy
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_protocol.errors import MeshMotionError

from mesh_motion_server.session.partitions.meshes import CellOrigin, MergedMesh

#: The pattern of a node in a message, and the keys of a node in the details.
_NODE = re.compile(r"\bnode (\d+)")
_NODE_KEYS = ("node", "image")
_Error = TypeVar("_Error", bound=MeshMotionError)


@dataclass(frozen=True, eq=False)
class UploadView:
    """The mesh in the senders' numbering."""

    points: Floats  # (n, d). Reference coordinates, mesh length unit
    cells: CellTable
    patches: Mapping[str, Patch]
    facets: Mapping[str, Integers]
    near: CellTable
    cell_order: Integers  # (m,). Canonical number of each cell
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
    origins = [origin for origin in mesh.cell_origins if isinstance(origin, CellOrigin)]
    for block, origin, first in zip(mesh.cells.blocks, origins, mesh.cells.offsets, strict=False):
        order = np.lexsort((origin.local, origin.partition))
        tables[block.type.name] = rank[block.nodes[order]]
        orders.append(first + order)
    return UploadView(
        points=mesh.points[mesh.id_order],
        cells=CellTable.from_arrays(tables) if origins else mesh.cells,
        patches={name: Patch(patch.role, np.sort(rank[patch.nodes])) for name, patch in mesh.patches.items()},
        facets={name: rank[rows] for name, rows in mesh.facets.items()},
        near=CellTable.from_arrays({block.type.name: rank[block.nodes] for block in mesh.near})
        if len(mesh.near)
        else mesh.near,
        cell_order=np.concatenate([np.empty(0, dtype=np.int64), *orders]),
        mesh=mesh,
    )


def text_in_senders_numbers(text: str, mesh: MergedMesh) -> str:
    """The text with its nodes, which have canonical numbers, named by global ids."""
    return _NODE.sub(lambda found: f"node {mesh.global_ids[int(found[1])]}", text)


def in_senders_numbers(error: _Error, mesh: MergedMesh) -> _Error:
    """Convert the error of a motion, whose nodes have canonical numbers, to the senders' numbering.

    Message and details name nodes by global id, which with one partition is the local index; with several partitions,
    the details also have the node's partition and local index.
    """
    translated, details = copy.copy(error), dict(error.details)
    translated.message = text_in_senders_numbers(error.message, mesh)
    for key in _NODE_KEYS:
        if isinstance(node := details.get(key), int):
            details[key] = int(mesh.global_ids[node])
            if key == "node" and len(mesh.node_maps) > 1:
                partition, local = mesh.locate_node(node)
                details |= {"partition": partition, "node": local, "global_id": int(mesh.global_ids[node])}
    translated.details = details
    return translated
