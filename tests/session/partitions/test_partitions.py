"""Merging: one and many partitions give identical arrays, and every disagreement is named."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.session.partitions.merging import merge
from mesh_motion_server.session.partitions.meshes import PartitionMesh
from mesh_motion_server.session.partitions.numbering import in_senders_numbers, text_in_senders_numbers, upload_view
from tests.faults.stand_in import grid_mesh, split_mesh


def assert_same(a: Any, b: Any) -> None:
    np.testing.assert_array_equal(a.points, b.points)
    np.testing.assert_array_equal(a.global_ids, b.global_ids)
    assert [block.type.name for block in a.cells] == [block.type.name for block in b.cells]
    for one, other in zip(a.cells, b.cells, strict=True):
        np.testing.assert_array_equal(one.nodes, other.nodes)
    assert list(a.patches) == list(b.patches)
    for name, patch in a.patches.items():
        assert patch.role == b.patches[name].role
        np.testing.assert_array_equal(patch.nodes, b.patches[name].nodes)


@pytest.mark.parametrize("parts", [1, 2, 3, 7])
def test_partitions_merge_to_identical_arrays(parts: int) -> None:
    whole = grid_mesh(6)
    for seed in range(5):
        assert_same(merge([whole]), merge(split_mesh(whole, parts, seed)))


@pytest.mark.parametrize("at", [0, 1, 2])
def test_a_partition_may_have_no_nodes(at: int) -> None:
    meshes = split_mesh(grid_mesh(6), 2)
    meshes.insert(at, PartitionMesh(np.empty((0, 2)), np.empty(0, dtype=np.int64), {}, {}))
    mesh = merge(meshes)
    assert_same(mesh, merge([grid_mesh(6)]))
    assert len(mesh.node_maps[at]) == len(mesh.moving_local[at]) == 0
    with pytest.raises(InvalidInput, match="the mesh has no nodes"):
        merge(meshes[at : at + 1] * 2)


@given(seed=st.integers(0, 10_000), parts=st.integers(1, 5))
def test_the_way_back_names_what_each_partition_sent(seed: int, parts: int) -> None:
    meshes = split_mesh(grid_mesh(5), parts, seed)
    mesh = merge(meshes)
    for p, sent in enumerate(meshes):
        np.testing.assert_array_equal(mesh.scatter(mesh.points, p), sent.points)
        np.testing.assert_array_equal(mesh.global_ids[mesh.node_maps[p]], sent.global_ids)
    for cell in range(len(mesh.cells)):
        p, name, local = mesh.locate_cell(cell)
        here = meshes[p].points[meshes[p].cells[name][local]]
        np.testing.assert_array_equal(mesh.points[mesh.cells.blocks[0].nodes[cell]], here)
    for node in range(len(mesh.points)):
        p, local = mesh.locate_node(node)
        assert meshes[p].global_ids[local] == mesh.global_ids[node]
    with pytest.raises(IndexError):
        mesh.locate_cell(len(mesh.cells))
    with pytest.raises(IndexError):
        mesh.locate_node(len(mesh.points))


@pytest.mark.parametrize("parts", [1, 2, 4])
def test_displacements_are_gathered_by_node(parts: int) -> None:
    meshes = split_mesh(grid_mesh(6), parts) if parts > 1 else [grid_mesh(6)]
    mesh = merge(meshes)
    rows = [np.sin(m.points[local]) for m, local in zip(meshes, mesh.moving_local, strict=True)]
    np.testing.assert_array_equal(mesh.gather_moving(rows), np.sin(mesh.points[mesh.moving]))
    assert (np.diff(mesh.moving) > 0).all()
    assert all((np.diff(local) > 0).all() for local in mesh.moving_local)


def two() -> list[Any]:
    meshes = split_mesh(grid_mesh(5), 2, 3)
    assert all("left" in mesh.patches for mesh in meshes)
    return list(meshes)


def test_partitions_that_move_a_shared_node_differently_are_named() -> None:
    meshes = two()
    mesh = merge(meshes)
    rows = [np.ones((len(local), 2)) for local in mesh.moving_local]
    ids = [m.global_ids[local] for m, local in zip(meshes, mesh.moving_local, strict=True)]
    shared = int(np.intersect1d(*ids)[0])
    row = int(np.flatnonzero(ids[1] == shared)[0])
    rows[1][row, 1] += 0.9e-7  # the mesh is 1 wide: accepted, and the larger value of all partitions is taken
    expected = np.ones((len(mesh.moving), 2))
    expected[np.flatnonzero(mesh.global_ids[mesh.moving] == shared), 1] = rows[1][row, 1]
    np.testing.assert_array_equal(mesh.gather_moving(rows), expected)
    np.testing.assert_array_equal(merge(meshes[::-1]).gather_moving(rows[::-1]), expected)
    rows[1][row, 1] += 0.2e-7
    with pytest.raises(InvalidInput, match=f"global id {shared}: partition 0 moves it by") as caught:
        mesh.gather_moving(rows)
    assert caught.value.code == "INVALID_ARGUMENT.PARTITION"
    assert caught.value.details["global_id"] == shared
    assert caught.value.details["partitions"] == [0, 1]


def test_coordinates_of_shared_nodes_must_agree() -> None:
    meshes = two()
    shared = int(np.intersect1d(meshes[0].global_ids, meshes[1].global_ids)[0])
    row = int(np.flatnonzero(meshes[1].global_ids == shared)[0])
    points = meshes[1].points.copy()
    points[row, 0] += 1e-10  # below 1e-10 of the diagonal √2
    meshes[1] = replace(meshes[1], points=points)
    assert_same(merge(meshes), merge([grid_mesh(5)]))
    points = points.copy()
    points[row, 0] += 1e-9
    meshes[1] = replace(meshes[1], points=points)
    with pytest.raises(InvalidInput, match=f"global id {shared}: partition 0 has it at") as caught:
        merge(meshes)
    assert caught.value.details["partitions"] == [0, 1]
    assert len(caught.value.details["values"]) == 2  # type: ignore[arg-type]


@pytest.mark.parametrize("parts", [1, 3])
def test_the_senders_numbering(parts: int) -> None:
    whole = grid_mesh(4)
    meshes = split_mesh(whole, parts) if parts > 1 else [whole]
    view = upload_view(merge(meshes))
    np.testing.assert_array_equal(view.points, whole.points)
    for name, patch in whole.patches.items():
        np.testing.assert_array_equal(view.patches[name].nodes, patch.nodes)
    sent = np.concatenate([m.global_ids[m.cells["triangle"]] for m in meshes])
    np.testing.assert_array_equal(view.cells.blocks[0].nodes, sent)
    first_of_last = sum(len(m.cells["triangle"]) for m in meshes[:-1])
    assert view.name_cell(first_of_last) == {"partition": parts - 1, "type": "triangle", "cell": 0}
    named = view.name_node(5)
    assert named["global_id"] == 5
    assert meshes[named["partition"]].global_ids[named["node"]] == 5  # type: ignore[index,call-overload]


def test_cells_in_pieces_are_merged_as_if_they_had_come_at_once() -> None:
    parts = split_mesh(grid_mesh(), 2)
    pieces = [
        replace(p, cells={name: (rows[:5], rows[5:5], rows[5:]) for name, rows in p.cells.items()}) for p in parts
    ]
    at_once, in_pieces = merge(parts), merge(pieces)
    np.testing.assert_array_equal(in_pieces.cells.blocks[0].nodes, at_once.cells.blocks[0].nodes)
    assert [in_pieces.locate_cell(c) for c in range(20)] == [at_once.locate_cell(c) for c in range(20)]
    rows = parts[0].cells["triangle"].copy()
    rows[7, 1] = 999
    with pytest.raises(InvalidInput, match=r"cell type 'triangle', row 7: node index 999"):
        merge([replace(parts[0], cells={"triangle": (rows[:5], rows[5:])})])


def test_ids_in_any_order_give_the_mesh_of_ascending_ones() -> None:
    whole = grid_mesh()
    order = np.random.default_rng(1).permutation(len(whole.points))
    rank = np.argsort(order)
    shuffled = replace(
        whole,
        points=whole.points[order],
        global_ids=whole.global_ids[order],
        cells={name: rank[rows] for name, rows in whole.cells.items()},
        patches={name: replace(patch, nodes=rank[patch.nodes]) for name, patch in whole.patches.items()},
    )
    one, other = merge([whole]), merge([shuffled])
    assert one.points.tobytes() == other.points.tobytes()
    np.testing.assert_array_equal(one.id_order, other.id_order)
    np.testing.assert_array_equal(one.cells.blocks[0].nodes, other.cells.blocks[0].nodes)
    np.testing.assert_array_equal(one.node_maps[0], other.node_maps[0][rank])


def test_the_origin_of_cells_takes_little_memory() -> None:
    whole = grid_mesh()
    single, split = merge([whole]), merge(split_mesh(whole, 3))
    for mesh in (single, split):
        (origin,) = mesh.cell_origins
        assert origin.partition.dtype == origin.local.dtype == np.int32
    assert single.cell_origins[0].partition.strides == (0,)
    cells = [single.locate_cell(cell)[2] for cell in range(len(single.cells))]
    assert sorted(cells) == list(range(len(whole.cells["triangle"])))
    rank = single.node_maps[0]
    np.testing.assert_array_equal(rank[whole.cells["triangle"][cells]], single.cells.blocks[0].nodes)


def test_the_durable_order_is_ascending_by_global_id() -> None:
    whole = replace(grid_mesh(), global_ids=np.random.default_rng(3).permutation(100)[:25] * 7)
    for mesh in (merge([whole]), merge(split_mesh(whole, 3))):
        np.testing.assert_array_equal(mesh.id_order, np.argsort(mesh.global_ids))


@pytest.mark.parametrize("parts", [1, 3])
def test_an_error_about_a_motion_counts_nodes_as_their_senders_do(parts: int) -> None:
    meshes = split_mesh(grid_mesh(), parts) if parts > 1 else [grid_mesh()]
    mesh = merge(meshes)
    node, image = 7, 13
    raised = InvalidInput(f"node {node} and node {image} differ by 7", hint="h", details={"node": node, "image": image})
    renumbered = in_senders_numbers(raised, mesh)
    ids = mesh.global_ids
    assert renumbered.message == f"node {ids[node]} and node {ids[image]} differ by 7"
    assert text_in_senders_numbers(f"moving node {node} is off", mesh) == f"moving node {ids[node]} is off"
    assert (renumbered.code, renumbered.hint, renumbered.details["image"]) == (raised.code, "h", ids[image])
    sender = meshes[int(renumbered.details.get("partition", 0))]
    assert sender.global_ids[renumbered.details["node"]] == ids[node] == renumbered.details.get("global_id", ids[node])
