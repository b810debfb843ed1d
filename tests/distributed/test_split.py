"""Partitions cover a mesh once, with the halo that their cells need."""

from __future__ import annotations

import numpy as np
import pytest
from box_meshes import CELL_KINDS, box_mesh

from mesh_motion_server.distributed.split import Split, mesh_digest
from mesh_motion_server.errors import InvalidInput
from mesh_motion_server.numerics.mesh.cells import CellTable


@pytest.mark.parametrize("kind", CELL_KINDS)
@pytest.mark.parametrize("count", [1, 3, 7])
def test_every_node_and_every_cell_has_one_owner(kind: str, count: int) -> None:
    mesh = box_mesh(kind, 5)
    split = Split.build(mesh.points, mesh.cells, count)
    parts = [split.partition(number) for number in range(count)]
    np.testing.assert_array_equal(np.sort(np.concatenate([p.nodes[p.own] for p in parts])), np.arange(len(mesh.points)))
    np.testing.assert_array_equal(np.sort(np.concatenate([p.cell_numbers for p in parts])), np.arange(len(mesh.cells)))
    sizes = np.empty(len(mesh.cells))
    for part in parts:
        np.testing.assert_array_equal(part.points, mesh.points[part.nodes])
        sizes[part.cell_numbers] = part.reference_sizes
    np.testing.assert_array_equal(sizes, mesh.sizes)


def test_cells_are_those_of_the_mesh_in_its_order() -> None:
    mesh = box_mesh("hexahedron + wedge", 5)
    for number in range(3):
        part = Split.build(mesh.points, mesh.cells, 3).partition(number)
        for block, first in zip(part.cells, part.cells.offsets, strict=False):
            numbers = part.cell_numbers[first : first + len(block)]
            assert (np.diff(numbers) > 0).all()
            for row, cell in zip(part.nodes[block.nodes], numbers, strict=True):
                whole, place = mesh.cells.locate(int(cell))
                assert whole.type is block.type
                np.testing.assert_array_equal(row, whole.nodes[place])


def test_shares_are_equal_and_halos_thin() -> None:
    mesh = box_mesh("tetra", 16)
    parts = [Split.build(mesh.points, mesh.cells, 4).partition(number) for number in range(4)]
    assert np.ptp([len(part.own) for part in parts]) <= 1
    assert max(len(part.nodes) - len(part.own) for part in parts) < 0.6 * len(parts[0].own)  # a layer of 16³ / 4
    assert max(len(part.cells) for part in parts) < 1.3 * len(mesh.cells) / 4


def test_too_many_partitions_are_refused() -> None:
    points = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    cells = CellTable.from_arrays({"triangle": np.array([[0, 1, 2], [1, 3, 2]])})
    with pytest.raises(InvalidInput, match=r"4 nodes and 2 cells in 4 partitions.*fewer partitions"):
        Split.build(points, cells, 4)


def test_a_digest_names_a_mesh() -> None:
    mesh, other = box_mesh("quad", 5), box_mesh("quad", 6)
    moved = mesh.points.copy()
    moved[3, 0] = np.nextafter(moved[3, 0], 1.0)
    digests = {
        mesh_digest(mesh.points, mesh.cells),
        mesh_digest(moved, mesh.cells),
        mesh_digest(other.points, other.cells),
    }
    assert len(digests) == 3
    assert mesh_digest(mesh.points.copy(), mesh.cells) in digests
