"""Finite-volume measures of a mesh: non-orthogonality, skewness and volume ratios of faces, and the largest shrinkage.

The definitions are exactly those of OpenFOAM, so the numbers are those that its ``checkMesh`` prints:

==================  ==================================================================================================
non-orthogonality   angle between a face's area vector S and the vector d between the centres of its two cells
skewness            distance of the face's centre from the point where d meets the face, relative to the extent of the
                    face in that direction (at least 0.2 \\|d\\|); boundary faces: with d normal to the face, 0.4
volume ratio        min(V_o, V_n) / max(V_o, V_n) of a face's two cells; negative next to an inverted one
==================  ==================================================================================================

A face's centre and area are sums over its triangles around the mean of its nodes; a cell's centre and volume are sums
over its pyramids around the mean of its faces' centres. A plane mesh is treated as one cell thick; its edges are faces.
Edges and faces are also compared with their state at rest, because neither angles nor ratios of volumes show a squeezed
cell.

References
----------
OpenFOAM v1912, src/OpenFOAM/meshes: ``primitiveMeshFaceCentresAndAreas``, ``primitiveMeshCellCentresAndVols``,
``primitiveMeshTools::faceOrthogonality``, ``::faceSkewness``, ``::boundaryFaceSkewness``, ``polyMeshTools::volRatio``.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any
from weakref import WeakKeyDictionary

import mesh_motion_kernels as kernels
import numpy as np
from numpy.typing import NDArray

from mesh_motion_numerics.arrays import Floats
from mesh_motion_numerics.mesh.cell_facets import CellFacets
from mesh_motion_numerics.mesh.cells import CELL_TYPES, CellBlock, CellTable
from mesh_motion_numerics.mesh.local_facets import LOCAL_FACETS

Ints = NDArray[np.integer[Any]]

#: Cells or faces per batch: about ten megabytes of coordinates.
_BLOCK = 1 << 16
#: OpenFOAM's VSMALL and its root, which keep quotients finite.
_TINY, _ROOT_TINY = 1e-300, 1e-150
#: Number of worst faces that are reported.
_WORST = 10
_EXTRUDED = {"triangle": "wedge", "quad": "hexahedron"}

#: Measures of a face other than the volumes of its cells: 0 is best.
FACE_METRICS = ("non-orthogonality", "face-skewness")


@dataclass(frozen=True)
class WorstFace:
    """One of the least orthogonal faces."""

    cells: tuple[int, int]  # numbers of the cells on either side, through the blocks of the cell table
    centre: tuple[float, ...]  # mesh length unit
    non_orthogonality: float  # degrees


@dataclass(frozen=True)
class FaceMeasures:
    """Finite-volume measures of a mesh."""

    faces: int  # faces between two cells
    max_non_orthogonality: float  # degrees; 0 in a mesh of a single cell
    #: faces_above_65, faces_above_75: faces with a non-orthogonality above that many degrees
    faces_above_65: int
    faces_above_75: int
    max_skewness: float  # includes faces of the boundary
    #: Ratio of two cells with a common face; 1: equal volumes, negative: one of them is inverted.
    min_volume_ratio: float
    #: shortest_edge, smallest_face: smallest length of an edge and area of a face, divided by the value at rest; in 2D
    #: an edge is a face
    shortest_edge: float
    smallest_face: float
    worst: tuple[WorstFace, ...]  # the least orthogonal first; at most ten

    def numbers(self) -> dict[str, Any]:
        """All measures except the worst faces, by name."""
        return {name: value for name, value in asdict(self).items() if name != "worst"}


#: 3D cells and their facets; of a 2D mesh those of the layer of cells.
_KEPT: WeakKeyDictionary[CellTable, tuple[CellTable, CellFacets]] = WeakKeyDictionary()


def face_measures(
    points: NDArray[np.floating], cells: CellTable, rest: NDArray[np.floating] | None = None
) -> FaceMeasures | None:
    """The measures of a mesh; None in one dimension, where faces are points.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
    rest : (n, d) array, optional
        Positions at rest; by default ``points``.

    Notes
    -----
    The cells of each face are computed once for a cell table and kept as long as it exists.
    """
    if cells.dimension == 1:
        return None
    positions, facets, (angles, skewness, ratio) = _faces(points, cells)
    edge, face = (1.0, 1.0) if rest is None else _shrunk(np.asarray(points), np.asarray(rest), cells, facets)
    return FaceMeasures(
        faces=len(angles),
        max_non_orthogonality=float(angles.max(initial=0.0)),
        faces_above_65=int(np.count_nonzero(angles > 65.0)),
        faces_above_75=int(np.count_nonzero(angles > 75.0)),
        max_skewness=float(skewness.max(initial=0.0)),
        min_volume_ratio=ratio,
        shortest_edge=edge,
        smallest_face=face,
        worst=_worst(positions, facets, angles, cells.dimension),
    )


def cell_values(points: NDArray[np.floating], cells: CellTable, metric: str) -> Floats:
    """The largest non-orthogonality (degrees) or skewness of each cell's faces (m,); parameters as above, not in 1D.

    Parameters
    ----------
    metric : str
        One of :data:`FACE_METRICS`.
    """
    _, facets, (angles, skewness, _) = _faces(points, cells)
    values = angles if metric == "non-orthogonality" else skewness
    largest = np.zeros(len(cells))
    np.maximum.at(largest, facets.owner[: len(values)], values)
    np.maximum.at(largest, facets.neighbour, values[: len(facets.neighbour)])
    return largest


def _faces(points: NDArray[np.floating], cells: CellTable) -> tuple[Floats, CellFacets, tuple[Floats, Floats, float]]:
    """Faces with their positions in 3D, and the measured values."""
    plane = cells.dimension == 2
    if cells not in _KEPT:
        table = extruded_cells(cells, len(points)) if plane else cells
        _KEPT[cells] = table, CellFacets.of(table)
    solid, facets = _KEPT[cells]
    positions = extruded_points(points) if plane else np.asarray(points, dtype=np.float64)
    return positions, facets, _measured(positions, facets, *_cell_geometry(positions, solid))


def _measured(points: Floats, facets: CellFacets, centres: Floats, volumes: Floats) -> tuple[Floats, Floats, float]:
    """Angle (i,), degrees, of each face between two cells; skewness (f,) of all faces; the smallest volume ratio."""
    inner = len(facets.neighbour)
    angles, skewness, ratio = np.empty(inner), np.empty(len(facets.owner)), 1.0
    for rows in _blocks(inner):
        owner, neighbour = facets.owner[rows], facets.neighbour[rows]
        between = centres[neighbour] - centres[owner]
        for chosen, corners in _by_size(points, facets.nodes[rows]):
            middle, area = _face_geometry(corners)
            d = between[chosen]
            cosine = _dot(d, area) / (_length(d) * _length(area) + _ROOT_TINY)
            angles[rows.start + chosen] = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
            reach = middle - centres[owner[chosen]]
            skewness[rows.start + chosen] = _skewness(reach, d, area, corners - middle[:, None], least=0.2)
        sizes = np.stack([volumes[owner], volumes[neighbour]])
        with np.errstate(over="ignore"):  # next to a cell of zero volume
            ratio = min(ratio, float((sizes.min(axis=0) / (sizes.max(axis=0) + _TINY)).min()))
    for rows in _blocks(len(facets.owner), inner):
        owner = facets.owner[rows]
        for chosen, corners in _by_size(points, facets.nodes[rows]):
            middle, area = _face_geometry(corners)
            reach = middle - centres[owner[chosen]]
            normal = area / (_length(area) + _ROOT_TINY)[:, None]
            d = normal * _dot(normal, reach)[:, None]
            skewness[rows.start + chosen] = _skewness(reach, d, area, corners - middle[:, None], least=0.4)
    return angles, skewness, ratio


def _shrunk(points: Floats, rest: Floats, cells: CellTable, facets: CellFacets) -> tuple[float, float]:
    """Smallest edge length and face area relative to rest; in 2D both are those of an edge."""
    edge = face = np.inf
    for nodes in _polygons(cells, facets):
        now, before = points[nodes], rest[nodes]
        edge = min(edge, _least_share(*(_length(np.roll(x, -1, axis=1) - x) for x in (now, before))))
        if cells.dimension == 3:
            face = min(face, _least_share(*(_length(_face_geometry(x)[1]) for x in (now, before))))
    return edge, face if cells.dimension == 3 else edge


def _polygons(cells: CellTable, facets: CellFacets) -> Iterator[Ints]:
    """Nodes (f, k) of the faces in 3D, of the cells in 2D; in batches with equal numbers of corners."""
    for table in [block.nodes for block in cells] if cells.dimension == 2 else [facets.nodes]:
        for rows in _blocks(len(table)):
            triangles = table[rows, -1] < 0
            yield from (table[rows][triangles, :3], table[rows][~triangles])


def _least_share(now: Floats, before: Floats) -> float:
    """The smallest ratio of ``now`` to ``before``; items without extent at rest are left out."""
    real = before > 0.0
    return float((now[real] / before[real]).min(initial=np.inf))


def _skewness(reach: Floats, d: Floats, area: Floats, spokes: Floats, *, least: float) -> Floats:
    """Skewness (f,) of faces: the centre of a face is at ``reach`` (f, 3) from the owner's centre, and its nodes at
    ``spokes`` (f, k, 3) from the face's centre; ``least``: smallest extent of a face as a share of |d|.
    """
    skew = reach - (_dot(area, reach) / (_dot(area, d) + _ROOT_TINY))[:, None] * d
    length = _length(skew)
    towards = skew / (length + _ROOT_TINY)[:, None]
    extent = np.abs(np.einsum("fki,fi->fk", spokes, towards)).max(axis=1)
    found: Floats = length / np.maximum(extent, least * _length(d) + _ROOT_TINY)
    return found


def _cell_geometry(points: Floats, cells: CellTable) -> tuple[Floats, Floats]:
    """Centres (m, 3) and volumes (m,) of all cells."""
    centres, volumes = np.empty((len(cells), 3)), np.empty(len(cells))
    for block, span in cells.numbered:
        for rows in _blocks(len(block)):
            faces = [_face_geometry(points[block.nodes[rows][:, local]]) for local in LOCAL_FACETS[block.type.name]]
            middles, areas = (np.stack(parts, axis=1) for parts in zip(*faces, strict=True))
            estimate = middles.mean(axis=1)
            pyramids = np.einsum("mfi,mfi->mf", areas, middles - estimate[:, None])
            total = pyramids.sum(axis=1)
            moment = 0.75 * np.einsum("mf,mfi->mi", pyramids, middles) + 0.25 * total[:, None] * estimate
            solid = np.abs(total) > _TINY
            estimate[solid] = moment[solid] / total[solid, None]
            at = slice(span.start + rows.start, span.start + rows.stop)
            centres[at], volumes[at] = estimate, total / 3.0
    return centres, volumes


def _face_geometry(corners: Floats) -> tuple[Floats, Floats]:
    """Centres and area vectors (f, 3) of faces with their nodes at (f, k, 3)."""
    middle = corners.mean(axis=1)
    if corners.shape[1] == 3:
        return middle, 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    following = np.roll(corners, -1, axis=1)
    normals = np.cross(following - corners, middle[:, None] - corners)
    weights = _length(normals)
    total = weights.sum(axis=1)
    moment = np.einsum("fk,fki->fi", weights, corners + following) + total[:, None] * middle
    real = total > _ROOT_TINY
    middle[real] = moment[real] / (3.0 * total[real, None])
    return middle, 0.5 * normals.sum(axis=1)


def _worst(points: Floats, facets: CellFacets, angles: Floats, dimension: int) -> tuple[WorstFace, ...]:
    """The least orthogonal faces; of equal faces the first."""
    found = []
    for face in kernels.smallest_values(-angles, _WORST).tolist():
        nodes = facets.nodes[face]
        centre = _face_geometry(points[None, nodes[nodes >= 0]])[0][0]
        cells = (int(facets.owner[face]), int(facets.neighbour[face]))
        found.append(WorstFace(cells, tuple(centre[:dimension].tolist()), float(angles[face])))
    return tuple(found)


def _by_size(points: Floats, nodes: Ints) -> Iterator[tuple[Ints, Floats]]:
    """Triangles and quads among faces (f, 4): their rows, and their nodes' positions (., k, 3)."""
    triangles = nodes[:, 3] < 0
    for size, mask in ((3, triangles), (4, ~triangles)):
        if mask.any():
            chosen = np.flatnonzero(mask)
            yield chosen, points[nodes[chosen, :size]]


