"""Grids about aerofoils and wings with the extremes of real grids: far fields, thin first cells, sharp edges, clusters.

All come from analytic maps, so that the mesh is valid for any far field and any first cell. Lengths are in chords.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from mesh_motion_numerics.mesh.roles import Patch
from numpy.typing import NDArray

__all__ = ["TRAILING_EDGES", "Grid", "c_grid", "h_grid", "o_grid", "wing"]

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


class Grid(NamedTuple):
    """Points (n, d), cells by type, and the nodes of body, far boundary and, for a wing, the planes at its ends."""

    points: Floats
    cells: dict[str, Indices]
    body: Indices
    far: Indices
    ends: Indices | None = None

    @property
    def patches(self) -> dict[str, Patch]:
        """The body moves, the far boundary rests, nodes slide on the planes."""
        found = {"body": Patch("moving", self.body), "far": Patch("fixed", self.far)}
        return found if self.ends is None else {**found, "ends": Patch("slip", self.ends)}


#: Exponent of the Kármán–Trefftz map (2 − angle of the edge / π), and how far the circle passes outside the edge.
TRAILING_EDGES = {"cusped": (2.0, 1e-3), "sharp": (1.9, 0.0), "blunt": (2.0, 2e-2)}


def _stretched(count: int, first: float, last: float) -> Floats:
    """0, first, … last: geometric steps, ``count`` of them."""
    low, high = 1.0 + 1e-9, 4.0
    for _ in range(200):
        ratio = 0.5 * (low + high)
        low, high = (ratio, high) if first * (ratio**count - 1.0) / (ratio - 1.0) < last else (low, ratio)
    steps = first * (low ** np.arange(1, count + 1) - 1.0) / (low - 1.0)
    return np.concatenate([[0.0], steps[:-1], [last]])


def _quads(rows: int, columns: int, *, closed: bool) -> Indices:
    """(m, 4) quads of nodes numbered row by row; positively oriented if columns go round and rows outwards."""
    j, i = np.meshgrid(np.arange(rows - 1), np.arange(columns - (not closed)), indexing="ij")
    after = (i + 1) % columns
    return np.stack(
        [j * columns + i, (j + 1) * columns + i, (j + 1) * columns + after, j * columns + after], -1
    ).reshape(-1, 4)


def o_grid(edge: str = "sharp", *, around: int = 160, layers: int = 40, first: float = 1e-5, far: float = 50.0) -> Grid:
    """Conformal O-grid of a Kármán–Trefftz aerofoil with a trailing edge of :data:`TRAILING_EDGES`.

    ``first`` is the first cell's height at mid-chord, ``far`` the far boundary's radius.
    """
    power, outside = TRAILING_EDGES[edge]
    centre = complex(-0.08, 0.04)
    radius = abs(1.0 + outside - centre)
    begin = np.angle(1.0 + outside - centre)
    angle = begin + 2.0 * np.pi * np.arange(around) / around
    at = _stretched(layers, first, math.log(far))
    zeta = centre + radius * np.exp(at)[:, None] * np.exp(1j * angle)[None]
    # the powers are taken continuously round the circle
    ahead = np.abs(zeta + 1.0) ** power * np.exp(1j * power * np.unwrap(np.angle(zeta + 1.0), axis=1))
    behind = np.abs(zeta - 1.0) ** power * np.exp(1j * power * np.unwrap(np.angle(zeta - 1.0), axis=1))
    z = power * (ahead + behind) / (ahead - behind)
    z /= np.ptp(z[0].real)
    points = np.column_stack([z.real.ravel(), z.imag.ravel()])
    n = around
    return Grid(
        points, {"quad": _quads(layers + 1, n, closed=True)}, np.arange(n), np.arange(layers * n, (layers + 1) * n)
    )


def c_grid(
    edge: str = "sharp", *, around: int = 128, wake: int = 32, layers: int = 48, first: float = 1e-5, far: float = 500.0
) -> Grid:
    """C-grid of a symmetric aerofoil, twelve in a hundred thick, by a parabolic map: z = (ξ + iη)².

    The grid lines get closer in the wake, down to the first cell's height at the far boundary.
    """
    along = np.cos(np.pi * np.arange(around + 1) / around)[::-1]
    behind = 1.0 + _stretched(wake, 2.0 / around**2, math.sqrt(far) - 1.0)[1:]
    xi = np.concatenate([behind[::-1], along[::-1], -behind])
    power = {"cusped": 1.5, "sharp": 1.0}[edge]
    thickness = np.where(np.abs(xi) <= 1.0, 0.08 * (1.0 - xi**2).clip(0.0) ** power, 0.0)
    eta = _stretched(layers, first / 1.4, math.sqrt(far))
    w = xi[None, :] + 1j * (thickness[None, :] + eta[:, None] * (1.0 - thickness[None, :] / math.sqrt(far)))
    z = (w**2).reshape(-1)
    columns = len(xi)
    quads = _quads(layers + 1, columns, closed=False)
    number = np.arange(len(z))
    number[columns - 1 - np.arange(wake + 1)] = np.arange(wake + 1)  # the wake's nodes are met from both sides
    used, renumbered = np.unique(number, return_inverse=True)
    points = np.column_stack([z.real, z.imag])[used]
    grid = np.arange(len(z)).reshape(layers + 1, columns)
    far_nodes = np.unique(renumbered[np.concatenate([grid[-1], grid[:, 0], grid[:, -1]])])
    body = np.unique(renumbered[grid[0, wake : wake + around + 1]])
    return Grid(points, {"quad": renumbered[quads]}, body, far_nodes)


def h_grid(*, along: int = 60, layers: int = 40, first: float = 1e-5, far: float = 100.0) -> Grid:
    """H-grid of a plate without thickness from (0, 0) to (1, 0): its nodes are double, except at the two edges."""
    plate = 0.5 - 0.5 * np.cos(np.pi * np.arange(along + 1) / along)
    outside = _stretched(layers, plate[1], far)[1:]
    x = np.concatenate([-outside[::-1], plate, 1.0 + outside])
    up = _stretched(layers, first, far)
    y = np.concatenate([-up[:0:-1], up])
    columns, rows = len(x), len(y)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    grid = np.arange(rows * columns).reshape(rows, columns)
    wall = grid[layers, layers : layers + along + 1]
    upper = wall[1:-1]
    lower = len(points) + np.arange(len(upper))
    quads = np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]], axis=-1)
    below = quads[:layers].reshape(-1, 4)
    renumbered = np.arange(len(points))
    renumbered[upper] = lower
    quads = np.concatenate([renumbered[below], quads[layers:].reshape(-1, 4)])
    far_nodes = np.unique(np.concatenate([grid[0], grid[-1], grid[:, 0], grid[:, -1]]))
    return Grid(np.vstack([points, points[upper]]), {"quad": quads}, np.concatenate([wall, lower]), far_nodes)


def wing(section: Grid, stations: int = 24, span: float = 6.0, taper: float = 0.4) -> Grid:
    """Hexahedra between sections that taper along z."""
    z = span * (np.arange(stations) / (stations - 1.0))
    scale = 1.0 - (1.0 - taper) * z / span
    n = len(section.points)
    points = np.concatenate(
        [np.column_stack([s * section.points, np.full(n, at)]) for s, at in zip(scale, z, strict=True)]
    )
    quads = section.cells["quad"]
    hexahedra = np.concatenate([np.hstack([quads + k * n, quads + (k + 1) * n]) for k in range(stations - 1)])
    inner = np.arange(stations)[:, None] * n
    ends = np.concatenate([np.arange(n), (stations - 1) * n + np.arange(n)])
    cells = {"hexahedron": hexahedra}
    return Grid(points, cells, (inner + section.body).ravel(), (inner + section.far).ravel(), ends)
