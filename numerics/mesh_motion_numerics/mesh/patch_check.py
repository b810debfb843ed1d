"""Checks that the patches of a mesh are usable and cover its boundary."""

from collections.abc import Mapping
from itertools import combinations

import numpy as np
from mesh_motion_protocol.errors import InvalidInput
from numpy.typing import NDArray

from mesh_motion_numerics.arrays import Integers, Marks
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.neighbours import connected
from mesh_motion_numerics.mesh.roles import ROLES, Patch


def check_patches(n: int, patches: Mapping[str, Patch]) -> None:
    """Refuse patches with an unknown role or unusable node ids, and a mesh on which nothing moves.

    Raises InvalidInput; names the patch and the first offending node.

    Parameters
    ----------
    n : int
        Number of nodes of the mesh.
    """
    for name, patch in patches.items():
        if patch.role not in ROLES:
            raise InvalidInput(
                f"patch {name!r}: unknown role {patch.role!r}; known are {', '.join(ROLES)}",
                code="INVALID_ARGUMENT.MESH",
                details={"patch": name, "role": str(patch.role)},
            )
        _check_nodes(n, name, np.asarray(patch.nodes))
    if not any(patch.role == "moving" for patch in patches.values()):
        raise InvalidInput(
            f"no patch has the role 'moving' (patches: {', '.join(map(repr, patches)) or 'none'})",
            code="INVALID_ARGUMENT.MESH",
            hint="give it to the patch that is displaced",
        )


def _check_nodes(n: int, name: str, nodes: NDArray[np.integer]) -> None:
    """Require a vector of distinct node indices in range, at least one."""
    if nodes.ndim != 1 or not np.issubdtype(nodes.dtype, np.integer):
        raise InvalidInput(
            f"patch {name!r}: expected node ids as a vector of integers, got shape {nodes.shape} of {nodes.dtype}",
            code="INVALID_ARGUMENT.SHAPE",
            details={"patch": name},
        )
    if not len(nodes):
        raise InvalidInput(
            f"patch {name!r} has no nodes", code="INVALID_ARGUMENT.MESH", hint="leave it out", details={"patch": name}
        )
    outside = np.flatnonzero((nodes < 0) | (nodes >= n))
    if len(outside):
        raise InvalidInput(
            f"patch {name!r}: node id {nodes[outside[0]]} is out of range, expected 0 to {n - 1}",
            code="INVALID_ARGUMENT.MESH",
            details={"patch": name, "node": int(nodes[outside[0]]), "nodes": n},
        )
    found, first, counts = np.unique(nodes, return_index=True, return_counts=True)
    if (counts > 1).any():
        repeated = int(found[counts > 1][np.argmin(first[counts > 1])])
        raise InvalidInput(
            f"patch {name!r} names node {repeated} twice",
            code="INVALID_ARGUMENT.MESH",
            details={"patch": name, "node": repeated},
        )


def patch_warnings(boundary: Integers, orphans: Integers, patches: Mapping[str, Patch], resting: Integers) -> list[str]:
    """Warnings about usable patches.

    Parameters
    ----------
    boundary : (b,) array
        Nodes on the boundary of the mesh.
    orphans : (o,) array
        Nodes in no cell, such as those between the corners of cells of second order; they are not inside the mesh.
    patches : mapping of name to Patch
        Checked by :func:`check_patches`.
    resting : (r,) array
        Result of :func:`nodes_behind_fixed`.
    """
    return [
        *_inside(np.union1d(boundary, orphans), patches),
        *_uncovered(boundary, patches, resting),
        *_shared(patches),
    ]


def nodes_behind_fixed(
    n: int, cells: CellTable, boundary: Integers, patches: Mapping[str, Patch], coincident: Integers
) -> Integers:
    """Boundary nodes (r,) in no patch that fixed nodes separate from all other patches: mostly nodes of halo cells.

    Interpolation does not use the cells, so it would move these nodes although fixed nodes separate them. The two sides
    of an interface, ``coincident`` nodes (c, 2), are joined.
    """
    floating = nodes_in_no_patch(boundary, patches)
    if not len(floating):
        return floating
    fixed, other = np.zeros((2, n), dtype=bool)
    for patch in patches.values():
        (fixed if patch.role == "fixed" else other)[patch.nodes] = True
    fixed &= ~other
    part = _parts(n, cells, ~fixed, coincident)
    meets = np.zeros(part.max() + 1, dtype=bool)  # whether each part touches a fixed node
    for block in cells:
        rows = block.nodes[fixed[block.nodes].any(axis=1)]
        meets[part[rows[~fixed[rows]]]] = True
    meets[part[other]] = False
    return floating[meets[part[floating]]]


def _parts(n: int, cells: CellTable, joined: Marks, coincident: Integers) -> Integers:
    """(n,) number of the part of the mesh of each node, if only ``joined`` (n,) nodes connect cells."""
    pairs = [coincident[joined[coincident].all(axis=1)].T]
    for block in cells:
        for a, b in combinations(block.nodes.T, 2):
            both = joined[a] & joined[b]
            pairs.append(np.stack([a[both], b[both]]))
    ends = np.concatenate(pairs, axis=1)
    return connected(n, *ends)


def _inside(usual: Integers, patches: Mapping[str, Patch]) -> list[str]:
    """A warning about patch nodes that are not among the usual ones: they are inside the mesh."""
    found = []
    for name, patch in patches.items():
        inside = np.setdiff1d(patch.nodes, usual)
        if len(inside):
            found.append(
                f"patch {name!r}: {_nodes(len(inside))} not on the boundary of the mesh, the first is node {inside[0]}"
            )
    return found


def _uncovered(boundary: Integers, patches: Mapping[str, Patch], resting: Integers) -> list[str]:
    """A warning about boundary nodes in no patch, and how they move."""
    fates = {
        "nothing holds them: they follow the interpolation like interior nodes": np.setdiff1d(
            nodes_in_no_patch(boundary, patches), resting
        ),
        "they lie behind fixed nodes and stay where they are": resting,
    }
    return [
        f"{len(nodes)} boundary node{'s are' if len(nodes) > 1 else ' is'} in no patch, the first is node "
        f"{nodes[0]}; {fate}"
        for fate, nodes in fates.items()
        if len(nodes)
    ]


def nodes_in_no_patch(boundary: Integers, patches: Mapping[str, Patch]) -> Integers:
    """Boundary nodes (f,) in no patch."""
    return np.setdiff1d(boundary, np.concatenate([patch.nodes for patch in patches.values()]))


def _shared(patches: Mapping[str, Patch]) -> list[str]:
    """A warning about nodes on both a moving and a fixed patch."""
    moving = [(name, patch) for name, patch in patches.items() if patch.role == "moving"]
    fixed = [(name, patch) for name, patch in patches.items() if patch.role == "fixed"]
    found = []
    for name, patch in moving:
        for other, held in fixed:
            common = np.intersect1d(patch.nodes, held.nodes)
            if len(common):
                found.append(
                    f"patches {name!r} (moving) and {other!r} (fixed) share {len(common)} "
                    f"node{'s' if len(common) > 1 else ''}, the first is node {common[0]}; moving wins"
                )
    return found


def _nodes(count: int) -> str:
    return f"{count} nodes are" if count > 1 else "1 node is"
