"""Blocks of Turek and Hron's channel for blockMesh: an O-grid about the cylinder, whose eastern part ends at the flag.

::

    4  +------+--------+----------+--------------------+
       |      |  \\  /  |          |                    |
       |      |  (  )==============                    |
       |      |  /  \\  |          |                    |
    0  +------+--------+----------+--------------------+
       0     0.1      0.3        0.6                  2.5
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

__all__ = ["DEPTH", "FLAG", "block_mesh"]

DEPTH = 0.02  # m, of the mesh and of the solid's strip
_CENTRE, _RADIUS, _HALF = (0.2, 0.2), 0.05, 0.01
_ROOT = _CENTRE[0] + math.sqrt(_RADIUS**2 - _HALF**2)
FLAG = (_ROOT, _CENTRE[1]), 0.6 - _ROOT, 2.0 * _HALF  # the middle of its foot, its length and width, m
_COLUMNS, _ROWS = (0.0, 0.1, 0.3, 0.6, 2.5), (0.0, 0.1, 0.19, 0.21, 0.3, 0.41)

#: cells of the mesh of 13 000: about the cylinder, from it outwards, in front, along the flag, behind it, next to the
#: walls, at the flag's end
_CELLS = {"west": 16, "north": 20, "east": 22, "out": 22, "front": 8, "flag": 48, "wake": 80, "wall": 14, "tip": 8}


def block_mesh(refinement: float = 1.0) -> str:
    """The blockMeshDict with ``refinement`` times as many cells in each direction."""
    n = {name: max(2, round(refinement * cells)) for name, cells in _CELLS.items()}
    points: dict[tuple[float, float], int] = {}

    def at(x: float, y: float) -> int:
        return points.setdefault((x, y), len(points))

    def on_cylinder(degrees: float) -> int:
        angle = math.radians(degrees)
        return at(_CENTRE[0] + _RADIUS * math.cos(angle), _CENTRE[1] + _RADIUS * math.sin(angle))

    grid = [[at(x, y) for y in _ROWS] for x in _COLUMNS]
    below, above = at(_ROOT, _ROWS[2]), at(_ROOT, _ROWS[3])
    sw, se, ne, nw = (on_cylinder(degrees) for degrees in (225.0, 315.0, 45.0, 135.0))
    # ratios of last to first cell: towards the body, away from walls, towards the flag's end, downstream
    fine, wall, tip, wake = 0.12, 4.0, 0.6, 12.0
    blocks = [
        # about the cylinder: along it, then outwards
        ((grid[1][1], sw, nw, grid[1][4]), ("out", "west"), (fine, 1.0)),
        ((grid[1][1], grid[2][1], se, sw), ("north", "out"), (1.0, fine)),
        ((nw, ne, grid[2][4], grid[1][4]), ("north", "out"), (1.0, 1.0 / fine)),
        ((se, grid[2][1], grid[2][2], below), ("out", "east"), (1.0 / fine, fine)),
        ((above, grid[2][3], grid[2][4], ne), ("out", "east"), (1.0 / fine, 1.0 / fine)),
        # in front
        ((grid[0][1], grid[1][1], grid[1][4], grid[0][4]), ("front", "west"), (1.0, 1.0)),
    ]
    for i, (along, grading) in enumerate((("front", 1.0), ("north", 1.0), ("flag", tip), ("wake", wake))):
        for j, up in ((0, wall), (4, 1.0 / wall)):
            corners = (grid[i][j], grid[i + 1][j], grid[i + 1][j + 1], grid[i][j + 1])
            blocks.append((corners, (along, "wall"), (grading, up)))
        if i >= 2:
            for j, across, up in ((1, "east", fine), (2, "tip", 1.0), (3, "east", 1.0 / fine)):
                if (i, j) != (2, 2):
                    corners = (grid[i][j], grid[i + 1][j], grid[i + 1][j + 1], grid[i][j + 1])
                    blocks.append((corners, (along, across), (grading, up)))
    count = len(points)

    def face(a: int, b: int) -> str:
        return f"({a} {b} {b + count} {a + count})"

    def sides(pairs: Sequence[tuple[int, int]]) -> str:
        return " ".join(face(a, b) for a, b in pairs)

    def ring(line: Sequence[int]) -> list[tuple[int, int]]:
        return list(itertools.pairwise(line))

    patches = {
        "inlet": ("patch", [(grid[0][0], grid[0][1]), (grid[0][1], grid[0][4]), (grid[0][4], grid[0][5])]),
        "outlet": ("patch", ring(grid[4])),
        "walls": ("wall", ring([column[0] for column in grid]) + ring([column[5] for column in grid])),
        "cylinder": ("wall", ring([above, ne, nw, sw, se, below])),
        "flag": ("wall", ring([above, grid[2][3], grid[3][3], grid[3][2], grid[2][2], below])),
    }
    flat = [corners for corners, _, _ in blocks]
    arcs = {(above, ne): 28.0, (ne, nw): 90.0, (nw, sw): 180.0, (sw, se): 270.0, (se, below): 332.0}
    text = ["FoamFile { version 2.0; format ascii; class dictionary; object blockMeshDict; }", "scale 1;", "vertices ("]
    text += [f"    ({x!r} {y!r} {z!r})" for z in (0.0, DEPTH) for x, y in points]
    text += [");", "blocks", "("]
    for corners, cells, (first, second) in blocks:
        eight = " ".join(str(corner) for corner in (*corners, *(corner + count for corner in corners)))
        across, up = (n[name] for name in cells)
        text.append(f"    hex ({eight}) ({across} {up} 1) simpleGrading ({first!r} {second!r} 1)")
    text += [");", "edges", "("]
    for (a, b), degrees in arcs.items():
        x, y = (
            c + _RADIUS * turn(math.radians(degrees)) for c, turn in zip(_CENTRE, (math.cos, math.sin), strict=True)
        )
        text += [f"    arc {a + k} {b + k} ({x!r} {y!r} {z!r})" for k, z in ((0, 0.0), (count, DEPTH))]
    text += [");", "boundary", "("]
    for name, (kind, pairs) in patches.items():
        text.append(f"    {name} {{ type {kind}; faces ({sides(pairs)}); }}")
    empty = " ".join(f"({' '.join(str(c + k) for c in corners)})" for corners in flat for k in (0, count))
    text += [f"    frontAndBack {{ type empty; faces ({empty}); }}", ");", ""]
    return "\n".join(text)
