"""The meshes: triangles of the fluid by Gmsh, quadrilaterals of the solid, written as Kratos' mdpa files.

On their common interface fluid and solid have the same nodes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mok_benchmark.benchmark import HEIGHT, LENGTH, OUTLET_FLOOR, RAMP_END, ROUNDING, WALL, WALL_HEIGHT

__all__ = ["FluidMesh", "channel_mesh", "fluid_mesh", "wall_lattice", "write_fluid", "write_solid"]

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class FluidMesh:
    """Triangles and the boundary's edges.

    Attributes
    ----------
    points : (n, 2) array, m
    triangles : (m, 3) int array
    edges : dict
        Part of the boundary → (k, 2) int array.
    """

    points: Floats
    triangles: Integers
    edges: dict[str, Integers]


def channel_mesh(wall_nodes: int, coarsest: float) -> FluidMesh:
    """Mesh the channel of Mok's benchmark.

    Parameters
    ----------
    wall_nodes : int
        Edges along each side of the wall.
    coarsest : float
        Edge length far from the wall, m.
    """
    return fluid_mesh(lambda gmsh: _geometry(gmsh, wall_nodes, coarsest))


def fluid_mesh(geometry: Callable[[Any], dict[str, list[int]]]) -> FluidMesh:
    """Mesh the model that ``geometry`` builds in Gmsh; ``geometry`` returns the lines of each part of the boundary."""
    import gmsh  # noqa: PLC0415  (its library is large)

    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Verbosity", 0)
    try:
        edges = geometry(gmsh)
        gmsh.model.mesh.generate(2)
        tags, flat, _ = gmsh.model.mesh.getNodes()
        row = np.full(int(tags.max()) + 1, -1)
        triangles = gmsh.model.mesh.getElements(2)[2][0].reshape(-1, 3).astype(np.int64)
        used = np.unique(triangles)
        row[used] = np.arange(len(used))
        order = np.argsort(tags)
        points = flat.reshape(-1, 3)[order][np.searchsorted(tags[order], used), :2]
        lines = {
            name: np.vstack([gmsh.model.mesh.getElements(1, line)[2][0].reshape(-1, 2) for line in group])
            for name, group in edges.items()
        }
        return FluidMesh(points, row[triangles], {name: row[nodes.astype(np.int64)] for name, nodes in lines.items()})
    finally:
        gmsh.finalize()


def _geometry(gmsh: Any, wall_nodes: int, coarsest: float) -> dict[str, list[int]]:
    """Make the channel in Gmsh's model; return its lines by part."""
    occ = gmsh.model.geo
    left, right = WALL
    finest = WALL_HEIGHT / wall_nodes
    slope = math.atan2(OUTLET_FLOOR, RAMP_END - right)
    tangent = ROUNDING * math.tan(slope / 2.0)  # from the corner to where the rounding begins and ends
    begins = (RAMP_END - tangent * math.cos(slope), OUTLET_FLOOR - tangent * math.sin(slope))
    ends = (RAMP_END + tangent, OUTLET_FLOOR)
    corners = [
        (0.0, 0.0, coarsest), (left, 0.0, finest), (left, WALL_HEIGHT, finest), (right, WALL_HEIGHT, finest),
        (right, 0.0, finest), (*begins, coarsest), (*ends, coarsest), (LENGTH, OUTLET_FLOOR, coarsest),
        (LENGTH, HEIGHT, coarsest), (0.0, HEIGHT, coarsest),
    ]  # fmt: skip
    points = [occ.addPoint(x, y, 0.0, size) for x, y, size in corners]
    centre = occ.addPoint(ends[0], OUTLET_FLOOR - ROUNDING, 0.0, coarsest)
    lines = [
        occ.addCircleArc(points[5], centre, points[6]) if i == 5 else occ.addLine(points[i], points[(i + 1) % 10])
        for i in range(10)
    ]
    occ.addPlaneSurface([occ.addCurveLoop(lines)])
    for line, count in ((1, wall_nodes), (2, 2), (3, wall_nodes)):
        occ.mesh.setTransfiniteCurve(lines[line], count + 1)
    occ.synchronize()
    parts = {"bottom": (0, 4, 5, 6), "interface": (1, 2, 3), "outlet": (7,), "top": (8,), "inlet": (9,)}
    return {name: [lines[i] for i in group] for name, group in parts.items()}


