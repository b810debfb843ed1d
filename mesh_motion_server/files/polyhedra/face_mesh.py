"""A mesh that is given by its faces, as in OpenFOAM's polyMesh and CGNS' NGON_n sections.

Each face has an owner cell, and its normal points out of this cell. Inner faces come first and also have a neighbour
cell.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_protocol.errors import InvalidInput
from numpy.typing import NDArray


@dataclass(frozen=True)
class FacePatch:
    """Boundary faces ``start`` … ``start + count - 1``; the type is named as in OpenFOAM."""

    name: str
    kind: str
    start: int
    count: int


@dataclass(frozen=True, eq=False)
class FaceMesh:
    """A mesh by its faces, checked for consistency.

    Raises InvalidInput if the data are inconsistent; names the first face, cell or patch that does not fit.
    """

    path: Path  # the path that it was read from
    points: Floats  # (n, 3)
    starts: Integers  # (f + 1,). Start of each face's points in ``nodes``
    nodes: Integers  # (k,)
    owner: Integers  # (f,)
    neighbour: Integers  # (i,). Neighbour cells of the inner faces
    patches: tuple[FacePatch, ...]

    def __post_init__(self) -> None:
        wrong = np.flatnonzero((self.nodes < 0) | (self.nodes >= len(self.points)))
        if len(wrong):
            face = int(np.searchsorted(self.starts, wrong[0], side="right")) - 1
            point, last = int(self.nodes[wrong[0]]), len(self.points) - 1
            raise self._refused(f"face {face} names point {point}, but there are the points 0 to {last}")
        if len(self.owner) != self.n_faces:
            raise self._refused(f"{self.n_faces} faces, but {len(self.owner)} owners")
        if len(self.neighbour) > self.n_faces:
            raise self._refused(f"{self.n_faces} faces, but {len(self.neighbour)} neighbours")
        self._check_cells()
        self._check_patches()

    def _check_cells(self) -> None:
        """Check that cells are numbered from 0 without gaps, each with at least four faces."""
        most = (self.n_faces + self.n_inner) // 4
        for what, cells in (("owner", self.owner), ("neighbour", self.neighbour)):
            wrong = np.flatnonzero((cells < 0) | (cells >= max(most, 1)))
            if len(wrong):
                cell = int(cells[wrong[0]])
                reason = "is negative" if cell < 0 else f"is too large: these faces make at most {most} cells"
                raise self._refused(f"the {what} of face {int(wrong[0])} is cell {cell}, which {reason}")
        same = np.flatnonzero(self.owner[: self.n_inner] == self.neighbour)
        if len(same):
            raise self._refused(f"face {int(same[0])} has the cell {int(self.neighbour[same[0]])} on both sides")
        few = np.flatnonzero(np.diff(self.cell_starts) < 4)
        if len(few):
            count = int(np.diff(self.cell_starts)[few[0]])
            raise self._refused(f"cell {int(few[0])} has {count} faces; at least 4 enclose a volume")

    def _check_patches(self) -> None:
        """Check that patches have only boundary faces, and, if there are patches, that each boundary face is in one."""
        for patch in self.patches:
            if not (self.n_inner <= patch.start and patch.count >= 0 and patch.start + patch.count <= self.n_faces):
                raise self._refused(
                    f"patch {patch.name!r} has {patch.count} faces from face {patch.start} on, but the boundary has "
                    f"the faces {self.n_inner} to {self.n_faces - 1}"
                )
        filled = sorted((patch for patch in self.patches if patch.count), key=lambda patch: patch.start)
        begin = self.n_inner
        for patch in filled:
            if patch.start < begin:
                raise self._refused(f"face {patch.start} is in patch {patch.name!r} and in another one, too")
            if patch.start > begin:
                break
            begin += patch.count
        if self.patches and begin < self.n_faces:
            raise self._refused(f"face {begin} of the boundary is in no patch")

    def _refused(self, reason: str) -> InvalidInput:
        return InvalidInput(f"{self.path}: {reason}")

    @property
    def n_faces(self) -> int:
        """Number of all faces."""
        return len(self.starts) - 1

    @property
    def n_inner(self) -> int:
        """Number of faces between two cells."""
        return len(self.neighbour)

    @property
    def n_cells(self) -> int:
        """Number of cells."""
        return len(self.cell_starts) - 1

    @cached_property
    def sizes(self) -> Integers:
        """(f,) number of points of each face."""
        return np.diff(self.starts)

    @cached_property
    def _by_cell(self) -> tuple[Integers, Integers]:
        cells = np.concatenate([self.owner, self.neighbour])
        order = np.argsort(cells, kind="stable")
        counts = np.bincount(cells)
        faces = np.concatenate([np.arange(self.n_faces), np.arange(self.n_inner)])[order]
        return np.concatenate([[0], np.cumsum(counts)]), faces

    @property
    def cell_starts(self) -> Integers:
        """(c + 1,) where the faces of each cell begin in ``cell_faces``."""
        return self._by_cell[0]

    @property
    def cell_faces(self) -> Integers:
        """(f + i,) faces of all cells."""
        return self._by_cell[1]

    def face(self, number: int) -> Integers:
        """The points of a face."""
        return self.nodes[self.starts[number] : self.starts[number + 1]]

    @cached_property
    def short(self) -> Integers:
        """(f, 4) points of the triangles and quadrilaterals; a triangle ends with -1, longer faces have only -1."""
        table = np.full((self.n_faces, 4), -1, dtype=np.int64)
        for size in (3, 4):
            faces = np.flatnonzero(self.sizes == size)
            table[faces, :size] = self.nodes[self.starts[faces, None] + np.arange(size)]
        return table

    def boundary_faces(self, patch: FacePatch) -> Integers:
        """(p,) numbers of the faces of a patch."""
        return np.arange(patch.start, patch.start + patch.count)

    @np.errstate(all="ignore")
    def middles(self, faces: Integers) -> Floats:
        """(k, 3) mean of each face's points; in a quadrilateral with a reflex corner, of it and its opposite."""
        out = np.empty((len(faces), 3))
        for size in np.unique(self.sizes[faces]):
            rows = np.flatnonzero(self.sizes[faces] == size)
            corners = self.points[self.nodes[self.starts[faces[rows], None] + np.arange(size)]]
            out[rows] = corners.mean(axis=1)
            if size == 4:
                normals = corner_normals(corners)
                reflex = np.einsum("ijk,ik->ij", normals, normals.sum(axis=1)) < 0.0
                bent, corner = np.flatnonzero(reflex.any(axis=1)), np.argmax(reflex, axis=1)
                out[rows[bent]] = 0.5 * (corners[bent, corner[bent]] + corners[bent, (corner[bent] + 2) % 4])
        return out

    def edges(self, faces: Integers) -> tuple[Integers, Integers]:
        """(e, 2) the edges of the faces, in their direction, and (e,) the row of ``faces`` of each."""
        counts = self.sizes[faces]
        rows = np.repeat(np.arange(len(faces)), counts)
        place = np.arange(len(rows)) - (np.cumsum(counts) - counts)[rows]
        begin = self.starts[faces][rows]
        return np.column_stack([self.nodes[begin + place], self.nodes[begin + (place + 1) % counts[rows]]]), rows

    def faces_of(self, cells: Integers) -> tuple[Integers, Integers]:
        """(k,) the faces of the cells, and (k,) the cell of each face."""
        counts = np.diff(self.cell_starts)[cells]
        places = np.arange(counts.sum()) + np.repeat(self.cell_starts[cells] - np.cumsum(counts) + counts, counts)
        return self.cell_faces[places], np.repeat(cells, counts)

    @cached_property
    @np.errstate(all="ignore")  # absurd coordinates are refused later, by the mesh check
    def areas_and_centres(self) -> tuple[Floats, Floats]:
        """(f, 3) area vectors and (f, 3) centroids, from triangles about the mean of each face's points."""
        areas, centres = np.empty((self.n_faces, 3)), np.empty((self.n_faces, 3))
        for size in np.unique(self.sizes):
            faces = np.flatnonzero(self.sizes == size)
            corners = self.points[self.nodes[self.starts[faces, None] + np.arange(size)]]
            middle = corners.mean(axis=1)
            after = np.roll(corners, -1, axis=1)
            triangles = 0.5 * np.cross(after - corners, middle[:, None] - corners)
            weights = np.linalg.norm(triangles, axis=2)
            thirds = (corners + after + middle[:, None]) / 3
            total = weights.sum(axis=1)
            areas[faces] = triangles.sum(axis=1)
            centroid = (weights[..., None] * thirds).sum(axis=1) / total[:, None]
            centres[faces] = np.where(total[:, None] > 0, centroid, middle)
        return areas, centres

    @np.errstate(all="ignore")
    def volumes_and_centres(self) -> tuple[Floats, Floats]:
        """(c,) volumes and (c, 3) centroids, from pyramids about the mean of each cell's face centroids."""
        areas, centres = self.areas_and_centres
        counts = np.diff(self.cell_starts)
        cells = np.repeat(np.arange(self.n_cells), counts)
        sign = np.where(self.owner[self.cell_faces] == cells, 1.0, -1.0)
        estimate = _sums(cells, centres[self.cell_faces], self.n_cells) / counts[:, None]
        heights = centres[self.cell_faces] - estimate[cells]
        pyramids = sign * np.einsum("ij,ij->i", areas[self.cell_faces], heights) / 3
        tips = 0.75 * centres[self.cell_faces] + 0.25 * estimate[cells]
        volumes = np.bincount(cells, pyramids, self.n_cells)
        centroid = _sums(cells, pyramids[:, None] * tips, self.n_cells) / volumes[:, None]
        return volumes.astype(np.float64), np.where(np.isfinite(centroid), centroid, estimate)


