"""Grids with polyhedra (VTK's type 42, prisms of five and six sides) or with polygons of more than four sides.

They are made grids of simple cells.

Polyhedra are divided as OpenFOAM's are (:mod:`mesh_motion_server.files.polyhedra.pieces`), polygons of a grid in a
plane about a node in their middle. The new nodes follow the nodes of the grid.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.mesh.cells import CELL_TYPES
from mesh_motion_numerics.mesh.local_facets import LOCAL_FACETS
from numpy.typing import NDArray

from mesh_motion_server.files.polyhedra.cells import find_cells
from mesh_motion_server.files.polyhedra.face_mesh import FaceMesh, from_sides
from mesh_motion_server.files.polyhedra.pieces import Pieces, divide
from mesh_motion_server.files.polyhedra.polygons import polygons
from mesh_motion_server.files.vtk.grid import KNOWN_TYPES, POLYGON, POLYHEDRON, CellFaces, VtkGrid

_QUAD = 4  # nodes of a quadrilateral
_PRISMS = {15: 5, 16: 6}  # nodes of the ends, by VTK's type
_CODES = {name: code for code, name in reversed(KNOWN_TYPES.items())}
#: Nodes (m, k) of new cells by their type, and the cell (m,) of the grid that gives them its values, or -1.
Added = tuple[str, Integers, Integers]
#: Our type, nodes (m, k), and a number (m,) of each element: of its group or part.
Numbered = tuple[str, Integers, Integers]


def divided(path: Path, grid: VtkGrid) -> VtkGrid:
    """The grid with simple cells only; itself if it has no others.

    Raises ValueError if a polyhedron has no faces, or a face has more than two cells. Raises InvalidInput for cells
    that cannot be divided.
    """
    solid = np.isin(grid.types, [POLYHEDRON, *_PRISMS])
    long = (grid.types == POLYGON) & (np.diff(grid.offsets) > _QUAD)
    if not (solid | long).any():
        return grid
    rest = np.flatnonzero(~(solid | long))
    simple = [(name, rest[rows], nodes) for name, rows, nodes in grid.of_rows(rest).cells()]
    solids = [each for each in simple if CELL_TYPES[each[0]].dimension == 3]
    sides = CellFaces.of_cells(grid.connectivity, grid.offsets, np.flatnonzero(long))
    _check_nodes(sides, len(grid.points))
    if not solids and not solid.any():
        edges, rows = sides.edges()
        points, cells = polygons(grid.points, edges, rows)
        added = [(name, nodes, np.full(len(nodes), -1)) for name, nodes in cells.items()]
        return _with(grid, ~long, points, [], added)
    flat = [each for each in simple if CELL_TYPES[each[0]].dimension == 2]
    facets = CellFaces.joined([sides, *(_faces_of(rows, nodes, (range(nodes.shape[1]),)) for _, rows, nodes in flat)])
    centre = np.where(facets.sizes > _QUAD, facets.nodes[facets.first], -1)
    if not solid.any():
        return _with(grid, ~long, grid.points, [], [_fans(facets, centre)])
    parts = [_faces_of(rows, nodes, LOCAL_FACETS[name]) for name, rows, nodes in solids]
    parts += [_prism_faces(grid, np.flatnonzero(grid.types == code), size) for code, size in _PRISMS.items()]
    faces = CellFaces.joined(parts if grid.faces is None else [grid.faces, *parts])
    if len(without := np.setdiff1d(np.flatnonzero(solid), faces.cells)):
        raise ValueError(f"cell {int(without[0])} is of VTK's type 42 (polyhedra), but has no faces")
    _check_nodes(faces, len(grid.points))
    group = _groups(CellFaces.joined([faces, facets]))
    mesh, pieces, middles = _in_pieces(path, grid.points, faces, group[: len(faces.sizes)])
    middle = middles[group[len(faces.sizes) :]]
    for _, rows, _ in solids:
        solid[rows] = True
    added = [(name, nodes, np.full(len(nodes), -1)) for name, nodes in pieces.cells.items()]
    split = mesh.n_inner + np.flatnonzero(pieces.middles[mesh.n_inner :] >= 0)
    on_faces = [(int(pieces.middles[face]), mesh.face(face)) for face in split.tolist()]
    return _with(
        grid, ~(solid | long), pieces.points, on_faces, [*added, _fans(facets, np.where(middle >= 0, middle, centre))]
    )


def simple_elements(
    path: Path,
    points: Floats,
    elements: Sequence[Numbered],
    *,
    polygons: Sequence[CellFaces],
    polyhedra: Sequence[CellFaces],
    groups: Mapping[str, Integers],
) -> tuple[Floats, list[Numbered], dict[str, Integers]]:
    """Points, elements and groups of nodes of a file of another program, without polygons and polyhedra.

    Elements of a file that has such cells keep their corners only. The points keep their numbers; new ones follow.
    Raises as :func:`divided` does.

    Parameters
    ----------
    polygons, polyhedra
        The cell of a polygon is its number; the polyhedra of each part are counted from 0.
    groups : {name: (p,) array}
        Nodes. A new node in the middle of a face is in the groups that have all nodes of this face.
    """
    if not polygons and not polyhedra:
        return points, list(elements), dict(groups)
    cells = [each for each in elements if each[0]]
    corners = [nodes[:, : CELL_TYPES[name].n_nodes] for name, nodes, _ in cells]
    none = CellFaces(*np.empty((4, 0), np.int64))
    flat, solid, count = CellFaces.joined([none, *polygons]), [none], 0
    for part in polyhedra:
        solid.append(replace(part, cells=part.cells + count))
        count += int(part.cells.max(initial=-1)) + 1
    kinds = [np.full(len(nodes), _CODES[name]) for name, nodes, _ in cells]
    sizes = [np.full(len(nodes), nodes.shape[1]) for nodes in corners]
    kinds += [np.full(len(flat.sizes), POLYGON), np.full(count, POLYHEDRON)]
    sizes += [flat.sizes, np.zeros(count, np.int64)]
    types, faces = np.concatenate(kinds), CellFaces.joined(solid)
    grid = VtkGrid(
        np.pad(points, ((0, 0), (0, 3 - points.shape[1]))),
        types,
        np.concatenate([[0], np.cumsum(np.concatenate(sizes))]),
        np.concatenate([*(nodes.ravel() for nodes in corners), flat.nodes]),
        {name: np.isin(np.arange(len(points)), nodes) for name, nodes in groups.items()},
        {"number": np.concatenate([*(numbers for *_, numbers in cells), flat.cells, np.zeros(count, np.int64)])},
        replace(faces, cells=faces.cells + len(types) - count),
    )
    grid = divided(path, grid)
    numbers = grid.cell_arrays["number"].astype(np.int64)
    found = [each for each in elements if not each[0]]
    found += [(name, nodes, numbers[rows]) for name, rows, nodes in grid.cells()]
    return grid.points, found, {name: np.flatnonzero(of) for name, of in grid.point_arrays.items()}


def _check_nodes(faces: CellFaces, count: int) -> None:
    """Raise ValueError for a face that names a node which the grid of ``count`` nodes does not have."""
    wrong = np.flatnonzero((faces.nodes < 0) | (faces.nodes >= count))
    if len(wrong):
        cell = int(faces.cells[np.searchsorted(faces.first, wrong[0], side="right") - 1])
        raise ValueError(
            f"cell {cell} names node {int(faces.nodes[wrong[0]])}, but there are the nodes 0 to {count - 1}"
        )


def _in_pieces(path: Path, points: Floats, faces: CellFaces, group: Integers) -> tuple[FaceMesh, Pieces, Integers]:
    """The mesh of the cells' faces, its pieces, and the node in the middle of the faces of each group (g,), or -1."""
    order = np.argsort(group, kind="stable")
    known, start, counts = np.unique(group[order], return_index=True, return_counts=True)
    if counts.max() > 2:
        several = faces.cells[order[start[np.argmax(counts)] :][:3]]
        raise ValueError(f"the cells {', '.join(map(str, several))} have one face together; two can have it")
    number = np.unique(faces.cells, return_inverse=True)[1]
    one, other = order[start], np.full(len(start), -1)
    other[counts == 2] = number[order[start[counts == 2] + 1]]
    outwards = _outwards(points, faces)[one, None]
    sides = np.where(outwards, np.column_stack([number[one], other]), np.column_stack([other, number[one]]))
    first = faces.of_rows(one)
    mesh, rows = from_sides(path, points, first.nodes, first.sizes, sides)
    pieces = divide(mesh, find_cells(mesh))
    middles = np.full(int(group.max(initial=0)) + 1 + len(points), -1)
    middles[known[rows]] = pieces.middles
    return mesh, pieces, middles


