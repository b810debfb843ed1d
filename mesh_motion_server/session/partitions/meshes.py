"""The uploads of n partitions, the merged mesh, and the mapping back to the partitions: nodes, cells, displacements.

The numerics use only the merged mesh, so that 1 and n partitions give identical arrays (:mod:`.merging` makes it). All
partitions that move a node must give it the same displacement, as :mod:`mesh_motion_protocol.shared_nodes` says.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.points import bounding_box, marks_at
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_protocol.errors import InvalidInput
from mesh_motion_protocol.shared_nodes import Torn, united
from numpy.typing import NDArray

from mesh_motion_server.session.partitions.exact_displacements import differences_of


@dataclass(frozen=True, eq=False)
class PartitionMesh:
    """The upload of one partition, in its own local numbering."""

    points: Floats  # (n, d), mesh length unit
    #: (n,). A node has the same id in every partition; with one partition the ids are the local indices.
    global_ids: Integers
    #: Type name → (m, n_nodes) integer local node indices, or the received pieces of them; (m, 0) if the cells stay
    #: with the client.
    cells: Mapping[str, Integers | Sequence[Integers]]
    patches: Mapping[str, Patch]  # name → Patch with local node indices
    #: Type name → (f, k) local node indices of the facets of the partition's boundary, pointing outwards; only where
    #: the cells stay with the client.
    facets: Mapping[str, Integers] = field(default_factory=dict)
    #: The cells near moving walls, in the form of ``cells``; only if the cells stay with the client.
    near: Mapping[str, Integers] = field(default_factory=dict)

    def cell_pieces(self, name: str) -> list[Integers]:
        """Cells (m_i, n_nodes) of a type, none of them empty."""
        cells = self.cells.get(name, ())
        return [piece for piece in ([cells] if isinstance(cells, np.ndarray) else cells) if len(piece)]

    @property
    def keeps_cells(self) -> bool:
        """Whether the partition has cells that stay with the client."""
        return any(not piece.size for name in self.cells for piece in self.cell_pieces(name))


@dataclass(frozen=True, eq=False)
class CellOrigin:
    """The origin of the cells of one type, in canonical order: partition (m,), local index there (m,)."""

    type_name: str
    partition: NDArray[np.integer]
    local: NDArray[np.integer]

    def __len__(self) -> int:
        return len(self.local)

    def rows_of(self, partition: int) -> Integers:
        """(m_p,) rows of a partition's cells, in the order of their local indices."""
        rows = np.flatnonzero(self.partition == partition)
        return rows[np.argsort(self.local[rows])]

    def place(self, row: int) -> tuple[int, int]:
        """(partition, local index) of a cell."""
        return int(self.partition[row]), int(self.local[row])


@dataclass(frozen=True, eq=False)
class CellCount:
    """The numbers of cells of one type that stay with the client, by partition.

    Rows count the cells of all partitions, in the order of the partitions.
    """

    type_name: str
    counts: tuple[int, ...]

    def __len__(self) -> int:
        return sum(self.counts)

    def rows_of(self, partition: int) -> Integers:
        """(m_p,) rows of a partition's cells."""
        first = sum(self.counts[:partition])
        return np.arange(first, first + self.counts[partition])

    def place(self, row: int) -> tuple[int, int]:
        """(partition, local index) of a cell."""
        ends = np.cumsum(self.counts)
        partition = int(np.searchsorted(ends, row, side="right"))
        return partition, row - int(ends[partition] - self.counts[partition])


