"""One mesh from n partitions.

Nodes are united by global id, a patch's nodes over all partitions, and everything is put in canonical order: nodes
along the Morton (Z-order) curve of their reference coordinates, cells of one type by their node tuple, patches by name.
The order depends only on coordinates and global ids, and not on the partition that sent a node: a mesh in one partition
or in many becomes the same arrays, and so gives bitwise the same answers. Near nodes are also near in memory, which the
kernels need. A node that several partitions have must have the same coordinates in each to 1e-10 of the diagonal of the
mesh's bounding box; those of the lowest partition are used.
"""

from collections.abc import Iterable, Sequence
from typing import Any

import mesh_motion_kernels as kernels
import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers, Shorts
from mesh_motion_numerics.mesh.cells import CELL_TYPES, CellTable
from mesh_motion_numerics.mesh.coincidence import coincident_nodes
from mesh_motion_numerics.mesh.morton import morton_codes
from mesh_motion_numerics.mesh.roles import Patch, nodes_with
from mesh_motion_protocol.errors import InvalidInput
from numpy.typing import NDArray

from mesh_motion_server.session.partitions.facets import merge_facets
from mesh_motion_server.session.partitions.meshes import CellCount, CellOrigin, MergedMesh, PartitionMesh, joined

#: Largest difference of one node's coordinates between partitions, relative to the bounding box's diagonal: above the
#: rounding of text files with 12 digits, far below any edge.
_COORDINATE_TOLERANCE = 1e-10


def canonical_order(points: Floats, global_ids: Integers) -> Integers:
    """(n,) indices that sort nodes, points (n, d), by Morton code, ties by global id (n,)."""
    return np.lexsort((global_ids, morton_codes(points)))


def merge(partitions: Sequence[PartitionMesh]) -> MergedMesh:
    """Join the partitions of one session.

    Raises InvalidInput naming the first offender: an index out of range, a global id twice in one partition, a shared
    node whose coordinates differ, a patch whose role differs, a cell or a facet that came twice.
    """
    for number, partition in enumerate(partitions):
        _check_partition(partition, number)
    if not any(len(partition.points) for partition in partitions):
        raise InvalidInput("the mesh has no nodes", code="INVALID_ARGUMENT.MESH", hint="send UPLOAD with item 'nodes'")
    points, global_ids, id_order, node_maps = _merge_nodes(partitions)
    cells, origins = _merge_cells(partitions, node_maps, len(points))
    points.flags.writeable = False
    return MergedMesh(
        points=points,
        global_ids=global_ids,
        id_order=id_order,
        cells=cells,
        patches=_merge_patches(partitions, node_maps),
        facets=merge_facets(partitions, node_maps, global_ids),
        near=_merge_near(partitions, node_maps, len(points)),
        node_maps=node_maps,
        moving_local=tuple(nodes_with(partition.patches, ("moving",)) for partition in partitions),
        moving_patches=tuple(
            {name: patch.nodes for name, patch in partition.patches.items() if patch.role == "moving"}
            for partition in partitions
        ),
        cell_origins=origins,
    )


def check_boundary(mesh: MergedMesh) -> None:
    """Check that the boundary of a mesh whose cells stay with the client determines its motion.

    A node on no patch may only be between partitions, so that several have it, or inside, near a moving wall: the
    motion of other nodes would depend on the cells. Only the cells show whether two nodes at the same place pass
    through each other. Raises InvalidInput naming the first offender.
    """
    held = np.zeros(len(mesh.points), dtype=np.int64)
    for node_map in mesh.node_maps:
        held[node_map] += 1
    held[mesh.on_patches] = 0
    inside = np.setdiff1d(_nodes_of(block.nodes for block in mesh.near), _nodes_of(mesh.facets.values()))
    held[inside] = 0
    alone = np.flatnonzero(held == 1)
    if len(alone):
        fault, hint = (
            f"is on the boundary, but on no patch ({len(alone)} such nodes)",
            "give it the role moving or fixed",
        )
        raise _undetermined(mesh, int(alone[0]), fault, hint)
    pairs = coincident_nodes(mesh.points, mesh.on_patches)
    if len(pairs):
        first, other = pairs[0].tolist()
        raise _undetermined(mesh, other, f"has the same position as that with {mesh.global_ids[first]}", "merge them")


