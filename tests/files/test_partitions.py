"""Partitions cover a mesh once, with the nodes that their cells need."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mesh_files import lists
from mesh_motion_protocol.errors import InvalidInput
from own_ranks import box_file

from mesh_motion_server.files import read_mesh
from mesh_motion_server.files.mesh_file import MeshFile
from mesh_motion_server.files.partitions import partitions, write_partitions

KINDS = ["quad", "quad + triangle", "tetra", "hexahedron + wedge"]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("count", [1, 3, 7])
def test_every_cell_is_in_one_partition_with_its_nodes_and_their_patches(kind: str, count: int) -> None:
    mesh, found = box_file(kind, 5), {name: [] for name in box_file(kind, 5).cells}
    on_patches: dict[str, set[int]] = {name: set() for name in mesh.patches}
    parts = list(partitions(mesh, count))
    for part in parts:
        ids = part.global_ids
        assert ids is not None
        assert (np.diff(ids) > 0).all()
        np.testing.assert_array_equal(part.points, mesh.points[ids])
        np.testing.assert_array_equal(
            np.unique(np.concatenate([c.ravel() for c in part.cells.values()])), np.arange(len(ids))
        )
        for name, nodes in part.cells.items():
            found[name] += [tuple(cell) for cell in ids[nodes].tolist()]
        for name, nodes in mesh.patches.items():
            here = part.patches.get(name, np.empty(0, dtype=np.int64))
            np.testing.assert_array_equal(ids[here], np.intersect1d(ids, nodes))
            on_patches[name] |= set(ids[here].tolist())
    assert len(parts) == count
    for name, nodes in mesh.cells.items():
        assert sorted(found[name]) == sorted(map(tuple, nodes.tolist()))
    assert on_patches == {name: set(nodes.tolist()) for name, nodes in mesh.patches.items()}


def test_shares_are_equal_and_few_nodes_are_in_two() -> None:
    mesh = box_file("tetra", 16)
    parts = list(partitions(mesh, 4))
    assert max(part.n_cells for part in parts) < 1.3 * mesh.n_cells / 4
    assert sum(len(part.points) for part in parts) < 1.45 * len(mesh.points)  # a layer of 16³ / 4 about each


def test_a_node_of_no_cell_is_in_no_partition() -> None:
    mesh = box_file("quad", 6)
    more = len(mesh.points)
    mesh = replace(mesh, points=np.concatenate([mesh.points, [[0.3, 0.9]]]))
    assert not any(more in part.global_ids.tolist() for part in partitions(mesh, 2) if part.global_ids is not None)


def test_too_many_partitions_are_refused() -> None:
    points = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    mesh = MeshFile(points, {"triangle": np.array([[0, 1, 2], [1, 3, 2]])}, {}, Path("two"))
    with pytest.raises(InvalidInput, match=r"two: a mesh of 4 nodes and 2 cells in 4 partitions.*fewer partitions"):
        next(partitions(mesh, 4))
    with pytest.raises(InvalidInput, match="expected one partition or more, got 0"):
        next(partitions(mesh, 0))


def test_a_written_partition_is_read_again_and_its_file_is_refused_where_its_numbers_do_not_fit(tmp_path: Path) -> None:
    mesh = box_file("quad", 6)
    files = write_partitions(tmp_path / "parts", mesh, 2)
    assert [file.name for file in files] == ["partition-000.npz", "partition-001.npz"]
    for file, part in zip(files, partitions(mesh, 2), strict=True):
        read = read_mesh(file)
        np.testing.assert_array_equal(read.global_ids, part.global_ids)
        np.testing.assert_array_equal(read.cells["quad"], part.cells["quad"])
        assert lists(read.patches) == {name: nodes.tolist() for name, nodes in part.patches.items()}
    again = [part.global_ids for part in partitions(replace(read_mesh(files[0])), 2)]
    assert all(np.isin(ids, read_mesh(files[0]).global_ids).all() for ids in again)
    with np.load(files[0]) as stored:
        arrays = dict(stored) | {"global_ids": stored["global_ids"][1:]}
    np.savez(files[0], **arrays)
    with pytest.raises(InvalidInput, match="global_ids: expected shape"):
        read_mesh(files[0])
