"""The lines along which sliding nodes move: in 2D the walls, in 3D the edges where two walls meet.

The nodes of a line keep their order between the nodes with known positions: the ends, and nodes that other parts place.
So no node passes the end of its wall. Spacings on a curved line change less, because the smooth correction moves no
node there: each node goes half of the way from the evenly stretched line to where it would follow the body.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.mesh.closest_point import FacetSet
from mesh_motion_numerics.mesh.smooth_pieces import Piece, sides
from mesh_motion_numerics.mesh.surface_constraints import OnFacets

#: A spacing is at least this share of its value in an evenly stretched line.
_LEAST = 0.1
#: … and at least this share on a curved one, where the smooth correction moves no node.
_LEAST_CURVED = 0.3
#: Share of an even stretch in the motion of a curved line.
_EVEN = 0.5
#: A place this close to a corner of a line is at the corner, relative to the line's length.
_ON_CORNER = 1e-12
#: Nodes this close to a straight line are on it, relative to its length.
_ON_LINE = 1e-6


@dataclass(frozen=True, eq=False)
class WallLine:
    """Nodes (m,) in their order along a line, its ends included, at places (m, d) in the reference mesh.

    ``keeps_order``: whether nodes may not come too close to each other.
    """

    nodes: Integers
    places: Floats
    keeps_order: bool = True

    def in_order(self, positions: Floats, known: Marks) -> Floats:
        """The positions (m, d) of the nodes on the line, in order between the ``known`` (m,) nodes.

        A part in which a spacing is too small is mixed with the evenly stretched part, as little as possible. All other
        nodes keep their bits.
        """
        if not self.keeps_order:
            return positions
        rest, now = self._at_rest, self._lengths(positions)
        out, fixed, limit = now.copy(), np.flatnonzero(known), _LEAST if self.is_straight else _LEAST_CURVED
        for a, b in pairwise(fixed):
            part = slice(a, b + 1)
            even = now[a] + (now[b] - now[a]) * (rest[part] - rest[a]) / (rest[b] - rest[a])
            least = float(np.min(np.diff(now[part]) / np.diff(even))) if now[b] > now[a] else 1.0
            if least < limit:
                share = (limit - least) / (1.0 - least)
                out[part] = now[part] + share * (even - now[part])
        changed = (out != now) & ~known
        return np.where(changed[:, None], self._places_at(out), positions)

    def _lengths(self, positions: Floats) -> Floats:
        """(m,) lengths along the line to positions (m, d) on it; a straight line continues beyond its ends."""
        steps = np.diff(self.places, axis=0)
        size = np.linalg.norm(steps, axis=1)
        if self.is_straight:
            return np.asarray((positions - self.places[0]) @ (steps[0] / size[0]))
        near, rows = self._segments.nearest(positions)
        before = np.concatenate([[0.0], np.cumsum(size)])
        return np.asarray(before[rows] + np.linalg.norm(near - self.places[rows], axis=1))

    @cached_property
    def _at_rest(self) -> Floats:
        """(m,) lengths along the line to its nodes in the reference mesh."""
        return self._lengths(self.places)

    @cached_property
    def _segments(self) -> FacetSet:
        return FacetSet(np.stack([self.places[:-1], self.places[1:]], axis=1))

    def _places_at(self, lengths: Floats) -> Floats:
        """(m, d) places at lengths (m,) along the line."""
        if self.is_straight:
            step = self.places[1] - self.places[0]
            return np.asarray(self.places[0] + lengths[:, None] * step / np.linalg.norm(step))
        return np.stack([np.interp(lengths, self._at_rest, column) for column in self.places.T], axis=1)

    def _directions(self, lengths: Floats) -> Floats:
        """(…, d) directions of the line at lengths (…) along it; at a corner the mean of both sides."""
        steps, rest = np.diff(self.places, axis=0), self._at_rest
        steps /= np.linalg.norm(steps, axis=1)[:, None]
        near = _ON_CORNER * rest[-1]
        sides = (np.searchsorted(rest[1:-1], lengths + off) for off in (near, -near))
        return np.asarray(np.mean([steps[side] for side in sides], axis=0))

    @cached_property
    def curve(self) -> OnFacets:
        """The line as a constraint, which changes smoothly with a node's place."""
        rows = np.arange(len(self.nodes))
        return OnFacets.from_simplices(self.places, np.column_stack([rows[:-1], rows[1:]]))

    @cached_property
    def is_straight(self) -> bool:
        """Whether all its nodes are on one straight line in the reference mesh."""
        away = self.places - self.places[0]
        along = away[-1] / np.linalg.norm(away[-1])
        off = away - np.outer(away @ along, along)
        return bool(np.abs(off).max() <= _ON_LINE * np.linalg.norm(away[-1]))


