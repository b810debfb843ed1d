"""Swept volumes: cells of every type, and faces with a known sweep."""

import itertools

import numpy as np
import pytest
from mesh_motion_numerics.mesh.local_facets import LOCAL_FACETS
from mesh_motion_numerics.mesh.swept_volumes import swept_by_cells, swept_volumes
from tiny_meshes import tiny_mesh, tiny_meshes

_GAUSS = (0.5 - 0.5 / 3**0.5, 0.5 + 0.5 / 3**0.5)
#: Of a cell's shape functions by its unit coordinates, which are those of the nodes of the unit square or cube.
_CORNERS = np.array(
    [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)], dtype=float
)


def simplices(x):
    """(m,) volumes of simplices (m, d + 1, d)."""
    d = x.shape[2]
    return np.linalg.det(x[:, 1:] - x[:, :1]) / np.prod(np.arange(1, d + 1))


def product_volumes(x, shape_gradients, weights):
    """(m,) volumes by quadrature of the Jacobian's determinant."""
    return sum(w * np.linalg.det(np.einsum("mnd,ne->mde", x, g)) for g, w in zip(shape_gradients, weights, strict=True))


def hexahedra(x):
    d = x.shape[2]
    corners = _CORNERS[: 2**d, :d]
    gradients = []
    for place in itertools.product(_GAUSS, repeat=d):
        factors = np.where(corners == 1, place, 1 - np.array(place))
        signs = np.where(corners == 1, 1.0, -1.0)
        gradients.append(np.stack([signs[:, e] * np.delete(factors, e, 1).prod(axis=1) for e in range(d)], axis=1))
    return product_volumes(x, gradients, [0.5**d] * len(gradients))


def wedges(x):
    gradients = []
    for z in _GAUSS:
        along = np.array([[-1, -1], [1, 0], [0, 1]], dtype=float)
        low, high = (
            np.column_stack([(1 - z) * along, np.full(3, -1 / 3)]),
            np.column_stack([z * along, np.full(3, 1 / 3)]),
        )
        gradients.append(np.vstack([low, high]))
    return product_volumes(x, gradients, [0.25, 0.25])


def pyramids(x):
    """The mean of both divisions of the base, which has the volume of the bilinear base."""
    cuts = [(0, 1, 2, 4), (0, 2, 3, 4), (0, 1, 3, 4), (1, 2, 3, 4)]
    return 0.5 * sum(simplices(x[:, cut]) for cut in map(list, cuts))


VOLUME = {"line": simplices, "triangle": simplices, "tetra": simplices, "quad": hexahedra, "hexahedron": hexahedra,
          "wedge": wedges, "pyramid": pyramids}  # fmt: skip


@pytest.mark.parametrize(("kind", "mesh"), list(tiny_meshes(3)), ids=[kind for kind, _ in tiny_meshes(1)])
def test_the_faces_of_a_cell_sweep_the_change_of_its_volume(kind, mesh):
    """In every step of a motion that turns, bends and shears faces."""
    points, cells = mesh
    (block,) = cells
    numbers = np.random.default_rng(3)
    before = points + 0.05 * numbers.standard_normal(points.shape)
    after = before + 0.2 * numbers.standard_normal(points.shape)
    change = VOLUME[kind](after[block.nodes]) - VOLUME[kind](before[block.nodes])
    swept = swept_by_cells(before, after, block)
    assert swept.shape == (len(block), len(LOCAL_FACETS[kind]))
    np.testing.assert_allclose(swept.sum(axis=1), change, rtol=0, atol=1e-15)
    np.testing.assert_allclose(np.abs(swept).max(), np.abs(change).max(), rtol=20)  # they are not all nothing


@pytest.mark.parametrize("kind", ["triangle", "quad", "tetra", "hexahedron"])
def test_both_sides_of_a_face_sweep_the_same(kind):
    points, cells = tiny_mesh(kind, 3)
    (block,) = cells
    after = points + 0.1 * np.random.default_rng(5).standard_normal(points.shape)
    swept = swept_by_cells(points, after, block)
    found = {}
    for cell, row in zip(block.nodes, swept, strict=True):
        for local, value in zip(LOCAL_FACETS[kind], row, strict=True):
            found.setdefault(tuple(sorted(cell[list(local)])), []).append(value)
    pairs = [values for values in found.values() if len(values) == 2]
    assert len(pairs) > 10
    assert all(one == -other for one, other in pairs)


def test_a_plane_face_that_is_shifted_sweeps_its_area_times_its_way():
    corners = np.array([[0, 0, 0], [2, 0, 0], [2, 1, 0], [1, 2, 0], [0, 1, 0]], dtype=float)
    shift = np.array([0.3, -0.2, 0.7])
    faces = np.array([[0, 1, 2, 3, 4], [0, 1, 2, -1, -1], [4, 3, 2, 1, 0]])
    found = swept_volumes(corners, corners + shift, faces)
    np.testing.assert_allclose(found, 0.7 * np.array([3.0, 1.0, -3.0]), rtol=1e-15)


def test_an_edge_that_turns_sweeps_the_parallelogram_of_its_straight_ways():
    before, after = np.array([[0.0, 0.0], [0.0, 1.0]]), np.array([[0.0, 0.0], [1.0, 0.0]])
    np.testing.assert_allclose(swept_volumes(before, after, np.array([[0, 1], [1, 0]])), [0.5, -0.5], rtol=1e-15)


def test_points_of_a_line():
    points, (block,) = tiny_mesh("line", 2)
    swept = swept_by_cells(points, points + 0.5 * points, block)
    np.testing.assert_array_equal(swept, [[0, 0.25], [-0.25, 0.5]])
