"""Interpolation that repeats with a periodic domain: each control point represents all its images.

With the group of the periodic images x → R_k x + s_k, thesis (2.1) becomes

    s(x) = Σ_j Σ_k R_k γ_j φ(|x − R_k x_j − s_k|/R),

which turns and repeats exactly like the domain: s(R_k x + s_k) = R_k s(x). So the displacement is as smooth across a
periodic side as in the interior. The matrix has one unknown per control point (times d if images turn), is symmetric,
and positive definite if the basis is. The support must be compact, so that the number of images is finite: those that
come closer than R to a point of evaluation.

If control points are so close to each other or to an image that the matrix would be singular, they are interpolated by
narrower levels, and a first level may be smoothed, as on other boundaries (:mod:`.two_scale.factorization`).
"""

import hashlib
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import mesh_motion_kernels as kernels
import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.spatial import cKDTree

from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.interpolation import evaluation
from mesh_motion_numerics.interpolation.assembly import dense_block, sparse_matrix
from mesh_motion_numerics.interpolation.centres import CentreLayout
from mesh_motion_numerics.interpolation.control_points import checked_control_points
from mesh_motion_numerics.interpolation.factor_source import FactorSource
from mesh_motion_numerics.interpolation.factorizations import LinearSolver
from mesh_motion_numerics.interpolation.factorizations.dense import PanelCholesky
from mesh_motion_numerics.interpolation.factorizations.sparse import SparseFactor
from mesh_motion_numerics.interpolation.interpolant import Factorization, Interpolant
from mesh_motion_numerics.interpolation.kernels import Basis, basis_named, checked_radius
from mesh_motion_numerics.interpolation.two_scale.compact_levels import (
    BASIS,
    LEVEL_RADII,
    LEVEL_RATIO,
    nested_members,
    scales_of_all,
)
from mesh_motion_numerics.interpolation.two_scale.factorization import SEPARATION
from mesh_motion_numerics.interpolation.two_scale.interpolant import TwoScaleInterpolant
from mesh_motion_numerics.interpolation.two_scale.smoothing import Smoothing
from mesh_motion_numerics.mesh.neighbours import local_spacing
from mesh_motion_numerics.mesh.open_sector import OpenSector
from mesh_motion_numerics.mesh.points import padded
from mesh_motion_numerics.mesh.rigid_transforms import Transform, generated_group
from mesh_motion_numerics.method import Method

#: Largest order that is factorized densely; above it the matrix is assembled sparse.
_DENSE_ORDER = 10_000
#: Columns of images that are assembled at once.
_IMAGES_AT_ONCE = 2048
#: An image this close to its control point, relative to the extent of all images, coincides with it.
_SAME_PLACE = 1e-12


class _Group(NamedTuple):
    """The generators of the images, and their sector if its angle is not a whole fraction of a turn."""

    generators: tuple[Transform, ...]
    sector: OpenSector | None


@dataclass(frozen=True, eq=False)
class _Images:
    """The images in use: the control point of each, its place, and the rotation of its weight.

    owners : (i,) int64 array
    places : (i, d) array
    rotations : (i, d, d) array, or None where nothing turns
    """

    owners: Integers
    places: Floats
    rotations: Floats | None


@dataclass(frozen=True, eq=False)
class PeriodicFactorization:
    """A prepared matrix of periodic control points; a :class:`Factorization`."""

    control_points: Floats  # (nc, d), mesh length unit. One control point of each orbit
    basis: Basis
    support_radius: float  # mesh length unit
    images: _Images
    layout: CentreLayout
    system: LinearSolver

    def solve(self, values: Floats) -> Interpolant:
        """Return the interpolant of (nc, d) values at the control points."""
        values = np.asarray(values, dtype=np.float64)
        images = self.images
        if images.rotations is None:
            weights = self.system.solve(values)[images.owners]
        else:
            own = self.system.solve(values.reshape(-1, 1)).reshape(values.shape)
            weights = np.einsum("iab,ib->ia", images.rotations, own[images.owners])
        return Interpolant(images.places, weights, self.basis, self.support_radius, self.layout)


def periodic_factorization_of(
    control_points: Floats,
    generators: tuple[Transform, ...],
    box: Floats,
    method: Method,
    factors: FactorSource,
    sector: OpenSector | None = None,
    smoothing: Smoothing | None = None,
    moving: Marks | None = None,
) -> Factorization:
    """Return the factorization of periodic control points.

    Parameters
    ----------
    control_points : (nc, d) array, mesh length unit
        One control point of each orbit.
    box : (2, d) array
        Least and largest coordinates of the points where the interpolant will be evaluated.
    sector : OpenSector, optional
        That of the generators.
    smoothing : Smoothing, optional
        Of the first level, with the ``moving`` (nc,) control points.
    """
    digest = hashlib.sha256(repr(("periodic", method.basis, method.support_radius, smoothing)).encode())
    moving = np.ones(len(control_points), dtype=bool) if moving is None or not moving.any() else moving
    for array in (control_points, box, moving, *(a for g in generators for a in (g.rotation, g.shift))):
        digest.update(np.ascontiguousarray(array).data)

    def made() -> Factorization:
        return _factorize(control_points, _Group(generators, sector), box, method, smoothing, moving)

    return factors.get_or_make(digest.digest(), made)[0]


