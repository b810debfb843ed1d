"""Builds ``layer_flag.npz`` and ``layer_wing.npz`` with Gmsh: two of the examples' bodies in fine boundary layers.

The flag of Turek and Hron gets ten rows of quads. The wing gets rows of prisms: its surface is moved outwards by the
layer's thickness with the tetrahedra following, and the gap is filled. ``columns`` (w, rows + 1) are the nodes above
each node of the wall, from the wall outwards.

Run: python build_layer_meshes.py
"""

import importlib.util
import tempfile
from pathlib import Path
from types import ModuleType

import gmsh
import numpy as np
from mesh_motion_numerics.mesh.boundary_facets import boundary_facets
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import Patch
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.motion import MotionModel

from docs.studies.beyond._layers import angle_weighted_normals
from mesh_motion_server.files import read_mesh
from mesh_motion_server.files.mesh_file import MeshFile

HERE = Path(__file__).parent
WING_LAYER, WING_ROWS, WING_GROWTH = 0.012, 6, 1.3
FLAG_UPRIGHT = (0.267, 0.588)  # between these places along the flag
FLAG_CELLS = (20, 20, 3, 46, 3, 6, 3, 46, 3)  # cells along the curves of the outline
MOST_STRETCHED = 1.6  # times the thickness: the mitre of a sharp edge


