"""The boundary is closed, outward and complete for every cell type; facets of three cells are refused."""

from collections import Counter

import mesh_motion_kernels as kernels
import numpy as np
import pytest
from mesh_motion_numerics.mesh import boundary_facets as module
from mesh_motion_numerics.mesh.boundary_facets import LOCAL_FACETS, boundary_facets, boundary_nodes
from mesh_motion_numerics.mesh.cells import CELL_TYPES, CellTable
from mesh_motion_numerics.quality.metrics import reference_sizes
from mesh_motion_protocol.errors import InvalidInput

CUBE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], dtype=float)
ONE_CELL = {
    "line": np.array([[0.0], [1.0]]),
    "triangle": np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]),
    "quad": np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]),
    "tetra": np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
    "hexahedron": CUBE,
    "wedge": CUBE[[0, 1, 3, 4, 5, 7]],
    "pyramid": np.vstack([CUBE[:4], [[0.5, 0.5, 1.0]]]),
}


def flux(points: np.ndarray, facets: dict[str, np.ndarray]) -> tuple[np.ndarray, float]:
    """Sum of outward area vectors, and the enclosed volume by the divergence theorem; quads as four triangles."""
    triangles = [facets.get("triangle", np.empty((0, 3), dtype=int))]
    triangles = [points[t] for t in triangles]
    for q in facets.get("quad", np.empty((0, 4), dtype=int)):
        middle = points[q].mean(axis=0)
        triangles.append(np.array([[points[q[i]], points[q[(i + 1) % 4]], middle] for i in range(4)]))
    a, b, c = np.concatenate(triangles).transpose(1, 0, 2)
    area = np.cross(b - a, c - a) / 2
    return area.sum(axis=0), float(((a + b + c) / 3 * area).sum() / 3)


@pytest.mark.parametrize("name", CELL_TYPES)
def test_one_cell_is_bounded_by_its_own_facets_seen_from_outside(name):
    points = ONE_CELL[name]
    cells = CellTable.from_arrays({name: np.arange(len(points))[None]})
    facets = boundary_facets(cells)
    found = [tuple(row) for nodes in facets.values() for row in nodes.tolist()]
    assert sorted(found) == sorted(LOCAL_FACETS[name])
    assert boundary_nodes(cells).tolist() == list(range(len(points)))
    if CELL_TYPES[name].dimension == 3:
        closed, volume = flux(points, facets)
        size = reference_sizes(points, cells)[0]
        assert closed == pytest.approx(np.zeros(3), abs=1e-15)
        assert volume == pytest.approx(size * CELL_TYPES[name].size_factor)


def test_a_mesh_of_all_four_3d_types_has_one_closed_surface():
    points = np.vstack([CUBE, [[0.5, 0.5, 2.0], [2, 0.5, 0], [2, 0.5, 1], [0.5, -0.5, 1.8]]])
    cells = CellTable.from_arrays(
        {
            "hexahedron": np.arange(8)[None],
            "pyramid": np.array([[4, 5, 6, 7, 8]]),
            "wedge": np.array([[1, 9, 2, 5, 10, 6]]),
            "tetra": np.array([[4, 5, 8, 11]]),  # on the pyramid's side 4, 5, 8
        }
    )
    assert (reference_sizes(points, cells) > 0).all()
    facets = boundary_facets(cells)
    assert {name: len(nodes) for name, nodes in facets.items()} == {"triangle": 3 + 3 + 2, "quad": 4 + 2}
    factors = [CELL_TYPES[name].size_factor for name in ("tetra", "hexahedron", "wedge", "pyramid")]
    closed, volume = flux(points, facets)
    assert closed == pytest.approx(np.zeros(3), abs=1e-15)
    assert volume == pytest.approx(reference_sizes(points, cells) @ factors)


def test_a_node_with_many_cells():
    around = np.arange(1, 101)
    fan = np.column_stack([np.zeros(100, dtype=int), around, np.roll(around, -1)])
    facets = boundary_facets(CellTable.from_arrays({"triangle": fan}))
    np.testing.assert_array_equal(facets["line"], fan[:, 1:])


