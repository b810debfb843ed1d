"""Common parts of the scripts of this folder: Gmsh without its words, rectangles, and a model's mesh as arrays."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import gmsh
import numpy as np


@contextmanager
def quiet_gmsh(**options: float) -> Iterator[None]:
    """A model; frontal Delaunay in 2D unless another option of ``Mesh`` says otherwise."""
    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        for name, value in ({"Algorithm": 6} | options).items():
            gmsh.option.setNumber(f"Mesh.{name}", value)
        yield
    finally:
        gmsh.finalize()


def rectangle(box: tuple[float, ...], size: float = 0.0) -> list[int]:
    x0, x1, y0, y1 = box
    geo = gmsh.model.geo
    corners = [geo.addPoint(x, y, 0, size) for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))]
    return [geo.addLine(corners[i], corners[(i + 1) % 4]) for i in range(4)]


def sizes_by(formula: str) -> None:
    field = gmsh.model.mesh.field.add("MathEval")
    gmsh.model.mesh.field.setString(field, "F", formula)
    gmsh.model.mesh.field.setAsBackgroundMesh(field)


def arrays(dimension: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, simplices of positive size, and the nodes of the boundary."""
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    nodes = gmsh.model.mesh.getElementsByType({2: 2, 3: 4}[dimension])[1].reshape(-1, dimension + 1)
    used, cells = np.unique(nodes, return_inverse=True)
    row = {int(tag): i for i, tag in enumerate(tags)}
    points = coordinates.reshape(-1, 3)[[row[int(tag)] for tag in used], :dimension]
    cells = cells.reshape(nodes.shape)
    flipped = np.linalg.det(points[cells[:, 1:]] - points[cells[:, :1]]) < 0
    cells[flipped] = cells[flipped][:, [1, 0, *range(2, dimension + 1)]]
    facets = np.sort(np.concatenate([np.delete(cells, i, axis=1) for i in range(dimension + 1)]), axis=1)
    unique, count = np.unique(facets, axis=0, return_counts=True)
    return points, cells, np.unique(unique[count == 1])


def save(name: str, **mesh: np.ndarray) -> None:
    np.savez_compressed(Path(__file__).with_name(f"{name}.npz"), **mesh)
