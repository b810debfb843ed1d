"""Shared by the studies of thesis chapter 3: meshes, boundary motions, and errors of predictions."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mesh_motion_numerics.interpolation.interpolant import factorize
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.metrics import CellQuality, reference_sizes
from numpy.typing import NDArray

from docs.studies.study import Cell, Table
from docs.studies.thesis._predictors import DisplacementField, InterpolantField, predict
from mesh_motion_server.files import read_mesh

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

REFERENCES = Path(__file__).parents[3] / "tests" / "references"
PREDICTORS = ("centre-gradient", "edge-midpoint-gradient", "trial-nodes")
SHORT = {"centre-gradient": "centre", "edge-midpoint-gradient": "edge midpoint", "trial-nodes": "trial nodes"}
COLOURS = {"centre-gradient": "#c1440e", "edge-midpoint-gradient": "#1b6ca8", "trial-nodes": "#3a7d44"}

#: Below this an error is rounding.
ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class Mesh:
    """A mesh with a moving body in a fixed box."""

    points: Floats
    cells: CellTable
    outer: Ints
    body: Ints

    @property
    def sizes(self) -> Floats:
        return reference_sizes(self.points, self.cells)

    def field(self, body_displacement: Floats, radius: float) -> InterpolantField:
        """The standard motion: Wendland C2 on all nodes of both boundaries, without correction."""
        nodes = np.concatenate([self.outer, self.body])
        displacement = np.concatenate([np.zeros((len(self.outer), self.points.shape[1])), body_displacement])
        return InterpolantField(factorize(self.points[nodes], support_radius=radius).solve(displacement))


class Errors(NamedTuple):
    """Errors of a predicted metric: largest value of thesis (3.13), largest difference, thesis (3.14)."""

    relative: float
    largest: float
    rmse: float


def errors(predicted: Floats, actual: Floats) -> Errors:
    """Thesis (3.13) and (3.14)."""
    difference = np.abs(predicted - actual)
    return Errors(
        float((difference / np.abs(actual)).max()), float(difference.max()), float(np.sqrt(np.mean(difference**2)))
    )


def predicted_errors(name: str, mesh: Mesh, field: DisplacementField, metric: str) -> Errors:
    """Errors of a predictor relative to the moved mesh."""
    sizes = mesh.sizes
    actual = predict("trial-nodes", mesh.points, mesh.cells, sizes, field).metric(metric)
    return errors(predict(name, mesh.points, mesh.cells, sizes, field).metric(metric), actual)


def qualities(mesh: Mesh, field: DisplacementField) -> dict[str, CellQuality]:
    """The results of every predictor."""
    sizes = mesh.sizes
    return {name: predict(name, mesh.points, mesh.cells, sizes, field) for name in PREDICTORS}


def order(coarse: float, fine: float, ratio: float = 2.0) -> float | None:
    """Order of convergence between two meshes with edges in this ratio; None if both errors are rounding errors."""
    return float(np.log(coarse / fine) / np.log(ratio)) if min(coarse, fine) > ROUNDING else None


def rigid(points: Floats, degrees: float, centre: Floats, shift: Floats) -> Floats:
    """(k, d) displacement of a body turned anticlockwise (3D: about z) and shifted."""
    a = np.deg2rad(degrees)
    turn = np.eye(points.shape[1])
    turn[:2, :2] = [[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]
    return (points - centre) @ turn.T + centre + shift - points


def line(n: int) -> Mesh:
    """Thesis Fig. 3.2: n cells on [0, 1]; static at 0 and 1, moving at 0.2 and 0.8; n a multiple of 5."""
    cells = CellTable.from_arrays({"line": np.column_stack([np.arange(n), np.arange(1, n + 1)])})
    return Mesh(np.linspace(0.0, 1.0, n + 1)[:, None], cells, np.array([0, n]), np.array([n // 5, n - n // 5]))


def thesis_triangles(refinements: int) -> Mesh:
    """The mesh of thesis Fig. 3.7: 416 triangles around a block 0.1 × 0.2, each cut into four ``halvings`` times."""
    stored = read_mesh(REFERENCES / "thesis_block_coarse.npz")
    points, triangles = stored.points, stored.cells["triangle"]
    for _ in range(refinements):
        points, triangles = _quarter(points, triangles)
    on_edge = np.abs(points - 0.5).max(axis=1) > 0.5 - 1e-9
    near = np.abs(points - 0.5) < np.array([0.05, 0.1]) + 1e-9
    return Mesh(
        points,
        CellTable.from_arrays({"triangle": triangles}),
        np.flatnonzero(on_edge),
        np.flatnonzero(near.all(axis=1)),
    )


def _quarter(points: Floats, triangles: Ints) -> tuple[Floats, Ints]:
    """Every triangle cut into four by the midpoints of its edges."""
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    unique, places = np.unique(edges, axis=0, return_inverse=True)
    a, b, c = triangles.T
    ab, bc, ca = (len(points) + places.reshape(-1, 3)).T
    parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.concatenate([points, points[unique].mean(axis=1)]), np.concatenate([np.column_stack(p) for p in parts])


_SQUARE = ((0, 0), (1, 0), (1, 1), (0, 1))
_CUBE = tuple((x, y, z) for z in (0, 1) for x, y in _SQUARE)
_PARTS: dict[str, tuple[tuple[int, ...], ...]] = {
    "triangle": ((0, 1, 2), (0, 2, 3)),
    "quad": ((0, 1, 2, 3),),
    "hexahedron": ((0, 1, 2, 3, 4, 5, 6, 7),),
    "wedge": ((4, 5, 6, 0, 1, 2), (4, 6, 7, 0, 2, 3)),
    "tetra": ((0, 1, 3, 7), (0, 7, 5, 1), (0, 5, 7, 4), (1, 2, 3, 7), (1, 7, 6, 2), (1, 6, 7, 5)),
}
_FACES = ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0))


def boxes(kind: str, n: int) -> Mesh:
    """Unit square or cube of n boxes along each axis, without [0.4, 0.6]^d, cut into cells; n is a multiple of 5."""
    d = 2 if kind in ("triangle", "quad") else 3
    axis = np.linspace(0.0, 1.0, n + 1)
    points = np.stack(np.meshgrid(*[axis] * d, indexing="ij"), axis=-1).reshape(-1, d)
    number = np.arange(len(points)).reshape((n + 1,) * d)
    corners = _SQUARE if d == 2 else _CUBE
    nodes = np.stack([number[tuple(slice(a, a + n) for a in corner)].ravel() for corner in corners], axis=1)
    nodes = nodes[~(np.abs(points[nodes].mean(axis=1) - 0.5) < 0.1).all(axis=1)]
    used, numbers = np.unique(nodes, return_inverse=True)
    points, nodes = points[used], numbers.reshape(nodes.shape)
    outer = np.flatnonzero((np.abs(points - 0.5) > 0.5 - 1e-9).any(axis=1))
    body = np.flatnonzero((np.abs(points - 0.5) < 0.1 + 1e-9).all(axis=1))
    if kind == "pyramid":
        tips = len(points) + np.arange(len(nodes))
        cells = np.concatenate([np.column_stack([nodes[:, face], tips]) for face in _FACES])
        points = np.concatenate([points, points[nodes].mean(axis=1)])
    else:
        cells = np.concatenate([nodes[:, part] for part in _PARTS[kind]])
    return Mesh(points, CellTable.from_arrays({kind: cells}), outer, body)


def polygons(mesh: Mesh, points: Floats) -> Floats:
    """(m, 3 or 4, 2) corners of the cells of a plane mesh of one type at positions (n, 2)."""
    return np.asarray(points[mesh.cells.blocks[0].nodes])


def draw_cells(axes: Any, corners: Floats, values: Floats, title: str, limits: tuple[float, float] = (0.0, 1.0)) -> Any:
    """Cells coloured by their values; all maps of a picture have the same scale."""
    from matplotlib import colormaps  # noqa: PLC0415 matplotlib only where something is drawn
    from matplotlib.collections import PolyCollection  # noqa: PLC0415

    fine = len(corners) > 1000  # lines would hide such cells, and smoothed borders make large files
    found = PolyCollection(
        corners,  # type: ignore[arg-type]
        array=values,
        cmap=colormaps["viridis"].resampled(20),  # bands of 0.05: values can be read, and the file is small
        clim=limits,
        edgecolors="face" if fine else "#00000070",
        linewidths=0.1 if fine else 0.25,
        antialiaseds=not fine,
    )
    axes.add_collection(found)
    axes.set(xlim=(-0.01, 1.01), ylim=(-0.01, 1.01), xticks=(), yticks=(), aspect="equal")
    axes.set_title(title, fontsize=9)
    return found


Curves = dict[str, tuple[Floats, str, str]]


def draw_slopes(axes: Any, sizes: NDArray[np.floating], curves: Curves, anchors: dict[int, float]) -> None:
    """Log-log plot of errors against edge length; a grey line for each order through its value at the last size."""
    for label, (values, colour, style) in curves.items():
        axes.loglog(sizes, values, style, color=colour, label=label, markersize=4, linewidth=1.3)
    for power, anchor in anchors.items():
        axes.loglog(sizes, anchor * (sizes / sizes[-1]) ** power, ":", color="#808080", linewidth=1)
        label = "h²" if power == 2 else "h"
        place = (sizes[0], anchor * (sizes[0] / sizes[-1]) ** power)
        axes.annotate(label, place, xytext=(5, -4), textcoords="offset points", fontsize=9, color="#606060")
    axes.set_xlim(right=1.25 * sizes[0])
    axes.set_xticks(sizes, labels=[f"{size:.3g}" for size in sizes], minor=False)
    axes.minorticks_off()
    axes.set_xlabel("edge length / coarsest")
    axes.grid(True, which="major", linewidth=0.3)


def order_table(first: str, labels: list[Cell], found: dict[str, list[Errors]], caption: str) -> Table:
    """Errors of the gradient predictors on meshes with edges halved from row to row, and the last order of each."""
    names = [name for name in PREDICTORS if name in found]
    columns = [first] + [f"{SHORT[name]}: {what}" for name in names for what in ("max", "RMSE")]
    rows: list[list[Cell]] = []
    for i, label in enumerate(labels):
        rows.append([label, *(value for name in names for value in (found[name][i].largest, found[name][i].rmse))])
    last: list[Cell] = ["**order**, last refinement"]
    for name in names:
        coarse, fine = found[name][-2], found[name][-1]
        last += [order(coarse.largest, fine.largest), order(coarse.rmse, fine.rmse)]
    return Table(columns, [*rows, last], caption, digits=3)
