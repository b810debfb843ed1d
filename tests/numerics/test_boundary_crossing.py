"""Boundaries that cross themselves: exact cases in 2D and 3D, boundaries that touch or share a node, and every cell
type.
"""

import mesh_motion_kernels as kernels
import numpy as np
import pytest
from frame_meshes import rotation
from mesh_motion_numerics.mesh.boundary_crossing import (
    BoundaryFacets,
    crossing_place,
    straddling_place,
    touching_facets,
)
from mesh_motion_numerics.mesh.smooth_pieces import area_vectors


def facets_of(points: np.ndarray, **nodes: list[list[int]]) -> tuple[BoundaryFacets, np.ndarray]:
    every = np.arange(len(points))
    table = {name: np.array(rows) for name, rows in nodes.items()}
    return BoundaryFacets.build(table, every, every[:0], len(points)), np.asarray(points, dtype=float)


@pytest.mark.parametrize(
    ("end", "crosses"),
    [((1.0, 1.0), True), ((0.2, 0.9), True), ((0.0, 0.49), False), ((0.5, 0.5), False), ((3.0, 0.0), False)],
)
def test_two_segments(end: tuple[float, float], crosses: bool) -> None:
    points = np.array([(0.0, 1.0), (1.0, 0.0), (0.0, 0.0), end])
    place = crossing_place(*facets_of(points, line=[[0, 1], [2, 3]]))
    assert (place is not None) == crosses


@pytest.mark.parametrize("turn", [0.0, 0.3, 1.1])
@pytest.mark.parametrize(
    ("ends", "crosses"),
    [((0.4, 1.4), True), ((0.2, 0.7), True), ((0.0, 1.0), True), ((1.0, 2.0), False), ((1.5, 2.0), False)],
)
def test_segments_in_one_line_cross_if_they_face_the_same_way(
    turn: float, ends: tuple[float, float], crosses: bool
) -> None:
    line = np.array([0.0, 1.0, *ends])
    for far in (0.0, 1e4):
        points = np.column_stack([line, 0.0 * line]) @ rotation(np.degrees(turn)).T + far
        assert (crossing_place(*facets_of(points, line=[[0, 1], [2, 3]])) is not None) == crosses
        assert crossing_place(*facets_of(points, line=[[0, 1], [3, 2]])) is None  # the sides of a baffle


@pytest.mark.parametrize(
    ("shift", "crosses"),
    [((0.5, 0.25), True), ((0.0, 0.0), True), ((1.0, 0.0), False), ((1.0, 1.0), False), ((0.9, 0.9), True)],
)
def test_facets_in_one_plane_cross_if_they_face_the_same_way(shift: tuple[float, float], crosses: bool) -> None:
    quad = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.0)])
    tilt = np.linalg.qr(np.random.default_rng(5).standard_normal((3, 3)))[0]
    tilt *= np.sign(np.linalg.det(tilt))
    for far in (0.0, 1e3):
        points = np.vstack([quad, quad + np.array([*shift, 0.0])]) @ tilt.T + far
        for rows in (
            {"quad": [[0, 1, 2, 3], [5, 6, 7, 4]]},
            {"triangle": [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]},
        ):
            assert (crossing_place(*facets_of(points, **rows)) is not None) == crosses
        assert crossing_place(*facets_of(points, quad=[[0, 1, 2, 3], [7, 6, 5, 4]])) is None
        above = points + np.repeat([(0.0, 0.0, 0.0), tilt[:, 2] * 1e-6], 4, axis=0)
        assert crossing_place(*facets_of(above, quad=[[0, 1, 2, 3], [5, 6, 7, 4]])) is None


@pytest.mark.parametrize(("low", "touches"), [(0.0, 2), (1e-17, 2), (1e-6, 0), (-1e-6, 2)])
def test_facets_that_touch_are_found(low: float, touches: int) -> None:
    points = np.array([(0.0, 0.0), (1.0, 0.0), (0.5, low), (0.5, 1.0)])
    assert len(touching_facets(*facets_of(points, line=[[0, 1], [2, 3]]))) == touches
    solid = np.insert(points, 2, 0.0, axis=1)
    solid = np.vstack([solid, solid[:2] + np.array([0.0, 0.0, 1.0]), solid[2:] + np.array([0.0, 0.0, 0.5])])
    rows = {"quad": [[0, 1, 5, 4]], "triangle": [[2, 3, 6]]}
    assert len(touching_facets(*facets_of(solid, **rows))) == touches


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize(
    ("low", "crosses"),
    [(-1.0, True), (-0.5, True), (1.0, False), (1.0 + 1e-9, False)],
    ids=["half", "", "touch", "gap"],
)
def test_facets_that_cross_in_their_nodes(dimension: int, low: float, crosses: bool) -> None:
    """A wall along y = 0, and a body of two facets from y = 1 to ``low`` that has its middle node on a node of it."""
    points = np.array([(-1.0, 0.0), (0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.0, 0.0), (0.0, low)])
    points[5, 0] = 0.3 if low > 0 else 0.0
    rows = np.array([[0, 1], [1, 2], [3, 4], [4, 5]])
    if low > 1:
        points[4, 1] = 1e-9
    if dimension == 3:
        points = np.vstack([np.insert(points, 2, depth, axis=1) for depth in (0.0, 1.0)])
        rows = np.column_stack([rows, rows[:, ::-1] + 6])
    body = np.flatnonzero(np.arange(len(points)) % 6 > 2)
    kind = {"line" if dimension == 2 else "quad": rows}
    facets = BoundaryFacets.build(kind, body, np.setdiff1d(np.arange(len(points)), body), len(points))
    assert (straddling_place(facets, points) is not None) == crosses
    assert crossing_place(facets, points) is None, "its signs do not say it"