def check_near(mesh: MergedMesh, wall: Integers) -> None:
    """Check that the sent cells near moving walls include cells at each node (k,) of the walls.

    Raises InvalidInput naming the first node without a cell.
    """
    bare = np.setdiff1d(wall, _nodes_of(block.nodes for block in mesh.near))
    if len(bare):
        fault = f"is on a moving wall, but in none of the near cells that were sent ({len(bare)} such nodes)"
        raise _undetermined(mesh, int(bare[0]), fault, "UPLOAD the cells around it as near_cells, then send BUILD")


def _nodes_of(rows: Iterable[Integers | Shorts]) -> Integers:
    """The nodes of cells or facets, ascending, each once."""
    return np.unique(np.concatenate([np.empty(0, dtype=np.int64), *(each.reshape(-1) for each in rows)]))


def _undetermined(mesh: MergedMesh, node: int, fault: str, hint: str) -> InvalidInput:
    partition, local = mesh.locate_node(node)
    global_id = int(mesh.global_ids[node])
    return InvalidInput(
        f"evaluation = 'client': the node with global id {global_id} {fault}",
        code="INVALID_ARGUMENT.MESH",
        hint=f"{hint}, or open the session with evaluation = 'server'",
        details={"partition": partition, "node": local, "global_id": global_id},
    )


def _check_partition(partition: PartitionMesh, number: int) -> None:
    """Check that indices are in range and that global ids are unique."""
    count = len(partition.points)
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
    for item, types in (("facets", partition.facets), ("near cells", partition.near)):
        for name, rows in types.items():
            _check_range(rows, count, f"partition {number}, {item} {name!r}", {"partition": number, "type": name})
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


def _ascending(ids: Integers) -> bool:
    """Whether the ids (n,) ascend strictly."""
    return bool((ids[1:] > ids[:-1]).all())


def _check_range(indices: Integers, count: int, where: str, details: dict[str, object], first_row: int = 0) -> None:
    """Check that every index is in 0 … count - 1; the rows count from ``first_row``."""
    if not indices.size or (indices.min() >= 0 and indices.max() < count):
        return
    bad = np.argwhere((indices < 0) | (indices >= count))
    row, value = first_row + int(bad[0][0]), int(indices[tuple(bad[0])])
    raise InvalidInput(
        f"{where}, row {row}: node index {value} is not in 0 … {count - 1}",
        code="INVALID_ARGUMENT.MESH",
        hint="indices are local to the partition and start at 0",
        details=details | {"row": row, "value": value},
    )


def _merge_nodes(partitions: Sequence[PartitionMesh]) -> tuple[Floats, Integers, Integers, tuple[Integers, ...]]:
    """Points (n, d) and global ids (n,) in canonical order, its inverse by ids (n,), and each partition's node map."""
    if len(partitions) == 1 and _ascending(partitions[0].global_ids):  # with one partition there is nothing to join
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


def _inverse(order: Integers) -> Integers:
    """The inverse (n,) of a permutation."""
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return rank


def _check_coordinates(given: Floats, taken: Floats, ids: Integers, owners: Integers) -> None:
    """Compare every partition's coordinates (r, d) with the coordinates (r, d) in use for the node."""
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
    partitions: Sequence[PartitionMesh], node_maps: Sequence[Integers], nodes: int
) -> tuple[CellTable, tuple[CellOrigin | CellCount, ...]]:
    """All cells in canonical order and their origins, types in the order of CELL_TYPES."""
    tables: dict[str, Shorts] = {}
    origins: list[CellOrigin] = []
    counted: list[CellCount] = []
    for name in CELL_TYPES:
        pieces = [(p, piece) for p, mesh in enumerate(partitions) for piece in mesh.cell_pieces(name)]
        if not pieces:
            continue
        if not pieces[0][1].size:  # the cells stay with the client
            own = np.bincount([p for p, _ in pieces], [len(piece) for _, piece in pieces], len(partitions))
            counted.append(CellCount(name, tuple(int(count) for count in own)))
            continue
        tables[name], order, again = sorted_cells([(node_maps[p], piece) for p, piece in pieces], nodes)
        origins.append(_origin(name, [(p, len(piece)) for p, piece in pieces], order))
        _check_no_duplicate(again, origins[-1])
    return (CellTable(()), tuple(counted)) if counted else (CellTable.from_arrays(tables), tuple(origins))


