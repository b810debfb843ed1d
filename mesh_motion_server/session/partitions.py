"""One mesh from n partitions, and the way back: which rank sent which node, cell and displacement.

Nodes are united by global id, a patch's nodes over all partitions, and everything is put in the canonical order of
:mod:`~mesh_motion_server.session.ordering` (cells of one type by their node tuple, patches by name). The numerics see
the result only, so that 1 and n partitions give identical arrays.

A node that several partitions hold must have the same coordinates in each to 1e-10 of the diagonal of the mesh's
bounding box, and be given the same displacement to 1e-12 of the largest one; the lowest partition's value is taken.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.cell_order import first_repetition, sorted_cells
from mesh_motion_server.numerics.cells import CELL_TYPES, CellTable
from mesh_motion_server.numerics.exact_displacements import differences_of
from mesh_motion_server.numerics.roles import Patch
from mesh_motion_server.session.joining import joined
from mesh_motion_server.session.ordering import canonical_order

__all__ = ["MergedMesh", "PartitionMesh", "merge"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Admitted difference of one node's coordinates between partitions, relative to the bounding box's diagonal: above
#: the rounding of 12-digit text files, far below any edge.
_COORDINATE_TOLERANCE = 1e-10
#: Admitted difference of one node's displacement between partitions, relative to the largest displacement.
_DISPLACEMENT_TOLERANCE = 1e-12


@dataclass(frozen=True, eq=False)
class PartitionMesh:
    """What one partition uploaded, in its own local numbering.

    Attributes
    ----------
    points : (n, d) array, mesh length unit
    global_ids : (n,) int64 array
        The same node has the same id in every partition; with one partition the local indices.
    cells : dict
        Type name → (m, n_nodes) integer local node indices, or the pieces that they came in.
    patches : dict
        Name → Patch with local node indices.
    """

    points: Floats
    global_ids: Ints
    cells: Mapping[str, Ints | Sequence[Ints]]
    patches: Mapping[str, Patch]

    def cell_pieces(self, name: str) -> list[Ints]:
        """Cells (m_i, n_nodes) of a type, none of them empty."""
        cells = self.cells.get(name, ())
        return [piece for piece in ([cells] if isinstance(cells, np.ndarray) else cells) if len(piece)]


@dataclass(frozen=True, eq=False)
class _CellOrigin:
    """Where the cells of one type came from, in canonical order: partition (m,), local index there (m,)."""

    type_name: str
    partition: NDArray[np.integer]
    local: NDArray[np.integer]


@dataclass(frozen=True, eq=False)
class MergedMesh:
    """One mesh in canonical order, and who sent what.

    Attributes
    ----------
    points : (n, d) array
        Reference coordinates, mesh length unit; read-only.
    global_ids : (n,) int64 array
    id_order : (n,) int64 array
        Canonical index of each node, ascending by global id: the order of the durable state.
    cells : CellTable
    patches : dict
        Name → Patch with canonical node indices, ascending; sorted by name.
    node_maps : tuple of (n_p,) int64 arrays
        Per partition: canonical index of each local node.
    moving_local : tuple of (k_p,) int64 arrays
        Per partition: local indices of the nodes it listed in a patch with role ``moving``, ascending.
    """

    points: Floats
    global_ids: Ints
    id_order: Ints
    cells: CellTable
    patches: Mapping[str, Patch]
    node_maps: tuple[Ints, ...]
    moving_local: tuple[Ints, ...]
    cell_origins: tuple[_CellOrigin, ...]

    @cached_property
    def moving(self) -> Ints:
        """(k,) canonical indices of the moving nodes, ascending."""
        return np.unique(np.concatenate([m[local] for m, local in self._moving_pairs()]))

    @cached_property
    def extent(self) -> float:
        """Longest side of the reference mesh's bounding box, mesh length unit."""
        return float(np.ptp(self.points, axis=0).max())

    def locate_cell(self, cell: int) -> tuple[int, str, int]:
        """(partition, type name, local index) of a canonical cell number."""
        for origin, first in zip(self.cell_origins, self.cells.offsets, strict=False):
            row = cell - first
            if row < len(origin.local):
                return int(origin.partition[row]), origin.type_name, int(origin.local[row])
        raise IndexError(cell)

    def locate_node(self, node: int) -> tuple[int, int]:
        """(lowest partition that holds it, local index there) of a canonical node index."""
        for partition, node_map in enumerate(self.node_maps):
            found = np.flatnonzero(node_map == node)
            if len(found):
                return partition, int(found[0])
        raise IndexError(node)

    def scatter(self, values: Floats, partition: int) -> Floats:
        """(n_p, d) rows of canonical ``values`` (n, d), in a partition's own order."""
        # take is three times as fast as indexing with an array
        return np.take(values, self.node_maps[partition], axis=0)

    def scatter_differences(self, moved: Floats, base: Floats, told: Floats) -> list[Floats]:
        """Displacements (n_p, d) from ``base`` to ``moved`` (n, d), in each partition's own order.

        Those of the moving nodes are ``told`` (k, d), rows in the order of ``moving``.
        """
        found = [differences_of(moved, base, node_map) for node_map in self.node_maps]
        for own, (local, rows) in zip(found, self._moving_places, strict=True):
            own[local] = told[rows]
        return found

    @cached_property
    def _moving_places(self) -> list[tuple[Ints, Ints]]:
        """Per partition: its local moving nodes, whoever listed them, and their rows in ``moving``."""
        is_moving = np.zeros(len(self.points), dtype=bool)
        is_moving[self.moving] = True
        local = [np.flatnonzero(is_moving[node_map]) for node_map in self.node_maps]
        return [(own, np.searchsorted(self.moving, m[own])) for own, m in zip(local, self.node_maps, strict=True)]

    def gather_moving(self, displacements: Sequence[Floats]) -> Floats:
        """One displacement per moving node from each partition's rows.

        Parameters
        ----------
        displacements : one (k_p, d) array per partition
            Rows in the order of ``moving_local``; finite.

        Returns
        -------
        (k, d) array
            Rows in the order of ``moving``.

        Raises
        ------
        InvalidInput
            Where two partitions move one node differently; names its global id, the partitions and both values.
        """
        if len(displacements) == 1:
            return self._single_gather(displacements[0])
        rows = np.concatenate(displacements)
        nodes = np.concatenate([m[local] for m, local in self._moving_pairs()])
        _, first, inverse = np.unique(nodes, return_index=True, return_inverse=True)
        taken = rows[first]
        self._check_agreement(rows, taken[inverse], nodes)
        return taken

    def _moving_pairs(self) -> list[tuple[Ints, Ints]]:
        return list(zip(self.node_maps, self.moving_local, strict=True))

    def _single_gather(self, rows: Floats) -> Floats:
        """Rows (k, d) of the only partition, sorted by canonical index."""
        return np.take(rows, self._moving_order, axis=0)

    @cached_property
    def _moving_order(self) -> Ints:
        """(k,) order that sorts the only partition's moving nodes by canonical index."""
        return np.argsort(self.node_maps[0][self.moving_local[0]])

    def _check_agreement(self, rows: Floats, taken: Floats, nodes: Ints) -> None:
        """Compare every row (r, d) with the one taken for its node (r,)."""
        gap = np.max(np.abs(rows - taken), axis=1)
        limit = _DISPLACEMENT_TOLERANCE * float(np.max(np.abs(taken)))
        bad = np.flatnonzero(gap > limit)
        if not len(bad):
            return
        row, node = int(bad[0]), int(nodes[bad[0]])
        lengths = np.cumsum([len(local) for local in self.moving_local])
        here, there = int(np.searchsorted(lengths, row, side="right")), self._first_mover(node)
        global_id = int(self.global_ids[node])
        raise InvalidInput(
            f"node with global id {global_id}: partition {there} moves it by {taken[row].tolist()}, "
            f"partition {here} by {rows[row].tolist()}",
            code="INVALID_ARGUMENT.PARTITION",
            hint="give a shared node the same displacement in every partition",
            details={
                "global_id": global_id,
                "partitions": [there, here],
                "values": [taken[row].tolist(), rows[row].tolist()],
            },
        )

    def _first_mover(self, node: int) -> int:
        """Lowest partition that moves a canonical node."""
        return next(p for p, (m, local) in enumerate(self._moving_pairs()) if np.any(m[local] == node))


