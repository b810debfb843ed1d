"""Two-dimensional meshes of OpenFOAM: one layer of cells between empty or wedge patches becomes a 2D mesh.

As in the motion solver for OpenFOAM (adapters/openfoam): the points of the plane with the larger coordinate are the
nodes, and its faces are the cells. A point of the other plane belongs to the node with which it shares an edge. A point
of both planes, on the axis of an axisymmetric mesh, is a node of the patch with the name of the first wedge patch. A
face of more than four points becomes triangles around a node in its middle.
"""

from dataclasses import dataclass

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.files.polyhedra.face_mesh import FaceMesh, FacePatch

#: A component of the empty patches' normals up to this value counts as zero, as in OpenFOAM.
_NO_COMPONENT = 1e-6


@dataclass(frozen=True, eq=False)
class Plane:
    """A 2D mesh."""

    points: Floats  # (n, 2). First the nodes that are points of the mesh, then the middles of its faces
    cells: dict[str, Integers]  # (m, k) each
    node_of: Integers  # (p,). The node of each point of the mesh
    axis: Integers  # (a,). Nodes on the axis of an axisymmetric mesh

    def edges(self, mesh: FaceMesh, patch: FacePatch) -> Integers:
        """(m, 2) the edges in the plane that represent the faces of a patch."""
        short = mesh.short[mesh.boundary_faces(patch)]
        nodes = np.sort(np.where(short >= 0, self.node_of[short], -1), axis=1)
        ends = np.column_stack([np.where(nodes[:, 0] < 0, nodes[:, 1], nodes[:, 0]), nodes[:, 3]])  # three at the axis
        return np.unique(ends[ends[:, 0] >= 0], axis=0)


@np.errstate(all="ignore")
def plane_axes(mesh: FaceMesh) -> tuple[int, ...]:
    """The coordinates in which points may move: (0, 1, 2), or the two coordinates of a plane.

    Raises InvalidInput for meshes of one dimension, and for wedge patches that are not one on each side of a coordinate
    plane.
    """
    wedges = [patch for patch in mesh.patches if patch.kind == "wedge"]
    areas = np.zeros(3)
    for patch in wedges:
        own = mesh.areas_and_centres[0][mesh.boundary_faces(patch)].sum(axis=0)
        areas += np.sign(own[np.argmax(np.abs(own))]) * own  # the common nodes of the two sides are at their middle
    if wedges and (len(wedges) != 2 or np.count_nonzero(np.abs(areas) > _NO_COMPONENT * np.abs(areas).max()) != 1):
        raise InvalidInput(
            f"{mesh.path}: patch {wedges[0].name!r} is of type wedge: there must be two such patches, one on each side "
            f"of a coordinate plane, got {', '.join(repr(patch.name) for patch in wedges)}",
            hint="turn the mesh about its axis, or give all faces of a side to one wedge patch",
        )
    areas = np.abs(areas)
    for patch in mesh.patches:
        if patch.kind == "empty":
            areas += np.abs(mesh.areas_and_centres[0][mesh.boundary_faces(patch)]).sum(axis=0)
    total = float(np.linalg.norm(areas))
    axes = tuple(int(a) for a in range(3) if total == 0.0 or areas[a] / total <= _NO_COMPONENT)
    if len(axes) < 2:
        raise InvalidInput(
            f"{mesh.path}: the empty patches leave {len(axes)} dimension(s); a mesh must have two or three",
            hint="empty patches must lie in planes normal to one coordinate",
        )
    return axes


def project(mesh: FaceMesh, axes: tuple[int, ...]) -> Plane:
    """Project the layer of cells onto a 2D mesh in the plane of two axes.

    Raises InvalidInput if the mesh is not one layer of cells with every point on one of its two sides.
    """
    (thin,) = {0, 1, 2} - set(axes)
    kinds = [mesh.boundary_faces(patch) for patch in mesh.patches if patch.kind in ("empty", "wedge")]
    faces = np.concatenate(kinds)
    is_front = mesh.areas_and_centres[0][faces, thin] > 0
    in_front, behind = (_points_of(mesh, side) for side in (faces[is_front], faces[~is_front]))
    on_axis, faces = in_front & behind, faces[is_front]
    node_of = np.full(len(mesh.points), -1, dtype=np.int64)
    front = np.flatnonzero(in_front)
    node_of[front] = np.arange(len(front))
    pairs = _edges_across(mesh, in_front & ~on_axis, behind & ~on_axis)
    node_of[pairs[:, 1]] = node_of[pairs[:, 0]]
    if len(faces) != mesh.n_cells or len(pairs) + on_axis.sum() != len(front) or (node_of < 0).any():
        raise InvalidInput(
            f"{mesh.path}: a 2D mesh must have one layer of cells between its empty or wedge patches, with every "
            f"point on either; got {len(faces)} of their faces on one side of {mesh.n_cells} cells, and "
            f"{len(pairs)} edges across it for {len(mesh.points)} points"
        )
    long = faces[mesh.sizes[faces] > 4]
    points = np.concatenate([mesh.points[front], mesh.middles(long)])[:, list(axes)]
    flip = axes[1] - axes[0] == 2  # anticlockwise about y is clockwise in (x, z)
    cells = _polygons(mesh, faces, long, node_of, len(front), flip)
    return Plane(np.ascontiguousarray(points), cells, node_of, node_of[on_axis])


def _points_of(mesh: FaceMesh, faces: Integers) -> Marks:
    """(p,) whether each point belongs to one of these faces."""
    found = np.zeros(len(mesh.points), dtype=bool)
    for face in faces:
        found[mesh.face(int(face))] = True
    return found


def _edges_across(mesh: FaceMesh, in_front: Marks, behind: Marks) -> Integers:
    """(k, 2) the front point and the back point of each edge between the planes."""
    ends = np.arange(1, len(mesh.nodes) + 1)
    ends[mesh.starts[1:] - 1] = mesh.starts[:-1]
    a, b = mesh.nodes, mesh.nodes[ends]
    across = (in_front[a] & behind[b]) | (behind[a] & in_front[b])
    a, b = a[across], b[across]
    found = np.where(in_front[a][:, None], np.column_stack([a, b]), np.column_stack([b, a]))
    return np.unique(found, axis=0)


def _polygons(
    mesh: FaceMesh, faces: Integers, long: Integers, node_of: Integers, first: int, flip: bool
) -> dict[str, Integers]:
    """{type: (m, k)} the faces of the plane as cells."""
    cells = {}
    for name, size in (("triangle", 3), ("quad", 4)):
        nodes = node_of[mesh.short[faces[mesh.sizes[faces] == size], :size]]
        cells[name] = nodes[:, ::-1] if flip else nodes
    fans = [cells["triangle"]]
    for number, face in enumerate(long):
        nodes = node_of[mesh.face(int(face))]
        nodes = nodes[::-1] if flip else nodes
        fans.append(np.column_stack([nodes, np.roll(nodes, -1), np.full(len(nodes), first + number)]))
    cells["triangle"] = np.concatenate(fans)
    return {name: np.ascontiguousarray(nodes) for name, nodes in cells.items() if len(nodes)}
