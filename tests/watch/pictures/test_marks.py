"""The ring, the close-up and the titles of a picture are about one cell; nothing is drawn past the axes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mesh_motion_numerics.mesh.cells import CellTable

from mesh_motion_server.watch.pictures.before_after import MeshPair, draw_before_after
from mesh_motion_server.watch.pictures.mesh_axes import draw_mesh
from mesh_motion_server.watch.pictures.page import Page, blank, styled
from mesh_motion_server.watch.pictures.runs import METRICS, read_runs
from mesh_motion_server.watch.pictures.snapshot import Snapshot

N = 20
PLACES = np.stack(np.meshgrid(np.arange(N + 1.0), np.arange(N + 1.0), indexing="ij"), axis=-1).reshape(-1, 2)
CORNER = np.array([i * (N + 1) + j for i in range(N) for j in range(N)])
CELLS = CellTable.from_arrays({"quad": np.column_stack([CORNER, CORNER + N + 1, CORNER + N + 2, CORNER + 1])})


def snapshot(worst: int) -> Snapshot:
    quality = np.linspace(0.8, 0.9, N * N)
    quality[worst] = 0.1
    moving = np.flatnonzero((np.abs(PLACES - 10) < 1.5).all(axis=1))
    return Snapshot(0, PLACES, CELLS, quality, moving)


@pytest.mark.parametrize(("worst", "rings"), [(10 * N + 10, 1), (0, 0)])
def test_only_the_worst_cell_of_all_has_a_ring(worst: int, rings: int) -> None:
    page = Page(160.0)
    with styled(page):
        axes = blank(page, 80.0).add_subplot()
        draw_mesh(axes, snapshot(worst), None, "mesh", np.array([[7.0, 7.0], [13.0, 13.0]]), page)
    found = [line for line in axes.lines if line.get_marker() == "o"]
    assert len(found) == rings
    for line in found:
        assert np.ravel(line.get_xydata()) == pytest.approx([10.5, 10.5])


@pytest.mark.parametrize(("worst", "frames"), [(0, 0), (10 * N + 10, 1), (10 * N + 8, 1), (10 * N + 5, 0)])
def test_the_frame_of_the_close_up_stays_in_the_picture_and_has_the_worst_cell_in_it(worst: int, frames: int) -> None:
    page, mesh = Page(160.0), snapshot(worst)
    with styled(page):
        figure = draw_before_after(MeshPair("a", "size-skew", mesh, replace(mesh, step=1), ("0", "1")), page)
    axes = figure.axes[1]
    found = [artist for artist in axes.get_children() if type(artist).__name__ == "InsetIndicator"]
    assert len(found) == frames
    for patch in found:
        x, y, width, height = patch.rectangle.get_bbox().bounds
        assert axes.get_xlim()[0] - 1 <= x <= x + width <= axes.get_xlim()[1] + 1
        assert axes.get_ylim()[0] - 1 <= y <= y + height <= axes.get_ylim()[1] + 1


def test_a_played_run_is_drawn_by_the_default_metric(played) -> None:
    folder: Path = played()
    (run,) = read_runs([folder], "relative-size-skew")
    assert METRICS[0] == run.metric == "relative-size-skew"
    assert np.isfinite(run.columns["actual_min"]).all()
