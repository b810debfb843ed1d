"""The flag and the wing with fine boundary layers, their motions, and measures of how a motion changes a layer."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mesh_motion_numerics.mesh.boundary_facets import boundary_facets
from mesh_motion_numerics.mesh.boundary_layer_wall import MovingWall
from mesh_motion_numerics.mesh.cells import CELL_TYPES, CellTable
from mesh_motion_numerics.mesh.closest_point import FacetSet
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel
from mesh_motion_numerics.quality.metrics import cell_quality, reference_sizes
from numpy.typing import NDArray

__all__ = ["Kept", "LayerMesh", "bent_flag", "bent_wing", "in_triangles", "stored_layer"]

Floats = NDArray[np.float64]

ROOT = Path(__file__).parents[3]
_ROLES = {"flag": "moving", "wing": "moving", "symmetry": "symmetry"}  # all others are fixed


class Kept(NamedTuple):
    """Changes of a layer in a motion, apart from columns at edges of the wall, which follow a sheared wall.

    Attributes
    ----------
    thickness : float
        Largest relative change of the distance of a layer's node from the wall.
    orthogonality : float, degrees
        Largest change of the angle between an edge of a column and the normal of the wall under it.
    """

    thickness: float
    orthogonality: float


@dataclass(frozen=True, eq=False)
class LayerMesh:
    """A body with layers of quads or prisms.

    Attributes
    ----------
    points : (n, d) array, mesh length unit
    patches : dict of name to Patch
    body : (k,) int array
        The moving nodes.
    columns : (w, rows + 1) int array
        Nodes above each node of the wall, the wall's own first.
    """

    points: Floats
    cells: CellTable
    patches: dict[str, Patch]
    body: NDArray[np.int64]
    columns: NDArray[np.int64]

    @property
    def thickness(self) -> float:
        """Most frequent value in the layer, apart from corners and edges."""
        first, last = self.points[self.columns[:, 0]], self.points[self.columns[:, -1]]
        return float(np.median(np.linalg.norm(last - first, axis=1)))

    def model(self, **choices: Any) -> MotionModel:
        """The method: it starts from the reference mesh and corrects up to the maximum; ``choices`` change it."""
        usual = {"displacement": "absolute", "correction_target": "maximum", "quality_threshold": 0.9}
        usual["quality_metric"] = "size-skew"
        return MotionModel.build(self.points, self.cells, self.patches, Method(**{**usual, **choices}))

    def kept(self, moved: Floats) -> Kept:
        """Changes of the layer in a mesh with nodes at ``moved`` (n, d)."""
        nodes = self.columns[self.on_faces, 1:]
        before, after = (self._distance(points)[nodes] for points in (self.points, moved))
        turned = np.abs(self._angles(moved) - self._angles(self.points))[self.on_faces]
        return Kept(float(np.abs(after / before - 1.0).max()), float(np.degrees(turned.max())))

    @cached_property
    def on_faces(self) -> NDArray[np.bool_]:
        """(w,) columns that are on average within 30° of the normals of the facets under them."""
        wall = MovingWall.of_patches(self.points, boundary_facets(self.cells), self.patches)
        assert wall is not None
        projections = wall.mean_projections[np.searchsorted(wall.nodes, self.columns[:, 0])]
        along = self.points[self.columns[:, 1]] - self.points[self.columns[:, 0]]
        cosine2 = np.einsum("wa,wab,wb->w", along, projections, along) / np.sum(along**2, axis=1)
        return np.asarray(cosine2 > 0.75)

    def outer_minimum(self, moved: Floats) -> float:
        """Smallest size-skew of the cells outside the layer, including those that touch it."""
        inside = np.zeros(len(self.points), dtype=bool)
        inside[self.columns.ravel()] = True
        outer = ~np.concatenate([inside[block.nodes].all(axis=1) for block in self.cells])
        return float(self._quality(moved)[outer].min())

    def minimum(self, moved: Floats) -> float:
        """Smallest size-skew of all cells."""
        return float(self._quality(moved).min())

    def _quality(self, moved: Floats) -> Floats:
        """(m,) size-skew of every cell."""
        return cell_quality(moved, self.cells, reference_sizes(self.points, self.cells)).metric("size-skew")

    def _wall(self) -> NDArray[np.int64]:
        """(f, d) facets of the body: edges or triangles."""
        [own] = [b[np.isin(b, self.body).all(axis=1)] for n, b in boundary_facets(self.cells).items() if n != "quad"]
        return own

    def _distance(self, points: Floats) -> Floats:
        """(n,) distance of every node from the wall; positions of both are ``points``."""
        return np.asarray(np.linalg.norm(points - FacetSet(points[self._wall()]).closest(points), axis=1))

    def _angles(self, points: Floats) -> Floats:
        """(w, rows) angle between each edge of a column and the normal of the wall at its foot, radians."""
        normals = angle_weighted_normals(points, self._wall())
        if "symmetry" in self.patches:
            normals[self.patches["symmetry"].nodes, 2] = 0.0  # of the wing and its mirror image
        along = np.diff(points[self.columns], axis=1)
        foot = normals[self.columns[:, 0]]
        cosine = np.einsum("wkd,wd->wk", along, foot) / np.linalg.norm(foot, axis=1)[:, None]
        return np.asarray(np.arccos(np.clip(cosine / np.linalg.norm(along, axis=2), -1.0, 1.0)))


def angle_weighted_normals(points: Floats, wall: NDArray[np.int64]) -> Floats:
    """(n, d) normals into the fluid at the nodes of outward facets (f, d), weighted equally (edges) or by angle."""
    normals = np.zeros_like(points)
    if wall.shape[1] == 2:
        edge = points[wall[:, 1]] - points[wall[:, 0]]
        unit = edge[:, ::-1] * [-1.0, 1.0] / np.linalg.norm(edge, axis=1)[:, None]
        for column in wall.T:
            np.add.at(normals, column, unit)
        return normals
    for i in range(3):
        a, b = (points[wall[:, (i + k) % 3]] - points[wall[:, i]] for k in (1, 2))
        area = np.cross(a, b)
        twice = np.linalg.norm(area, axis=1)
        np.add.at(normals, wall[:, i], -area * (np.arctan2(twice, np.sum(a * b, axis=1)) / twice)[:, None])
    return normals


@cache
def stored_layer(name: str) -> LayerMesh:
    """``layer_flag`` or ``layer_wing``."""
    with np.load(ROOT / "tests" / "references" / f"{name}.npz") as file:
        arrays = {key: file[key] for key in file.files}
    cells = CellTable.from_arrays({key: value for key, value in arrays.items() if key in CELL_TYPES})
    nodes = {key.removeprefix("patch_"): v.astype(np.int64) for key, v in arrays.items() if key.startswith("patch_")}
    patches = {key: Patch(_ROLES.get(key, "fixed"), value) for key, value in nodes.items()}
    [body] = (patch.nodes for patch in patches.values() if patch.role == "moving")
    return LayerMesh(arrays["points"], cells, patches, np.sort(body), arrays["columns"].astype(np.int64))


def in_triangles(mesh: LayerMesh) -> LayerMesh:
    """The mesh with its quads cut into triangles: the same nodes, but no stacked cells."""
    blocks = {block.type.name: block.nodes for block in mesh.cells}
    quads = blocks.pop("quad")
    blocks["triangle"] = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]], blocks["triangle"]])
    return replace(mesh, cells=CellTable.from_arrays(blocks))


def bent_flag(points: Floats, fraction: float) -> Floats:
    """Positions (n, 2) of the flag's points at a fraction of the motion of FSI2; ± 1 is the tip at ± 80 mm."""
    module = _example("turek_hron_flag")
    return np.asarray(points + module.bend(points, fraction * module.find_amplitude()))


def bent_wing(points: Floats, fraction: float) -> Floats:
    """Positions (n, 3) of the wing's points: 1 bends it by two fifths of the span and twists its end by 30°."""
    return np.asarray(points + _example("tapered_wing").deform(points, fraction))


@cache
def _example(name: str) -> Any:
    """The module that builds an example's motion."""
    path = ROOT / "examples" / name / "build_motion.py"
    spec = importlib.util.spec_from_file_location(f"motion_of_{name}", path)
    if spec is None or spec.loader is None:
        raise FileNotFoundError(path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
