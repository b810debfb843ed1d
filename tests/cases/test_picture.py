from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mesh_motion_numerics.quality.metrics import cell_quality, reference_sizes
from tiny_meshes import tiny_meshes

from mesh_motion_server.watch.pictures.before_after import MeshPair, draw_before_after
from mesh_motion_server.watch.pictures.page import Page, save, styled
from mesh_motion_server.watch.pictures.snapshot import Snapshot, choose_plane, choose_window

pytest.importorskip("matplotlib")
MESHES = dict(tiny_meshes())


def snapshots(name: str, *, invert: bool = False) -> tuple[Snapshot, Snapshot]:
    """A tiny mesh before and after its lower side moved by 0.1 along the last axis (or far beyond the upper one)."""
    points, cells = MESHES[name]
    sizes = reference_sizes(points, cells)
    moving = np.flatnonzero(points[:, 0] == 0.0)
    moved = points.copy()
    moved[moving, 0] += 3.0 if invert else 0.1

    def snapshot(step: int, at: np.ndarray) -> Snapshot:
        return Snapshot(step, at, cells, cell_quality(at, cells, sizes).metric("size-skew"), moving)

    return snapshot(0, points), snapshot(1, moved)


def draw(path: Path, name: str, *, invert: bool = False) -> None:
    pair, page = (
        MeshPair(name, "size-skew", *snapshots(name, invert=invert), ("at opening", "after step 1")),
        Page(dpi=120),
    )
    with styled(page):
        save(draw_before_after(pair, page), path, page)


@pytest.mark.parametrize(
    ("name", "invert"), [("line", False), ("line", True), ("triangle", True), ("tetra", False), ("hexahedron", True)]
)
def test_every_kind_of_mesh_has_a_picture(name: str, invert: bool, tmp_path: Path) -> None:
    path = tmp_path / "quality.png"
    draw(path, name, invert=invert)
    assert path.read_bytes().startswith(b"\x89PNG")
    assert path.stat().st_size > 5_000


def test_the_same_case_gives_the_same_picture(tmp_path: Path) -> None:
    for name in ("a.png", "b.png"):
        draw(tmp_path / name, "quad")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_a_3d_motion_is_cut_across_the_axis_of_least_motion() -> None:
    before, after = snapshots("tetra")
    plane = choose_plane(before, after)
    assert plane.axis in (1, 2)
    assert choose_plane(*snapshots("quad")) is None


def test_a_small_moving_part_of_a_long_domain_is_shown_alone() -> None:
    before, after = snapshots("quad")
    np.testing.assert_array_equal(choose_window(before, after, None), [[0, 0], [1, 1]])
    stretch = np.array([20.0, 1.0])
    long = [replace(mesh, points=mesh.points * stretch) for mesh in (before, after)]
    long[1] = replace(
        long[1], points=np.where(long[0].points[:, :1] == 0, long[0].points + np.array([0.1, 0.0]), long[0].points)
    )
    low, high = choose_window(long[0], long[1], None)
    assert high[0] - low[0] < 2.0
