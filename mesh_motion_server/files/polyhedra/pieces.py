"""Divide polyhedra into pieces, as the motion solver for OpenFOAM does (adapters/openfoam).

A polyhedron is divided around a node at its centre: one tetrahedron for each triangle, one pyramid for each
quadrilateral. A face with more points gets a node in its middle, and there is a tetrahedron for each of its edges. The
same is done with a quadrilateral that has a corner which the centre does not see: snappyHexMesh makes such faces when
it snaps a cell to an edge. The cell on the other side of such a face is divided in the same way, even if it is a
hexahedron, so that the cells fit. A simple cell with an inverted corner is also divided. The mesh's own points keep
their numbers; middles and centres follow.
"""

from dataclasses import dataclass

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.mesh.cells import CELL_TYPES
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.files.polyhedra.cells import FoundCells
from mesh_motion_server.files.polyhedra.face_mesh import FaceMesh, corner_normals

_QUAD = 4  # points of a quadrilateral
#: Depths of an inner point below a cell's faces that are tried, in sizes of the cell; number of steps for each; their
#: length.
_DEPTHS = 0.1 * 0.5 ** np.arange(10.0)
_STEPS, _BEYOND = 200, 1.9
_ROUNDING = 1e-12  # a determinant of at most this share of the cell's largest may be 0


@dataclass(frozen=True, eq=False)
class Pieces:
    """A mesh of simple cells."""

    points: Floats  # (n, 3). First the points of the mesh, then the middles of faces, then the centres of cells
    cells: dict[str, Integers]  # (m, k) each. For each type, first the cells of the mesh, then the pieces
    middles: Integers  # (f,). The node in the middle of each face, or -1

    def facets(self, mesh: FaceMesh, faces: Integers) -> dict[str, Integers]:
        """{type: (m, k)} the facets into which these faces are divided."""
        split = self.middles[faces] >= 0
        whole = np.where(split, 0, mesh.sizes[faces])
        found = {name: mesh.short[faces[whole == k], :k] for name, k in (("triangle", 3), ("quad", _QUAD))}
        edges, rows = mesh.edges(faces[split])
        fans = np.column_stack([edges, self.middles[faces[split][rows]]])
        found["triangle"] = np.concatenate([found["triangle"], fans])
        return {name: nodes for name, nodes in found.items() if len(nodes)}


def divide(mesh: FaceMesh, found: FoundCells) -> Pieces:
    """Divide the polyhedra, and also simple cells if their shape or a neighbouring polyhedron requires it.

    Raises InvalidInput if no point of a cell sees all its faces: a piece would be inverted.
    """
    new = np.union1d(found.others, _crossed(mesh, found))
    centres = mesh.volumes_and_centres()[1] if len(new) else mesh.points
    split, (divided, bent) = mesh.sizes > _QUAD, np.zeros((2, mesh.n_cells), dtype=bool)
    while len(new):
        divided[new] = True
        hidden, hiding = _hidden(mesh, new, centres)
        split[hidden] = bent[hiding] = True
        adjacent = np.concatenate([mesh.owner[hidden], mesh.neighbour[hidden[hidden < mesh.n_inner]]])
        new = np.unique(adjacent[~divided[adjacent]])
    for cell in np.flatnonzero(bent):
        centres[cell] = _seeing_all(mesh, int(cell), centres[cell])
    long, others = np.flatnonzero(split), np.flatnonzero(divided)
    middles = np.full(mesh.n_faces, -1, dtype=np.int64)
    middles[long] = len(mesh.points) + np.arange(len(long))
    centre = np.full(mesh.n_cells, -1, dtype=np.int64)
    centre[others] = len(mesh.points) + len(long) + np.arange(len(others))
    points = np.concatenate([mesh.points, mesh.middles(long), centres[others]]) if len(others) else mesh.points
    pieces = _pieces(mesh, *mesh.faces_of(others), middles, centre)
    whole = {name: nodes[~divided[found.numbers[name]]] for name, nodes in found.nodes.items()}
    return Pieces(points, _joined(whole, pieces), middles)


@np.errstate(all="ignore")
def _crossed(mesh: FaceMesh, found: FoundCells) -> Integers:
    """Numbers of the simple cells with an inverted corner."""
    crossed = [np.empty(0, dtype=np.int64)]
    for name, nodes in found.nodes.items():
        corners = mesh.points[nodes[:, CELL_TYPES[name].corner_array]]
        determinants = np.linalg.det(corners[..., 1:, :] - corners[..., :1, :])
        crossed.append(found.numbers[name][_nonpositive(determinants)])
    return np.concatenate(crossed)


def _nonpositive(determinants: Floats) -> Marks:
    """Whether one of the determinants (m, k) of a cell is not positive, up to rounding."""
    least: Marks = determinants.min(axis=1) <= _ROUNDING * np.abs(determinants).max(axis=1)
    return least


