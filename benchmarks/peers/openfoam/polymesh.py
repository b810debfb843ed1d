"""Cell tables as OpenFOAM's polyMesh: points, faces, owner, neighbour and boundary.

The rules of the format (OpenFOAM user guide, "Mesh description"):

* an inner face belongs to the neighbouring cell with the smaller label (its owner) and its normal points out of it;
* inner faces come first, ordered by owner, then by neighbour (upper triangular order);
* boundary faces follow patch by patch, with normals that point out of the domain;
* a 2D mesh is one cell thick, with its front and back faces in a patch of type ``empty``.

Only the order of the faces is free: cells and points keep their numbers, and in a 2D mesh of n nodes point n + i is the
copy of node i.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.local_facets import LOCAL_FACETS
from numpy.typing import NDArray

__all__ = ["FRONT_AND_BACK", "PolyMesh", "PolyPatch"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

FRONT_AND_BACK = "frontAndBack"
_EXTRUDED = {"triangle": "wedge", "quad": "hexahedron"}


@dataclass(frozen=True)
class PolyPatch:
    """A patch: its faces are consecutive.

    Attributes
    ----------
    name, kind : str
        ``kind`` is ``patch`` or ``empty``.
    start, count : int
        First face and number of faces.
    """

    name: str
    kind: str
    start: int
    count: int


@dataclass(frozen=True, eq=False)
class PolyMesh:
    """A polyhedral mesh by faces.

    Attributes
    ----------
    points : (p, 3) array
    faces : (F, 4) int64 array
        Point labels in order; -1 in the last column of a triangle.
    owner : (F,) int64 array
    neighbour : (f,) int64 array
        Of the inner faces, which come first.
    patches : tuple of PolyPatch
    copies : int
        How often each node of the source mesh occurs among the points: 2 for an extruded mesh.
    """

    points: Floats
    faces: Ints
    owner: Ints
    neighbour: Ints
    patches: tuple[PolyPatch, ...]
    copies: int

    @classmethod
    def from_cells(cls, points: Floats, cells: CellTable, patches: Mapping[str, Ints]) -> PolyMesh:
        """Build from points (n, d), cells and patches ``{name: (k,) node numbers}``; 2D meshes are extruded.

        Raises
        ------
        ValueError
            If a boundary face belongs to no patch.
        """
        copies = 1
        if cells.dimension == 2:
            copies = 2
            patches = {name: np.concatenate([nodes, nodes + len(points)]) for name, nodes in patches.items()}
            points, cells = _extruded(points, cells)
        faces, owners = _all_faces(cells)
        inner, neighbour, outer = _paired(faces, owners)
        groups = _patch_faces(faces[outer], len(points), patches, extruded=copies == 2)
        chosen = np.concatenate([inner, *(outer[rows] for rows in groups.values())])
        return cls(points, faces[chosen], owners[chosen], neighbour, _patches(groups, len(inner)), copies)

    def point_values(self, node_values: Floats) -> Floats:
        """(p, 3) values at the points from values (n, d) at the nodes of the source mesh."""
        values = np.zeros((len(node_values), 3))
        values[:, : node_values.shape[1]] = node_values
        return np.concatenate([values] * self.copies)

    def node_values(self, point_values: Floats) -> Floats:
        """(n, d) values at the nodes of the source mesh from values (p, 3) at the points."""
        dimension = 3 if self.copies == 1 else 2
        return np.ascontiguousarray(point_values[: len(self.points) // self.copies, :dimension])


def _extruded(points: Floats, cells: CellTable) -> tuple[Floats, CellTable]:
    """One layer of wedges and hexahedra between z = 0 and a height of about one cell."""
    n = len(points)
    height = float(np.sqrt(np.prod(np.ptp(points, axis=0)) / n))
    layers = [np.column_stack([points, np.full(n, z)]) for z in (0.0, height)]
    blocks = {_EXTRUDED[b.type.name]: np.concatenate([b.nodes, b.nodes + n], axis=1) for b in cells}
    return np.concatenate(layers), CellTable.from_arrays(blocks)


def _all_faces(cells: CellTable) -> tuple[Ints, Ints]:
    """Every face of every cell, outwards, (F', 4) padded with -1, and the cell it belongs to."""
    faces, owners = [], []
    for block, span in cells.numbered:
        for local in LOCAL_FACETS[block.type.name]:
            nodes = np.full((len(block), 4), -1, dtype=np.int64)
            nodes[:, : len(local)] = block.nodes[:, local]
            faces.append(nodes)
            owners.append(np.arange(span.start, span.stop))
    return np.concatenate(faces), np.concatenate(owners)


def _paired(faces: Ints, owners: Ints) -> tuple[Ints, Ints, Ints]:
    """Inner faces in upper triangular order, oriented as their owners' faces; their neighbours; the boundary faces."""
    keys = np.sort(faces, axis=1)
    order = np.lexsort((owners, *keys.T))
    equal = np.all(keys[order[1:]] == keys[order[:-1]], axis=1)
    inner, other = order[:-1][equal], order[1:][equal]  # the smaller cell comes first
    alone = np.ones(len(order), dtype=bool)
    alone[:-1][equal] = alone[1:][equal] = False
    rank = np.lexsort((owners[other], owners[inner]))
    outer: Ints = np.sort(order[alone])
    return inner[rank], owners[other[rank]], outer


def _patch_faces(faces: Ints, n: int, patches: Mapping[str, Ints], *, extruded: bool) -> dict[str, Ints]:
    """Rows of the boundary faces (b, 4) of each patch; a face belongs to the first patch that has all its nodes."""
    free = np.ones(len(faces), dtype=bool)
    groups = {}
    if extruded:
        upper = np.where(faces >= 0, faces >= n // 2, -1)
        flat = np.array([len(set(row) - {-1}) == 1 for row in upper.tolist()])
        groups[FRONT_AND_BACK] = np.flatnonzero(flat)
        free[flat] = False
    for name, nodes in patches.items():
        member = np.zeros(n + 1, dtype=bool)
        member[nodes] = member[-1] = True  # -1, the padding, is a member of every patch
        rows = np.flatnonzero(free & member[faces].all(axis=1))
        groups[name] = rows
        free[rows] = False
    if free.any():
        first = [int(node) for node in faces[np.argmax(free)] if node >= 0]
        raise ValueError(f"{int(free.sum())} boundary faces belong to no patch, the first has the points {first}")
    if extruded:  # after the others: patches that take part in the motion come first
        groups[FRONT_AND_BACK] = groups.pop(FRONT_AND_BACK)
    return groups


def _patches(groups: Mapping[str, Ints], first: int) -> tuple[PolyPatch, ...]:
    """Consecutive ranges of faces, from the first boundary face on."""
    starts = first + np.cumsum([0, *(len(rows) for rows in groups.values())])
    return tuple(
        PolyPatch(name, "empty" if name == FRONT_AND_BACK else "patch", int(start), len(rows))
        for (name, rows), start in zip(groups.items(), starts, strict=False)
    )
