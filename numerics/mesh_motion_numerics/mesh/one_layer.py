"""A plane problem in three dimensions: one layer of hexahedra and wedges between two parallel planes.

Solvers without cells in the plane (code_saturne, Fluent, CalculiX, OpenFOAM) have such meshes. The faces on one of the
planes are the cells of the 2D problem; each node of the other plane belongs to the node with which it shares an edge.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.mesh.boundary_facets import boundary_facets
from mesh_motion_numerics.mesh.cells import CELL_TYPES, CellBlock, CellTable
from mesh_motion_numerics.mesh.local_facets import LOCAL_FACETS
from mesh_motion_numerics.mesh.points import marks_at
from mesh_motion_numerics.mesh.roles import SLIDING_ROLES, Patch
from mesh_motion_numerics.mesh.smooth_pieces import area_vectors, widened

#: The face in the plane, for each type of 3D cell.
_FACES = {"hexahedron": "quad", "wedge": "triangle"}
#: Nodes are this close to their plane and their partner's place, as a share of the layer's height and of the extent.
_FLAT, _OPPOSITE = 1e-4, 1e-9


@dataclass(frozen=True, eq=False)
class OneLayer:
    """The plane of a mesh of one layer."""

    #: (2, 3). Orthonormal directions of the plane; the second is to the left of the first, seen from the front.
    axes: Floats
    #: (n,). The front node of each node: a front node itself; for a back node, the node with which it shares an edge.
    front: Integers
    cells: CellTable  # triangles and quads of front nodes, numbered like the 3D cells
    #: Front nodes of each patch; for a patch on the two planes, the nodes on its sides that no other patch has.
    patches: dict[str, Patch]

    @classmethod
    def find(cls, points: Floats, cells: CellTable, patches: Mapping[str, Patch]) -> OneLayer | None:
        """Find the plane of a mesh; None if it is not one layer between planes that slide, or are both fixed.

        With fixed planes only nodes of the moving patches could move.

        Parameters
        ----------
        points : (n, 3) array, mesh length unit
        cells : CellTable
            In one orientation.
        patches : mapping of name to Patch
            Checked patches. The patches of the planes may leave out nodes of the sides that other patches have.
        """
        if not {block.type.name for block in cells} <= set(_FACES):
            return None
        if len(np.unique(np.concatenate([*(patch.nodes for patch in patches.values()), [-1]]))) <= len(points):
            return None  # a node is inside
        for roles, normal in product((SLIDING_ROLES, ("fixed",)), _normals(points, cells)):
            heights = points @ normal
            low, high = float(heights.min()), float(heights.max())
            in_front = heights > 0.5 * (low + high)
            flat = np.abs(heights - np.where(in_front, high, low)).max() <= _FLAT * (high - low)
            faces = _faces(cells, in_front) if flat else None
            if faces is None:
                continue
            planes = _plane_patches(cells, patches, in_front, roles)
            layer = cls._of(points, _axes(normal), faces, _partners(cells, in_front), patches, planes)
            if layer is not None:
                return layer
        return None

    @classmethod
    def _of(
        cls,
        points: Floats,
        axes: Floats,
        faces: CellTable,
        front: Integers | None,
        patches: Mapping[str, Patch],
        planes: dict[str, Integers] | None,
    ) -> OneLayer | None:
        """Make the plane with these faces, if its nodes are opposite each other and its two ``planes`` are complete."""
        if front is None:
            return None
        apart = np.abs((points - points[front]) @ axes.T).max()
        if apart > _OPPOSITE * np.ptp(points, axis=0).max() or planes is None:
            return None
        own = {
            name: Patch(patch.role, np.unique(front[planes.get(name, patch.nodes)])) for name, patch in patches.items()
        }
        own = {name: patch for name, patch in own.items() if len(patch.nodes)}
        return cls(axes, front, faces, own)

    def project(self, points: Floats) -> Floats:
        """(n, 2) coordinates in the plane of points (n, 3)."""
        return np.column_stack([_along(points, axis) for axis in self.axes])

    def moved(self, points: Floats, before: Floats, after: Floats) -> Floats:
        """``points`` (n, 3) plus the displacement of the front nodes from ``before`` to ``after`` (n, 2)."""
        moved = points.copy()
        for column, axis in enumerate(self.axes):
            if np.count_nonzero(axis) == 1:
                along = int(np.argmax(axis))
                in_place = points[:, along] == before[:, column]  # bitwise equal to the plane's own
                stepped = points[:, along] + (after - before)[:, column]
                moved[:, along] = np.where(in_place, after[:, column], stepped)
            else:
                moved += np.outer((after - before)[:, column], axis)
        return moved


def _normals(points: Floats, cells: CellTable) -> Iterator[Floats]:
    """Possible directions across the layer: normals of the faces of a cell that has an opposite face."""
    block = cells.blocks[-1]  # wedges come last, and have only one such direction
    facets = LOCAL_FACETS[block.type.name]
    opposite = [(0, 1)] if block.type.name == "wedge" else [(0, 1), (2, 4), (3, 5)]
    for one, other in opposite:
        corners = np.array([widened(block.nodes[:1, facets[side]].astype(np.int64), 4)[0] for side in (one, other)])
        back, front = area_vectors(points, corners)
        normal = front - back
        length = float(np.linalg.norm(normal))
        if length > 0.0:
            normal = normal / length
            axis = int(np.argmax(np.abs(normal)))
            exact = np.sign(normal[axis]) * np.eye(3)[axis]
            yield np.abs(exact) if np.abs(normal - exact).max() < _OPPOSITE else normal


def _axes(normal: Floats) -> Floats:
    """(2, 3) directions of the plane with this normal: for a coordinate plane the next two coordinates."""
    along = int(np.argmax(np.abs(normal)))
    if np.count_nonzero(normal) == 1:
        return np.eye(3)[[(along + 1) % 3, (along + 2) % 3]]
    first = np.cross(np.eye(3)[(along + 2) % 3], normal)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(normal, first)])


def _along(points: Floats, axis: Floats) -> Floats:
    """(n,) coordinates along a direction; along a coordinate axis bitwise equal to the coordinate."""
    return points[:, int(np.argmax(axis))] if np.count_nonzero(axis) == 1 else points @ axis


def _faces(cells: CellTable, in_front: Marks) -> CellTable | None:
    """The front face of each cell, in the order of the cells; None if a cell has no such face."""
    blocks = []
    for block in cells:
        kind = CELL_TYPES[_FACES[block.type.name]]
        nodes = np.full((len(block), kind.n_nodes), -1, dtype=np.int32)
        for local in LOCAL_FACETS[block.type.name]:
            if len(local) == kind.n_nodes:
                rows = in_front[block.nodes[:, local]].all(axis=1)
                nodes[rows] = block.nodes[rows][:, local]
        half = in_front[block.nodes].sum(axis=1) == kind.n_nodes
        if not half.all() or (nodes < 0).any():
            return None
        blocks.append(CellBlock(kind, nodes))
    return CellTable(tuple(blocks))


def _partners(cells: CellTable, in_front: Marks) -> Integers | None:
    """(n,) the front node of each node, by the edges across the layer; None if these do not pair the nodes."""
    pairs = []
    for block in cells:
        for local in LOCAL_FACETS[block.type.name]:
            for a, b in zip(local, (*local[1:], local[0]), strict=True):
                ends = block.nodes[:, [a, b]]
                pairs.append(ends[in_front[ends[:, 0]] & ~in_front[ends[:, 1]]])
    across = np.unique(np.concatenate(pairs), axis=0)
    front = np.arange(len(in_front))
    front[across[:, 1]] = across[:, 0]
    paired = np.unique(across[:, 0]).size == len(across) == np.unique(across[:, 1]).size
    return front if paired and 2 * len(across) == len(in_front) else None


def _plane_patches(
    cells: CellTable, patches: Mapping[str, Patch], in_front: Marks, roles: tuple[str, ...]
) -> dict[str, Integers] | None:
    """The patches with these roles that form the two planes, each with its nodes (k,) on sides of no other patch; None
    if they leave out a face of a plane.

    Such a patch has all nodes of a plane, or as many faces on the planes as on the sides; nodes that also lie on sides
    may be left to the patches of the sides. In a single row of cells the sides look like planes too, but most of their
    faces belong to other patches.
    """
    rows = np.concatenate([widened(block, 4) for block in boundary_facets(cells).values()])
    side = np.where(rows >= 0, in_front[rows], in_front[rows[:, :1]])
    flat = (side == side[:, :1]).all(axis=1)
    rim = marks_at(len(in_front) + 1, rows[~flat])
    found: dict[str, Marks] = {}
    covered, taken, sides = np.zeros((3, len(rows)), dtype=bool)
    for name, patch in patches.items():
        inside = marks_at(len(in_front) + 1, np.append(patch.nodes, -1))  # the last one for the -1 of a triangle
        own, wide = inside[rows].all(axis=1), inside | (rim & (inside & ~rim)[:-1].any())
        whole = wide[:-1][in_front].all() or wide[:-1][~in_front].all()
        if patch.role not in roles:
            taken |= own & flat
        elif whole or (own & flat).sum() > (own & ~flat).sum():
            covered |= wide[rows].all(axis=1)
            found[name] = own & ~flat
            continue
        sides |= own
    if not covered[flat].all() or 2 * taken.sum() >= flat.sum():
        return None
    return {name: np.setdiff1d(rows[own & ~sides], [-1]) for name, own in found.items()}
