"""The derivative of a boundary layer's motion (:mod:`.boundary_layer`) with respect to the wall's nodes.

A layer's node depends only on the wall's nodes around its foot, so the derivative is a sparse matrix; it is used for
tangents and, transposed, for adjoints.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.decomposition import nearest_rotation, nearest_rotation_slope
from mesh_motion_numerics.mesh.boundary_layer_wall import (
    MovingWall,
    angles_at_corners,
    facet_frames,
    least_rotation,
)
from mesh_motion_numerics.motion.boundary_layer import BoundaryLayer

__all__ = ["carried_slope"]


def carried_slope(layer: BoundaryLayer, moved: Floats) -> csr_array:
    """(l d, w d) derivative of :meth:`.BoundaryLayer.carried` by the wall's nodes, which are at ``moved`` (n, d)."""
    wall, (corners, weights), offsets = layer.wall, layer.tied.places, layer.tied.offsets
    at, (n, d) = moved[wall.nodes], offsets.shape
    mean = np.einsum("lj,ljab,lb->la", weights, wall.rotations(at)[corners], offsets)
    length, distance = np.linalg.norm(mean, axis=1), np.linalg.norm(offsets, axis=1)
    clear = length > 0.0
    unit = np.divide(mean, length[:, None], out=np.zeros_like(mean), where=clear[:, None])
    scale = np.divide(distance, length, out=np.zeros_like(length), where=clear)
    across = scale[:, None, None] * (np.eye(d) - unit[:, :, None] * unit[:, None, :])
    placed = np.broadcast_to(np.eye(d), (n, d, d))
    if layer.sliding is not None:
        rows = np.searchsorted(layer.nodes, layer.sliding.nodes)
        onto = layer.sliding.slope(layer.lifted(moved)[rows])
        placed = placed.copy()
        placed[rows] = onto
        across[rows] = onto @ across[rows]
    of_places = np.einsum("lj,lac->lajc", weights, placed)  # derivative by the corners' positions
    of_turns = np.einsum("lj,lac,lb->lajcb", weights, across, offsets)  # derivative by the corners' rotations
    directly = _sparse(of_places, n, corners, len(wall.nodes))
    turned = _sparse(of_turns.reshape(n, d, d, d * d), n, corners, len(wall.nodes))
    return csr_array(directly + turned @ _rotations_slope(wall, at))


def _rotations_slope(wall: MovingWall, moved: Floats) -> csr_array:
    """(w d d, w d) derivative of :meth:`.MovingWall.rotations` at ``moved`` (w, d).

    Each node's rotation is a function of sums over its facets, so the derivative is a sum over the facets.
    """
    rest, now, d = wall.reference[wall.simplices], moved[wall.simplices], moved.shape[1]
    frames, own = np.linalg.inv(facet_frames(rest)), facet_frames(now)
    own_slope = _frames_slope(now)  # (s, d, d, j, c)
    of_facet = own @ frames
    facet_slope = np.einsum("sxyjc,sye->sxejc", own_slope, frames)
    facet_slope = np.einsum("sabxe,sxejc->sabjc", nearest_rotation_slope(of_facet), facet_slope)

    at_rest, angles = angles_at_corners(rest), angles_at_corners(now)
    summed = wall.summed(nearest_rotation(of_facet), at_rest)
    mean, normal = nearest_rotation(summed), wall.summed(facet_frames(rest)[:, :, -1], at_rest)
    goal = wall.summed(own[:, :, -1], angles)
    least = least_rotation(np.einsum("wij,wj->wi", mean, normal), goal)

    # incidences of facets and nodes: row s d + i is the facet s and its corner i
    nodes = wall.simplices.ravel()
    summed_slope = (at_rest[:, :, None, None, None, None] * facet_slope[:, None]).reshape(-1, d, d, d, d)
    goal_slope = angles[:, :, None, None, None] * own_slope[:, None, :, -1]
    goal_slope = goal_slope + _angles_slope(now)[:, :, None] * own[:, None, :, -1, None, None]
    goal_slope = goal_slope.reshape(-1, d, d, d)
    mean_slope = np.einsum("qabxy,qxyjc->qabjc", nearest_rotation_slope(summed)[nodes], summed_slope)
    start_slope = np.einsum("qabjc,qb->qajc", mean_slope, normal[nodes])
    start = np.einsum("wij,wj->wi", mean, normal)
    least_slope = _least_slope(start[nodes], goal[nodes], start_slope, goal_slope)
    slope = np.einsum("qaxjc,qxb->qabjc", least_slope, mean[nodes])
    slope += np.einsum("qax,qxbjc->qabjc", least[nodes], mean_slope)
    return _sparse(slope.reshape(len(nodes), d * d, d, d), nodes, np.repeat(wall.simplices, d, axis=0), len(moved))


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


def _angles_slope(corners: Floats) -> Floats:
    """(s, d, d, d) derivatives ``[s, i, j, c]`` of the facets' angles at their corners i by the corners' positions."""
    out = np.zeros((*corners.shape[:2], *corners.shape[1:]))
    if corners.shape[1] == 2:
        return out
    for i in range(3):
        one, other = (i + 1) % 3, (i + 2) % 3
        a, b = corners[:, one] - corners[:, i], corners[:, other] - corners[:, i]
        la, lb = np.linalg.norm(a, axis=1, keepdims=True), np.linalg.norm(b, axis=1, keepdims=True)
        a, b = a / la, b / lb
        cosine = np.sum(a * b, axis=1, keepdims=True)
        sine = np.linalg.norm(np.cross(a, b), axis=1, keepdims=True)
        out[:, i, one], out[:, i, other] = (cosine * a - b) / (la * sine), (cosine * b - a) / (lb * sine)
        out[:, i, i] = -out[:, i, one] - out[:, i, other]
    return out


def _least_slope(a: Floats, b: Floats, da: Floats, db: Floats) -> Floats:
    """(q, d, d, j, c) derivatives of the least rotations from a to b (q, d), whose derivatives are da and db."""
    (a, da), (b, db) = _unit(a, da), _unit(b, db)
    cosine = np.sum(a * b, axis=1)
    slope_of_cosine = np.einsum("qajc,qa->qjc", da, b) + np.einsum("qajc,qa->qjc", db, a)
    outer = np.einsum("qxjc,qy->qxyjc", db, a) + np.einsum("qx,qyjc->qxyjc", b, da)
    skew, skew_slope = b[:, :, None] * a[:, None, :], outer - np.swapaxes(outer, 1, 2)
    skew = skew - np.swapaxes(skew, 1, 2)
    clear = 1.0 + cosine > 1e-6
    scale = 1.0 / np.where(clear, 1.0 + cosine, 1.0)
    both = np.einsum("qxyjc,qyz->qxzjc", skew_slope, skew) + np.einsum("qxy,qyzjc->qxzjc", skew, skew_slope)
    out = skew_slope + scale[:, None, None, None, None] * both
    out -= (scale**2)[:, None, None, None, None] * (skew @ skew)[..., None, None] * slope_of_cosine[:, None, None]
    return np.where(clear[:, None, None, None, None], out, 0.0)


def _unit(vectors: Floats, slopes: Floats) -> tuple[Floats, Floats]:
    """Unit vectors (q, d), and their derivatives from the derivatives of the vectors."""
    length = np.linalg.norm(vectors, axis=1)
    unit = vectors / length[:, None]
    across = (np.eye(vectors.shape[1]) - unit[:, :, None] * unit[:, None, :]) / length[:, None, None]
    return unit, np.einsum("qax,qxjc->qajc", across, slopes)


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