def merge(partitions: Sequence[PartitionMesh]) -> MergedMesh:
    """Unite the partitions of one session.

    Raises
    ------
    InvalidInput
        Naming the first offender: an index out of range, a global id twice in one partition, a shared node whose
        coordinates differ, a patch whose role differs, a cell that came twice.
    """
    for number, partition in enumerate(partitions):
        _check_partition(partition, number)
    points, global_ids, id_order, node_maps = _merge_nodes(partitions)
    cells, origins = _merge_cells(partitions, node_maps, len(points))
    points.flags.writeable = False
    return MergedMesh(
        points=points,
        global_ids=global_ids,
        id_order=id_order,
        cells=cells,
        patches=_merge_patches(partitions, node_maps),
        node_maps=node_maps,
        moving_local=tuple(_moving_local(partition) for partition in partitions),
        cell_origins=origins,
    )


def _check_partition(partition: PartitionMesh, number: int) -> None:
    """Indices within range and global ids unique."""
    count = len(partition.points)
    if not count:
        raise InvalidInput(
            f"partition {number} has no nodes",
            code="INVALID_ARGUMENT.MESH",
            hint="send UPLOAD with item 'nodes'",
            details={"partition": number},
        )
    if len(partition.global_ids) != count:
        raise InvalidInput(
            f"partition {number}: {count} nodes but {len(partition.global_ids)} global ids",
            hint="send one global id per node",
            code="INVALID_ARGUMENT.SHAPE",
            details={"partition": number},
        )
    for name in partition.cells:
        row = 0
        for piece in partition.cell_pieces(name):
            _check_range(
                piece, count, f"partition {number}, cell type {name!r}", {"partition": number, "type": name}, row
            )
            row += len(piece)
    for name, patch in partition.patches.items():
        _check_range(patch.nodes, count, f"partition {number}, patch {name!r}", {"partition": number, "patch": name})
    if _ascending(partition.global_ids):
        return
    ids, repeats = np.unique(partition.global_ids, return_counts=True)
    if len(ids) < count:
        twice = int(ids[np.argmax(repeats > 1)])
        raise InvalidInput(
            f"partition {number}: global id {twice} is given to more than one node",
            code="INVALID_ARGUMENT.MESH",
            hint="a global id names one node",
            details={"partition": number, "global_id": twice},
        )


