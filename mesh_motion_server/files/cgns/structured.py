"""Structured zones of CGNS, one or several: each is a block of hexahedra or quadrilaterals; all blocks become one mesh.

Nodes that ``GridConnectivity1to1_t`` pairs become one node, except periodic pairs. In a file with several zones but
without such connections, for example with blocks that another program split, nodes of two zones at one place become one
node.

https://cgns.github.io/CGNS_docs_current/sids/cnct.html
"""

from collections import defaultdict
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers

from mesh_motion_server.files.cgns.conditions import patch_name
from mesh_motion_server.files.cgns.tree import Node
from mesh_motion_server.files.mesh_file import MeshFile, assemble, concatenated
from mesh_motion_server.files.vtk.grid import structured_cells
from mesh_motion_server.files.vtk.pieces import PatchKey, VtkPiece, joined, renumbered

_NAMES = {3: "line", 9: "quad", 12: "hexahedron"}


@dataclass(frozen=True, eq=False)
class _Block:
    """A zone: its counts of nodes in each direction, and its nodes' coordinates, the first direction fastest."""

    node: Node
    counts: tuple[int, ...]
    points: Floats

    def nodes(self, low: Integers, high: Integers) -> Integers:
        """Nodes of the indices from ``low`` to ``high``, counted from 1, the first direction fastest."""
        limits = np.stack([low, high])
        if (limits.min(axis=0) < 1).any() or (limits.max(axis=0) > self.counts).any():
            raise self.node.refused(f"it names nodes {low.tolist()} to {high.tolist()} of {list(self.counts)}")
        return self.number(_indices(low, high))

    def number(self, indices: Integers) -> Integers:
        """Nodes (k,) of indices (..., dimensions), counted from 1."""
        strides = np.cumprod([1, *self.counts[:-1]])
        wrong = (indices < 1) | (indices > np.array(self.counts))
        if wrong.any():
            raise self.node.refused(f"it names node {indices[wrong.any(axis=-1)][0].tolist()} of {list(self.counts)}")
        found: Integers = ((indices - 1) @ strides).ravel()
        return found