def test_segments_that_share_a_node_do_not_cross() -> None:
    points = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    assert crossing_place(*facets_of(points, line=[[0, 1], [1, 2], [2, 3], [3, 0]])) is None
    bow = points[[0, 2, 1, 3]]
    assert crossing_place(*facets_of(bow, line=[[0, 1], [1, 2], [2, 3], [3, 0]])) is not None


@pytest.mark.parametrize("order", [[0, 1, 2], [1, 2, 0], [0, 2, 1]])
@pytest.mark.parametrize(
    ("x", "y", "low", "crosses"),
    [(0.2, 0.2, -1.0, True), (0.2, 0.2, 0.1, False), (0.2, 0.2, 0.0, False), (0.6, 0.6, -1.0, False)],
)
def test_a_needle_and_a_triangle(order: list[int], x: float, y: float, low: float, crosses: bool) -> None:
    triangle = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)])
    needle = np.array([(x, y, low), (x, y, 1.0), (x + 1e-3, y, 1.0)])
    points = np.vstack([triangle, needle])
    place = crossing_place(*facets_of(points, triangle=[order, [3, 4, 5]]))
    assert (place is not None) == crosses


def test_opposite_walls_that_are_meshed_alike_cross_edge_by_edge() -> None:
    low = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.0)])
    triangles = [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]
    for heights, crosses in (((0.5, 0.5, -0.5, 0.5), True), ((0.5, 0.5, 0.0, 0.5), False)):
        points = np.vstack([low, np.column_stack([low[:, :2], heights])])
        assert (crossing_place(*facets_of(points, triangle=triangles)) is not None) == crosses


def test_quads_of_either_diagonal() -> None:
    quad = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.0)])
    through = np.array([(0.3, 0.4, -1.0), (0.3, 0.4, 1.0), (0.31, 0.4, 1.0), (0.31, 0.4, -1.0)])
    assert crossing_place(*facets_of(np.vstack([quad, through]), quad=[[0, 1, 2, 3], [4, 5, 6, 7]])) is not None
    next_to = through + np.array([1.0, 0.0, 0.0])
    assert crossing_place(*facets_of(np.vstack([quad, next_to]), quad=[[0, 1, 2, 3], [4, 5, 6, 7]])) is None


def test_large_and_small_facets_find_each_other() -> None:
    wall = np.array([(-100.0, 0.0), (100.0, 0.0)])
    small = np.array([(37.0, -1e-3), (37.001, 2e-3)])
    boundary = BoundaryFacets.build({"line": np.array([[0, 1], [2, 3]])}, np.array([2, 3]), np.array([0, 1]), 4)
    place = crossing_place(boundary, np.vstack([wall, small]))
    assert place is not None
    assert crossing_place(boundary, np.vstack([wall, small + np.array([0.0, 0.01])])) is None


def test_facets_with_nodes_that_are_free_to_slide_are_left_out() -> None:
    points = np.array([(0.0, 1.0), (1.0, 0.0), (0.0, 0.0), (1.0, 1.0)])
    rows = {"line": np.array([[0, 1], [2, 3]]), "vertex": np.array([[0]])}
    boundary = BoundaryFacets.build(rows, np.array([2, 3]), np.array([0]), 4)
    assert crossing_place(boundary, points) is None


def gap(one: np.ndarray, other: np.ndarray, along: np.ndarray) -> float:
    """The gap between two sets of places along a unit vector; negative if they overlap."""
    a, b = one @ along, other @ along
    return max(a.min() - b.max(), b.min() - a.max())


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("seed", range(3))
def test_near_facets_are_all_pairs_without_a_plane_between_them(d: int, seed: int) -> None:
    numbers, margin = np.random.default_rng(seed), 0.01
    count, width = 150, 2 if d == 2 else 4
    points = (numbers.uniform(size=(count, 1, d)) + 0.2 * numbers.uniform(size=(count, width, d))).reshape(-1, d)
    facets = np.arange(len(points), dtype=np.int32).reshape(count, width)
    facets[1::5, 0] = facets[0::5, 0]  # common nodes
    if d == 3:
        facets[::3, 3] = -1
    moving = numbers.uniform(size=count) < 0.4
    corners = [points[nodes[nodes >= 0]] for nodes in facets]
    normals = area_vectors(points, facets)
    axes = [[*np.eye(d), normal / np.linalg.norm(normal)] for normal in normals]
    expected = {
        (i, j)
        for i in range(count)
        for j in range(i + 1, count)
        if moving[i] or moving[j]
        if not (set(facets[i]) & set(facets[j])) - {-1}
        if max(gap(corners[i], corners[j], axis) for axis in (*axes[i], *axes[j])) <= margin
    }
    found = kernels.near_facets(points, facets, moving, margin)
    assert len(found) == len(expected) > 100
    assert set(map(tuple, found.tolist())) == expected