@np.errstate(all="ignore")
def _hidden(mesh: FaceMesh, cells: Integers, centres: Floats) -> tuple[Integers, Integers]:
    """The quadrilaterals of these cells to be split, and the cells whose centre does not see all triangles.

    A quadrilateral is split if a corner is not seen. If a triangle is not seen (a face or a part of a split face), all
    quadrilaterals of the cell are split: then for another point only triangles must be tested.
    """
    faces, own = mesh.faces_of(cells)
    quads = np.flatnonzero(mesh.sizes[faces] == _QUAD)
    corners = mesh.points[mesh.short[faces[quads]]]
    heights = np.einsum("ijk,ijk->ij", corner_normals(corners), centres[own[quads], None] - corners)
    heights[mesh.owner[faces[quads]] == own[quads]] *= -1.0
    hidden = quads[_nonpositive(heights)]
    fans = np.concatenate([np.flatnonzero(mesh.sizes[faces] != _QUAD), hidden])
    normals, corners, rows = _fan_planes(mesh, faces[fans], own[fans])
    unseen = np.einsum("ij,ij->i", normals, centres[own[fans[rows]]] - corners) <= 0.0
    hiding = np.unique(own[fans[rows[unseen]]])
    return np.unique(faces[np.concatenate([hidden, quads[np.isin(own[quads], hiding)]])]), hiding


def _fan_planes(mesh: FaceMesh, faces: Integers, cells: Integers) -> tuple[Floats, Floats, Integers]:
    """Triangles from the edges of faces to their middles: inward normals, corners, and rows of the faces."""
    edges, rows = mesh.edges(faces)
    middles = mesh.middles(faces)
    corners = mesh.points[edges[:, 0]]
    normals = np.cross(mesh.points[edges[:, 1]] - corners, middles[rows] - corners)
    normals[(mesh.owner[faces] == cells)[rows]] *= -1.0
    return normals, corners, rows


@np.errstate(all="ignore")
def _seeing_all(mesh: FaceMesh, cell: int, centre: Floats) -> Floats:
    """A point of a cell that is inside the triangles of all its faces, and deep inside if possible.

    From the centre, each step crosses the plane of which the point is farthest outside: the relaxation method of
    Motzkin and Schoenberg (Canadian Journal of Mathematics 6, 1954), as in the motion solver for OpenFOAM. Raises
    InvalidInput if no such point is found: each point of the cell misses a part of its faces.
    """
    faces, own = mesh.faces_of(np.array([cell]))
    normals, corners, rows = _fan_planes(mesh, faces, own)
    normals = normals / np.linalg.norm(normals, axis=1)[:, None]
    size = np.linalg.norm(np.ptp(corners, axis=0))
    for depth in size * _DEPTHS:
        point = centre
        for _ in range(_STEPS):
            heights = np.einsum("ij,ij->i", normals, point - corners)
            worst = int(np.argmin(heights))
            if heights[worst] >= depth:
                return point
            point = point + _BEYOND * (depth - heights[worst]) * normals[worst]
    at, face = ", ".join(f"{value:.6g}" for value in centre), int(faces[rows[worst]])
    raise InvalidInput(
        f"{mesh.path}: cell {cell} at ({at}) cannot be judged: no point in it sees all its faces, as face {face}",
        hint="a cell that is no valid hexahedron, prism, pyramid or tetrahedron is divided about such a point",
        code="INVALID_ARGUMENT.MESH",
        details={"cell": cell, "face": face},
    )


def _pieces(
    mesh: FaceMesh, faces: Integers, cells: Integers, middles: Integers, centre: Integers
) -> dict[str, Integers]:
    """{type: (m, k) nodes of the pieces}, bases anticlockwise from the centre."""
    own, split = mesh.owner[faces] == cells, middles[faces] >= 0
    found = {}
    for name, size in (("tetra", 3), ("pyramid", _QUAD)):
        rows = np.flatnonzero((mesh.sizes[faces] == size) & ~split)
        base = mesh.short[faces[rows], :size]
        base = np.where(own[rows, None], base[:, ::-1], base)
        found[name] = np.column_stack([base, centre[cells[rows]]])
    fans, own, cells = faces[split], own[split], cells[split]
    edges, rows = mesh.edges(fans)
    edges = np.where(own[rows, None], edges[:, ::-1], edges)
    found["tetra"] = np.concatenate(
        [found["tetra"], np.column_stack([edges, middles[fans[rows]], centre[cells[rows]]])]
    )
    return found


def _joined(first: dict[str, Integers], second: dict[str, Integers]) -> dict[str, Integers]:
    """{type: nodes} of both; empty types are left out."""
    both = {name: np.concatenate([part[name] for part in (first, second) if name in part]) for name in first | second}
    return {name: nodes for name, nodes in both.items() if len(nodes)}
