"""A refined mesh fills the same space with eight times the cells, and keeps its quality."""

from itertools import permutations

import numpy as np
import pytest
from mesh_motion_numerics.mesh.boundary_facets import boundary_facets, boundary_nodes
from mesh_motion_numerics.mesh.cells import CellTable
from mesh_motion_numerics.quality.metrics import reference_sizes

from benchmarks.peers.refinement import refined_tetrahedra


def _cube() -> tuple[np.ndarray, np.ndarray]:
    """A distorted grid of the unit cube, each of its boxes cut into six tetrahedra along a diagonal (Kuhn)."""
    lines = np.linspace(0, 1, 4)
    points = np.stack(np.meshgrid(lines, lines, lines, indexing="ij"), axis=-1).reshape(-1, 3)
    inside = ((points > 0) & (points < 1)).all(axis=1)
    points[inside] += 0.06 * np.random.default_rng(0).uniform(-1, 1, (inside.sum(), 3))
    number = np.arange(64).reshape(4, 4, 4)
    corner, steps = number[:-1, :-1, :-1].ravel(), np.array([16, 4, 1])
    paths = [corner[:, None] + [0, *np.cumsum(steps[list(order)])] for order in permutations(range(3))]
    cells = np.concatenate(paths)
    mirrored = np.linalg.det(points[cells[:, 1:]] - points[cells[:, :1]]) < 0
    cells[mirrored] = cells[mirrored][:, [1, 0, 2, 3]]
    return points, cells


@pytest.mark.nightly
def test_eight_cells_fill_each_cell_conformingly() -> None:
    points, cells = _cube()
    refined, parts = refined_tetrahedra(points, cells)
    whole, fine = CellTable.from_arrays({"tetra": cells}), CellTable.from_arrays({"tetra": parts})
    assert len(parts) == 8 * len(cells)
    sizes = reference_sizes(refined, fine)
    assert (sizes > 0).all()
    np.testing.assert_allclose(sizes.reshape(-1, 8), np.repeat(reference_sizes(points, whole), 8).reshape(-1, 8) / 8)
    assert len(boundary_facets(fine)["triangle"]) == 4 * len(boundary_facets(whole)["triangle"])
    on_box = ((refined == 0) | (refined == 1)).any(axis=1)  # midpoints of flat faces stay on them
    assert np.array_equal(np.flatnonzero(on_box), boundary_nodes(fine))


def test_old_nodes_stay_and_new_ones_are_midpoints_of_edges() -> None:
    points, cells = _cube()
    refined, parts = refined_tetrahedra(points, cells)
    assert np.array_equal(refined[: len(points)], points)
    edges = np.unique(np.sort(np.concatenate([cells[:, [a, b]] for a in range(4) for b in range(a)]), axis=1), axis=0)
    assert np.array_equal(refined[len(points) :], points[edges].mean(axis=1))
    assert parts.max() == len(refined) - 1
