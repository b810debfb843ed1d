"""The stored mesh: bitwise, and damage is found."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mesh_motion_protocol.errors import DataLoss

from mesh_motion_server.session.journal.filesystem import PosixFileSystem
from mesh_motion_server.session.journal.mesh_store import has_its_length, read_mesh, write_mesh
from tests.faults.stand_in import grid_mesh, split_mesh

FILES = PosixFileSystem()


def test_facets_and_near_cells_are_read_back(tmp_path: Path) -> None:
    kept = {"triangle": np.empty((7, 0), dtype=np.int64)}
    facets = {"line": np.arange(12).reshape(-1, 2), "quad": np.arange(8).reshape(-1, 4)}
    near = {"triangle": np.arange(15).reshape(-1, 3), "quad": np.arange(4).reshape(-1, 4)}
    path, mesh = tmp_path / "mesh.bin", replace(grid_mesh(3), cells=kept, facets=facets, near=near)
    (read,) = read_mesh(path, FILES, write_mesh(path, FILES, [mesh]))
    assert has_its_length(path, FILES)
    for found, given in ((read.facets, facets), (read.near, near)):
        assert list(found) == list(given)
        for name, rows in given.items():
            np.testing.assert_array_equal(found[name], rows)
    assert len(read.cells["triangle"]) == 7


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
