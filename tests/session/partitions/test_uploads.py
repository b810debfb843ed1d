"""Uploads: parts are appended, counted and checked at their arrival."""

from typing import Any

import numpy as np
import pytest
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.session.partitions.uploads import MeshUpload, Part


def nodes(rows: Any) -> Part:
    return Part("nodes", "", "", np.asarray(rows, dtype=float))


@pytest.fixture
def upload() -> MeshUpload:
    return MeshUpload(2, 1, 10_000)


def test_parts_are_appended_in_the_order_they_come(upload: MeshUpload) -> None:
    assert upload.add(0, nodes([[0, 0], [1, 0]])) == 2
    assert upload.add(0, Part("cells", "triangle", "", np.array([[0, 1, 2]]))) == 1
    assert upload.add(0, nodes([[0, 1]])) == 3
    assert upload.add(0, Part("patch", "wall", "moving", np.array([[2]]))) == 1
    assert upload.add(0, Part("patch", "wall", "moving", np.array([[0], [1]]))) == 3
    (mesh,) = upload.meshes()
    assert mesh.points.tolist() == [[0, 0], [1, 0], [0, 1]]
    assert mesh.patches["wall"].nodes.tolist() == [2, 0, 1]
    assert mesh.global_ids.tolist() == [0, 1, 2]
    assert upload.nbytes == 3 * 16 + 24 + 24
    upload.clear()
    assert upload.nbytes == 0


def test_parts_can_be_taken_back(upload: MeshUpload) -> None:
    upload.add(0, nodes([[0, 0], [1, 0], [0, 1]]))
    before = upload.count, upload.nbytes
    upload.add(0, Part("patch", "triangle", "moving", np.array([[2]])))
    upload.add(0, Part("cells", "triangle", "", np.array([[0, 1, 2]])))
    upload.add(0, nodes([[1, 1]]))
    upload.back_to(upload.count - 2)
    assert upload.meshes()[0].patches["triangle"].nodes.tolist() == [2]
    upload.back_to(1)
    assert (upload.count, upload.nbytes) == before
    assert upload.add(0, Part("patch", "triangle", "fixed", np.array([[0]]))) == 1  # with any role
    (mesh,) = upload.meshes()
    assert (len(mesh.points), mesh.cells) == (3, {})
    assert mesh.patches["triangle"].role == "fixed"


def test_an_empty_part_is_a_part(upload: MeshUpload) -> None:
    with pytest.raises(InvalidInput, match="partition 0 sent no nodes"):
        upload.meshes()
    assert upload.add(0, nodes(np.empty((0, 2)))) == 0
    assert len(upload.meshes()[0].points) == 0


def test_a_mesh_in_parts_is_not_held_twice() -> None:
    upload = MeshUpload(dimension=2, partitions=1, byte_budget=1 << 20)
    for start in (0.0, 1.0, 2.0):
        upload.add(0, Part("nodes", "", "", np.full((3, 2), start)))
    (mesh,) = upload.meshes()
    (again,) = upload.meshes()
    assert again.points is mesh.points
    assert upload.add(0, Part("nodes", "", "", np.full((1, 2), 3.0))) == 10
    assert upload.meshes()[0].points[:, 0].tolist() == [0, 0, 0, 1, 1, 1, 2, 2, 2, 3]
