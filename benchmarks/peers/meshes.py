"""The meshes: a slab in a square (triangles), a thin wing in a cube (tetrahedra; hexahedra).

For every system nodes are numbered along a space-filling curve and cells by their first node, so that no system suffers
from a generator's numbering.

M1, M6, M8, M2 and M7 have about 1 k, 10 k, 22 k, 100 k and 1 M nodes in two dimensions, M3, M4 and M5 50 k, 500 k and
5 M in three; M5 is a mesh a little finer than M4, refined once. W2 and W3 are 50 bodies wide, on the bodies of S2 and
S3 the spacing varies by a factor of 30.
"""

from __future__ import annotations

import signal
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gmsh
import numpy as np
from numpy.typing import NDArray

from benchmarks.peers.refinement import refined_tetrahedra

__all__ = ["MESHES", "BenchmarkMesh", "load_or_build"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Gmsh's element number, nodes and our name.
_GMSH_TYPES = {2: (3, "triangle"), 4: (4, "tetra")}
Box = tuple[tuple[float, float], ...]

_SLAB: Box = ((0.4, 0.6), (0.48, 0.52))
_WING: Box = ((0.3, 0.7), (0.47, 0.53), (0.4, 0.6))
#: Bodies a fiftieth as long as the domain.
_SMALL_SLAB: Box = ((0.49, 0.51), (0.498, 0.502))
_SMALL_WING: Box = ((0.49, 0.51), (0.4985, 0.5015), (0.495, 0.505))


@dataclass(frozen=True, eq=False)
class BenchmarkMesh:
    """A mesh with a moving body in a fixed box.

    Attributes
    ----------
    points : (n, d) array
    cells : dict of (m, k) int64 arrays
        Type of the arrays after reading; a newly built mesh has int32.
    moving, fixed : (k,), (f,) int64 arrays
        Nodes of the body and of the box.
    """

    points: Floats
    cells: Mapping[str, NDArray[np.integer]]
    moving: Ints
    fixed: Ints


def slab(*, outer_size: float, body_size: float, ratio: float = 1.0, body: Box = _SLAB) -> BenchmarkMesh:
    """Triangles in the unit square around a slab; their size on the slab grows along x by the ratio."""
    (x0, x1), (y0, y1) = body
    gmsh.option.setNumber("Mesh.Algorithm", 6)
    loops = [
        _polygon([(0, 0), (1, 0), (1, 1), (0, 1)], [outer_size] * 4),
        _polygon([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], [body_size * r for r in (1.0, ratio, ratio, 1.0)]),
    ]
    gmsh.model.geo.addPlaneSurface(loops)
    gmsh.model.geo.synchronize()
    gmsh.model.mesh.generate(2)
    return _mesh_of_model(2, body)


def wing(*, body_size: float, growth: float, ratio: float = 1.0, body: Box = _WING) -> BenchmarkMesh:
    """Tetrahedra in the unit cube around a box, of size h + g D + 0.2 D³ at the distance D; h grows along x."""
    gmsh.option.setNumber("Mesh.Algorithm3D", 10)
    for name in ("ExtendFromBoundary", "FromPoints", "FromCurvature"):
        gmsh.option.setNumber(f"Mesh.MeshSize{name}", 0)
    box = gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
    (x0, x1), (y0, y1), (z0, z1) = body
    hole = gmsh.model.occ.addBox(x0, y0, z0, x1 - x0, y1 - y0, z1 - z0)
    gmsh.model.occ.cut([(3, box)], [(3, hole)])
    gmsh.model.occ.synchronize()
    # max(a - x, x - b, 0) = (|x - a| + |x - b| - (b - a)) / 2
    outside = [f"((Abs({x}-{a})+Abs({x}-{b})-{b - a})/2)^2" for x, (a, b) in zip("xyz", body, strict=True)]
    distance = f"Sqrt({'+'.join(outside)})"
    field = gmsh.model.mesh.field.add("MathEval")
    graded = f"*{ratio}^((1+(Abs(x-{x0})-Abs(x-{x1}))/{x1 - x0})/2)" if ratio != 1.0 else ""
    gmsh.model.mesh.field.setString(field, "F", f"{body_size}{graded}+({growth})*{distance}+0.2*{distance}^3")
    gmsh.model.mesh.field.setAsBackgroundMesh(field)
    gmsh.model.mesh.generate(3)
    return _mesh_of_model(3, body)


def refined_wing(*, body_size: float, growth: float) -> BenchmarkMesh:
    """The same mesh with each tetrahedron divided into eight."""
    coarse = wing(body_size=body_size, growth=growth)
    points, nodes = refined_tetrahedra(coarse.points, coarse.cells["tetra"])
    return _renumbered(points, {"tetra": nodes}, _WING)


def hexahedral_wing(*, divisions: tuple[tuple[int, int, int], ...]) -> BenchmarkMesh:
    """Hexahedra of a Cartesian grid around the same wing; ``divisions``: before, along and behind it on each axis."""
    lines = [_graded_lines(span, counts) for span, counts in zip(_WING, divisions, strict=True)]
    points = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange(len(points)).reshape([len(line) for line in lines])
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    nx, ny, nz = (len(line) - 1 for line in lines)
    nodes = np.stack([number[i : i + nx, j : j + ny, k : k + nz].ravel() for i, j, k in corners], axis=1)
    centres = points[nodes].mean(axis=1)
    inside = np.all([(a < x) & (x < b) for x, (a, b) in zip(centres.T, _WING, strict=True)], axis=0)
    return _renumbered(points, {"hexahedron": nodes[~inside]}, _WING)


#: Name → what it is, and how it is built.
MESHES: dict[str, tuple[str, Callable[[], BenchmarkMesh]]] = {
    "M1": ("slab in a square, 723 nodes", lambda: slab(outer_size=0.0446, body_size=0.04)),
    "M6": ("slab in a square, 10 k nodes", lambda: slab(outer_size=0.0109, body_size=0.0109)),
    "M8": ("slab in a square, 22 k nodes", lambda: slab(outer_size=0.00730, body_size=0.00730)),
    "M2": ("slab in a square, 98 k nodes", lambda: slab(outer_size=0.00345, body_size=0.00345)),
    "M7": ("slab in a square, 1.0 M nodes", lambda: slab(outer_size=0.00108, body_size=0.00108)),
    "M3": ("wing in a cube, 50 k nodes, tetrahedra", lambda: wing(body_size=0.0155, growth=0.0078)),
    "M4": ("wing in a cube, 495 k nodes, tetrahedra", lambda: wing(body_size=0.0070, growth=-0.003)),
    "M5": (
        "wing in a cube, 4.9 M nodes, tetrahedra of a mesh refined once",
        lambda: refined_wing(body_size=0.0065, growth=-0.003),
    ),
    "W2": (
        "slab in a square 50 slabs wide",
        lambda: slab(outer_size=0.01, body_size=0.00005, body=_SMALL_SLAB),
    ),
    "S2": (
        "slab in a square, surface spacing × 30",
        lambda: slab(outer_size=0.01, body_size=0.00008, ratio=30.0),
    ),
    "W3": (
        "wing in a cube 50 wings wide, tetrahedra",
        lambda: wing(body_size=0.0005, growth=0.15, body=_SMALL_WING),
    ),
    "S3": (
        "wing in a cube, surface spacing × 30, tetrahedra",
        lambda: wing(body_size=0.002, growth=0.2, ratio=30.0),
    ),
    "H1": (
        "wing in a cube, 22 k nodes, hexahedra",
        lambda: hexahedral_wing(divisions=((9, 16, 9), (10, 3, 10), (9, 8, 9))),
    ),
}


def load_or_build(name: str, folder: Path) -> BenchmarkMesh:
    """The mesh with this name; built once, then read from ``folder`` (Gmsh takes minutes for the large ones)."""
    path = folder / f"{name}.npz"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        mesh = _in_gmsh(MESHES[name][1])
        cells: dict[str, Any] = {f"cells_{kind}": nodes for kind, nodes in mesh.cells.items()}
        np.savez(path, points=mesh.points, patch_moving=mesh.moving, patch_fixed=mesh.fixed, **cells)
    with np.load(path) as content:
        # 4 bytes for each number on disk, 8 in every system, so that no system has to convert
        cells = {
            key.removeprefix("cells_"): content[key].astype(np.int64, copy=False)
            for key in content.files
            if key.startswith("cells_")
        }
        return BenchmarkMesh(content["points"], cells, content["patch_moving"], content["patch_fixed"])


def _in_gmsh(build: Callable[[], BenchmarkMesh]) -> BenchmarkMesh:
    """Run a builder with a quiet, fresh Gmsh of one thread: the same mesh every time."""
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("General.NumThreads", 1)
        gmsh.model.add("peers")
        return build()
    finally:
        gmsh.finalize()
        signal.signal(signal.SIGPIPE, signal.SIG_IGN)  # Gmsh lets the process end at a broken pipe


def _polygon(corners: list[tuple[float, float]], sizes: list[float]) -> int:
    """Curve loop through the corners with a mesh size at each."""
    geo = gmsh.model.geo
    tags = [geo.addPoint(x, y, 0, size) for (x, y), size in zip(corners, sizes, strict=True)]
    return int(geo.addCurveLoop([geo.addLine(a, b) for a, b in zip(tags, tags[1:] + tags[:1], strict=True)]))


def _graded_lines(span: tuple[float, float], counts: tuple[int, int, int]) -> Floats:
    """Grid lines of [0, 1] that include the body's faces, denser towards the body."""
    before, along, behind = counts
    a, b = span
    t = np.linspace(0, 1, before + 1)
    s = np.linspace(0, 1, behind + 1)
    grading = 1.5  # exponent: the cells at the wall are about three times smaller than those at the box
    return np.concatenate(
        [a * (1 - (1 - t) ** grading), np.linspace(a, b, along + 1)[1:], (b + (1 - b) * s**grading)[1:]]
    )


def _mesh_of_model(dimension: int, body: Box) -> BenchmarkMesh:
    """The current Gmsh model as arrays."""
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    number = np.full(int(tags.max()) + 1, -1, dtype=np.int64)
    number[tags.astype(np.int64)] = np.arange(len(tags))
    points = np.asarray(coordinates, dtype=np.float64).reshape(-1, 3)[:, :dimension]
    cells = {}
    types, _, nodes = gmsh.model.mesh.getElements(dimension)
    for kind, flat in zip(types, nodes, strict=True):
        count, name = _GMSH_TYPES[int(kind)]
        cells[name] = number[flat.astype(np.int64)].reshape(-1, count)
    return _renumbered(points, cells, body)


def _renumbered(points: Floats, cells: Mapping[str, NDArray[np.integer]], body: Box) -> BenchmarkMesh:
    """Renumber: used nodes along a Z-order curve, cells by their smallest node, patches by coordinates."""
    named = np.zeros(len(points), dtype=bool)
    for nodes in cells.values():
        named[nodes] = True
    used = np.flatnonzero(named)
    order = used[np.argsort(_z_order(points[used]), kind="stable")]
    new = np.full(len(points), -1, dtype=np.int32)
    new[order] = np.arange(len(order))
    points = np.ascontiguousarray(points[order])
    sorted_cells = {}
    for name, nodes in cells.items():
        renamed = new[nodes]
        sorted_cells[name] = renamed[np.argsort(renamed.min(axis=1), kind="stable")]
    tolerance = 1e-9
    on_box = np.any((points < tolerance) | (points > 1 - tolerance), axis=1)
    near_body = np.all(
        [(a - tolerance <= x) & (x <= b + tolerance) for x, (a, b) in zip(points.T, body, strict=True)], 0
    )
    return BenchmarkMesh(points, sorted_cells, np.flatnonzero(near_body), np.flatnonzero(on_box))


def _z_order(points: Floats) -> NDArray[np.int64]:
    """(n,) Morton codes with 20 bits an axis."""
    low, high = points.min(axis=0), points.max(axis=0)
    scaled = ((points - low) / (high - low) * (2**20 - 1)).astype(np.int64)
    codes = np.zeros(len(points), dtype=np.int64)
    d = points.shape[1]
    for bit in range(20):
        for axis in range(d):
            codes |= ((scaled[:, axis] >> bit) & 1) << (bit * d + axis)
    return codes