@dataclass(frozen=True, eq=False)
class MergedMesh:
    """One mesh in canonical order, and the origin of its parts."""

    points: Floats  # (n, d). Reference coordinates, mesh length unit; read-only
    global_ids: Integers  # (n,)
    id_order: Integers  # (n,). Canonical index of each node, ascending by global id: the order of the durable state
    cells: CellTable  # empty if the cells stay with the client
    patches: Mapping[str, Patch]  # name → Patch with canonical node indices, ascending; sorted by name
    #: Type name → (f, k) canonical node indices of the whole boundary's facets, if clients send them.
    facets: Mapping[str, Integers]
    near: CellTable  # the cells near moving walls that clients send, if all other cells stay with the clients
    node_maps: tuple[Integers, ...]  # tuple of (n_p,). Per partition: canonical index of each local node
    #: tuple of (k_p,). Per partition: local indices of the nodes it listed in a patch with role ``moving``, ascending.
    moving_local: tuple[Integers, ...]
    #: Per partition: name → (p,) local indices of the nodes of each of these patches, in the order of the upload.
    moving_patches: tuple[Mapping[str, Integers], ...]
    cell_origins: tuple[CellOrigin | CellCount, ...]

    @cached_property
    def moving(self) -> Integers:
        """(k,) canonical indices of the moving nodes, ascending."""
        pairs = zip(self.node_maps, self.moving_local, strict=True)
        return np.unique(np.concatenate([node_map[local] for node_map, local in pairs]))

    @cached_property
    def _moving_rows(self) -> list[Integers]:
        """Per partition: the row in ``moving`` of each node of its ``moving_local``."""
        pairs = zip(self.node_maps, self.moving_local, strict=True)
        return [np.searchsorted(self.moving, node_map[local]) for node_map, local in pairs]

    @cached_property
    def on_patches(self) -> Integers:
        """(k,) canonical indices of the nodes on patches, ascending."""
        return np.unique(np.concatenate([patch.nodes for patch in self.patches.values()]))

    @cached_property
    def moving_by_id(self) -> NDArray[np.intp]:
        """(k,) order that sorts the moving nodes by global id."""
        return np.argsort(self.global_ids[self.moving])

    @cached_property
    def extent(self) -> float:
        """Longest side of the reference mesh's bounding box, mesh length unit."""
        return float(np.ptp(bounding_box(self.points), axis=0).max())

    def locate_cell(self, cell: int) -> tuple[int, str, int]:
        """(partition, type name, local index) of a canonical cell number."""
        first = 0
        for origin in self.cell_origins:
            if cell < first + len(origin):
                partition, local = origin.place(cell - first)
                return partition, origin.type_name, local
            first += len(origin)
        raise IndexError(cell)

    def cell_number(self, partition: int, type_name: str, local: int) -> int:
        """Canonical number of a cell that stays with the client.

        Raises IndexError if the partition has no such cell.
        """
        first = 0
        for origin in self.cell_origins:
            if (
                isinstance(origin, CellCount)
                and origin.type_name == type_name
                and local in range(origin.counts[partition])
            ):
                return first + sum(origin.counts[:partition]) + local
            first += len(origin)
        raise IndexError(f"partition {partition} has no cell {local} of type {type_name}")

    def locate_node(self, node: int) -> tuple[int, int]:
        """(lowest partition that has the node, local index there) of a canonical node index."""
        for partition, node_map in enumerate(self.node_maps):
            found = np.flatnonzero(node_map == node)
            if len(found):
                return partition, int(found[0])
        raise IndexError(node)

    def ids_of(self, partition: int) -> Integers:
        """(n_p,) global ids of a partition's nodes, in its own order."""
        return self.global_ids[self.node_maps[partition]]

    def scatter(self, values: Floats, partition: int) -> Floats:
        """(n_p, d) rows of canonical ``values`` (n, d), in a partition's own order."""
        # take is three times as fast as indexing with an array
        return np.take(values, self.node_maps[partition], axis=0)

    def scatter_differences(self, moved: Floats, base: Floats, boundary_displacement: Floats) -> list[Floats]:
        """Displacements (n_p, d) from ``base`` to ``moved`` (n, d), in each partition's own order.

        The displacements of the moving nodes are the ``boundary_displacement`` (k, d), rows in the order of ``moving``.
        """
        found = [differences_of(moved, base, node_map) for node_map in self.node_maps]
        for own, (local, rows) in zip(found, self._moving_places, strict=True):
            own[local] = boundary_displacement[rows]
        return found

    @cached_property
    def _moving_places(self) -> list[tuple[Integers, Integers]]:
        """Per partition: its local moving nodes, from any partition's list, and their rows in ``moving``."""
        is_moving = marks_at(len(self.points), self.moving)
        local = [np.flatnonzero(is_moving[node_map]) for node_map in self.node_maps]
        return [(own, np.searchsorted(self.moving, m[own])) for own, m in zip(local, self.node_maps, strict=True)]

    def scatter_moving(self, values: Floats) -> list[Floats]:
        """Rows (k_p, c) of the moving nodes' ``values`` (k, c) for each partition, in the order of its
        ``moving_local``.
        """
        return [np.take(values, rows, axis=0) for rows in self._moving_rows]

    def gather_sums(self, values: Sequence[Floats]) -> Floats:
        """(n, c) the sums of the values (n_p, c) that partitions give for their nodes."""
        out = np.zeros((len(self.points), values[0].shape[1]))
        for node_map, rows in zip(self.node_maps, values, strict=True):
            out[node_map] += rows
        return out

    def gather_moving(self, boundary_displacements: Sequence[Floats], scale: float | None = None) -> Floats:
        """One displacement per moving node from each partition's rows.

        Raises InvalidInput if two partitions move one node differently; names its global id, the partitions and both
        values.

        Parameters
        ----------
        boundary_displacements : one (k_p, d) array per partition
            Rows in the order of ``moving_local``; finite.
        scale : float, optional
            Unit for differences between partitions; by default the extent of the mesh.

        Returns
        -------
        (k, d) array
            Rows in the order of ``moving``.
        """
        if len(boundary_displacements) == 1:
            gathered = np.empty_like(boundary_displacements[0])
            gathered[self._moving_rows[0]] = boundary_displacements[0]
            return gathered
        try:
            return united(
                boundary_displacements, self._moving_rows, len(self.moving), self.extent if scale is None else scale
            )
        except Torn as torn:
            raise self._torn(torn) from None

    def _torn(self, torn: Torn) -> InvalidInput:
        """The error for a node that two partitions move to different places."""
        global_id, values = int(self.global_ids[self.moving[torn.place]]), [value.tolist() for value in torn.values]
        there, here = torn.parts
        return InvalidInput(
            f"node with global id {global_id}: partition {there} moves it by {values[0]}, "
            f"partition {here} by {values[1]}",
            code="INVALID_ARGUMENT.PARTITION",
            hint="give a shared node the same displacement in every partition",
            details={"global_id": global_id, "partitions": [there, here], "values": values},
        )


def joined(pieces: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Concatenate the pieces (k, …) by rows; a single piece is returned without a copy."""
    return pieces[0] if len(pieces) == 1 else np.concatenate(pieces)