def _factorize(
    control_points: Floats, group: _Group, box: Floats, method: Method, smoothing: Smoothing | None, moving: Marks
) -> Factorization:
    basis = basis_named(method.basis)
    radius = checked_radius(method.support_radius, basis)
    points = checked_control_points(control_points)
    images = _near_images(points, group, box, radius)
    tree = cKDTree(images.places)
    pairs = images.owners[tree.query_pairs(SEPARATION * radius, output_type="ndarray")]
    single = not np.any(pairs[:, 0] != pairs[:, 1])
    if single and smoothing is None:
        return _level(points, images, basis, radius)
    none = np.empty(0, dtype=np.int64)
    first = np.arange(len(points)) if single else _separated(images, len(points), SEPARATION * radius, none)
    near = images if single else _near_images(points[first], group, box, radius)
    shares = None
    if smoothing is not None:  # all images count as nodes of the wall
        shares = smoothing.shares(basis, radius, near.places, local_spacing(near.places))[: len(first)]
    levels = [(first, _level(points[first], near, basis, radius, shares))]
    if smoothing is None:
        scale, radii = SEPARATION * radius / LEVEL_RATIO, LEVEL_RADII[points.shape[1]]
        scales = scale, scale
    else:
        scales, radii = scales_of_all(local_spacing(points), moving), smoothing.radii
    separated = partial(_separated, images, len(points))
    held = first if smoothing is None else none
    for scale, members in nested_members(len(points), _closest(images), scales, held, separated):
        reach = min(radii * scale, radius)  # a sector may allow no larger radius
        near = _near_images(points[members], group, box, reach)
        levels.append((members, _level(points[members], near, BASIS, reach)))
    return PeriodicLevels(points, levels)


def _closest(images: _Images) -> float:
    """Smallest distance of a control point from another one, or from an image of another one."""
    tree, count = cKDTree(images.places), int(np.bincount(images.owners).max()) + 1
    distance, near = tree.query(images.places, k=min(count, len(images.owners)))
    return float(distance[images.owners[near] != images.owners[:, None]].min())


def _separated(images: _Images, count: int, separation: float, first: Integers) -> Integers:
    """Control points of ``count``, ascending, that are not near others or their images; ``first`` (f,) come first."""
    rank = np.empty(count, dtype=np.int64)
    rank[np.concatenate([first, np.setdiff1d(np.arange(count), first)])] = np.arange(count)
    near = cKDTree(images.places).query_pairs(separation, output_type="ndarray")
    pairs = np.unique(np.sort(rank[images.owners[near]], axis=1), axis=0)
    taken = np.full(count, True)
    kernels.drop_followers(pairs[pairs[:, 0] != pairs[:, 1]], taken)
    return np.flatnonzero(taken[rank])


def _level(
    points: Floats, images: _Images, basis: Basis, radius: float, smoothing: Floats | None = None
) -> PeriodicFactorization:
    """Return the interpolation from all of some control points (nc, d), with λ (nc,) added to the diagonal."""
    layout = CentreLayout.build(images.places, basis, radius)
    order = points.size if images.rotations is not None else len(points)
    make = _sparse if order > _DENSE_ORDER else _dense
    more = _braces(points, images)
    if smoothing is not None:
        more += smoothing[:, None, None] * np.eye(more.shape[1])
    system = make(points, images, layout, basis=basis, radius=radius, more=more)
    return PeriodicFactorization(points, basis, radius, images, layout, system)


@dataclass(frozen=True, eq=False)
class PeriodicLevels:
    """Prepared matrices of periodic control points, widest first; a :class:`Factorization`."""

    control_points: Floats  # (nc, d), mesh length unit. One control point of each orbit
    #: Members (m,) and factorization of each level; the last one has all control points.
    levels: list[tuple[Integers, PeriodicFactorization]]

    def solve(self, values: Floats) -> TwoScaleInterpolant:
        """Return the interpolant of (nc, d) values at the control points."""
        left, found = np.array(values, dtype=np.float64), []
        for members, level in self.levels:
            found.append(level.solve(left[members]))
            left -= evaluation.displacement(found[-1], self.control_points)
        return TwoScaleInterpolant(found[0], tuple(found[1:]))


