"""Steps until a boundary meets itself: known contacts, and the static test of crossings before and after them."""

import numpy as np
import pytest
from box_meshes import CELL_KINDS
from far_meshes import near_block
from mesh_motion_numerics.mesh.boundary_crossing import BoundaryFacets, crossing_place
from mesh_motion_numerics.mesh.boundary_facets import boundary_facets
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.mesh.roles import BoundaryRoles, Patch
from mesh_motion_numerics.method import Method
from mesh_motion_numerics.motion.contact_ahead import ContactAhead
from mesh_motion_numerics.motion.motion import MotionModel

#: The body of :func:`.near_block` is the middle fifth of the unit square or cube.
GAP = 0.4


def boundary_of(kind: str, layers: int = 5) -> tuple[np.ndarray, BoundaryFacets]:
    points, cells, patches = near_block(kind, layers)
    roles = BoundaryRoles.from_patches(patches)
    return points, BoundaryFacets.build(boundary_facets(cells), roles.moving, roles.fixed, len(points))


def steps(points: np.ndarray, boundary: BoundaryFacets, way: np.ndarray) -> float:
    return ContactAhead.build(boundary, points).steps(points, points - way, 100.0)


def test_a_cell_without_a_free_node_ends_earlier_than_the_boundary() -> None:
    """A square of two triangles: its corner falls past the lower side, and the first triangle has no area at 0.55."""
    points, cells = np.array([[0.0, 0.0], [1.0, 0.0], [1.1, 1.1], [0.0, 1.0]]), np.array([[0, 1, 2], [0, 2, 3]])
    patches = {"corner": Patch("moving", np.array([2])), "rest": Patch("fixed", np.array([0, 1, 3]))}
    model = MotionModel.build(points, CellTable.from_arrays({"triangle": cells}), patches, Method())
    way = np.array([[0.0, 0.0], [0.0, 0.0], [0.0, -2.0], [0.0, 0.0]])
    assert model.headroom(points - way, points, np.array([0])).inversion == pytest.approx(0.55, rel=1e-12)


@pytest.mark.parametrize("kind", CELL_KINDS)
@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_body_that_moves_straight_meets_the_wall(kind: str, axis: int, sign: float) -> None:
    points, boundary = boundary_of(kind)
    way = np.zeros_like(points)
    way[boundary.moving, axis] = sign * 0.02
    assert steps(points, boundary, way) == pytest.approx(GAP / 0.02, rel=1e-12)
    assert steps(points, boundary, 0.19 * way) == np.inf  # 105 steps
    assert steps(points, boundary, 0.0 * way) == np.inf


def least_distance(points: np.ndarray, boundary: BoundaryFacets) -> float:
    """From a node of the boundary to a segment, or to a triangle of either half of a quad, without this node; from an
    edge to an edge.
    """
    corners = {"line": [(0, 1)], "triangle": [(0, 1, 2)], "quad": [(0, 1, 2), (0, 2, 3)]}
    facets = np.concatenate([rows[:, list(one)] for kind, rows in boundary.nodes.items() for one in corners[kind]])
    found = np.inf
    for node in np.unique(facets):
        own = facets[(facets != node).all(axis=1)]
        first, edges = points[own[:, 0]], points[own[:, 1:]] - points[own[:, :1]]
        away = points[node] - first
        shares = np.stack([np.linalg.lstsq(e.T, x)[0] for e, x in zip(edges, away, strict=True)])
        inside = (shares >= -1e-6).all(axis=1) & (shares.sum(axis=1) <= 1.0 + 1e-6)
        height = np.linalg.norm(away - np.einsum("fi,fid->fd", shares, edges), axis=1)
        found = min(found, height[inside].min(initial=np.inf))
    if points.shape[1] == 3:
        ends = np.concatenate([facets[:, [k, (k + 1) % 3]] for k in range(3)])
        found = min(found, *(_between_edges(points, own, ends) for own in np.unique(np.sort(ends), axis=0)))
    return found


def _between_edges(points: np.ndarray, own: np.ndarray, ends: np.ndarray) -> float:
    """The least distance of an edge from those lines that cross it, as seen along the common normal."""
    others = ends[~np.isin(ends, own).any(axis=1)]
    u, v = points[own[1]] - points[own[0]], points[others[:, 1]] - points[others[:, 0]]
    across, normals = points[others[:, 0]] - points[own[0]], np.cross(u, v)
    squares = np.maximum((normals**2).sum(axis=1), 1e-300)
    s = (np.cross(across, v) * normals).sum(axis=1) / squares
    t = (np.cross(across, u) * normals).sum(axis=1) / squares
    inside = (np.minimum(s, t) >= -1e-6) & (np.maximum(s, t) <= 1.0 + 1e-6) & (squares > 1e-12)
    height = np.abs((across * normals).sum(axis=1)) / np.sqrt(squares)
    return float(height[inside].min(initial=np.inf))


@pytest.mark.parametrize("everything", [False, True])
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("kind", ["quad", "quad + triangle", "tetra", "hexahedron"])
def test_it_is_the_first_contact_of_a_motion_that_bends_and_folds(kind: str, seed: int, everything: bool) -> None:
    points, boundary = boundary_of(kind)
    d, numbers = points.shape[1], np.random.default_rng(seed)
    way = 0.02 * np.sin(points @ numbers.uniform(-5.0, 5.0, (d, d)) + numbers.uniform(-3.0, 3.0, d))
    if everything:
        boundary, points = BoundaryFacets(boundary.nodes, np.ones_like(boundary.moving)), points + way
    else:
        way[~boundary.moving] = 0.0
    found = steps(points, boundary, way)
    assert 0.0 < found < 100.0
    assert least_distance(points + found * way, boundary) < 1e-12
    before = np.linspace(0.0, found * (1.0 - 1e-9), 100)
    assert all(crossing_place(boundary, points + s * way) is None for s in before)
