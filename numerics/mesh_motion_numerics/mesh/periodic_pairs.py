"""Pairs of periodic patches: the image of each patch, the translation or rotation, and the pairs of nodes.

A translation is found from the patches' centroids. A rotation is found from two nodes that characterise a patch (the
farthest from the centroid, and in 3D the one that spans the largest triangle with it) and every pair of nodes of the
other patch that could be their images. It is a full turn divided by an integer if that fits, else any angle, about an
axis, without a shift along it. In both cases every node must then have an image among the other patch's nodes, close
relative to the local spacing. If a patch may be paired with several, as the parts of a divided side may, the period
that most pairs have decides. A rotation by 270° has the matrix of one by −90°: the side on which the mesh is shows
which one it is, and one by more than half a turn is refused.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np
from mesh_motion_protocol.errors import InvalidInput
from scipy.spatial import cKDTree

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.mesh.neighbours import local_spacing
from mesh_motion_numerics.mesh.points import bounding_box, marks_at
from mesh_motion_numerics.mesh.revolution import about
from mesh_motion_numerics.mesh.rigid_transforms import Transform
from mesh_motion_numerics.mesh.smooth_pieces import area_vectors, widened

#: Largest error of an image, as a share of the distance to the nearest other node of its patch.
_TOLERANCE = 1e-3
#: The larger error allowed for a rotation from few nodes, before it is fitted to all nodes.
_ROUGH = 0.1
#: Largest number of sectors of a full turn.
_MOST_SECTORS = 100_000
_AXIS = 1e-9  # a direction this close to a coordinate axis is set to that axis


@dataclass(frozen=True, eq=False)
class PeriodicPair:
    """Two patches that are images of each other."""

    #: first, second: Names of the patches.
    first: str
    second: str
    transform: Transform  # Maps the first patch onto the second
    nodes: Integers  # (p, 2). Each node of the first patch and its image
    error: float  # mesh length unit. Largest distance of a transformed node from its image

    def describe(self) -> str:
        """A description: the patches, and the translation or the number of sectors between them."""
        how = f"translation by ({', '.join(f'{s:g}' for s in self.transform.shift)})"
        if self.transform.turns:
            angle, sectors = abs(self.transform.angle), self.transform.sectors
            how = f"rotation by {f'360°/{sectors}' if sectors else f'{math.degrees(angle):.6g}°'}"
        return f"{self.first} and {self.second}: {len(self.nodes)} nodes each, {how}"


@dataclass(frozen=True, eq=False)
class _Side:
    """A periodic patch: name, nodes, their positions, the spacing at each, its facets' middles and area vectors."""

    name: str
    nodes: Integers
    places: Floats
    spacing: Floats
    middles: Floats
    areas: Floats

    @property
    def area(self) -> Floats:
        """The sum of the area vectors (d,)."""
        return np.asarray(self.areas.sum(axis=0))


def periodic_pairs(
    points: Floats, facets: Mapping[str, Integers], patches: Mapping[str, Integers]
) -> tuple[PeriodicPair, ...]:
    """Pair the periodic patches.

    Raises InvalidInput if a patch has no partner (names the first node without an image, and how far the nearest node
    is from it), or if the mesh spans more than half a turn between two patches.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
    facets : dict of (f, k) int64 arrays
        The facets of the whole boundary, with outward normals, by type.
    patches : dict of (p,) int64 arrays
        Nodes of each patch with role periodic, by name.
    """
    sides = [_side(points, facets, name, np.sort(patches[name])) for name in sorted(patches)]
    _refuse_same(sides)
    pairs: list[PeriodicPair] = []
    for candidates in (_translations, _rotations):  # a box allows both, so translations are tried first
        single = [side for side in sides if not any(side.name in (pair.first, pair.second) for pair in pairs)]
        found = [
            _pair(first, second, candidates(first, second))
            for place, first in enumerate(single)
            for second in single[place + 1 :]
        ]
        pairs += _agreeing([pair for pair in found if pair], points)
    _refuse_single(sides, pairs)
    for pair in pairs:
        _refuse_wide(pair, next(side for side in sides if side.name == pair.first))
    return tuple(pairs)


def _agreeing(pairs: list[PeriodicPair], points: Floats) -> list[PeriodicPair]:
    """Of pairs that share patches, those whose period most pairs have: parts of one side have the same image."""
    left, chosen = list(pairs), []
    while left:
        alike = [[other for other in left if is_same_period(pair.transform, other.transform, points)] for pair in left]
        names = [{name for pair in group for name in (pair.first, pair.second)} for group in alike]
        most = left[max(range(len(left)), key=lambda row: len(names[row]))]  # the first of several
        chosen.append(most)
        left = [pair for pair in left if not {pair.first, pair.second} & {most.first, most.second}]
    return chosen


def is_same_period(one: Transform, other: Transform, points: Floats) -> bool:
    """Whether two transforms, or one and the inverse of the other, differ by rounding only in the box of a mesh."""
    corners = np.array(list(product(*bounding_box(points).T)))
    there = one(corners)
    reach = float(np.abs(there - corners).max())
    return any(np.abs(there - way(corners)).max() <= _TOLERANCE * reach for way in (other, other.inverse()))


