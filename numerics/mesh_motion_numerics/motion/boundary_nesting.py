"""Detects a part of the boundary that has left the part around it, or entered another one: no valid mesh exists then.

A body that has moved wholly through a wall crosses nothing at its targets. The winding number shows on which side of a
closed part a node of another part is: how often the part goes round the node. It is the sum of the angles of the part's
segments in 2D, of the solid angles of its triangles in 3D, as a share of the full angle. No valid motion changes it.

The winding number of the whole boundary is 1 in the mesh and 0 outside of it. So it decides whether touching facets
have crossed: the mesh must be once on one side of each facet, and not twice on the other side.

References
----------
A. Van Oosterom, J. Strackee, "The solid angle of a plane triangle", IEEE Trans. Biomed. Eng. 30 (1983) 125–126.
"""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.mesh.boundary_orientation import closed_parts
from mesh_motion_numerics.mesh.points import marks_at, spread
from mesh_motion_numerics.mesh.rigid_transforms import Transform
from mesh_motion_numerics.mesh.smooth_pieces import area_vectors, as_simplices, of_one_width

#: Smallest number of tested places, spread over all: a part that has left is found by any node that is outside …
_PROBES = 16
#: … and, for a small boundary, this number of pairs of a place and a facet; they are computed in blocks of this size.
_MOST_PAIRS = 1 << 15
#: Number of touching facets that are tested, spread over all.
_MOST_TOUCHING = 64
#: … and number of places near each other that are tested together.
_TOGETHER = 32
#: Distance from a facet, relative to its size, at which its sides are tested: far above rounding, far below any gap.
_NEAR = 1e-8
#: Number of facets of which those beyond curved walls are chosen.
MOST_BEYOND = 256
#: Nodes are equally far out if they differ by less, relative to the domain …
_LEVEL = 1e-9
#: … and facets that face inwards decide if all that face outwards do so by less than this share.
_FLATTER = 0.5
#: Steps of the search for a plane between a place and a cloud of points.
_STEPS = 20
#: Barycentric places of the tests: in the corners, at the sides and in the middle.
_WHERE = {
    2: np.array([(0.999, 0.001), (0.5, 0.5), (0.001, 0.999)]),
    3: np.vstack(
        [np.roll([(0.998, 0.001, 0.001), (0.4995, 0.4995, 0.001)], k, axis=1) for k in range(3)]
        + [np.full((1, 3), 1 / 3)]
    ),
}
#: A node on the part itself has no side: its winding number is not near an integer.
_ON_IT = 0.1
#: A linear map after which a ray along the first axis meets no edge of a mesh that is parallel to the axes.
_TURN = np.array([(0.83, 0.31, 0.47), (-0.57, 0.53, 0.63), (-0.13, -0.77, 0.61)])


