"""Ways for the moving boundary from its present to its target position; every body follows its own path.

A body is a connected part of the moving boundary. Its path is the motion of constant twist of its best rigid fit
(:mod:`.paths`): a body in rigid motion stays rigid all the way, independent of the other bodies. A body that is
attached to nodes that do not move (a flag behind a cylinder, a wing on its symmetry plane) turns about the seam.

The rigid fit does not show on which side of the domain there is room. So up to four ways are tried, in this order:

turning
    every body follows its twist; exactly half a turn is anticlockwise (2D) or about the axis with a positive largest
    component (3D)
the other way round
    bodies that turn by more than a quarter turn the other way, by the rest of the full turn
straight
    the displacement is scaled
around each other
    the centres of free bodies follow the twist of the best rigid fit of all centres, and every body turns as above:
    two bodies that exchange their places do not meet half way
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers
from mesh_motion_numerics.mesh.boundary_facets import boundary_facets
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.neighbours import connected
from mesh_motion_numerics.mesh.paths import RigidMotion, fit_rigid_motion
from mesh_motion_numerics.mesh.points import rows_among

#: Smaller angles count as no rotation, radians.
_NO_TURN = 1e-9
_NO_ORBIT = np.pi / 12  # smaller angles: the straight way is good enough


@dataclass(frozen=True, eq=False)
class Body:
    """A connected part of the moving boundary."""

    rows: Integers  # (b,). Its nodes, as rows among the moving nodes
    seam: Integers  # (s,). Its nodes that share a boundary facet with a node that does not move


@dataclass(frozen=True, eq=False)
class _Piece:
    """A body on its way.

    rows : (b,) its nodes
    rigid : its rigid motion
    remainder : (b, d) the non-rigid part of its motion, in the frame of the turning body
    detour : (rigid motion of all centres, (d,) remainder of this centre), if the centre takes another way
    """

    rows: Integers
    rigid: RigidMotion
    remainder: Floats
    detour: tuple[RigidMotion, Floats] | None = None

    def at(self, start: Floats, fraction: float) -> Floats:
        """(b, d) positions after a fraction, from ``start`` (b, d)."""
        places = self.rigid.apply(start + fraction * self.remainder, fraction)
        if self.detour is None:
            return places
        orbit, drift = self.detour
        centre = self.rigid.centre[None]
        return places + orbit.apply(centre + fraction * drift, fraction) - self.rigid.apply(centre, fraction)


@dataclass(frozen=True, eq=False)
class Way:
    """Positions of the moving nodes as a function of a fraction of the way."""

    #: origin, targets: (k, d), mesh length unit. Positions at 0 and 1, bitwise
    origin: Floats
    targets: Floats
    pieces: tuple[_Piece, ...] = ()  # bodies that turn; the other nodes go straight

    def at(self, fraction: float) -> Floats:
        """(k, d) positions after a fraction in [0, 1] of the way."""
        if fraction in {0.0, 1.0}:
            return self.targets if fraction else self.origin
        places = self.origin + fraction * (self.targets - self.origin)
        for piece in self.pieces:
            places[piece.rows] = piece.at(self.origin[piece.rows], fraction)
        return places


def moving_bodies(cells: CellTable, moving: Integers) -> tuple[Body, ...]:
    """The bodies of a mesh: moving nodes (k,) connected by boundary facets whose nodes all move.

    All moving nodes that are on no such facet form one body. Bodies are in the order of their first nodes.
    """
    facets = list(boundary_facets(cells).values())
    row_of = rows_among(1 + max(int(moving.max()), *(int(nodes.max()) for nodes in facets)), moving)
    links, seam = [], [np.empty(0, dtype=np.int64)]
    for nodes in facets:
        rows = row_of[nodes]
        whole = rows[(rows >= 0).all(axis=1)]
        links += [np.column_stack([whole[:, 0], column]) for column in whole.T]
        partly = rows[(rows < 0).any(axis=1)]
        seam.append(partly[partly >= 0])
    pairs = np.concatenate(links)
    labels = connected(len(moving), *pairs.T)
    labels[~np.isin(np.arange(len(moving)), pairs)] = -1
    _, first = np.unique(labels, return_index=True)
    on_seam = np.isin(np.arange(len(moving)), np.concatenate(seam))
    bodies = [np.flatnonzero(labels == labels[row]) for row in np.sort(first)]
    return tuple(Body(rows, rows[on_seam[rows]]) for rows in bodies)


def ways(origin: Floats, targets: Floats, bodies: tuple[Body, ...]) -> Iterator[Way]:
    """The ways to try from ``origin`` to ``targets`` (k, d), the most promising first."""
    pieces = [_piece(origin, targets, body) for body in bodies]
    turning = tuple(piece for piece in pieces if abs(piece.rigid.angle) > _NO_TURN)
    if turning:
        yield Way(origin, targets, turning)
    if any(_far(piece) for piece in turning):
        yield Way(origin, targets, tuple(_other_way(piece) if _far(piece) else piece for piece in turning))
    yield Way(origin, targets)  # the displacement is scaled
    orbiting = _around_each_other([piece for piece, body in zip(pieces, bodies, strict=True) if not len(body.seam)])
    if orbiting:
        attached = (piece for piece, body in zip(pieces, bodies, strict=True) if len(body.seam))
        yield Way(origin, targets, (*orbiting, *attached))


def _piece(origin: Floats, targets: Floats, body: Body) -> _Piece:
    """A body's rigid motion and the rest of its displacement."""
    start, goal = origin[body.rows], targets[body.rows]
    rigid = fit_rigid_motion(start, goal)
    if len(body.seam):
        centre = origin[body.seam].mean(axis=0)
        rigid = replace(rigid, centre=centre, translation=targets[body.seam].mean(axis=0) - centre)
    return _Piece(body.rows, rigid, (goal - rigid.apply(start)) @ rigid.rotation)


def _far(piece: _Piece) -> bool:
    """Whether a body turns by more than a quarter turn, so that the other direction is also tried."""
    return abs(piece.rigid.angle) > np.pi / 2


def _around_each_other(pieces: list[_Piece]) -> tuple[_Piece, ...]:
    """The same end positions, with the centres on their common twist; empty if they do not turn about each other."""
    if len(pieces) < 2:
        return ()
    centres = np.array([piece.rigid.centre for piece in pieces])
    goals = centres + np.array([piece.rigid.translation for piece in pieces])
    orbit = fit_rigid_motion(centres, goals)
    if abs(orbit.angle) <= _NO_ORBIT:
        return ()
    drifts = (goals - orbit.apply(centres)) @ orbit.rotation
    return tuple(replace(piece, detour=(orbit, drift)) for piece, drift in zip(pieces, drifts, strict=True))


def _other_way(piece: _Piece) -> _Piece:
    """The same end position, reached in the other direction by the rest of the full turn."""
    angle = piece.rigid.angle
    return replace(piece, rigid=replace(piece.rigid, angle=angle - np.copysign(2.0 * np.pi, angle)))