def _ascending(ids: Ints) -> bool:
    """Whether the ids (n,) ascend strictly, as local indices do."""
    return bool((ids[1:] > ids[:-1]).all())


def _check_range(indices: Ints, count: int, where: str, details: dict[str, object], first_row: int = 0) -> None:
    """Every index in 0 … count - 1; the rows count from ``first_row``."""
    if not len(indices) or (indices.min() >= 0 and indices.max() < count):
        return
    bad = np.argwhere((indices < 0) | (indices >= count))
    row, value = first_row + int(bad[0][0]), int(indices[tuple(bad[0])])
    raise InvalidInput(
        f"{where}, row {row}: node index {value} is not in 0 … {count - 1}",
        code="INVALID_ARGUMENT.MESH",
        hint="indices are local to the partition and start at 0",
        details=details | {"row": row, "value": value},
    )


def _merge_nodes(partitions: Sequence[PartitionMesh]) -> tuple[Floats, Ints, Ints, tuple[Ints, ...]]:
    """Points (n, d) and global ids (n,) in canonical order, its inverse by ids (n,), and each partition's node map."""
    if len(partitions) == 1 and _ascending(partitions[0].global_ids):  # nothing to unite
        ids, points = partitions[0].global_ids, partitions[0].points
        order = canonical_order(points, ids)
        rank = _inverse(order)
        return np.take(points, order, axis=0), ids[order], rank, (rank,)
    all_points = joined([p.points for p in partitions])
    all_ids = joined([p.global_ids for p in partitions])
    ids, first, inverse = np.unique(all_ids, return_index=True, return_inverse=True)
    points = all_points[first]
    owners = np.repeat(np.arange(len(partitions)), [len(p.points) for p in partitions])
    _check_coordinates(all_points, points[inverse], all_ids, owners)
    order = canonical_order(points, ids)
    rank = _inverse(order)
    ends = np.cumsum([len(p.points) for p in partitions])[:-1]
    return points[order], ids[order], rank, tuple(np.split(rank[inverse], ends))


def _inverse(order: Ints) -> Ints:
    """Where each index stands in a permutation (n,)."""
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return rank