def _blocks(zones: list[Node], points: list[Floats]) -> list[_Block]:
    found = []
    for zone, of in zip(zones, points, strict=True):
        sizes = zone.integers()
        counts = tuple(sizes[: len(sizes) // 3].tolist())
        if len(sizes) % 3 or np.prod(counts, dtype=np.int64) != len(of):
            raise zone.refused(f"{len(of)} nodes, but the sizes {sizes.tolist()}")
        found.append(_Block(zone, counts, of))
    return found


def read_structured(path: Path, base: Node, zones: list[Node], points: list[Floats]) -> MeshFile:
    """The mesh of all zones; ``points`` (n, d) are the coordinates of each.

    Raises InvalidInput for conditions and connections that name missing items.
    """
    pieces = []
    for block in _blocks(zones, points):
        code, nodes = structured_cells(block.counts)
        patches: dict[PatchKey, list[Integers]] = defaultdict(list)
        for group in block.node.children("ZoneBC_t"):
            for condition in group.children("BC_t"):
                patches[0, patch_name(base, condition)].append(_listed(block, condition))
        pieces.append(VtkPiece(block.points, {_NAMES[code]: nodes}, concatenated(patches)))
    number, notes = numbering(path, zones, points)
    whole = np.empty((int(number.max()) + 1, points[0].shape[1]))
    whole[number[::-1]] = np.concatenate(points)[::-1]  # of several nodes the first one counts
    one = renumbered(pieces, number, whole)
    mesh = assemble(path, whole, one.cells, {str(name): nodes for (_, name), nodes in one.patches.items()})
    return replace(mesh, notes=(*mesh.notes, *notes))


def _listed(block: _Block, condition: Node) -> Integers:
    """The nodes of a boundary condition, of nodes or of faces."""
    place = condition.child("GridLocation")
    of_faces = place is not None and place.text() not in ("", "Vertex")
    size = len(block.counts)
    if (node := condition.child("PointRange") or condition.child("ElementRange")) is not None:
        low, high = _ends(condition, node.integers(), size)
        if of_faces:  # a face has the nodes up to the next index, except in the direction across the side
            letter = place.text()[:1] if place is not None else ""
            across = "IJK".find(letter) if letter in "IJK" else int(np.argmax(low == high))
            high = high + (np.arange(size) != across)
        return block.nodes(low, high)
    if (node := condition.child("PointList")) is None or of_faces:
        raise condition.refused("neither a PointRange nor a PointList of nodes")
    return block.number(node.integers().reshape(-1, size))


def _indices(low: Integers, high: Integers) -> Integers:
    """(..., dimensions) all indices from ``low`` to ``high``; either may be the larger one."""
    axes = [np.arange(a, b + (1 if b >= a else -1), 1 if b >= a else -1) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


def _ends(node: Node, values: Integers, size: int) -> tuple[Integers, Integers]:
    """The first and the last index of a range."""
    if len(values) != 2 * size:
        raise node.refused(f"a range of {len(values)} numbers, expected {2 * size}")
    return values[:size], values[size:]


def numbering(path: Path, zones: list[Node], points: list[Floats]) -> tuple[Integers, list[str]]:
    """The mesh's node (n,) of each node of all zones, one zone after the other, and notes."""
    blocks = _blocks(zones, points)
    starts = np.cumsum([0, *map(len, points)])
    by_name = {zone.name.replace(" ", "_"): place for place, zone in enumerate(zones)}  # Gmsh takes either for a donor
    pairs, n_periodic, connected = [np.empty((0, 2), np.int64)], 0, False
    missing: list[str] = []
    for place, block in enumerate(blocks):
        for group in block.node.children("ZoneGridConnectivity_t"):
            for link in group.children("GridConnectivity1to1_t"):
                donor = by_name.get(link.text().split("/")[-1].replace(" ", "_"))
                connected = True
                if any(of.children("Periodic_t") for of in link.children("GridConnectivityProperty_t")):
                    n_periodic += 1
                elif donor is not None:
                    own, other = _paired(link, block, blocks[donor])
                    pairs.append(np.column_stack([starts[place] + own, starts[donor] + other]))
                else:
                    missing.append(f"the connection {link.name!r} is a boundary: no zone {link.text()!r} is read")
    if len(zones) > 1 and not connected:
        listed = [
            VtkPiece(np.pad(of, ((0, 0), (0, 3 - of.shape[1]))), {}, {(0, ""): np.arange(len(of))}) for of in points
        ]
        whole, notes = joined(path, listed)
        return whole.patches[0, ""], notes
    number = _united(np.concatenate(pairs), int(starts[-1]))
    notes = [f"{len(zones)} zones were joined; {len(number) - int(number.max()) - 1} nodes were in several of them"]
    periodic = [f"{n_periodic} connections are periodic: give their patches the role periodic"]
    return number, notes * (len(zones) > 1) + periodic * (n_periodic > 0) + missing


def _paired(link: Node, block: _Block, donor: _Block) -> tuple[Integers, Integers]:
    """Nodes of a zone and the same nodes in its neighbour; SIDS, section 8.2: the transform's columns are +/- axes."""
    size = len(block.counts)
    children = [link.child(name) for name in ("PointRange", "PointRangeDonor", "Transform")]
    if any(child is None for child in children[:2]):
        raise link.refused("it has no PointRange or no PointRangeDonor")
    (low, high), (donor_low, _) = (_ends(link, child.integers(), size) for child in children[:2] if child is not None)
    turn = children[2].integers() if children[2] is not None else np.arange(1, size + 1)
    if sorted(np.abs(turn).tolist()) != list(range(1, size + 1)):
        raise link.refused(f"a transform of {turn.tolist()}")
    indices = _indices(low, high)
    matrix = np.zeros((size, size), dtype=np.int64)
    matrix[np.abs(turn) - 1, np.arange(size)] = np.sign(turn)
    return block.number(indices), donor.number((indices - low) @ matrix.T + donor_low)


def _united(pairs: Integers, count: int) -> Integers:
    """(count,) a number for each set of nodes that pairs connect, in the order of their first nodes."""
    from scipy.sparse import coo_matrix  # noqa: PLC0415 - a quarter of a second
    from scipy.sparse.csgraph import connected_components  # noqa: PLC0415

    graph = coo_matrix((np.ones(len(pairs), bool), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    _, label = connected_components(graph, directed=False)
    _, first, inverse = np.unique(label, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    found: Integers = rank[inverse]
    return found
