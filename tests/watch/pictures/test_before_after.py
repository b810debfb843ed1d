"""Meshes before and after: drawn cells, their colours, and marks."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mesh_motion_numerics.mesh.finite_volume import FACE_METRICS, face_measures
from mesh_motion_protocol.errors import InvalidInput
from tiny_meshes import tiny_mesh

from mesh_motion_server.watch.pictures.snapshot import Snapshot

pytest.importorskip("matplotlib")

from mesh_motion_server.watch.pictures import mesh_axes
from mesh_motion_server.watch.pictures.before_after import MeshPair, draw_before_after
from mesh_motion_server.watch.pictures.meshes import pair_of, read_pair
from mesh_motion_server.watch.pictures.page import Page, save, styled
from mesh_motion_server.watch.pictures.runs import read_played
from mesh_motion_server.watch.pictures.slices import flat

MakePlayed = Callable[..., Path]


def drawn(pair: MeshPair, page: Page | None = None) -> tuple[Any, dict[str, Any]]:
    page = page or Page(190.0)
    with styled(page):
        figure = draw_before_after(pair, page)
        figure.draw_without_rendering()
    return figure, {axes.get_title().split()[0]: axes for axes in figure.axes if axes.get_title()}


def cells_of(axes: Any) -> Any:
    return next(each for each in axes.collections if each.get_array() is not None)


def test_both_meshes_are_drawn_in_the_colours_of_their_quality(played: MakePlayed) -> None:
    pair = read_pair(played(mesh="triangle"))
    assert (pair.before.step, pair.after.step, pair.titles[1]) == (0, 3, "after step 3 (the worst)")
    figure, panels = drawn(pair)
    assert list(panels) == ["at", "after", "its"]
    for mesh, axes in ((pair.before, panels["at"]), (pair.after, panels["after"])):
        cells = cells_of(axes)
        np.testing.assert_allclose(cells.get_array(), np.clip(mesh.quality, 0, 1))
        assert len(cells.get_paths()) == len(mesh.cells)
        assert axes.get_title().endswith(f"minimum {mesh.quality.min():.3f}")
    assert figure.axes[-1].get_xlabel() == "size-skew of a cell"
    assert figure.get_suptitle() == "flag"


@pytest.mark.parametrize("mesh", ["triangle", "hexahedron"])
@pytest.mark.parametrize("metric", FACE_METRICS)
def test_cells_have_the_colours_of_their_worst_face(played: MakePlayed, mesh: str, metric: str) -> None:
    pair = read_pair(played(mesh=mesh), metric)
    faces = face_measures(pair.after.points, pair.after.cells)
    assert faces is not None
    largest = faces.max_non_orthogonality if metric == "non-orthogonality" else faces.max_skewness
    assert pair.after.quality[pair.after.worst] == pair.after.quality.max() == largest
    if metric == "non-orthogonality":
        assert pair.after.worst in faces.worst[0].cells
    figure, panels = drawn(pair, Page(90.0))
    assert f"maximum {largest:.3f}" in panels["after"].get_title()
    assert figure.axes[-1].get_xlabel() == f"{metric} of a cell"
    line = next(line for line in panels["cells"].get_lines() if line.get_label().startswith("after"))
    np.testing.assert_allclose(line.get_xdata(), -np.sort(-pair.after.quality))


def test_the_close_up_outlines_the_worst_cell(played: MakePlayed) -> None:
    pair = read_pair(played(mesh="quad"))
    _, panels = drawn(pair)
    block, row = pair.after.cells.locate(pair.after.worst)
    outline = panels["its"].collections[-1].get_paths()[0].vertices[:4]
    np.testing.assert_allclose(np.sort(outline, axis=0), np.sort(pair.after.points[block.nodes[row]], axis=0))


def test_a_narrow_page_has_the_distribution_too(played: MakePlayed) -> None:
    pair = read_pair(played(mesh="triangle"))
    _, panels = drawn(pair, Page(90.0))
    after = next(line for line in panels["cells"].get_lines() if line.get_label().startswith("after"))
    np.testing.assert_allclose(after.get_xdata(), np.sort(pair.after.quality))


def test_other_steps_are_drawn_on_demand(played: MakePlayed) -> None:
    pair = read_pair(played(mesh="triangle"), first=2, last=5)
    assert (pair.before.step, pair.after.step) == (2, 5)
    assert pair.titles == ("after step 2", "after step 5")
    assert pair.after.points[:, 0].min() == pytest.approx(-0.1)


def test_a_step_that_was_not_written_is_reported(played: MakePlayed) -> None:
    with pytest.raises(InvalidInput, match="has no step 40; it has 0, 1, 2"):
        read_pair(played(mesh="triangle"), last=40)


def test_inverted_cells_are_pink_and_the_bar_says_so(played: MakePlayed) -> None:
    pair = read_pair(played(mesh="triangle"))
    moved = pair.before.points.copy()
    moved[pair.before.moving, 0] += 3.0
    before, after = pair_of(
        pair.before.points, pair.before.cells, pair.before.points, moved, steps=(0, 1), metric="size-skew"
    )
    figure, panels = drawn(replace(pair, before=before, after=after))
    assert figure.axes[-1].get_xlabel() == "size-skew of a cell (pink: inverted)"
    pink = [each for each in panels["after"].collections if each.get_array() is None and len(each.get_paths())]
    assert len(pink[0].get_paths()) == int((after.quality <= 0).sum())


def test_enrichment_points_are_marked(played: MakePlayed) -> None:
    pair = replace(read_pair(played(mesh="triangle")), enrichment_points=np.array([[0.2, 0.3], [0.4, 0.5]]))
    _, panels = drawn(pair)
    (marks,) = [line for line in panels["after"].get_lines() if line.get_label() == "enrichment points"]
    np.testing.assert_array_equal(marks.get_xydata(), pair.enrichment_points)


def test_a_cell_that_is_inverted_is_so_in_every_metric() -> None:
    """The skew of a mirrored cell is that of its mirror image."""
    points, cells = tiny_mesh("triangle")
    mirrored = points * [-1.0, 1.0]
    before, after = pair_of(points, cells, points, mirrored, steps=(0, 1), metric="skew")
    assert after.quality.min() > 0.0
    assert after.inverted.all()
    assert not before.inverted.any()
    (colours,) = (c for c in drawn_polygons(after) if c.get_array() is None)
    assert len(colours.get_paths()) == len(cells)


def drawn_polygons(mesh: Snapshot) -> list[Any]:
    """The collections that draw a mesh; that of inverted cells has no array of values."""
    from matplotlib.figure import Figure  # noqa: PLC0415

    axes = Figure().subplots()
    mesh_axes.draw_polygons(axes, flat(mesh.points, mesh.cells), mesh, Page())
    return list(axes.collections)


def test_a_3d_mesh_has_its_picture(played: MakePlayed, tmp_path: Path) -> None:
    pair = read_pair(played(mesh="hexahedron"))
    pair = replace(pair, enrichment_points=np.array([[0.2, 0.3, 0.4]]))
    figure, panels = drawn(pair)
    assert panels["its"].get_title().startswith("its worst cell, ")
    assert "1 enrichment points" in [text.get_text() for text in panels["after"].texts]
    with styled(Page()):
        save(figure, tmp_path / "a.pdf", Page())


def test_titles_of_tall_meshes_in_space_do_not_lie_over_each_other(played: MakePlayed) -> None:
    pair = read_pair(played(mesh="hexahedron"))
    before, after = (replace(mesh, points=mesh.points * [1.0, 2.0, 0.5]) for mesh in (pair.before, pair.after))
    panels = drawn(replace(pair, before=before, after=after), Page(135.0))[1]
    boxes = [panels[name].title.get_window_extent() for name in ("at", "after", "its")]
    assert "cut at" in panels["at"].get_title()
    assert boxes[0].x0 >= 0.0
    assert all(left.x1 < right.x0 for left, right in pairwise(boxes))


def test_the_history_stands_below(played: MakePlayed) -> None:
    folder = played(mesh="triangle")
    with styled(Page(190.0)):
        figure = draw_before_after(read_pair(folder), Page(190.0), run=read_played(folder))
        figure.draw_without_rendering()
    lower = next(axes for axes in figure.axes if axes.get_xlabel() == "step")
    assert lower.get_position().y1 < figure.axes[0].get_position().y0
    assert [line.get_label() for line in lower.get_lines()][-2:] == ["minimum", "threshold"]


def test_large_meshes_are_pixels_in_vector_files(played: MakePlayed, monkeypatch: pytest.MonkeyPatch) -> None:
    pair = read_pair(played(mesh="triangle"))
    assert not cells_of(drawn(pair)[1]["after"]).get_rasterized()
    monkeypatch.setattr(mesh_axes, "RASTER_ABOVE", 10)
    assert cells_of(drawn(pair)[1]["after"]).get_rasterized()


def test_a_line_has_no_picture(played: MakePlayed) -> None:
    with pytest.raises(InvalidInput, match="one dimension"):
        read_pair(played(mesh="line"))


def test_a_folder_without_a_series_is_reported(played: MakePlayed) -> None:
    with pytest.raises(InvalidInput, match=r"mesh\.pvd: not readable"):
        read_pair(played())