def test_a_facet_of_three_cells_is_named():
    cells = CellTable.from_arrays({"tetra": np.array([[0, 1, 2, 3], [0, 2, 1, 4], [5, 0, 1, 2]])})
    with pytest.raises(
        InvalidInput, match=r"facet with the nodes \[0, 1, 2\] belongs to 3 cells \(0, 1, 2\)"
    ) as caught:
        boundary_facets(cells)
    assert caught.value.code == "INVALID_ARGUMENT.MESH_DEGENERATE"
    assert caught.value.details == {"facet": [0, 1, 2], "cells": [0, 1, 2]}


def test_quads_with_three_nodes_in_common_are_different_facets():
    cells = CellTable.from_arrays({"pyramid": np.array([[0, 1, 2, 3, 8], [0, 1, 2, 4, 9]])})
    assert len(boundary_facets(cells)["quad"]) == 2


@pytest.mark.parametrize("name", CELL_TYPES)
def test_a_cell_and_its_copy_overlap(name):
    nodes = np.arange(CELL_TYPES[name].n_nodes)
    with pytest.raises(InvalidInput, match=r"belongs to 2 cells \(0, 1\); .* on different sides"):
        boundary_facets(CellTable.from_arrays({name: np.array([nodes, nodes])}))


def test_cells_on_one_side_of_their_common_facet_overlap():
    with pytest.raises(InvalidInput, match=r"nodes \[0, 1\] belongs to 2 cells"):
        boundary_facets(CellTable.from_arrays({"triangle": np.array([[0, 1, 2], [0, 1, 3]])}))


def test_a_closed_surface_has_no_boundary():
    cells = CellTable.from_arrays({"triangle": np.array([[0, 1, 2], [0, 2, 1]])})
    assert boundary_facets(cells) == {}
    assert len(boundary_nodes(cells)) == 0


def test_facets_are_found_once_for_a_cell_table_and_forgotten_with_it() -> None:
    cells = CellTable.from_arrays({"triangle": np.array([[0, 1, 2], [0, 2, 3]])})
    first = boundary_facets(cells)
    assert boundary_facets(cells)["line"] is first["line"]
    first.clear()
    assert list(boundary_facets(cells)) == ["line"]
    kept = len(module._KEPT)
    del cells
    assert len(module._KEPT) == kept - 1


def mixed_layers(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Hexahedra, wedges and pairs of pyramids and tetrahedra in a row, with nodes in random order."""
    grid = np.arange(5 * 4 * 4).reshape(5, 4, 4)
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    boxes = np.stack([grid[i : i + 4, j : j + 3, k : k + 3].ravel() for i, j, k in corners], axis=1)
    rename = rng.permutation(grid.size)
    boxes = rename[boxes[rng.permutation(len(boxes))]]
    third = len(boxes) // 3
    wedges = np.concatenate([boxes[:third, [0, 1, 3, 4, 5, 7]], boxes[:third, [1, 2, 3, 5, 6, 7]]])
    top = grid.size + np.arange(third)[:, None]  # a node in the middle of each box
    around = boxes[third : 2 * third]
    sides = [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
    pyramids = [np.hstack([around[:, side[::-1]], top]) for side in sides]
    split = pyramids.pop()
    tetra = np.concatenate([split[:, [0, 1, 2, 4]], split[:, [0, 2, 3, 4]]])
    return {"hexahedron": boxes[2 * third :], "wedge": wedges, "pyramid": np.concatenate(pyramids), "tetra": tetra}


def counted_one_by_one(cells: CellTable) -> dict[str, list[list[int]]]:
    """Facets with nodes of no other facet, by a search through all of them."""
    facets = [
        [row[i] for i in facet]
        for block in cells
        for row in block.nodes.tolist()
        for facet in LOCAL_FACETS[block.type.name]
    ]
    times = Counter(tuple(sorted(facet)) for facet in facets)
    single = [facet for facet in facets if times[tuple(sorted(facet))] == 1]
    names = {1: "vertex", 2: "line", 3: "triangle", 4: "quad"}
    return {names[size]: [f for f in single if len(f) == size] for size in sorted({len(f) for f in single})}


@pytest.mark.parametrize("threads", [1, 2])
def test_many_cells_of_all_types_have_the_facets_that_one_by_one_counting_finds(threads):
    cells = CellTable.from_arrays(mixed_layers(np.random.default_rng(5)))
    before = kernels.get_threads()
    kernels.set_threads(min(threads, kernels.available_threads()))
    try:
        found = boundary_facets(cells)
    finally:
        kernels.set_threads(before)
    assert {name: nodes.tolist() for name, nodes in found.items()} == counted_one_by_one(cells)
