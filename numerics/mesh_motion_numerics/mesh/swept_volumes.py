"""The volume that each face sweeps while its nodes go straight from one position to another.

In 3D a face with the corners p₁ … p_k is the fan of the triangles (m, p_i, p_{i+1}) around the mean m of its corners.
For a triangle this is the triangle itself; a quad sweeps the volume of its bilinear surface. In 2D a face is an edge,
and swept volumes are areas; in 1D it is a point, and they are lengths. Cells are bounded by these faces.

The velocity of a point of a face is constant during the step and its normal is a polynomial in time, of degree 2 for a
triangle, so Simpson's rule is exact:

    ∫ u · n dA dt = u(mean) · (S(0) + 4 S(½) + S(1)) / 6,   S the area vector, u(mean) the mean displacement

Therefore the sum over the faces of a closed cell is the change of its volume: the geometric conservation law in its
discrete form. Both sides of a face get the same number with opposite signs, bit for bit.

References
----------
P. D. Thomas, C. K. Lombard, Geometric conservation law and its application to flow computations on moving grids, AIAA
Journal 17 (1979). I. Demirdžić, M. Perić, Space conservation law in finite volume calculations, IJNMF 8 (1988).
"""

from __future__ import annotations

import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.mesh.cells import CellBlock
from mesh_motion_numerics.mesh.local_facets import LOCAL_FACETS

#: Faces per batch: some ten megabytes of coordinates.
_BLOCK = 1 << 16


def swept_volumes(before: Floats, after: Floats, faces: Integers) -> Floats:
    """Volumes (f,) that faces sweep in the direction of their normals, mesh length unit to the power of d.

    Parameters
    ----------
    before, after : (n, d) arrays, mesh length unit
        Positions of the nodes.
    faces : (f, k) integer array
        Nodes, filled up with -1. In 3D they are anticlockwise as seen from the side to which the normal points. The
        normal of an edge points to the right of its direction, that of a point along the axis.
    """
    found = np.empty(len(faces))
    for start in range(0, len(faces), _BLOCK):
        rows = slice(start, start + _BLOCK)
        nodes, signs = _canonical(faces[rows], before.shape[1])
        counts = (nodes >= 0).sum(axis=1)
        swept = np.empty(len(nodes))
        for count in np.unique(counts).tolist():
            chosen = counts == count
            own = nodes[chosen, :count]
            swept[chosen] = _swept(before[own], after[own])
        found[rows] = signs * swept
    return found


def swept_by_cells(before: Floats, after: Floats, block: CellBlock) -> Floats:
    """Volumes (m, f) that the faces of each cell sweep outwards, faces in the order of :data:`LOCAL_FACETS`.

    Parameters
    ----------
    before, after : (n, d) arrays, mesh length unit
    block : CellBlock
        Cells; for cells in the opposite orientation the faces have the opposite signs.
    """
    columns = []
    for number, local in enumerate(LOCAL_FACETS[block.type.name]):
        outwards = -1.0 if block.type.dimension == 1 and number == 0 else 1.0
        columns.append(outwards * swept_volumes(before, after, block.nodes[:, local].astype(np.int64)))
    return np.stack(columns, axis=1)


def _canonical(faces: Integers, dimension: int) -> tuple[Integers, Floats]:
    """Faces (f, k) from their smallest node on, towards its smaller neighbour, and the signs (f,) of this change."""
    nodes = faces.copy()
    signs = np.ones(len(faces))
    if dimension == 2:
        turned = nodes[:, 0] > nodes[:, 1]
        nodes[turned], signs[turned] = nodes[turned, ::-1], -1.0
    elif dimension == 3:
        counts = (faces >= 0).sum(axis=1)
        for count in np.unique(counts).tolist():
            chosen = np.flatnonzero(counts == count)
            own = faces[chosen, :count]
            first = own.argmin(axis=1)[:, None]
            own = np.take_along_axis(own, (first + np.arange(count)) % count, axis=1)
            turned = own[:, 1] > own[:, -1]
            own[turned, 1:] = own[turned, :0:-1]
            nodes[chosen, :count], signs[chosen[turned]] = own, -1.0
    return nodes, signs


def _swept(before: Floats, after: Floats) -> Floats:
    """Volumes (f,) of faces with their nodes at (f, k, d)."""
    shift = after - before
    dimension = before.shape[2]
    if dimension == 1:
        return shift[:, 0, 0]
    middle = before + 0.5 * shift
    if dimension == 2:
        edge, mean = middle[:, 1] - middle[:, 0], shift.mean(axis=1)
        area: Floats = mean[:, 0] * edge[:, 1] - mean[:, 1] * edge[:, 0]
        return area
    if before.shape[1] == 3:
        return _dot(shift.mean(axis=1), _simpson(*(_area(x[:, 0], x[:, 1], x[:, 2]) for x in (before, middle, after))))
    total = np.zeros(len(before))
    centres = [x.mean(axis=1) for x in (before, middle, after)]
    drift, count = shift.mean(axis=1), before.shape[1]
    for one in range(count):
        other = (one + 1) % count
        mean = (drift + shift[:, one] + shift[:, other]) / 3.0
        areas = (_area(m, x[:, one], x[:, other]) for m, x in zip(centres, (before, middle, after), strict=True))
        total += _dot(mean, _simpson(*areas))
    return total


def _simpson(first: Floats, middle: Floats, last: Floats) -> Floats:
    return (first + 4.0 * middle + last) / 6.0


def _area(a: Floats, b: Floats, c: Floats) -> Floats:
    """Area vectors (f, 3) of triangles with their corners at (f, 3) each."""
    return 0.5 * np.cross(b - a, c - a)


def _dot(a: Floats, b: Floats) -> Floats:
    product: Floats = np.einsum("fi,fi->f", a, b)
    return product