def builder(example: str) -> ModuleType:
    """The module that builds an example's mesh."""
    path = HERE.parents[1] / "examples" / example / "build_mesh.py"
    spec = importlib.util.spec_from_file_location(f"build_{example}", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def built(module: ModuleType) -> MeshFile:
    """The mesh that the module builds, without the file that it would write."""
    with tempfile.TemporaryDirectory() as folder:
        module.__file__ = f"{folder}/build_mesh.py"
        module.main()
        return read_mesh(f"{folder}/mesh.npz")


def flag() -> dict[str, np.ndarray]:
    """Quads around cylinder and flag, triangles outside; columns stand upright but for the flag's corners."""
    module = builder("turek_hron_flag")
    module.boundary_layer = lambda: flag_layer(module)
    module.ROWS, module.GROWTH, module.SIZE_BODY, module.SIZE_CHANNEL = 10, 1.2, 0.012, 0.05
    mesh = built(module)
    columns = above(mesh.patches["flag"], mesh.cells["quad"], module.ROWS)
    return {"points": mesh.points, **mesh.cells, "columns": columns, **named(mesh.patches)}


def flag_layer(module: ModuleType) -> tuple[list[int], list[int], list[int]]:
    """The body's curves, those at the layer's rim, and the layer's surfaces between them; as in the example."""
    geo = gmsh.model.geo
    (body_points, body), (rim_points, rim) = (flag_outline(module, distance) for distance in (0.0, module.LAYER))
    rays = [geo.addLine(a, b) for a, b in zip(body_points, rim_points, strict=True)]
    for ray in rays:
        geo.mesh.setTransfiniteCurve(ray, module.ROWS + 1, "Progression", module.GROWTH)
    surfaces = []
    for i, cells in enumerate(FLAG_CELLS):
        after = (i + 1) % len(FLAG_CELLS)
        for curve in (body[i], rim[i]):
            geo.mesh.setTransfiniteCurve(curve, cells + 1)
        surfaces.append(geo.addPlaneSurface([geo.addCurveLoop([body[i], rays[after], -rim[i], -rays[i]])]))
        geo.mesh.setTransfiniteSurface(surfaces[-1])
        geo.mesh.setRecombine(2, surfaces[-1])
    return body, rim, surfaces


def flag_outline(module: ModuleType, distance: float) -> tuple[list[int], list[int]]:
    """Points and curves around the body: two arcs from above the flag to below it, side, end and side of the flag."""
    (x, y), radius = module.CENTRE, module.RADIUS + distance
    half, end = module.FLAG_HALF + distance, module.FLAG_END + distance
    root = x + np.sqrt(radius**2 - half**2)
    along = [root, *FLAG_UPRIGHT, end]
    places = [
        (root, y + half),
        (x - radius, y),
        *((u, y - half) for u in along),
        *((u, y + half) for u in along[:0:-1]),
    ]
    centre = gmsh.model.geo.addPoint(x, y, 0.0)
    points = [gmsh.model.geo.addPoint(*place, 0.0, module.SIZE_BODY) for place in places]
    after = [*points[1:], points[0]]
    curves = [gmsh.model.geo.addCircleArc(a, centre, b) for a, b in zip(points[:2], after[:2], strict=True)]
    return points, curves + [gmsh.model.geo.addLine(a, b) for a, b in zip(points[2:], after[2:], strict=True)]


def above(wall: np.ndarray, quads: np.ndarray, rows: int) -> np.ndarray:
    """Columns of nodes, found by going from side to opposite side."""
    sides = {}
    for quad in quads.tolist():
        for i in range(4):
            a, b, c, d = (quad[(i + k) % 4] for k in range(4))
            sides.setdefault(frozenset((a, b)), []).append({a: d, b: c})
    passed, columns = set(wall.tolist()), {node: [node] for node in wall.tolist()}
    front = [side for side in sides if side <= passed]
    for _ in range(rows):
        steps = [step for side in front for step in sides[side] if not passed & set(step.values())]
        onwards = {node: over for step in steps for node, over in step.items()}
        columns = {node: [*column, onwards[column[-1]]] for node, column in columns.items()}
        front = [frozenset(step.values()) for step in steps]
        passed |= set(onwards.values())
    return np.array([columns[node] for node in wall.tolist()])


def wing() -> dict[str, np.ndarray]:
    """Prisms around the wing, tetrahedra outside."""
    module = builder("tapered_wing")
    module.SIZE_WING, module.SIZE_FAR = 0.055, 0.5
    mesh = built(module)
    facets = boundary_facets(CellTable.from_arrays(mesh.cells))["triangle"]
    wall = facets[np.isin(facets, mesh.patches["wing"]).all(axis=1)]
    moved, nodes = inflated(mesh, wall), mesh.patches["wing"]
    share = (WING_GROWTH ** np.arange(WING_ROWS) - 1.0) / (WING_GROWTH**WING_ROWS - 1.0)
    inner = [mesh.points[nodes] + s * (moved[nodes] - mesh.points[nodes]) for s in share]
    n, w = len(moved), len(nodes)
    columns = np.column_stack([*(np.arange(w) + n + w * row for row in range(WING_ROWS)), nodes])
    row_of = np.searchsorted(nodes, wall)[:, ::-1]  # seen from the fluid
    prisms = [np.hstack([columns[row_of, k], columns[row_of, k + 1]]) for k in range(WING_ROWS)]
    symmetry = np.concatenate([mesh.patches["symmetry"], columns[mesh.points[nodes, 2] == 0.0][:, :-1].ravel()])
    patches = {"wing": columns[:, 0], "symmetry": np.unique(symmetry), "far": mesh.patches["far"]}
    points = np.concatenate([moved, *inner])
    return {
        "points": points,
        "tetra": mesh.cells["tetra"],
        "wedge": np.concatenate(prisms),
        "columns": columns,
        **named(patches),
    }


def inflated(mesh: MeshFile, wall: np.ndarray) -> np.ndarray:
    """The mesh with the wing's surface moved outwards by the thickness of the layer."""
    area = np.cross(*(mesh.points[wall[:, k]] - mesh.points[wall[:, 0]] for k in (2, 1)))  # into the fluid
    normals = angle_weighted_normals(mesh.points, wall)
    normals[mesh.points[:, 2] == 0.0, 2] = 0.0
    nodes = mesh.patches["wing"]
    normals[nodes] /= np.linalg.norm(normals[nodes], axis=1, keepdims=True)
    unit = area / np.linalg.norm(area, axis=1, keepdims=True)
    along = np.zeros(len(normals))
    for column in wall.T:
        np.maximum.at(along, column, np.sum(unit * normals[column], axis=1))
    step = WING_LAYER * normals[nodes] * np.minimum(1.0 / along[nodes], MOST_STRETCHED)[:, None]
    roles = {"wing": "moving", "symmetry": "symmetry", "far": "fixed"}
    patches = {name: Patch(roles[name], own) for name, own in mesh.patches.items()}
    method = Method(support_radius=0.5, displacement="absolute", correction_target="maximum", quality_threshold=0.9)
    model = MotionModel.build(mesh.points, CellTable.from_arrays(mesh.cells), patches, method)
    targets = mesh.points.copy()
    targets[nodes] += step
    return model.move(mesh.points, targets[model.roles.moving]).points


def named(patches: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {f"patch_{name}": nodes.astype(np.int32) for name, nodes in patches.items()}


if __name__ == "__main__":
    for name, build in {"layer_flag": flag, "layer_wing": wing}.items():
        arrays = build()
        small = {key: value if key == "points" else value.astype(np.int32) for key, value in arrays.items()}
        np.savez_compressed(HERE / f"{name}.npz", **small)