def misplaced_place(
    facets: Mapping[str, Integers], prescribed: Marks, moving: Integers, reference: Floats, points: Floats
) -> Floats | None:
    """The first place (d,) of a moving node on the wrong side of another part of the boundary, None if there is none.

    Parameters
    ----------
    facets : dict of (f, k) int64 arrays
        The whole boundary, pointing outwards, by type.
    prescribed : (n,) bool array
        Nodes with prescribed positions; a part with any other node is not tested.
    moving : (k,) int64 array
        Moving nodes.
    reference, points : (n, d) arrays, mesh length unit
        Before and after the motion.
    """
    if reference.shape[1] == 1 or not facets:
        return None
    rows = of_one_width(facets)
    parts, whole = closed_parts(rows, prescribed, len(points))
    chosen = spread(moving, max(_PROBES, _MOST_PAIRS // max(len(rows), 1)))
    for part in np.flatnonzero(whole):
        own = rows[parts == part]
        others, simplices = chosen[~np.isin(chosen, own)], as_simplices(own)
        if not len(others):
            continue
        rays = [_crossings(places[others], places, simplices) for places in (reference, points)]
        others = others[rays[0] != rays[1]]  # a ray is cheap, and uncertain only from a node on the part itself
        for one in others:  # mostly the first is wrong
            before, after = (_windings(places[[one]], places, own)[0] for places in (reference, points))
            sure = max(abs(each - np.round(each)) for each in (before, after)) < _ON_IT
            if sure and np.round(before) != np.round(after):
                place: Floats = points[one]
                return place
    return None


def beyond(places: Floats, around: Sequence[Floats]) -> Marks:
    """(s,) whether planes part all of the ``places`` (s, k, d) from each of some clouds of points (c, d).

    Nodes that slide on a curved wall, and the facets between them, stay in its convex hull. So the winding number of
    the boundary about a place outside of that hull does not depend on where they slide.
    """
    outside = np.ones(len(places), dtype=bool)
    for cloud in around:
        for row in np.flatnonzero(outside):
            outside[row] = _is_parted(places[row], cloud)
    return outside


def _is_parted(corners: Floats, cloud: Floats) -> bool:
    """Whether a plane between the corners (k, d) and the cloud (c, d) is found: by Gilbert's method, in a few steps."""
    place, nearest = corners.mean(axis=0), cloud.mean(axis=0)
    for _ in range(_STEPS):
        across = place - nearest
        farthest = cloud[np.argmax(cloud @ across)]
        if ((corners - farthest) @ across).min() > _NEAR * float(across @ across):
            return True
        edge = farthest - nearest
        square = float(edge @ edge)
        if square == 0.0:
            return False
        nearest = nearest + min(max(float(across @ edge) / square, 0.0), 1.0) * edge
    return False


def left_place(
    facets: Mapping[str, Integers],
    prescribed: Marks,
    moving: Integers,
    reference: Floats,
    points: Floats,
    around: Sequence[Floats] = (),
) -> Floats | None:
    """The first place (d,) of a moving wall outside the part of the boundary to which it is joined; None without one.

    A body between two planes, for example, that has passed wholly through the wall around it. Parameters as in
    :func:`misplaced_place`, which tests parts that are joined to no other. Only facets :func:`beyond` the clouds
    ``around`` are tested.
    """
    if not facets:
        return None
    rows = of_one_width(facets)
    own = marks_at(len(points) + 1, np.append(moving, -1))[rows].all(axis=1)  # the last mark is for a triangle's -1
    parts, _ = closed_parts(rows, prescribed, len(points))
    joined = np.bincount(parts, ~own) > 0
    walls = as_simplices(rows[own & joined[parts]])
    if len(around):
        walls = spread(walls, MOST_BEYOND)
        walls = walls[beyond(points[walls], around)]
    chosen = spread(walls, _PROBES)
    return contact_place(facets, chosen, prescribed, reference, points)


def passed_place(
    facets: Mapping[str, Integers],
    moving: Marks,
    still: Marks,
    generators: Sequence[Transform],
    reference: Floats,
    points: Floats,
) -> Floats | None:
    """The place (d,) of a body of a periodic domain that is farther out than all other walls; None if none is found.

    How far out a place is does not differ between its images, and no inner place of a mesh is the farthest one. So the
    farthest moving wall must have the mesh on its inner side.

    Parameters
    ----------
    facets : dict of (f, k) int64 arrays
        The whole boundary, pointing outwards, by type.
    moving, still : (n,) bool arrays
        Moving nodes; nodes on all other walls, which slide or are fixed.
    generators : sequence of Transform
    reference, points : (n, d) arrays, mesh length unit
        Before and after the motion.
    """
    rows = of_one_width(facets)
    rows = np.where(rows < 0, rows[:, :1], rows)  # triangles among quads
    walls, bodies = (marks[rows].all(axis=1) for marks in (still, moving))
    if not walls.any() or not bodies.any():
        return None
    extent = float(np.ptp(reference, axis=0).max())
    corners = reference[rows[walls]]
    size = float(np.linalg.norm(np.ptp(corners, axis=1), axis=1).max())
    nodes, normals = np.unique(rows[bodies]), area_vectors(points, rows[bodies])
    normals /= np.maximum(np.linalg.norm(normals, axis=1), np.finfo(float).tiny)[:, None]
    for (limits, _), (heights, up), slack in _ways_out(generators, reference, points, size):
        top = nodes[heights[nodes] >= heights[nodes].max() - _LEVEL * extent]
        if heights[top[0]] <= limits[still].max() + slack + _LEVEL * extent:
            continue
        at = rows[bodies]
        facing = np.einsum("fd,fkd->fk", normals, up[at])[np.isin(at, top)]
        if facing.max() < -_FLATTER * facing.min():  # at an edge the flattest facet shows the side
            return np.asarray(points[top[0]])
    return None


_Heights = tuple[Floats, Floats]


def _ways_out(
    generators: Sequence[Transform], reference: Floats, points: Floats, size: float
) -> Iterator[tuple[_Heights, _Heights, float]]:
    """Yield heights (n,) with gradients (n, d), of the places before and after a motion, that are equal for all images.

    With each comes the height by which walls with facets of this size may rise above their nodes.
    """
    d = reference.shape[1]
    if len(generators) == 1 and generators[0].turns:
        rotation, shift = generators[0].rotation, generators[0].shift
        turned = np.eye(d) - rotation
        centre = np.linalg.lstsq(turned, shift, rcond=None)[0]
        across = np.linalg.svd(turned)[2][:2]
        flat = [(places - centre) @ across.T for places in (reference, points)]
        radii = [np.linalg.norm(away, axis=1) for away in flat]
        tiny = np.finfo(float).tiny
        ups = [away / np.maximum(r, tiny)[:, None] @ across for away, r in zip(flat, radii, strict=True)]
        for sign, slack in ((1.0, 0.0), (-1.0, size)):
            yield (sign * radii[0], sign * ups[0]), (sign * radii[1], sign * ups[1]), slack
    elif not any(generator.turns for generator in generators):
        shifts = np.array([generator.shift for generator in generators])
        free = np.linalg.svd(shifts)[2][np.linalg.matrix_rank(shifts) :]
        for sign in (1.0, -1.0) if len(free) == 1 else ():
            up = np.broadcast_to(sign * free, reference.shape)
            yield (reference @ up[0], up), (points @ up[0], up), 0.0


def contact_place(
    facets: Mapping[str, Integers], touching: Integers, prescribed: Marks, reference: Floats, points: Floats
) -> Floats | None:
    """The first place (d,) where touching facets have crossed, None if there is none.

    Parameters
    ----------
    facets, prescribed, reference, points
        As in :func:`misplaced_place`.
    touching : (t, w) int64 array
        The facets to test.
    """
    if not len(touching):
        return None
    rows = of_one_width(facets)
    parts, whole = closed_parts(rows, prescribed, len(points))
    rows = rows[whole[parts]]
    touching = touching[np.isin(touching[:, 0], rows)]
    if not len(touching):  # all facets are of parts with nodes that follow
        return None
    some, simplices = as_simplices(touching), as_simplices(rows)
    some = spread(some, _MOST_TOUCHING)
    inside, outside = _sides(some, points, simplices)
    wrong = np.argwhere((inside != 1) | (outside > 1) | (outside < 0))
    for row, place in wrong:
        before = _sides(some[[row]], reference, simplices)[:, 0, place]
        if inside[row, place] != before[0] or not -1 <= outside[row, place] - before[0] <= 0:
            return np.asarray(_WHERE[points.shape[1]][place] @ points[some[row]])
    return None


def _sides(chosen: Integers, points: Floats, simplices: Integers) -> Integers:
    """(2, s, w) winding numbers of the boundary at places on both sides of chosen simplices, the mesh's side first."""
    corners = points[chosen]
    normals = area_vectors(points, chosen if corners.shape[2] == 2 else np.insert(chosen, 3, -1, axis=1))
    size = np.linalg.norm(np.ptp(corners, axis=1), axis=1) * _NEAR
    size /= np.maximum(np.linalg.norm(normals, axis=1), np.finfo(float).tiny)
    places = np.einsum("wk,skd->swd", _WHERE[points.shape[1]], corners)
    step = (normals * size[:, None])[:, None]
    both = np.stack([places - step, places + step], axis=1)
    return _crossings(both.reshape(-1, points.shape[1]), points, simplices).reshape(both.shape[:3]).swapaxes(0, 1)


def _crossings(probes: Floats, points: Floats, simplices: Integers) -> Integers:
    """(p,) winding numbers of closed simplices (s, d) at places off them: exits minus entries of a ray.

    Places that follow each other should be near each other.
    """
    d = probes.shape[1]
    used, numbers = np.unique(simplices, return_inverse=True)
    places, middle = points[used], points[used].mean(axis=0)
    probes, corners = (probes - middle) @ _TURN[:d, :d], ((places - middle) @ _TURN[:d, :d])[numbers.reshape(-1, d)]
    low, high = corners[:, :, 1:].min(axis=1), corners[:, :, 1:].max(axis=1)
    found = []
    for block in np.split(probes, range(_TOGETHER, len(probes), _TOGETHER)):
        places = block[:, 1:]
        near = np.flatnonzero(((low <= places.max(axis=0)) & (places.min(axis=0) < high)).all(axis=1))
        number, hit = np.nonzero(((low[near] <= places[:, None]) & (places[:, None] < high[near])).all(axis=2))
        # the volume of a simplex and the probe has the sign of the side on which the probe is; with the direction of
        # the ray in place of each of the simplex's corners in turn, it shows whether the ray goes through the simplex
        edges = corners[near[hit]] - block[number, None]
        side = np.sign(np.linalg.det(edges))
        through = np.ones(len(hit), dtype=bool)
        for corner in range(d):
            replaced = edges.copy()
            replaced[:, corner] = np.eye(d)[0]
            through &= np.sign(np.linalg.det(replaced)) == side
        found.append(np.bincount(number, np.where(through, side, 0.0), len(block)).astype(np.int64))
    return np.concatenate(found)


def _windings(probes: Floats, points: Floats, rows: Integers) -> Floats:
    """(p,) how often closed facets (f, w) of a mesh ``points`` (n, d) wind round each of the probes (p, d)."""
    simplices = as_simplices(rows)
    blocks = np.array_split(probes, max(1, -(-len(probes) * len(simplices) // _MOST_PAIRS)))
    return np.concatenate([_windings_of_block(block, points, simplices) for block in blocks])


def _windings_of_block(probes: Floats, points: Floats, simplices: Integers) -> Floats:
    """The same for closed simplices (s, d), all at once."""
    if probes.shape[1] == 2:
        a, b = (points[simplices[:, corner]] - probes[:, None] for corner in (0, 1))
        angles = np.arctan2(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0], np.sum(a * b, axis=2))
        return np.asarray(angles.sum(axis=1) / (2.0 * np.pi))
    a, b, c = (points[simplices[:, corner]] - probes[:, None] for corner in (0, 1, 2))
    la, lb, lc = (np.linalg.norm(edge, axis=2) for edge in (a, b, c))
    volume = np.sum(a * np.cross(b, c), axis=2)
    share = la * lb * lc + np.sum(a * b, axis=2) * lc + np.sum(b * c, axis=2) * la + np.sum(c * a, axis=2) * lb
    return np.asarray(2.0 * np.arctan2(volume, share).sum(axis=1) / (4.0 * np.pi))
