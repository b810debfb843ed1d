import numpy as np
import pytest
from mesh_motion_numerics.mesh.smooth_pieces import sides, smooth_pieces


def polygon(turns):
    """Closed polygon that turns by the given angles (degrees) at its corners; edges of length 1."""
    heading = np.radians(np.cumsum(turns))
    steps = np.column_stack([np.cos(heading), np.sin(heading)])
    edges = np.column_stack([np.arange(len(turns)), np.roll(np.arange(len(turns)), -1)])
    return np.cumsum(steps, axis=0) - steps, {"line": edges}


@pytest.mark.parametrize(("corners", "pieces"), [(4, 4), (6, 6), (8, 8), (10, 1), (64, 1)])
def test_a_polygon_is_smooth_from_ten_corners_on(corners, pieces):
    points, edges = polygon([360 / corners] * corners)
    found = smooth_pieces(points, edges, np.arange(corners))
    assert len(found) == pieces
    assert all((piece.normal is None) == (pieces == 1) for piece in found)


def test_straight_edges_are_one_planar_piece_with_an_exact_normal():
    points = np.column_stack([np.linspace(0, 1, 8), np.zeros(8)])
    edges = {"line": np.column_stack([np.arange(7), np.arange(1, 8)])}
    (piece,) = smooth_pieces(points, edges, np.arange(8))
    assert piece.normal.tolist() == [0.0, 1.0]
    assert piece.nodes.tolist() == list(range(8))


def test_only_facets_with_all_nodes_in_the_patch_count():
    points = np.column_stack([np.linspace(0, 1, 8), np.zeros(8)])
    edges = {"line": np.column_stack([np.arange(7), np.arange(1, 8)])}
    (piece,) = smooth_pieces(points, edges, np.array([0, 1, 2, 5]))
    assert piece.facets.tolist() == [[0, 1], [1, 2]]
    assert smooth_pieces(points, edges, np.array([0, 2, 5])) == []


def test_slightly_bent_is_curved_and_file_precision_is_planar():
    x = np.linspace(0, 1, 21)
    edges = {"line": np.column_stack([np.arange(20), np.arange(1, 21)])}
    for height, planar in ((1e-8, True), (1e-4, False)):
        (piece,) = smooth_pieces(np.column_stack([x, height * np.sin(3 * x)]), edges, np.arange(21))
        assert (piece.normal is not None) == planar


def test_quads_and_triangles_join_at_their_sides():
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0], [2, 0, 1], [1, 0, 1.0]])
    facets = {"triangle": np.array([[1, 4, 2]]), "quad": np.array([[0, 1, 2, 3], [1, 6, 5, 4]])}
    floor, wall = sorted(smooth_pieces(points, facets, np.arange(7)), key=lambda piece: -len(piece.facets))
    assert floor.normal.tolist() == [0, 0, 1]
    assert floor.simplices.tolist() == [[1, 4, 2], [0, 1, 2], [0, 2, 3]]
    assert wall.normal.tolist() == [0, 1, 0]


def test_a_closed_surface_has_no_normal():
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 0.05], [0.5, 0.5, -0.05]])
    around = [(0, 1), (1, 2), (2, 3), (3, 0)]
    top, bottom = [(a, b, 4) for a, b in around], [(b, a, 5) for a, b in around]
    pieces = smooth_pieces(points, {"triangle": np.array(top + bottom)}, np.arange(6))
    assert len(pieces) == 2  # the rim turns by far more than 40°
    assert all(piece.normal is None for piece in pieces)


def test_vertices_of_a_line_mesh_stand_alone():
    pieces = smooth_pieces(np.array([[0.0], [1.0]]), {"vertex": np.array([[0], [1]])}, np.array([0, 1]))
    assert [piece.normal.tolist() for piece in pieces] == [[1.0], [1.0]]


def test_sides():
    keys, owners = sides(np.array([[5, 1, 3, -1], [1, 3, 7, 9]]))
    found = sorted((owner, *key) for owner, key in zip(owners.tolist(), keys.tolist(), strict=True))
    assert found == [(0, 1, 3), (0, 1, 5), (0, 3, 5), (1, 1, 3), (1, 1, 9), (1, 3, 7), (1, 7, 9)]
    assert sides(np.array([[2]]))[0].shape == (0, 1)