def _blocks(stop: int, start: int = 0) -> Iterator[slice]:
    """Slices of the cells or faces of each batch."""
    for begin in range(start, stop, _BLOCK):
        yield slice(begin, min(begin + _BLOCK, stop))


def _dot(a: Floats, b: Floats) -> Floats:
    """Dot products (f,) of vectors (f, 3)."""
    product: Floats = np.einsum("...i,...i->...", a, b)
    return product


def _length(vectors: Floats) -> Floats:
    """Lengths of vectors (…, 3)."""
    return np.sqrt(_dot(vectors, vectors))


def extruded_cells(cells: CellTable, count: int) -> CellTable:
    """Return triangles and quads as wedges and hexahedra, in the same order; above node i is node i + ``count``."""
    return CellTable(
        tuple(
            CellBlock(CELL_TYPES[_EXTRUDED[block.type.name]], np.hstack([block.nodes, block.nodes + count]))
            for block in cells
        )
    )


def extruded_points(points: NDArray[np.floating]) -> Floats:
    """(2 n, 3) nodes of one layer about as high as a cell is wide, from positions (n, 2), mesh length unit."""
    n = len(points)
    height = float(np.sqrt(np.prod(np.ptp(points, axis=0)) / max(n, 1))) or 1.0
    return np.concatenate([np.column_stack([points, np.full(n, z)]) for z in (0.0, height)])