def write_fluid(path: Path, mesh: FluidMesh, properties: dict[str, float]) -> None:
    """The fluid's mdpa: elements, wall conditions, a sub model part for each part of the boundary."""
    conditions, parts = [], []
    first = 1
    for name, edges in mesh.edges.items():
        conditions.append(edges)
        numbers = range(first, first + len(edges))
        first += len(edges)
        parts.append(_sub_part(name, conditions=numbers, nodes=np.unique(edges) + 1))
    volume = range(1, len(mesh.triangles) + 1)
    parts.append(_sub_part("Parts_Fluid", elements=volume, nodes=range(1, len(mesh.points) + 1), properties=[1]))
    blocks = [
        _block("Properties 1", [f"{name} {value!r}" for name, value in properties.items()]),
        _nodes(mesh.points),
        _numbered("Elements Element2D3N", mesh.triangles + 1, 1),
        _numbered("Conditions WallCondition2D2N", np.vstack(conditions) + 1, 0),
        *parts,
    ]
    path.write_text("".join([_block("Properties 0", []), *blocks]))


def wall_lattice(rows: int, columns: int, order: int = 2) -> Floats:
    """Mok's wall for :func:`write_solid`, of ``rows`` by ``columns`` elements."""
    places, heights = np.linspace(*WALL, order * columns + 1), np.linspace(0.0, WALL_HEIGHT, order * rows + 1)
    return np.stack(np.broadcast_arrays(places, heights[:, None]), axis=-1)


def write_solid(path: Path, lattice: Floats, order: int = 2) -> Floats:
    """The solid's mdpa: quadrilaterals of four (``order`` 1) or eight nodes; the (k, 2) points.

    Parameters
    ----------
    lattice : (order rows + 1, order columns + 1, 2) array, m
        Corners, midpoints of edges and of elements, from the clamped foot on; the foot's first point is at the left.
    """
    levels, columns = (count - 1 for count in lattice.shape[:2])
    number: dict[tuple[int, int], int] = {}
    for level in range(levels + 1):
        for column in range(columns + 1):
            if order == 1 or level % 2 == 0 or column % 2 == 0:  # eight nodes: none in the middle
                number[level, column] = len(number) + 1
    points = np.array([lattice[place] for place in number])
    corners = ((0, 0), (0, order), (order, order), (order, 0))
    around = corners if order == 1 else (*corners, (0, 1), (1, 2), (2, 1), (1, 0))
    elements = np.array(
        [
            [number[level + up, column + side] for up, side in around]
            for level in range(0, levels, order)
            for column in range(0, columns, order)
        ]
    )
    wetted = [node for (level, column), node in number.items() if column in (0, columns) or level == levels]
    clamped = [node for (level, _), node in number.items() if level == 0]
    loads = np.array(wetted)[:, None]
    blocks = [
        _block("Properties 1", []),
        _nodes(points),
        _numbered(f"Elements TotalLagrangianElement2D{len(around)}N", elements, 1),
        _numbered("Conditions PointLoadCondition2D1N", loads, 0),
        _sub_part(
            "Parts_Structure", elements=range(1, len(elements) + 1), nodes=range(1, len(points) + 1), properties=[1]
        ),
        _sub_part("interface", nodes=wetted),
        _sub_part("loads", nodes=wetted, conditions=range(1, len(wetted) + 1)),
        _sub_part("foot", nodes=clamped),
    ]
    path.write_text("".join([_block("Properties 0", []), *blocks]))
    return points


def _block(head: str, lines: Iterable[str]) -> str:
    inner = "".join(f"  {line}\n" for line in lines)
    return f"Begin {head}\n{inner}End {head.split(maxsplit=1)[0]}\n\n"


def _nodes(points: Floats) -> str:
    return _block("Nodes", [f"{number} {x!r} {y!r} 0.0" for number, (x, y) in enumerate(points.tolist(), 1)])


def _numbered(head: str, rows: Integers, properties: int) -> str:
    lines = [f"{number} {properties} {' '.join(map(str, row))}" for number, row in enumerate(rows.tolist(), 1)]
    return _block(head, lines)


def _sub_part(name: str, **members: Iterable[int]) -> str:
    inner = "".join(
        _block(f"SubModelPart{kind.capitalize()}", [str(int(number)) for number in numbers])
        for kind, numbers in members.items()
    )
    return f"Begin SubModelPart {name}\n{inner}End SubModelPart\n\n"
