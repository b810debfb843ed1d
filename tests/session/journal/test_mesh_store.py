"""The stored mesh: bitwise, and damage is found."""

from pathlib import Path

import numpy as np
import pytest
from mesh_motion_protocol.errors import DataLoss

from mesh_motion_server.session.journal.filesystem import PosixFileSystem
from mesh_motion_server.session.journal.mesh_store import has_its_length, read_mesh, write_mesh
from proofs.stand_in import grid_mesh, split_mesh

FILES = PosixFileSystem()


@pytest.mark.parametrize("parts", [1, 3])
def test_partitions_are_read_back_bitwise(tmp_path: Path, parts: int) -> None:
    meshes = split_mesh(grid_mesh(5), parts) if parts > 1 else [grid_mesh(5)]
    digest = write_mesh(tmp_path / "mesh.bin", FILES, meshes)
    for sent, read in zip(meshes, read_mesh(tmp_path / "mesh.bin", FILES, digest), strict=True):
        np.testing.assert_array_equal(sent.points, read.points)
        np.testing.assert_array_equal(sent.global_ids, read.global_ids)
        assert list(sent.cells) == list(read.cells)
        np.testing.assert_array_equal(sent.cells["triangle"], read.cells["triangle"])
        assert {n: p.role for n, p in sent.patches.items()} == {n: p.role for n, p in read.patches.items()}
        for name, patch in sent.patches.items():
            np.testing.assert_array_equal(patch.nodes, read.patches[name].nodes)


def test_every_damaged_byte_is_found(tmp_path: Path) -> None:
    path = tmp_path / "mesh.bin"
    digest = write_mesh(path, FILES, [grid_mesh(3)])
    data = path.read_bytes()
    for offset in range(len(data)):
        path.write_bytes(data[:offset] + bytes([data[offset] ^ 1]) + data[offset + 1 :])
        with pytest.raises(DataLoss, match="does not match its digest"):
            read_mesh(path, FILES, digest)
    path.write_bytes(data[:-1])
    with pytest.raises(DataLoss, match="does not match its digest"):
        read_mesh(path, FILES, digest)
    path.unlink()
    with pytest.raises(DataLoss, match="cannot be read") as caught:
        read_mesh(path, FILES, digest)
    assert caught.value.code == "DATA_LOSS.CHECKSUM"


@pytest.mark.parametrize("parts", [1, 3])
def test_a_file_that_is_cut_or_grew_does_not_have_its_length(tmp_path: Path, parts: int) -> None:
    path = tmp_path / "mesh.bin"
    write_mesh(path, FILES, split_mesh(grid_mesh(5), parts) if parts > 1 else [grid_mesh(5)])
    assert has_its_length(path, FILES)
    data = path.read_bytes()
    for length in range(0, len(data), 3):
        path.write_bytes(data[:length])
        assert not has_its_length(path, FILES)
    path.write_bytes(data + b"x")
    assert not has_its_length(path, FILES)


def test_a_damaged_header_is_an_answer(tmp_path: Path) -> None:
    path = tmp_path / "mesh.bin"
    write_mesh(path, FILES, [grid_mesh(3)])
    data = path.read_bytes()
    for offset in range(200):
        for flipped in (1, 0x80, 0xFF):
            path.write_bytes(data[:offset] + bytes([data[offset] ^ flipped]) + data[offset + 1 :])
            has_its_length(path, FILES)  # raises nothing