def _side(points: Floats, facets: Mapping[str, Integers], name: str, nodes: Integers) -> _Side:
    places = points[nodes]
    spacing = np.full(len(nodes), float(np.ptp(points, axis=0).max()))
    if len(nodes) > 1:
        spacing = local_spacing(places)
    inside = marks_at(len(points), nodes)
    middles, areas = [np.empty((0, points.shape[1]))], [np.empty((0, points.shape[1]))]
    for block in facets.values():
        own = block[inside[block].all(axis=1)]
        filled = widened(own, 4) if own.shape[1] == 3 else own
        middles.append(points[own].mean(axis=1))
        areas.append(area_vectors(points, filled))
    return _Side(name, nodes, places, spacing, np.concatenate(middles), np.concatenate(areas))


def _images(first: _Side, second: _Side, transform: Transform) -> tuple[Floats, Integers]:
    """Distance (p,) of each transformed node of the first side to the second's nearest node, and that node's row."""
    distance, rows = cKDTree(second.places).query(transform(first.places))
    return np.asarray(distance), np.asarray(rows, dtype=np.int64)


def _pair(first: _Side, second: _Side, candidates: Iterator[Transform]) -> PeriodicPair | None:
    """The pair, with the first candidate that maps all nodes."""
    for transform in candidates:
        distance, rows = _images(first, second, transform)
        if (distance <= _TOLERANCE * first.spacing).all() and len(np.unique(rows)) == len(second.nodes):
            nodes = np.stack([first.nodes, second.nodes[rows]], axis=1)
            return PeriodicPair(first.name, second.name, transform, nodes, float(distance.max()))
    return None


def _translations(first: _Side, second: _Side) -> Iterator[Transform]:
    """The translation between the centroids, if the sides have the same number of nodes."""
    if len(first.nodes) == len(second.nodes):
        shift = second.places.mean(axis=0) - first.places.mean(axis=0)
        shift[np.abs(shift) <= _TOLERANCE * first.spacing.min()] = 0.0  # along a coordinate: that coordinate is equal
        transform = Transform.translation(shift)
        if shift.any() and _faces(transform, first.area, second.area):
            yield transform


def _rotations(first: _Side, second: _Side) -> Iterator[Transform]:
    """Rotations that may map the first side onto the second, smaller angles first, 1/N of a turn before any angle."""
    if len(first.nodes) != len(second.nodes) or first.places.shape[1] == 1:
        return
    found = []
    for rough in _rigid_candidates(first, second):
        distance, rows = _images(first, second, rough)
        if (distance <= _ROUGH * first.spacing).all() and len(np.unique(rows)) == len(rows):
            fitted = _fitted(first.places, second.places[rows])
            found += [
                turn for turn in _turns(fitted, float(first.spacing.min())) if _faces(turn, first.area, second.area)
            ]
    yield from sorted(found, key=lambda transform: abs(transform.angle))


def _faces(transform: Transform, first: Floats, second: Floats) -> bool:
    """Whether the first side's outward area vector maps to the second's inward one: the domain continues behind it."""
    if len(first) == 1:  # the ends of a line
        return True
    return float(np.linalg.norm(transform.rotation @ first + second)) <= _ROUGH * float(np.linalg.norm(second))


def _rigid_candidates(first: _Side, second: _Side) -> Iterator[Transform]:
    """Proper rigid motions that take a few characteristic nodes of the first side to nodes of the second."""
    a, b = first.places - first.places.mean(axis=0), second.places - second.places.mean(axis=0)
    reach, other = np.linalg.norm(a, axis=1), np.linalg.norm(b, axis=1)
    p = int(np.argmax(reach))
    close = _ROUGH * float(first.spacing[p])
    for q in np.flatnonzero(np.abs(other - reach[p]) <= close):
        if a.shape[1] == 2:
            yield _fitted(first.places[[p, p]] + [[0.0, 0.0], -a[p]], second.places[[q, q]] + [[0.0, 0.0], -b[q]])
            continue
        r = int(np.argmax(np.linalg.norm(np.cross(a, a[p]), axis=1)))
        alike = np.abs(other - reach[r]) <= close
        alike &= np.abs(np.linalg.norm(b - b[q], axis=1) - np.linalg.norm(a[r] - a[p])) <= close
        for s in np.flatnonzero(alike):
            centres = np.stack([first.places.mean(axis=0), second.places.mean(axis=0)])
            yield _fitted(
                np.vstack([first.places[[p, r]], centres[:1]]), np.vstack([second.places[[q, s]], centres[1:]])
            )


def _fitted(origin: Floats, goal: Floats) -> Transform:
    """The proper rigid motion that takes origin (m, d) closest to goal (m, d) (Kabsch)."""
    a, b = origin.mean(axis=0), goal.mean(axis=0)
    u, _, vt = np.linalg.svd((origin - a).T @ (goal - b))
    sign = np.ones(len(a))
    sign[-1] = np.sign(np.linalg.det(u @ vt))
    rotation = (u * sign) @ vt
    return Transform(rotation.T, b - rotation.T @ a)


