"""Identify hexahedra, wedges, pyramids and tetrahedra in a mesh that is given by its faces.

The numbers of triangles and quadrilaterals of a cell give its candidate type. One face is its base; the nodes above are
the other ends of the edges that leave the base's nodes. The cell has the candidate type if its faces are those of
:data:`~mesh_motion_numerics.mesh.local_facets.LOCAL_FACETS`; otherwise it is a polyhedron, like all other cells.
"""

from dataclasses import dataclass

import numpy as np
from mesh_motion_numerics.arrays import Integers, Marks
from mesh_motion_numerics.mesh.cells import CELL_TYPES
from mesh_motion_numerics.mesh.local_facets import LOCAL_FACETS

from mesh_motion_server.files.polyhedra.face_mesh import FaceMesh

#: Number of triangles, number of quadrilaterals, number of points of the base.
_SHAPES = {"hexahedron": (0, 6, 4), "wedge": (2, 3, 3), "pyramid": (4, 1, 4), "tetra": (4, 0, 3)}
#: Number of cells per chunk: the comparison takes a few hundred bytes for each cell.
_CHUNK = 50_000


@dataclass(frozen=True, eq=False)
class FoundCells:
    """The types of the cells of a mesh."""

    nodes: dict[str, Integers]  # (m, k) each. Nodes of the cells of each type
    numbers: dict[str, Integers]  # (m,) each. Cell numbers in the mesh, ascending
    others: Integers  # (p,). Cell numbers of the polyhedra


def find_cells(mesh: FaceMesh) -> FoundCells:
    """Find the cells of each type."""
    faces_of = np.diff(mesh.cell_starts)
    cells = np.repeat(np.arange(mesh.n_cells), faces_of)
    sizes = mesh.sizes[mesh.cell_faces]
    triangles = np.bincount(cells[sizes == 3], minlength=mesh.n_cells)
    quads = np.bincount(cells[sizes == 4], minlength=mesh.n_cells)
    simple = np.zeros(mesh.n_cells, dtype=bool)
    nodes, numbers = {}, {}
    for name, (n_triangles, n_quads, base) in _SHAPES.items():
        fits = (triangles == n_triangles) & (quads == n_quads) & (faces_of == n_triangles + n_quads)
        candidates = np.flatnonzero(fits)
        parts = [
            _shaped(mesh, name, base, candidates[first : first + _CHUNK]) for first in range(0, len(candidates), _CHUNK)
        ]
        if not parts:
            continue
        whole = np.concatenate([good for _, good in parts])
        nodes[name] = np.concatenate([found for found, _ in parts])[whole]
        numbers[name] = candidates[whole]
        simple[numbers[name]] = True
    return FoundCells(nodes, numbers, np.flatnonzero(~simple))


def _shaped(mesh: FaceMesh, name: str, base: int, cells: Integers) -> tuple[Integers, Marks]:
    """(m, k) nodes of the cells if they had this type, and (m,) whether they have this type."""
    n_faces = len(LOCAL_FACETS[name])
    faces = mesh.cell_faces[mesh.cell_starts[cells, None] + np.arange(n_faces)]
    first = np.argmax(mesh.sizes[faces] == base, axis=1)
    rows = np.arange(len(cells))
    faces[rows, first], faces[:, 0] = faces[:, 0].copy(), faces[rows, first]
    bottom = mesh.short[faces[:, 0], :base]
    inwards = mesh.owner[faces[:, 0]] != cells
    bottom = np.where(inwards[:, None], bottom, bottom[:, ::-1])  # its normal points to the top
    starts, ends = _edges(mesh.short[faces[:, 1:]])
    leaves = (ends[:, :, None] != bottom[:, None]).all(axis=2) & (ends >= 0)
    n_top = CELL_TYPES[name].n_nodes - base
    top = np.empty((len(cells), n_top), dtype=np.int64)
    for corner in range(n_top):
        up = leaves & (starts == bottom[:, corner, None])
        top[:, corner] = np.where(up.any(axis=1), ends[rows, np.argmax(up, axis=1)], -1)
    nodes = np.concatenate([bottom, top], axis=1)
    return nodes, _has_facets(nodes, mesh.short[faces], name)


def _edges(faces: Integers) -> tuple[Integers, Integers]:
    """(m, e) the ends of the edges of faces (m, f, 4), each edge in both directions; -1 for none."""
    after = np.roll(faces, -1, axis=2)
    triangle = faces[:, :, 3] < 0
    after[triangle, 2], after[triangle, 3] = faces[triangle, 0], -1
    a, b = faces.reshape(len(faces), -1), after.reshape(len(faces), -1)
    return np.concatenate([a, b], axis=1), np.concatenate([b, a], axis=1)


def _has_facets(nodes: Integers, faces: Integers, name: str) -> Marks:
    """(m,) whether the faces (m, f, 4) are those of cells with these nodes; each face is a set of bits."""
    bits = np.zeros(faces.shape, dtype=np.int64)
    for local in range(nodes.shape[1]):
        bits |= np.where(faces == nodes[:, local, None, None], 1 << local, 0)
    foreign = ((bits == 0) & (faces >= 0)).any(axis=(1, 2))
    masks = np.bitwise_or.reduce(bits, axis=2)
    expected = sorted(sum(1 << node for node in facet) for facet in LOCAL_FACETS[name])
    same = (np.sort(masks, axis=1) == expected).all(axis=1)
    found: Marks = same & ~foreign & (nodes >= 0).all(axis=1)
    return found
