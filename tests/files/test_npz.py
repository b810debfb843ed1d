import zipfile
from pathlib import Path

import numpy as np
import pytest
from mesh_files import one_line
from mesh_motion_protocol.errors import InvalidInput

from mesh_motion_server.files import read_mesh, write_npz
from mesh_motion_server.files.npz import read_points

POINTS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
TRIANGLE = np.array([[0, 1, 2]])


def archive(path: Path, **arrays: object) -> Path:
    np.savez(path, **arrays)  # type: ignore[arg-type]
    return path


def test_round_trip_is_bitwise(tmp_path: Path, all_solids: tuple[np.ndarray, dict[str, np.ndarray]]) -> None:
    points, cells = all_solids
    points = points + np.random.default_rng(0).normal(size=points.shape) * 1e-3
    path = tmp_path / "mesh.npz"
    arrays = {f"cells_{name}": nodes for name, nodes in cells.items()}
    mesh = read_mesh(archive(path, points=points, **arrays, **{"patch_a b/ü": np.array([3, 1, 3])}))
    assert list(mesh.patches) == ["a b/ü"]
    np.testing.assert_array_equal(mesh.patches["a b/ü"], [1, 3])
    write_npz(tmp_path / "again.npz", mesh)
    again = read_mesh(tmp_path / "again.npz")
    np.testing.assert_array_equal(again.points, points)
    for name, nodes in cells.items():
        np.testing.assert_array_equal(again.cells[name], nodes)
    assert sorted(f.name for f in tmp_path.iterdir()) == ["again.npz", "mesh.npz"]


def test_narrow_numbers_are_widened(tmp_path: Path) -> None:
    mesh = read_mesh(
        archive(tmp_path / "m.npz", points=POINTS.astype(np.float32), cells_triangle=TRIANGLE.astype(np.uint16))
    )
    assert mesh.points.dtype == np.float64
    assert mesh.cells["triangle"].dtype == np.int64


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"points": POINTS}, "no cells"),
        ({"cells_triangle": TRIANGLE}, "expected 'points'"),
        ({}, "got nothing"),
        ({"points": POINTS, "cells_triangle": TRIANGLE, "patches_wall": TRIANGLE[0]}, "'patches_wall'"),
        ({"points": POINTS, "cells_triangle": np.empty((0, 3), int)}, "no cells"),
        ({"points": np.empty((0, 2)), "cells_triangle": TRIANGLE}, "the mesh is empty"),
        ({"points": POINTS * np.nan, "cells_triangle": TRIANGLE}, "node 0 has x = nan"),
        (
            {"points": POINTS + np.array([[0, 0], [0, np.inf], [0, 0]]), "cells_triangle": TRIANGLE},
            "node 1 has y = inf",
        ),
        ({"points": POINTS * 1j, "cells_triangle": TRIANGLE}, "real numbers, got dtype complex128"),
        ({"points": POINTS[:, 0], "cells_triangle": TRIANGLE}, r"shape \(n, 1 \| 2 \| 3\), got \(3,\)"),
        ({"points": np.pad(POINTS, ((0, 0), (0, 1))), "cells_triangle": TRIANGLE}, "2D cells, but points with 3"),
        ({"points": POINTS, "cells_triangle": TRIANGLE * 1.0}, "integers, got dtype float64"),
        ({"points": POINTS, "cells_triangle": TRIANGLE + 1}, "row 0 names node 3"),
        ({"points": POINTS, "cells_triangle": TRIANGLE - 1}, "row 0 names node -1"),
        ({"points": POINTS, "cells_triangle": TRIANGLE[:, :2]}, r"\(m, 3\), got \(1, 2\)"),
        ({"points": POINTS, "cells_octagon": TRIANGLE}, "unknown cell type 'octagon'"),
        ({"points": POINTS, "cells_triangle": TRIANGLE, "patch_w": np.array([3])}, "patch 'w': row 0 names node 3"),
        ({"points": POINTS, "cells_triangle": TRIANGLE, "patch_w": TRIANGLE}, r"patch_w: expected shape \(p,\)"),
        ({"points": POINTS, "cells_triangle": TRIANGLE, "cells_line": TRIANGLE[:, :2]}, "different dimension"),
        ({"points": np.array([[None]]), "cells_triangle": TRIANGLE}, "archive of plain arrays"),
    ],
)
def test_wrong_arrays_are_refused_in_one_line(tmp_path: Path, arrays: dict[str, object], message: str) -> None:
    path = archive(tmp_path / "bad.npz", **arrays)
    one_line(path, message)


def test_a_cut_archive_and_a_flipped_byte_are_refused(tmp_path: Path) -> None:
    whole = archive(tmp_path / "whole.npz", points=POINTS, cells_triangle=TRIANGLE).read_bytes()
    damaged = tmp_path / "damaged.npz"
    damaged.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InvalidInput):
        read_mesh(damaged)
    position = whole.index(POINTS.tobytes()) + 16
    damaged.write_bytes(whole[:position] + bytes([whole[position] ^ 1]) + whole[position + 1 :])
    with pytest.raises(InvalidInput, match="CRC"):
        read_mesh(damaged)


@pytest.mark.parametrize("rows", [10**13, 2**62, 10**30])
def test_a_header_of_more_rows_than_any_memory_has_is_refused(tmp_path: Path, rows: int) -> None:
    header = f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({rows}, 2)}}".encode().ljust(117) + b"\n"
    array = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header
    with zipfile.ZipFile(tmp_path / "m.npz", "w") as archive:
        archive.writestr("points.npy", array)
    (tmp_path / "p.npy").write_bytes(array)
    one_line(tmp_path / "m.npz", r"not readable as an \.npz archive")
    with pytest.raises(InvalidInput, match=r"not readable as a \.npy file"):
        read_points(tmp_path / "p.npy", (3, 2))


def test_a_small_file_that_would_fill_the_memory_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mesh_motion_server.files.packages._UNPACKED_BYTES", 1 << 20)
    path = tmp_path / "m.npz"
    np.savez_compressed(path, points=np.zeros((1 << 20, 2)), cells_triangle=TRIANGLE)
    with pytest.raises(InvalidInput, match=r"m\.npz: \d+ bytes that hold 16777\d+ or more, expected at most"):
        read_mesh(path)


def test_a_single_array_is_no_mesh(tmp_path: Path) -> None:
    path = tmp_path / "single.npz"
    with path.open("wb") as file:
        np.save(file, POINTS)
    with pytest.raises(InvalidInput, match="single array"):
        read_mesh(path)