def _check_coordinates(given: Floats, taken: Floats, ids: Ints, owners: Ints) -> None:
    """Compare every partition's coordinates (r, d) with those taken for the node (r, d)."""
    gap = np.max(np.abs(given - taken), axis=1)
    limit = _COORDINATE_TOLERANCE * float(np.linalg.norm(np.ptp(taken, axis=0)))
    bad = np.flatnonzero(gap > limit)
    if not len(bad):
        return
    row = int(bad[0])
    here, global_id = int(owners[row]), int(ids[row])
    there = int(owners[np.flatnonzero(ids == global_id)[0]])
    raise InvalidInput(
        f"node with global id {global_id}: partition {there} has it at {taken[row].tolist()}, partition {here} at "
        f"{given[row].tolist()}, further apart than {limit:.3g}",
        code="INVALID_ARGUMENT.PARTITION",
        hint="a global id names one node, at the same place in every partition",
        details={
            "global_id": global_id,
            "partitions": [there, here],
            "values": [taken[row].tolist(), given[row].tolist()],
        },
    )


def _merge_cells(
    partitions: Sequence[PartitionMesh], node_maps: Sequence[Ints], nodes: int
) -> tuple[CellTable, tuple[_CellOrigin, ...]]:
    """All cells in canonical order and where they came from, types in the order of CELL_TYPES."""
    tables: dict[str, Ints] = {}
    origins = []
    for name in CELL_TYPES:
        pieces = [(p, piece) for p, mesh in enumerate(partitions) for piece in mesh.cell_pieces(name)]
        if not pieces:
            continue
        tables[name], order = sorted_cells([(node_maps[p], piece) for p, piece in pieces], nodes)
        origins.append(_origin(name, [(p, len(piece)) for p, piece in pieces], order))
        _check_no_duplicate(tables[name], origins[-1])
    return CellTable.from_arrays(tables), tuple(origins)


def _origin(name: str, lengths: Sequence[tuple[int, int]], order: NDArray[np.integer]) -> _CellOrigin:
    """Where cells came from that are put in this ``order`` (m,): (partition, number of cells) of each piece before."""
    # kept as long as the session: none for an only partition
    if len({p for p, _ in lengths}) == 1:
        return _CellOrigin(name, np.broadcast_to(np.int32(lengths[0][0]), len(order)), order)
    counts = np.zeros(1 + max(p for p, _ in lengths), dtype=np.int64)
    for p, count in lengths:
        counts[p] += count
    partition = np.repeat(np.arange(len(counts), dtype=np.int32), counts)
    local = np.concatenate([np.arange(count, dtype=order.dtype) for count in counts])
    return _CellOrigin(name, partition[order], local[order])


def _check_no_duplicate(nodes: Ints, origin: _CellOrigin) -> None:
    """Sorted rows (m, k) all differ."""
    again = first_repetition(nodes)
    if again is None:
        return
    places = [(int(origin.partition[row]), int(origin.local[row])) for row in (again - 1, again)]
    (p, a), (q, b) = places
    raise InvalidInput(
        f"cell {a} of type {origin.type_name!r} in partition {p} is also cell {b} in partition {q}",
        code="INVALID_ARGUMENT.MESH" if p == q else "INVALID_ARGUMENT.PARTITION",
        hint="send every cell once, from the partition that owns it",
        details={"type": origin.type_name, "partitions": [p, q], "cells": [a, b]},
    )


def _merge_patches(partitions: Sequence[PartitionMesh], node_maps: Sequence[Ints]) -> dict[str, Patch]:
    """Every patch's nodes over all partitions, ascending; patches sorted by name."""
    found: dict[str, tuple[str, int, list[Ints]]] = {}
    for number, (partition, node_map) in enumerate(zip(partitions, node_maps, strict=True)):
        for name, patch in partition.patches.items():
            role, first, parts = found.setdefault(name, (patch.role, number, []))
            if patch.role != role:
                raise InvalidInput(
                    f"patch {name!r} has the role {role!r} in partition {first} and {patch.role!r} in {number}",
                    code="INVALID_ARGUMENT.PARTITION",
                    hint="give a patch one role in all partitions",
                    details={"patch": name, "partitions": [first, number], "values": [role, patch.role]},
                )
            parts.append(node_map[patch.nodes])
    return {name: Patch(role, np.unique(np.concatenate(parts))) for name, (role, _, parts) in sorted(found.items())}


def _moving_local(partition: PartitionMesh) -> Ints:
    """(k_p,) local indices of the partition's own moving patches, ascending, each once."""
    parts = [patch.nodes for patch in partition.patches.values() if patch.role == "moving"]
    return np.unique(np.concatenate(parts)) if parts else np.empty(0, dtype=np.int64)
