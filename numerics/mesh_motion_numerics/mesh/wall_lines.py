"""The lines along which sliding nodes move: in 2D the walls, in 3D the edges where two walls meet.

The nodes of a line keep their order between the nodes with known positions: the ends, and nodes that other parts place.
So no node passes the end of its wall.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mesh_motion_numerics.arrays import Floats, Integers, Marks
from mesh_motion_numerics.mesh.closest_point import FacetSet
from mesh_motion_numerics.mesh.smooth_pieces import Piece, sides

__all__ = ["WallLine", "wall_lines"]


#: A spacing is at least this share of its value in an evenly stretched line.
_LEAST = 0.1
#: … and at least this share on a curved one, where the smooth correction moves no node.
_LEAST_CURVED = 0.3
#: Nodes this close to a straight line are on it, relative to its length.
_ON_LINE = 1e-6


@dataclass(frozen=True, eq=False)
class WallLine:
    """Nodes (m,) in their order along a line, its ends included, at places (m, d) in the reference mesh."""

    nodes: Integers
    places: Floats

    def in_order(self, positions: Floats, known: Marks) -> Floats:
        """The positions (m, d) of the nodes on the line, in order between the ``known`` (m,) nodes.

        A part in which a spacing is too small is mixed with the evenly stretched part, as little as possible. All other
        nodes keep their bits.
        """
        rest, now = self._lengths(self.places), self._lengths(positions)
        out, fixed, limit = now.copy(), np.flatnonzero(known), _LEAST if self._straight else _LEAST_CURVED
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
        if self._straight:
            return np.asarray((positions - self.places[0]) @ (steps[0] / size[0]))
        corners = np.stack([self.places[:-1], self.places[1:]], axis=1)
        near, rows = FacetSet(corners).nearest(positions)
        before = np.concatenate([[0.0], np.cumsum(size)])
        return np.asarray(before[rows] + np.linalg.norm(near - corners[rows, 0], axis=1))

    def _places_at(self, lengths: Floats) -> Floats:
        """(m, d) places at lengths (m,) along the line."""
        if self._straight:
            step = self.places[1] - self.places[0]
            return np.asarray(self.places[0] + lengths[:, None] * step / np.linalg.norm(step))
        rest = self._lengths(self.places)
        return np.stack([np.interp(lengths, rest, column) for column in self.places.T], axis=1)

    @property
    def _straight(self) -> bool:
        away = self.places - self.places[0]
        along = away[-1] / np.linalg.norm(away[-1])
        off = away - np.outer(away @ along, along)
        return bool(np.abs(off).max() <= _ON_LINE * np.linalg.norm(away[-1]))


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