def _turns(found: Transform, spacing: float) -> list[Transform]:
    """The nearest rotations by exactly 1/N of a turn and by the angle found; none if it is a screw."""
    angle = found.angle
    if abs(angle) * _MOST_SECTORS < 2.0 * math.pi:
        return []
    sectors = round(2.0 * math.pi / abs(angle))
    exact = math.copysign(2.0 * math.pi / sectors, angle)
    angles = [exact, angle] if abs(exact - angle) <= 1e-3 * abs(angle) else [angle]
    gap = np.eye(len(found.shift)) - found.rotation
    if len(found.shift) == 2:
        centre = np.linalg.solve(gap, found.shift).astype(np.float64)
        return [Transform.about(centre, turn) for turn in angles]
    axis = _axis(found.rotation)
    along = float(found.shift @ axis)
    if abs(along) > _TOLERANCE * spacing:
        return []
    centre = np.linalg.lstsq(gap, found.shift - along * axis, rcond=1e-9)[0].astype(np.float64)
    return [Transform.about(centre, abs(turn), axis) for turn in angles]


def _axis(rotation: Floats) -> Floats:
    """Unit axis (3,) about which a rotation turns anticlockwise."""
    skew = np.array([rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]])
    axis: Floats = np.linalg.svd(rotation - np.eye(3))[2][-1].astype(np.float64)
    axis = -axis if axis @ skew < 0.0 else axis
    largest = int(np.argmax(np.abs(axis)))
    if np.abs(np.delete(axis, largest)).max() < _AXIS:
        axis = np.copysign(np.eye(3)[largest], axis[largest])
    return axis


def _refuse_same(sides: list[_Side]) -> None:
    """Raise for two patches with the same nodes: a rotation that maps a side onto itself is not a period."""
    for place, first in enumerate(sides):
        for second in sides[:place]:
            if np.array_equal(first.nodes, second.nodes):
                raise InvalidInput(
                    f"the periodic patches {second.name!r} and {first.name!r} have the same nodes, the first is node "
                    f"{first.nodes[0]}",
                    code="INVALID_ARGUMENT.MESH",
                    hint="give each of the two sides a patch of its own, both with the role periodic",
                    details={"patch": second.name, "node": int(first.nodes[0])},
                )


def _refuse_wide(pair: PeriodicPair, first: _Side) -> None:
    """Raise if the mesh is on the side of the first patch that the shorter rotation to the second leaves."""
    turn = pair.transform
    if not turn.turns or turn.sectors == 2:
        return
    if np.sum(about(turn, first.middles) * first.areas) > 0.0:
        raise InvalidInput(
            f"the periodic patches {pair.first!r} and {pair.second!r} are {360.0 - math.degrees(abs(turn.angle)):.6g}° "
            "apart, measured through the mesh; expected at most half a turn",
            code="INVALID_ARGUMENT.MESH",
            hint="mesh a sector that is a whole fraction of a turn, such as 360°/7, or the whole ring",
            details={"patch": pair.first},
        )


def _refuse_single(sides: list[_Side], pairs: list[PeriodicPair]) -> None:
    """Raise for the first side without a partner."""
    taken = {name for pair in pairs for name in (pair.first, pair.second)}
    single = next((side for side in sides if side.name not in taken), None)
    if single is None:
        return
    others = [side for side in sides if side is not single and side.name not in taken]
    if not others:
        raise InvalidInput(
            f"the periodic patch {single.name!r} has no partner",
            code="INVALID_ARGUMENT.MESH",
            hint="give each of the two sides a patch of its own, both with the role periodic",
            details={"patch": single.name},
        )
    other = min(others, key=lambda side: abs(len(side.nodes) - len(single.nodes)))
    raise _unmatched(*sorted((single, other), key=lambda side: -len(side.nodes)))


def _unmatched(single: _Side, other: _Side) -> InvalidInput:
    """The error for two sides that do not map onto each other, the one with more nodes first."""
    transform = Transform.translation(other.places.mean(axis=0) - single.places.mean(axis=0))
    distance, _ = _images(single, other, transform)
    row = int(np.argmax(distance > _TOLERANCE * single.spacing))
    return InvalidInput(
        f"the periodic patches {single.name!r} ({len(single.nodes)} nodes) and {other.name!r} ({len(other.nodes)} "
        f"nodes) do not map onto each other: node {single.nodes[row]}, shifted from centroid to centroid, is "
        f"{distance[row]:.3g} from the nearest node, allowed is {_TOLERANCE * single.spacing[row]:.3g}; no rotation "
        "about an axis fits either",
        code="INVALID_ARGUMENT.MESH",
        hint="mesh the two sides alike (Gmsh: setPeriodic), or give them another role",
        details={"patch": single.name, "node": int(single.nodes[row]), "distance": float(distance[row])},
    )
