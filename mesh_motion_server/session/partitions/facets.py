"""The boundary of a mesh whose cells stay with the client, from the facets of its partitions' boundaries."""

from collections.abc import Sequence

import numpy as np
from mesh_motion_numerics.arrays import Integers
from mesh_motion_numerics.mesh.local_facets import FACET_NAMES
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.session.partitions.meshes import PartitionMesh

#: Types of facets, and their numbers of nodes.
FACET_NODES = {name: count for count, name in FACET_NAMES.items()}


def merge_facets(
    partitions: Sequence[PartitionMesh], node_maps: Sequence[Integers], global_ids: Integers
) -> dict[str, Integers]:
    """The facets (f, k) of the whole boundary by type, in canonical order; none if a partition sent none.

    A facet that two partitions have is between them. The order depends only on the nodes, and the first node of each
    facet stays the first. Raises InvalidInput if a partition sent no facets although a role needs them, if it sent a
    facet twice, or if three partitions have a facet.

    Parameters
    ----------
    node_maps : sequence of (n_p,) int64 arrays
        Canonical index of each partition's nodes.
    global_ids : (n,) int64 array
    """
    patches = ((name, patch.role) for one in partitions for name, patch in sorted(one.patches.items()))
    needing = next(((name, role) for name, role in patches if role not in ("moving", "fixed")), None)
    silent = next((number for number, one in enumerate(partitions) if one.keeps_cells and not one.facets), None)
    if silent is not None:
        if needing is None:
            return {}
        raise InvalidInput(
            f"evaluation = 'client': patch {needing[0]!r} has the role {needing[1]!r}, expected moving or fixed: "
            f"partition {silent} sent no facets of its boundary",
            code="INVALID_ARGUMENT.MESH",
            hint="send them with UPLOAD, as the client in Python does, or open the session with evaluation = 'server'",
            details={"patch": needing[0], "partition": silent},
        )
    found: dict[str, Integers] = {}
    for name in FACET_NODES:
        pieces = [(p, node_maps[p][one.facets[name]]) for p, one in enumerate(partitions) if name in one.facets]
        if pieces:
            rows = np.concatenate([piece for _, piece in pieces])
            owners = np.repeat([number for number, _ in pieces], [len(piece) for _, piece in pieces])
            kept = _alone(name, rows, owners, global_ids)
            found |= {name: kept} if len(kept) else {}
    return found


def _alone(name: str, rows: Integers, owners: Integers, global_ids: Integers) -> Integers:
    """The facets (f, k) that only one partition has, sorted; ``owners`` (f,) are their partitions."""
    keys = np.sort(rows, axis=1)
    order = np.lexsort((owners, *keys.T[::-1]))
    keys, rows, owners = keys[order], rows[order], owners[order]
    again = np.concatenate([[False], (keys[1:] == keys[:-1]).all(axis=1), [False]])
    wrong = again[1:-1] & ((owners[1:] == owners[:-1]) | again[:-2])
    if wrong.any():
        row = int(np.argmax(wrong)) + 1
        nodes, pair = sorted(global_ids[rows[row]].tolist()), owners[row - 1 : row + 1].tolist()
        twice = f"partition {pair[0]} sent it twice" if pair[0] == pair[1] else "more than two partitions have it"
        raise InvalidInput(
            f"the {name} of the nodes with global ids {nodes}: {twice}, expected a facet of one partition's boundary, "
            "or of two between them",
            code="INVALID_ARGUMENT.PARTITION",
            details={"global_ids": nodes, "partitions": pair},
        )
    return np.ascontiguousarray(rows[~again[:-1] & ~again[1:]])
