"""The derivative of a boundary layer's motion (:mod:`.boundary_layer`) with respect to the wall's nodes.

A layer's node depends only on the wall's nodes around its foot, so the derivative is a sparse matrix; it is used for
tangents and, transposed, for adjoints.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.mesh.boundary_layer_wall import ALONG, MovingWall, facet_frames, weighting_of
from mesh_motion_numerics.motion.boundary_layer import BoundaryLayer


def carried_slope(layer: BoundaryLayer, moved: Floats) -> csr_array:
    """(l d, w d) derivative of :meth:`.BoundaryLayer.carried` by the wall's nodes, which are at ``moved`` (n, d)."""
    wall, (corners, weights), offsets = layer.wall, layer.tied.places, layer.tied.offsets
    at, (n, d) = moved[wall.nodes], offsets.shape
    weighting, sums = wall.deformation_sums(at)
    deformations = np.asarray(np.linalg.solve(weighting, sums), dtype=np.float64)
    turned = np.einsum("ljab,lb->lja", deformations[corners], offsets)
    lengths = np.linalg.norm(turned, axis=2)
    directions = np.divide(turned, lengths[:, :, None], out=np.zeros_like(turned), where=lengths[:, :, None] > 0.0)
    mean, distance = np.einsum("lj,lja->la", weights, turned), layer.distances(turned)
    length = np.linalg.norm(mean, axis=1)
    clear = length > 0.0
    unit = np.divide(mean, length[:, None], out=np.zeros_like(mean), where=clear[:, None])
    scale = np.divide(distance, length, out=np.zeros_like(length), where=clear)
    across = scale[:, None, None] * (np.eye(d) - unit[:, :, None] * unit[:, None, :])
    following = layer.follows[:, None, None, None] * unit[:, None, :, None] * directions[:, :, None, :]
    of_turned = across[:, None] + following  # (l, j, a, c)
    placed = np.broadcast_to(np.eye(d), (n, d, d))
    if layer.sliding is not None:
        rows = np.searchsorted(layer.nodes, layer.sliding.nodes)
        onto = layer.sliding.slope(layer.lifted(moved)[rows])
        placed = placed.copy()
        placed[rows] = onto
        of_turned[rows] = onto[:, None] @ of_turned[rows]
    of_places = np.einsum("lj,lac->lajc", weights, placed)  # derivative by the corners' positions
    of_deformations = np.einsum("lj,ljac,lb->lajcb", weights, of_turned, offsets)  # by the corners' deformations
    directly = _sparse(of_places, n, corners, len(wall.nodes))
    deformed = _sparse(of_deformations.reshape(n, d, d, d * d), n, corners, len(wall.nodes))
    return csr_array(directly + deformed @ _deformations_slope(wall, at, weighting, deformations))


def _deformations_slope(wall: MovingWall, moved: Floats, weighting: Floats, deformations: Floats) -> csr_array:
    """(w d d, w d) derivative of :meth:`.MovingWall.deformations` G (w, d, d) at ``moved`` (w, d).

    ``weighting`` is A (w, d, d). Each node's G = A⁻¹ B is a function of sums over its facets, so its derivative
    A⁻¹ (dB − dA G) is one, too.
    """
    now, d, inverse = moved[wall.simplices], moved.shape[1], wall.at_rest[0]
    own, own_slope = facet_frames(now), _frames_slope(now)
    normal, bent = own[:, :, -1], (1.0 - ALONG) * own_slope[:, :, -1]  # (s, d), (s, a, j, c)
    weighting_slope = np.einsum("sxjc,sy->sxyjc", bent, normal) + np.einsum("sx,syjc->sxyjc", normal, bent)
    gradient, gradient_slope = own @ inverse, np.einsum("sxyjc,sye->sxejc", own_slope, inverse)
    slope_of_sums = np.einsum("sxyjc,sye->sxejc", weighting_slope, gradient)
    slope_of_sums += np.einsum("sxy,syejc->sxejc", weighting_of(own), gradient_slope)

    around = wall.around.tocoo()
    nodes, of_facet = around.coords
    slope = slope_of_sums[of_facet] - np.einsum("qxyjc,qye->qxejc", weighting_slope[of_facet], deformations[nodes])
    slope = np.einsum("q,qax,qxejc->qaejc", around.data, np.linalg.inv(weighting)[nodes], slope)
    return _sparse(slope.reshape(len(nodes), d * d, d, d), nodes, wall.simplices[of_facet], len(moved))


def _frames_slope(corners: Floats) -> Floats:
    """(s, d, d, d, d) derivatives ``[s, a, b, j, c]`` of the facets' frames by the corners' positions (s, d, d)."""
    count, d = corners.shape[:2]
    out, edges = np.zeros((count, d, d, d, d)), corners[:, 1:] - corners[:, :1]
    for k in range(d - 1):
        for c in range(d):
            out[:, c, k, k + 1, c], out[:, c, k, 0, c] = 1.0, -1.0
    if d == 2:
        normal = np.column_stack([edges[:, 0, 1], -edges[:, 0, 0]])
        turn = np.array([[0.0, 1.0], [-1.0, 0.0]])
        slope = np.stack([np.broadcast_to(-turn, (count, 2, 2)), np.broadcast_to(turn, (count, 2, 2))], axis=2)
    else:
        normal = np.cross(edges[:, 0], edges[:, 1])
        first, second = -_crossing(edges[:, 1]), _crossing(edges[:, 0])
        slope = np.stack([-first - second, first, second], axis=2)  # (s, a, j, c)
    length = np.linalg.norm(normal, axis=1)
    unit = normal / length[:, None]
    across = (np.eye(d) - unit[:, :, None] * unit[:, None, :]) / length[:, None, None]
    out[:, :, -1] = np.einsum("sax,sxjc->sajc", across, slope)
    return out


def _crossing(vectors: Floats) -> Floats:
    """(s, 3, 3) matrices of the cross products v × …."""
    out = np.zeros((len(vectors), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -vectors[:, 2], vectors[:, 1], -vectors[:, 0]
    return out - np.swapaxes(out, 1, 2)


def _sparse(values: Floats, rows: Integers | int, columns: Integers, n_columns: int) -> csr_array:
    """Values (q, r, j, k) as a sparse matrix: row r of item ``rows`` (q,), and number k of item j (q, j)."""
    count, r, _, k = values.shape
    items = np.arange(count) if isinstance(rows, int) else rows
    n_rows = rows if isinstance(rows, int) else n_columns
    row = np.broadcast_to((items[:, None] * r + np.arange(r))[:, :, None, None], values.shape)
    column = np.broadcast_to((columns[:, :, None] * k + np.arange(k))[:, None], values.shape)
    entries = values.ravel(), (row.ravel(), column.ravel())
    return csr_array(coo_array(entries, shape=(n_rows * r, n_columns * k)))