@np.errstate(all="ignore")
def _outwards(points: Floats, faces: CellFaces) -> Marks:
    """(f,) whether each face's normal points out of its cell.

    A cell whose faces have one direction (each edge once in each direction) is the side on which its volume is
    positive; of another cell each face is turned away from the middle of the cell.
    """
    edges, rows = faces.edges()
    number = np.unique(faces.cells, return_inverse=True)[1]
    middle = _means(rows, points[edges[:, 0]])
    begin = points[edges[:, 0]]
    double = np.cross(points[edges[:, 1]] - begin, middle[rows] - begin)
    area = np.column_stack([np.bincount(rows, column) for column in double.T])
    heights = np.einsum("ij,ij->i", area, middle - _means(number, middle)[number])
    outwards: Marks = heights > 0
    mixed = np.bincount(number, outwards) % np.bincount(number) > 0
    chosen = mixed[number[rows]]
    keys = np.column_stack([number[rows], np.sort(edges, axis=1)])[chosen]
    directed = np.where(edges[:, 0] < edges[:, 1], 1, -1)[chosen]
    _, edge = np.unique(keys, axis=0, return_inverse=True)
    open_edges = np.bincount(edge.ravel(), directed)[edge.ravel()] != 0
    mixed[keys[open_edges, 0]] = False  # mixed, and in one direction
    volume = np.bincount(number, heights)
    return np.where(mixed[number], volume[number] > 0, outwards)


