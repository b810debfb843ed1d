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


@pytest.mark.parametrize("thin", [1, 2])
def test_of_two_axes_without_motion_the_shorter_one_is_cut(thin: int) -> None:
    """One layer of cells is shown in its plane."""
    shape = np.where(np.arange(3) == thin, 0.1, 1.0)
    before, after = (replace(mesh, points=mesh.points * shape) for mesh in snapshots("hexahedron"))
    for rounding in (0.0, 1e-9):
        noisy = replace(after, points=after.points + rounding * np.array([0.0, thin == 1, thin == 2]))
        assert choose_plane(before, noisy).axis == thin


@pytest.mark.parametrize("stretch", [5.0, 20.0])
@pytest.mark.parametrize("width", [90.0, 190.0])
def test_a_long_mesh_takes_the_width_of_its_page(stretch: float, width: float) -> None:
    pair = MeshPair("long", "size-skew", *snapshots("quad"), ("at opening", "after step 1"))
    long = [replace(mesh, points=mesh.points[:, ::-1] * [stretch, 1.0]) for mesh in (pair.before, pair.after)]
    page = Page(width)
    with styled(page):
        figure = draw_before_after(replace(pair, before=long[0], after=long[1]), page)
        figure.draw_without_rendering()
    places = [axes.get_position() for axes in figure.axes[:4]]
    for mesh, close_up in ((places[0], places[2]), (places[1], places[3])):
        assert mesh.width > 0.7
        assert close_up.width > 0.25


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


def test_nodes_that_move_at_one_place_have_a_picture() -> None:
    before, after = snapshots("quad")
    one = np.arange(len(before.points)) == 0
    resting = replace(after, points=before.points, moving=one)
    pair = MeshPair("one", "size-skew", replace(before, moving=one), resting, ("before", "after"))
    low, high = choose_window(pair.before, pair.after, None)
    assert (high > low).all()
    page = Page(190.0)
    with styled(page):
        draw_before_after(pair, page).draw_without_rendering()