@dataclass(frozen=True, eq=False)
class EvenedLine:
    """A curved ``line`` after a motion of which half is an even stretch, and the derivative."""

    line: WallLine
    positions: Floats  # (m, d), mesh length unit. Those of the line's nodes without the stretch
    rows: Integers  # (k,). Those of the line's nodes that are between known ones
    places: Floats  # (k, d), mesh length unit. Their positions after the motion
    lengths: Floats  # (k,). Lengths along the line to these places
    lengths_without: Floats  # (m,). Lengths along the line to all nodes without the stretch
    #: ends, shares: (k, 2). Rows of the known nodes before and after each of them, and the shares of their motion in
    #: its own
    ends: Integers
    shares: Floats

    @classmethod
    def build(cls, line: WallLine, before: Floats, positions: Floats, known: Marks) -> EvenedLine:
        """Build it for a motion of the line's nodes from ``before`` to ``positions`` (m, d), ``known`` (m,) or not."""
        curve, fixed = line.curve, np.flatnonzero(known)
        begin, now = (line._lengths(curve.project(at, at)) for at in (before, positions))
        rows = np.flatnonzero(~known)
        after = np.searchsorted(fixed, rows)
        inner = (after > 0) & (after < len(fixed))
        rows, after = rows[inner], after[inner]
        ends = np.stack([fixed[after - 1], fixed[after]], axis=1)
        rest = line._at_rest
        part = (rest[rows] - rest[ends[:, 0]]) / (rest[ends[:, 1]] - rest[ends[:, 0]])
        shares = _EVEN * np.stack([1.0 - part, part], axis=1)
        moved = now - begin
        own = (1.0 - _EVEN) * moved[rows] + np.sum(shares * moved[ends], axis=1)
        lengths = begin[rows] + own
        stays = lengths == now[rows]
        places = np.where(stays[:, None], positions[rows], line._places_at(lengths))
        return cls(line, positions, rows, places, lengths, now, ends, shares)

    @property
    def nodes(self) -> Integers:
        """(k,) mesh nodes of the rows."""
        return self.line.nodes[self.rows]

    @cached_property
    def along(self) -> Floats:
        """(k, d) the line's direction at each place."""
        return self.line._directions(self.lengths)

    @cached_property
    def turns(self) -> Floats:
        """(k, d, d) from the directions of the motion without the stretch to those with it."""
        without = self.lengths_without[self.rows]
        turns = self.along[:, :, None] * self.line._directions(without)[:, None, :]
        turns[self.lengths == without] = np.eye(turns.shape[1])
        return np.asarray((1.0 - _EVEN) * turns)

    @cached_property
    def at_ends(self) -> Floats:
        """(k, 2, d) the line's directions at the known nodes."""
        slopes = self.line.curve.slope(self.positions, self.positions)[self.ends]
        return np.asarray(np.einsum("ked,kedc->kec", self.line._directions(self.lengths_without[self.ends]), slopes))

    def apply(self, rows: Floats) -> None:
        """Replace the velocities without the stretch by those with it, in ``rows`` (n, d) of all nodes."""
        ends = np.sum(self.shares * np.einsum("ked,ked->ke", self.at_ends, rows[self.line.nodes[self.ends]]), axis=1)
        rows[self.nodes] = np.einsum("kij,kj->ki", self.turns, rows[self.nodes]) + ends[:, None] * self.along

    def transpose(self, rows: Floats) -> None:
        """Do the transpose of :meth:`apply`."""
        weights = rows[self.nodes]
        rows[self.nodes] = np.einsum("kij,ki->kj", self.turns, weights)
        ends = np.einsum("ki,ki->k", self.along, weights)[:, None] * self.shares
        np.add.at(rows, self.line.nodes[self.ends], ends[:, :, None] * self.at_ends)


def wall_lines(points: Floats, pieces: Sequence[Piece], freedom: Integers) -> tuple[WallLine, ...]:
    """The lines of the nodes that slide along one. A closed line has no end and keeps no order: it is left out.

    Parameters
    ----------
    points : (n, d) array, mesh length unit
    pieces : sequence of Piece
        The pieces of all walls.
    freedom : (n,) int64 array
        Dimension of the space of directions in which each sliding node may move; 0 for other nodes.
    """
    sliding = freedom == 1
    found, left = [], _neighbours(pieces, freedom)
    for start in sorted(left):
        if sliding[start] and len(left[start]) > 1:
            continue  # not an end
        while left[start]:
            nodes = [start]
            while left[nodes[-1]] and (len(nodes) == 1 or sliding[nodes[-1]]):
                after = min(left[nodes[-1]])
                left[nodes[-1]].remove(after)
                left[after].remove(nodes[-1])
                nodes.append(after)
            found.append(WallLine(np.array(nodes), points[nodes]))
    return tuple(found)


def _neighbours(pieces: Sequence[Piece], freedom: Integers) -> Mapping[int, set[int]]:
    """The neighbours of each node along the lines."""
    width = max((piece.facets.shape[1] for piece in pieces), default=1)
    if width == 1:
        return {}
    edges = np.concatenate([p.facets if width == 2 else np.unique(sides(p.facets)[0], axis=0) for p in pieces])
    edges, counts = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
    lines = edges[(counts >= width / 2) & (freedom[edges].max(axis=1) == 1)]  # in 3D a line belongs to two walls
    out: dict[int, set[int]] = {}
    for a, b in lines.tolist():
        out.setdefault(a, set()).add(b)
        out.setdefault(b, set()).add(a)
    return out