def from_sides(
    path: Path, points: Floats, nodes: Integers, sizes: Integers, sides: Integers
) -> tuple[FaceMesh, Integers]:
    """The mesh of faces in any order, and for each of its faces the row (f,) among these.

    Inner faces come first; faces that point into their only cell are turned. Raises InvalidInput if a face has no cell,
    and as :class:`FaceMesh` does.

    Parameters
    ----------
    nodes, sizes : (k,), (f,) arrays
        The points of all faces, one face after the other, and the number of points of each face.
    sides : (f, 2) array
        The cell from which the face's normal points, and the cell to which it points; -1 for none.
    """
    starts = np.concatenate([[0], np.cumsum(sizes)])
    turned = sides[:, 0] < 0
    order = np.argsort((sides < 0).any(axis=1), kind="stable")
    cellless = np.flatnonzero((sides < 0).all(axis=1))
    if len(cellless):
        raise InvalidInput(f"{path}: face {int(cellless[0])} belongs to no cell")
    new_starts = np.concatenate([[0], np.cumsum(sizes[order])])
    within = np.arange(len(nodes)) - np.repeat(new_starts[:-1], sizes[order])
    back = np.repeat(sizes[order], sizes[order]) - 1 - within
    take = np.repeat(starts[:-1][order], sizes[order]) + np.where(np.repeat(turned[order], sizes[order]), back, within)
    inner = int((sides >= 0).all(axis=1).sum())
    owner = np.where(turned, sides[:, 1], sides[:, 0])[order]
    return FaceMesh(path, points, new_starts, nodes[take], owner, sides[order[:inner], 1], ()), order


def corner_normals(corners: Floats) -> Floats:
    """(m, k, 3) cross product of the edges at each corner of polygons (m, k, 3): the area of their parallelogram."""
    return np.cross(np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners)


def _sums(rows: NDArray[np.integer], values: Floats, count: int) -> Floats:
    """(count, 3) sums of values (k, 3) that belong to the same row."""
    return np.column_stack([np.bincount(rows, values[:, axis], count) for axis in range(3)])
