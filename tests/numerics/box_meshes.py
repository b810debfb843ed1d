"""Computed meshes of every cell type: the unit square or cube minus [0.4, 0.6]^d, the body that moves."""

from functools import cache

import numpy as np
from correction_cases import BodyMesh
from frame_meshes import tensor_grid, without_unused
from mesh_motion_numerics.correction.free_region import FreeRegion, free_region
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.metrics import cells_at_rest, reference_sizes

_TRIANGLES = ((0, 1, 2), (0, 2, 3))
_WEDGES = ((0, 1, 2, 4, 5, 6), (0, 2, 3, 4, 6, 7))
_TETRAHEDRA = ((0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6))
_FACES = ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))
_MIRRORED = {"tetra": [1, 0, 2, 3], "wedge": [3, 4, 5, 0, 1, 2], "pyramid": [0, 3, 2, 1, 4]}

CELL_KINDS = ("quad", "hexahedron", "wedge", "pyramid", "tetra", "quad + triangle", "hexahedron + wedge")


@cache
def box_mesh(kind: str, n: int = 10) -> BodyMesh:
    d = 2 if kind in ("quad", "triangle", "quad + triangle") else 3
    points, boxes = _boxes(n, d)
    near = (np.abs(points[boxes].mean(axis=1) - 0.5) < 0.25).all(axis=1)
    if kind == "quad + triangle":
        cells = {"quad": boxes[near], "triangle": _cut(boxes[~near], _TRIANGLES)}
    elif kind == "hexahedron + wedge":
        near = (np.abs(points[boxes].mean(axis=1) - 0.5) < 0.25)[:, :2].all(axis=1)  # quads meet quads
        cells = {"hexahedron": boxes[near], "wedge": _cut(boxes[~near], _WEDGES)}
    elif kind == "pyramid":
        centres = len(points) + np.arange(len(boxes))
        cells = {"pyramid": np.concatenate([np.column_stack([boxes[:, face], centres]) for face in _FACES])}
        points = np.vstack([points, points[boxes].mean(axis=1)])
    else:
        parts = {"wedge": _WEDGES, "tetra": _TETRAHEDRA}.get(kind)
        cells = {kind: _cut(boxes, parts) if parts else boxes}
    outer = np.flatnonzero(((points < 1e-9) | (points > 1 - 1e-9)).any(axis=1))
    body = np.flatnonzero(((points > 0.4 - 1e-9) & (points < 0.6 + 1e-9)).all(axis=1))
    return BodyMesh(points, CellTable.from_arrays(_oriented(points, cells)), outer, body)


def _boxes(n: int, d: int) -> tuple[np.ndarray, np.ndarray]:
    """Points and quads or hexahedra of a uniform grid, without the body's."""
    points, boxes = tensor_grid(*[np.linspace(0.0, 1.0, n + 1)] * d)
    return without_unused(points, boxes[~(np.abs(points[boxes].mean(axis=1) - 0.5) < 0.1).all(axis=1)])


def _cut(boxes: np.ndarray, parts: tuple[tuple[int, ...], ...]) -> np.ndarray:
    return np.concatenate([boxes[:, part] for part in parts])


def _oriented(points: np.ndarray, cells: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    out = {}
    for name, nodes in cells.items():
        negative = reference_sizes(points, CellTable.from_arrays({name: nodes})) < 0
        out[name] = nodes.copy()
        if negative.any():
            out[name][negative] = nodes[negative][:, _MIRRORED[name]]
    return out


def shaken(kind: str, size: float = 0.02, *, relative: bool = False) -> tuple[np.ndarray, FreeRegion]:
    """A box mesh whose free nodes are moved at random, and its free region; sizes as lengths or as at rest."""
    mesh = box_mesh(kind, 5)
    sizes = cells_at_rest(mesh.points, mesh.cells) if relative else mesh.sizes
    region = free_region(mesh.points, mesh.cells, sizes, ~mesh.held)
    points = mesh.points[region.nodes].copy()
    points[: region.n_free] += size * np.random.default_rng(1).normal(size=(region.n_free, points.shape[1]))
    return points, region
