"""Divide polyhedra into pieces, as the motion solver for OpenFOAM does (adapters/openfoam).

A polyhedron is divided around a node at its centre: one tetrahedron for each triangle, one pyramid for each
quadrilateral, and for a face with more points tetrahedra around a node in the middle of the face. The neighbour of such
a face is also a polyhedron and is divided in the same way, so the cells fit. The mesh's own points keep their numbers;
middles and centres follow.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.files.mesh_file import FloatArray, IntArray
from mesh_motion_server.files.polyhedra.cells import FoundCells
from mesh_motion_server.files.polyhedra.face_mesh import FaceMesh

__all__ = ["Pieces", "divide"]


@dataclass(frozen=True, eq=False)
class Pieces:
    """A mesh of simple cells.

    Attributes
    ----------
    points : (n, 3) array
        First the points of the mesh, then the middles of faces, then the centres of cells.
    cells : dict of str to (m, k) arrays
        For each type, first the cells of the mesh, then the pieces.
    middles : (f,) array
        The node in the middle of each face, or -1.
    """

    points: FloatArray
    cells: dict[str, IntArray]
    middles: IntArray

    def facets(self, mesh: FaceMesh, faces: IntArray) -> dict[str, IntArray]:
        """{type: (m, k)} the facets that these faces are divided into."""
        found = {name: mesh.short[faces[mesh.sizes[faces] == k], :k] for name, k in (("triangle", 3), ("quad", 4))}
        fans = [_fan(mesh.face(int(face)), self.middles[face]) for face in faces[mesh.sizes[faces] > 4]]
        found["triangle"] = np.concatenate([found["triangle"], *fans])
        return {name: nodes for name, nodes in found.items() if len(nodes)}


def divide(mesh: FaceMesh, found: FoundCells) -> Pieces:
    """Divide the polyhedra.

    Raises
    ------
    InvalidInput
        If part of a face is not visible from the centre of its cell: a piece would be inverted.
    """
    middles = np.full(mesh.n_faces, -1, dtype=np.int64)
    cells = np.repeat(found.others, np.diff(mesh.cell_starts)[found.others])  # the cell of each face
    spans = [mesh.cell_faces[mesh.cell_starts[c] : mesh.cell_starts[c + 1]] for c in found.others]
    faces = np.concatenate(spans) if spans else np.empty(0, dtype=np.int64)
    long = np.unique(faces[mesh.sizes[faces] > 4])
    middles[long] = len(mesh.points) + np.arange(len(long))
    centre = np.full(mesh.n_cells, -1, dtype=np.int64)
    centre[found.others] = len(mesh.points) + len(long) + np.arange(len(found.others))
    points = mesh.points
    if len(found.others):
        centres = mesh.volumes_and_centres()[1][found.others]
        points = np.concatenate([points, mesh.means(long), centres])
    pieces = _pieces(mesh, faces, cells, middles, centre)
    _check_seen(mesh, points, pieces)
    return Pieces(points, _joined(found.nodes, {name: nodes for name, (nodes, _) in pieces.items()}), middles)


def _pieces(
    mesh: FaceMesh, faces: IntArray, cells: IntArray, middles: IntArray, centre: IntArray
) -> dict[str, tuple[IntArray, IntArray]]:
    """{type: (m, k) nodes of the pieces, (m, 2) face and cell of each}, bases anticlockwise from the centre."""
    own = mesh.owner[faces] == cells
    found = {}
    for name, size in (("tetra", 3), ("pyramid", 4)):
        rows = np.flatnonzero(mesh.sizes[faces] == size)
        base = mesh.short[faces[rows], :size]
        base = np.where(own[rows, None], base[:, ::-1], base)
        found[name] = np.column_stack([base, centre[cells[rows]]]), rows
    tetras, owners = [found["tetra"][0]], [found["tetra"][1]]
    for row in np.flatnonzero(mesh.sizes[faces] > 4):
        nodes = mesh.face(int(faces[row]))
        fan = _fan(nodes[::-1] if own[row] else nodes, middles[faces[row]])
        tetras.append(np.column_stack([fan, np.full(len(fan), centre[cells[row]])]))
        owners.append(np.full(len(fan), row))
    found["tetra"] = np.concatenate(tetras), np.concatenate(owners)
    return {name: (nodes, np.column_stack([faces[rows], cells[rows]])) for name, (nodes, rows) in found.items()}


@np.errstate(all="ignore")
def _check_seen(mesh: FaceMesh, points: FloatArray, pieces: Mapping[str, tuple[IntArray, IntArray]]) -> None:
    """Check that, at each corner of each base, the centre is on the inner side."""
    for nodes, rows in pieces.values():
        corners, tip = points[nodes[:, :-1]], points[nodes[:, -1]]
        first, second = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
        normals = np.cross(first, second)
        wrong = (np.einsum("ijk,ijk->ij", normals, tip[:, None] - corners) <= 0).any(axis=1)
        if wrong.any():
            face, cell = (int(v) for v in rows[np.argmax(wrong)])
            at = ", ".join(f"{value:.6g}" for value in tip[np.argmax(wrong)])
            raise InvalidInput(
                f"{mesh.path}: polyhedral cell {cell} at ({at}) cannot be judged: its face {face} is not seen as a "
                "whole from the cell's centre",
                hint="a cell that is no hexahedron, prism, pyramid or tetrahedron is divided about its centre",
                code="INVALID_ARGUMENT.MESH",
                details={"cell": cell, "face": face},
            )


def _fan(nodes: IntArray, middle: np.int64) -> IntArray:
    """(k, 3) triangles from each edge of a face to its middle."""
    return np.column_stack([nodes, np.roll(nodes, -1), np.full(len(nodes), middle)])


def _joined(first: dict[str, IntArray], second: dict[str, IntArray]) -> dict[str, IntArray]:
    """{type: nodes} of both; empty types are left out."""
    both = {name: np.concatenate([part[name] for part in (first, second) if name in part]) for name in first | second}
    return {name: nodes for name, nodes in both.items() if len(nodes)}