def _merge_near(partitions: Sequence[PartitionMesh], node_maps: Sequence[Integers], nodes: int) -> CellTable:
    """The cells near moving walls in canonical order."""
    tables: dict[str, Shorts] = {}
    for name in CELL_TYPES:
        pieces = [(p, mesh.near[name]) for p, mesh in enumerate(partitions) if name in mesh.near]
        if pieces:
            tables[name], order, again = sorted_cells([(node_maps[p], piece) for p, piece in pieces], nodes)
            _check_no_duplicate(again, _origin(name, [(p, len(piece)) for p, piece in pieces], order))
    return CellTable.from_arrays(tables) if tables else CellTable(())


def _origin(name: str, lengths: Sequence[tuple[int, int]], order: NDArray[np.integer]) -> CellOrigin:
    """The origins of cells put in this ``order`` (m,), from the (partition, number of cells) of each piece."""
    # kept as long as the session; none for a single partition
    if len({p for p, _ in lengths}) == 1:
        return CellOrigin(name, np.broadcast_to(np.int32(lengths[0][0]), len(order)), order)
    counts = np.zeros(1 + max(p for p, _ in lengths), dtype=np.int64)
    for p, count in lengths:
        counts[p] += count
    partition = np.repeat(np.arange(len(counts), dtype=np.int32), counts)
    local = np.concatenate([np.arange(count, dtype=order.dtype) for count in counts])
    return CellOrigin(name, partition[order], local[order])


def _check_no_duplicate(again: int, origin: CellOrigin) -> None:
    """Check that no row equals the one before it; ``again`` is the first such row, or negative."""
    if again < 0:
        return
    places = [(int(origin.partition[row]), int(origin.local[row])) for row in (again - 1, again)]
    (p, a), (q, b) = places
    raise InvalidInput(
        f"cell {a} of type {origin.type_name!r} in partition {p} is also cell {b} in partition {q}",
        code="INVALID_ARGUMENT.MESH" if p == q else "INVALID_ARGUMENT.PARTITION",
        hint="send every cell once, from the partition that owns it",
        details={"type": origin.type_name, "partitions": [p, q], "cells": [a, b]},
    )


def _merge_patches(partitions: Sequence[PartitionMesh], node_maps: Sequence[Integers]) -> dict[str, Patch]:
    """Every patch's nodes over all partitions, ascending; patches sorted by name."""
    found: dict[str, tuple[str, int, list[Integers]]] = {}
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


def sorted_cells(pieces: Sequence[tuple[Integers, Integers]], nodes: int) -> tuple[Shorts, NDArray[Any], int]:
    """Cells of one type, renumbered, in the lexicographic order of their nodes.

    Parameters
    ----------
    pieces : sequence of (node map, cells)
        New number of each node of the cells (m_i, k), and these cells; every number in range.
    nodes : int
        Upper bound: all new numbers are smaller.

    Returns
    -------
    (m, k) int32 array
        Rows ascending; equal rows in the input order.
    (m,) int32 or int64 array
        Input row of each row, counted through the pieces.
    int
        The first row that equals the one before it, or -1.
    """
    given = [
        (np.ascontiguousarray(new, dtype=np.int64), np.ascontiguousarray(cells, dtype=np.int32))
        for new, cells in pieces
    ]
    total = sum(len(cells) for _, cells in given)
    rows = np.empty((total, given[0][1].shape[1]), dtype=np.int32)
    # kept as long as the session: int32, where possible, takes half the memory
    order = np.empty(total, dtype=np.int32 if total < 2**31 else np.int64)
    return rows, order, kernels.sort_cells(given, nodes, rows, order)
