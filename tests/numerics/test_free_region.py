"""Regions: their nodes and cells, and gathers compared with dense scatters."""

import numpy as np
import pytest
from box_meshes import CELL_KINDS, box_mesh
from mesh_motion_numerics.correction.distortion import PNorm, corner_blocks, distortion_gradient, mean_distortion
from mesh_motion_numerics.correction.free_region import cells_of_nodes, free_region, gathered, grow, nodes_of_cells


def some_free(mesh, seed: int = 1) -> np.ndarray:
    return (np.random.default_rng(seed).random(len(mesh.points)) < 0.3) & ~mesh.held


@pytest.mark.parametrize("kind", CELL_KINDS)
def test_a_region_holds_the_cells_that_feel_its_free_nodes(kind: str) -> None:
    mesh = box_mesh(kind, 5)
    free = some_free(mesh)
    region = free_region(mesh.points, mesh.cells, mesh.sizes, free)
    assert np.array_equal(region.free, np.flatnonzero(free))
    everything = [tuple(row) for block in mesh.cells for row in block.nodes.tolist()]
    expected = [number for number, nodes in enumerate(everything) if free[list(nodes)].any()]
    assert region.cell_numbers.tolist() == expected
    local = [tuple(region.nodes[row].tolist()) for block in region.cells for row in block.nodes]
    assert local == [everything[number] for number in expected]
    np.testing.assert_array_equal(region.reference_sizes, mesh.sizes[expected])
    assert len(set(region.nodes.tolist())) == len(region.nodes)


@pytest.mark.parametrize("kind", CELL_KINDS)
def test_gathers_are_the_sums_over_corners(kind: str) -> None:
    mesh = box_mesh(kind, 5)
    region = free_region(mesh.points, mesh.cells, mesh.sizes, some_free(mesh))
    points, norm, d = mesh.points[region.nodes], PNorm(2, 1), mesh.points.shape[1]
    points = points + 0.01 * np.random.default_rng(2).normal(size=points.shape)
    _, weights = mean_distortion(points, region.simplices, norm)
    shares = distortion_gradient(points, region.simplices, weights, norm)
    expected = np.zeros_like(points)
    np.add.at(expected, region.simplices.nodes, shares)
    np.testing.assert_allclose(gathered(region.adjacency, shares), expected[: region.n_free], rtol=1e-12, atol=1e-13)

    blocks = np.zeros((len(region.simplices), d * d, d * d), dtype=np.float32)
    corner_blocks(points, region.simplices, weights, norm, blocks)
    dense = np.zeros((len(points), d, len(points), d))
    edges_to_nodes = np.kron(np.hstack([-np.ones((d, 1)), np.eye(d)]), np.eye(d))  # (d², (d + 1) d)
    for nodes, block in zip(region.simplices.nodes, blocks, strict=True):
        at_edges = block.astype(float).reshape(d, d, d, d).swapaxes(1, 2).reshape(d * d, d * d)
        full = (edges_to_nodes.T @ at_edges @ edges_to_nodes).reshape(d + 1, d, d + 1, d)
        dense[np.ix_(nodes, range(d), nodes, range(d))] += full
    found = np.zeros_like(dense)
    adjacency, hessian = region.adjacency, region.adjacency.assemble(blocks, d)
    for row in range(region.n_free):
        for entry in range(adjacency.row_starts[row], adjacency.row_starts[row + 1]):
            found[row, :, adjacency.columns[entry]] += hessian[entry]
    free = slice(0, region.n_free)
    scale = np.abs(dense).max()
    np.testing.assert_allclose(found[free, :, free], dense[free, :, free], atol=1e-12 * scale)
    assert (adjacency.columns[adjacency.row_starts[:-1]] == np.arange(region.n_free)).all()  # diagonal first


def test_growing_adds_layers_of_cells() -> None:
    mesh = box_mesh("quad")
    marked = np.zeros(len(mesh.points), dtype=bool)
    marked[np.flatnonzero((mesh.points == [0.0, 0.0]).all(axis=1))] = True
    for rings in (0, 1, 2):
        grown = grow(mesh.cells, marked, rings)
        assert np.array_equal(grown, (mesh.points < 0.1 * rings + 0.05).all(axis=1))
    touched = cells_of_nodes(mesh.cells, marked)
    assert touched.sum() == 1
    assert nodes_of_cells(mesh.cells, touched, len(mesh.points)).sum() == 4


def test_a_region_may_be_given_its_cells() -> None:
    mesh = box_mesh("tetra", 5)
    chosen = np.zeros(len(mesh.cells), dtype=bool)
    chosen[::7] = True
    region = free_region(mesh.points, mesh.cells, mesh.sizes, ~mesh.held, chosen=chosen)
    assert np.array_equal(region.cell_numbers, np.flatnonzero(chosen))
    assert np.array_equal(np.sort(region.nodes), np.flatnonzero(nodes_of_cells(mesh.cells, chosen, len(mesh.points))))
    assert not mesh.held[region.free].any()