def _means(rows: Integers, values: Floats) -> Floats:
    """Mean of the values (k, 3) of each row."""
    return np.column_stack([np.bincount(rows, column) for column in values.T]) / np.bincount(rows)[:, None]


def _groups(faces: CellFaces) -> Integers:
    """(f,) a number for each face, the same for faces with the same nodes."""
    found, count = np.empty(len(faces.sizes), np.int64), 0
    for size in np.unique(faces.sizes).tolist():
        rows = np.flatnonzero(faces.sizes == size)
        nodes = np.sort(faces.nodes[faces.first[rows, None] + np.arange(size)], axis=1)
        order = np.lexsort(nodes.T)
        new = (nodes[order[1:]] != nodes[order[:-1]]).any(axis=1)
        found[rows[order]] = count + np.concatenate([[0], np.cumsum(new)])
        count = int(found[rows].max()) + 1
    return found


def _faces_of(rows: Integers, nodes: Integers, local: tuple[tuple[int, ...] | range, ...]) -> CellFaces:
    """The faces of cells (m, k) of one type."""
    parts = [nodes[:, list(each)] for each in local]
    sizes = np.repeat([part.shape[1] for part in parts], len(rows))
    return CellFaces(
        np.concatenate([part.ravel() for part in parts]), np.cumsum(sizes) - sizes, sizes, np.tile(rows, len(parts))
    )


def _prism_faces(grid: VtkGrid, rows: Integers, size: int) -> CellFaces:
    """The faces of prisms whose ends have ``size`` nodes each."""
    if len(few := rows[np.diff(grid.offsets)[rows] != 2 * size]):
        raise ValueError(f"cell {int(few[0])} is a prism of {size} sides, but has not {2 * size} nodes")
    sides = [(k, (k + 1) % size, size + (k + 1) % size, size + k) for k in range(size)]
    local = (tuple(reversed(range(size))), tuple(range(size, 2 * size)), *sides)
    return _faces_of(rows, grid.connectivity[grid.offsets[rows, None] + np.arange(2 * size)], local)


def _fans(facets: CellFaces, centre: Integers) -> Added:
    """The triangles of the facets about their centres (f,); none of a facet whose centre is -1."""
    edges, rows = facets.edges()
    fan = centre[rows] >= 0
    return "triangle", np.column_stack([edges, centre[rows]])[fan], facets.cells[rows[fan]]


def _with(
    grid: VtkGrid, kept: Marks, points: Floats, on_faces: list[tuple[int, Integers]], added: list[Added]
) -> VtkGrid:
    """The grid with these points, its ``kept`` cells and added cells.

    ``on_faces`` are new nodes, each with the nodes of its face: it has their value in an array where this is one value.
    Other new nodes have zeros.
    """

    def of_points(values: NDArray[np.generic]) -> NDArray[np.generic]:
        out = np.zeros((len(points), *values.shape[1:]), values.dtype)
        out[: len(values)] = values
        for node, corners in on_faces:
            if (values[corners] == values[corners[0]]).all():
                out[node] = values[corners[0]]
        return out

    def of_cells(values: NDArray[np.generic]) -> NDArray[np.generic]:
        parts = [np.where((rows >= 0).reshape(-1, *[1] * (values.ndim - 1)), values[rows], 0) for _, _, rows in added]
        return np.concatenate([values[kept], *(part.astype(values.dtype) for part in parts)])

    whole = grid.of_rows(np.flatnonzero(kept))
    nodes = [whole.connectivity, *(nodes.ravel() for _, nodes, _ in added)]
    sizes = [np.diff(whole.offsets), *(np.full(len(nodes), nodes.shape[1]) for _, nodes, _ in added)]
    return replace(
        whole,
        points=points,
        types=np.concatenate([whole.types, *(np.full(len(nodes), _CODES[name]) for name, nodes, _ in added)]),
        offsets=np.concatenate([[0], np.cumsum(np.concatenate(sizes))]),
        connectivity=np.concatenate(nodes),
        point_arrays={name: of_points(values) for name, values in grid.point_arrays.items()},
        cell_arrays={name: of_cells(values) for name, values in grid.cell_arrays.items()},
        faces=None,
    )