def _near_images(points: Floats, group: _Group, box: Floats, radius: float) -> _Images:
    """The images closer to the box than the radius; the control points (nc, d) themselves come first."""

    def near(transform: Transform) -> Marks:
        places = transform(points)
        away = np.maximum(np.maximum(box[0] - places, places - box[1]), 0.0)
        return np.asarray(np.sum(away * away, axis=1) < radius * radius)

    d = points.shape[1]
    scale = float((box[1] - box[0]).max())
    turns = [Transform.identity(d)] if group.sector is None else group.sector.turns(radius)
    closed = group.generators if group.sector is None else group.sector.others
    found = generated_group(closed, d, scale, lambda one: any(near(turn.after(one)).any() for turn in turns))
    found = [turn.after(one) for one in found for turn in turns]
    kept = [np.ones(len(points), dtype=bool), *(near(transform) for transform in found[1:])]
    owners = np.concatenate([np.flatnonzero(rows) for rows in kept])
    places = np.concatenate([points, *(t(points[rows]) for t, rows in zip(found[1:], kept[1:], strict=True))])
    rotations = None
    if any(transform.turns for transform in group.generators):
        counts = [int(np.count_nonzero(rows)) for rows in kept]
        rotations = np.repeat(np.stack([transform.rotation for transform in found]), counts, axis=0)
    return _Images(owners, places, rotations)


def _dense(
    points: Floats, images: _Images, layout: CentreLayout, *, basis: Basis, radius: float, more: Floats
) -> LinearSolver:
    """Cholesky factor of the matrix, of order nc or nc · d, with blocks ``more`` (nc, 1, 1) or (nc, d, d) added."""
    del layout
    rows, width = padded(points), 1 if images.rotations is None else points.shape[1]
    by_owner = np.argsort(images.owners, kind="stable")
    starts = np.searchsorted(images.owners[by_owner], np.arange(len(points) + 1))
    places = padded(images.places)

    def columns(low: int, high: int, bottom: int) -> Floats:
        """Columns of the control points low … high, from the rows of ``bottom`` down."""
        chosen = by_owner[starts[low] : starts[high]]
        values = dense_block(basis, radius, rows[bottom:], places[chosen])
        groups = starts[low:high] - starts[low]
        if images.rotations is None:
            return np.asarray(np.add.reduceat(values, groups, axis=1))
        turned = values[:, None, :, None] * np.swapaxes(images.rotations[chosen], 0, 1)[None]
        return np.asarray(np.add.reduceat(turned, groups, axis=2).reshape(len(values) * width, -1))

    def panel(first: int, last: int) -> Floats:
        """Columns first … last of the matrix, from the diagonal down."""
        low, high = first // width, -(-last // width)
        share = max(1, _IMAGES_AT_ONCE * len(points) // len(images.owners))
        parts = [columns(at, min(at + share, high), low) for at in range(low, high, share)]
        block = np.concatenate(parts, axis=1)
        own = np.arange((high - low) * width).reshape(-1, width)
        block[own[:, :, None], own[:, None, :]] += more[low:high]
        skip = first - low * width
        return np.ascontiguousarray(block[skip:, skip : skip + last - first])

    return PanelCholesky(len(points) * width, panel)


def _braces(points: Floats, images: _Images) -> Floats:
    """(nc, d, d) stiffness of control points on an axis, in the directions in which their images cancel each other.

    (nc, 1, 1) zeros if no image turns.
    """
    d = 1 if images.rotations is None else points.shape[1]
    found = np.zeros((len(points), d, d))
    if images.rotations is None:
        return found
    here = np.flatnonzero(
        np.linalg.norm(images.places - points[images.owners], axis=1) <= _SAME_PLACE * np.ptp(images.places)
    )
    several, counts = np.unique(images.owners[here], return_counts=True)
    for j in several[counts > 1]:
        total = images.rotations[here[images.owners[here] == j]].sum(axis=0)
        sizes, directions = np.linalg.eigh(0.5 * (total + total.T))
        lost = directions[:, sizes < 0.5]
        found[j] = lost @ lost.T
    return found


def _sparse(
    points: Floats, images: _Images, layout: CentreLayout, *, basis: Basis, radius: float, more: Floats
) -> LinearSolver:
    """Factors of the sparse matrix, as :func:`_dense`."""
    nc = len(points)
    among = sparse_matrix(layout, basis, radius).tocoo()
    row, column = layout.order[among.row], layout.order[among.col]
    kept = row < nc  # the first images are the control points themselves
    row, column, values = row[kept], column[kept], among.data[kept]
    owners = images.owners[column]
    width = more.shape[1]
    turned = values[:, None, None] * (1.0 if images.rotations is None else images.rotations[column])
    own = np.arange(nc)
    row, owners = np.concatenate([row, own]), np.concatenate([owners, own])
    a, b = np.indices((width, width))
    rows, columns = row[:, None, None] * width + a, owners[:, None, None] * width + b
    entries = np.concatenate([turned, more]).ravel(), (rows.ravel(), columns.ravel())
    return SparseFactor(csr_array(coo_array(entries, shape=(nc * width, nc * width))), np.arange(nc * width))
